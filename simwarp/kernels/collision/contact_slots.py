"""The contact slots of one world: new contacts go in with the impulses of those that they continue."""

import warp as wp

from simwarp.kernels.collision.placement import CollisionScratch
from simwarp.kernels.core.face_tables import has_face_code
from simwarp.kernels.core.fields import ContactArrays, StateArrays
from simwarp.kernels.core.tables import Topology
from simwarp.kernels.core.vector_math import contact_frame, to_float

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class ContactProgress:
    """Slots in use, cached contacts passed, and the deepest penetration so far [m]."""

    count: int
    cursor: int
    deepest: float


@wp.func
def keep_last_contacts(
    world: int, scratch_slot: int, topology: Topology, contacts: ContactArrays, scratch: CollisionScratch
) -> int:  # fmt: skip
    """Copies the last step's contacts aside, impulses in world axes; returns how many."""
    count = contacts.contact_count[world]
    for contact in range(count):
        frame = contact_frame(contacts.contact_normal_w[world, contact])
        scratch.shape0[scratch_slot, contact] = contacts.contact_shape0[world, contact]
        scratch.shape1[scratch_slot, contact] = contacts.contact_shape1[world, contact]
        scratch.feature[scratch_slot, contact] = contacts.contact_feature[world, contact]
        scratch.arm1[scratch_slot, contact] = contacts.contact_arm1[world, contact]
        if has_face_code():
            if topology.face_count > 0:
                scratch.face[scratch_slot, contact] = contacts.contact_face[world, contact]
        scratch.impulse_w[scratch_slot, contact] = contacts.contact_impulse[world, contact] * frame
        m = contacts.contact_moment[world, contact]
        scratch.moment_w[scratch_slot, contact] = wp.vec3(m[2], m[0], m[1]) * frame
    return count


@wp.func
def free_slot(world: int, count: int, gap: float, topology: Topology, contacts: ContactArrays) -> int:
    """The slot of a new contact: the next one, or, when all are taken, the last, once the shallowest contact has made
    room; -1 if the new one is the shallowest.
    """
    capacity = contacts.contact_gap.shape[1]
    if count < capacity:
        return count
    contacts.contact_overflow[world] = contacts.contact_overflow[world] + 1
    worst = int(-1)
    worst_gap = float(gap)
    for contact in range(capacity):
        if contacts.contact_gap[world, contact] > worst_gap:
            worst_gap = contacts.contact_gap[world, contact]
            worst = contact
    if worst < 0:
        return -1
    for contact in range(worst, capacity - 1):
        contacts.contact_shape0[world, contact] = contacts.contact_shape0[world, contact + 1]
        contacts.contact_shape1[world, contact] = contacts.contact_shape1[world, contact + 1]
        contacts.contact_feature[world, contact] = contacts.contact_feature[world, contact + 1]
        contacts.contact_normal_w[world, contact] = contacts.contact_normal_w[world, contact + 1]
        contacts.contact_gap[world, contact] = contacts.contact_gap[world, contact + 1]
        contacts.contact_arm0[world, contact] = contacts.contact_arm0[world, contact + 1]
        contacts.contact_arm1[world, contact] = contacts.contact_arm1[world, contact + 1]
        contacts.contact_impulse[world, contact] = contacts.contact_impulse[world, contact + 1]
        contacts.contact_moment[world, contact] = contacts.contact_moment[world, contact + 1]
        if has_face_code():
            if topology.face_count > 0:
                contacts.contact_face[world, contact] = contacts.contact_face[world, contact + 1]
                contacts.contact_weights[world, contact] = contacts.contact_weights[world, contact + 1]
    return capacity - 1


@wp.func
def body_arm(shape: int, world: int, point: wp.vec3d, topology: Topology, state: StateArrays) -> wp.vec3:
    """From the centre of mass of a shape's body (the world's origin) to a point."""
    body = topology.shape_body[shape]
    if body < 0:
        return to_float(point)
    return to_float(point - state.body_x[world, body])


@wp.func
def match_contacts(
    world: int, scratch_slot: int, shape0: int, shape1: int, face: int, first: int, end: int, cached: int,
    cursor: int, topology: Topology, contacts: ContactArrays, scratch: CollisionScratch,
):  # fmt: skip
    """Hands the impulses of a pair's last contacts on: each to the new contact of the same feature, or to the nearest,
    so that what the pair carried as a whole is kept when its points change. `face` of a mesh: of those on it, -1: of
    those on none.
    """
    old = int(cursor)
    while old < cached and scratch.shape0[scratch_slot, old] == shape0 and scratch.shape1[scratch_slot, old] == shape1:
        matched = int(-1)
        nearest = float(1.0e30)
        last = int(end)
        if has_face_code():
            if topology.face_count > 0:
                if scratch.face[scratch_slot, old] != face:
                    last = first
        for slot in range(first, last):
            apart = wp.length_sq(contacts.contact_arm1[world, slot] - scratch.arm1[scratch_slot, old])
            if contacts.contact_feature[world, slot] == scratch.feature[scratch_slot, old]:
                apart = -1.0
            if apart < nearest:
                nearest = apart
                matched = slot
        if matched >= 0:
            frame = contact_frame(contacts.contact_normal_w[world, matched])
            m = frame * scratch.moment_w[scratch_slot, old]
            contacts.contact_impulse[world, matched] = (
                contacts.contact_impulse[world, matched] + frame * scratch.impulse_w[scratch_slot, old]
            )
            contacts.contact_moment[world, matched] = contacts.contact_moment[world, matched] + wp.vec3(
                m[1], m[2], m[0]
            )
        old += 1


@wp.func
def skip_contacts(
    scratch_slot: int, shape0: int, shape1: int, cursor: int, cached: int, scratch: CollisionScratch
) -> int:
    """The first of the last step's contacts from `cursor` on that is of this pair or of a later one."""
    now = int(cursor)
    while now < cached and (
        scratch.shape0[scratch_slot, now] < shape0
        or (scratch.shape0[scratch_slot, now] == shape0 and scratch.shape1[scratch_slot, now] < shape1)
    ):
        now += 1
    return now


@wp.func
def keep_pair(
    world: int, scratch_slot: int, shape0: int, shape1: int, face: int, found: int, origin: wp.vec3d, slots: int,
    cached: int, cursor: int, topology: Topology, state: StateArrays, contacts: ContactArrays,
    scratch: CollisionScratch,
) -> int:  # fmt: skip
    """Writes the `found` contacts of a pair, or of a `face` of it, with their warm starts; returns the slots in use.

    `cursor` is the first cached contact of this pair or of a later one.
    """
    count = int(slots)
    for k in range(found):
        gap = scratch.pair_gap[scratch_slot, k]
        slot = free_slot(world, count, gap, topology, contacts)
        if slot >= 0:
            count = wp.max(count, slot + 1)
            normal = scratch.pair_normal[scratch_slot, k]
            feature = scratch.pair_feature[scratch_slot, k]
            point0 = scratch.pair_point[scratch_slot, k]
            point1 = point0 + gap * normal
            contacts.contact_shape0[world, slot] = shape0
            contacts.contact_shape1[world, slot] = shape1
            contacts.contact_feature[world, slot] = feature
            contacts.contact_normal_w[world, slot] = normal
            contacts.contact_gap[world, slot] = gap
            at0 = origin + wp.vec3d(wp.float64(point0[0]), wp.float64(point0[1]), wp.float64(point0[2]))
            at1 = origin + wp.vec3d(wp.float64(point1[0]), wp.float64(point1[1]), wp.float64(point1[2]))
            contacts.contact_arm0[world, slot] = body_arm(shape0, world, at0, topology, state)
            contacts.contact_arm1[world, slot] = body_arm(shape1, world, at1, topology, state)
            contacts.contact_impulse[world, slot] = wp.vec3()
            contacts.contact_moment[world, slot] = wp.vec3()
            if has_face_code():
                if topology.face_count > 0:
                    contacts.contact_face[world, slot] = face
                    contacts.contact_weights[world, slot] = scratch.pair_weights[scratch_slot, k]
    match_contacts(world, scratch_slot, shape0, shape1, face, slots, count, cached, cursor, topology, contacts, scratch)
    return count
