"""Collision of one world: places its shapes, goes through the pairs, keeps the contacts and their warm starts.

Contacts come in the order of the pairs of shapes, so that slots are deterministic and the cache of the last step is
read in step with them.
"""

import dataclasses
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout, ShapeType, WorldStatus
from simwarp.kernels.collision.broad import Grid, GridScratch, candidates, fill_grid
from simwarp.kernels.collision.pair import pair_contacts
from simwarp.kernels.collision.shape import Assets, Manifold, ManifoldScratch, Shape
from simwarp.kernels.collision.support import Bounds, core_radius, inner_point, shape_bounds
from simwarp.kernels.collision.surfaces import (
    TriangleSurface,
    is_triangle_surface,
    triangle_surface_bounds,
    triangle_surface_of,
)
from simwarp.kernels.collision.triangles import RawContacts, RawContactScratch
from simwarp.kernels.core.fields import ContactArrays, Parameters, StateArrays
from simwarp.kernels.core.scratch import (
    ScratchGroup,
    make_memory,
    memory_layouts,
    memory_struct,
    scratch_array,
    slot_function,
)
from simwarp.kernels.core.spatial import contact_frame, matrix_to_float, to_float
from simwarp.kernels.core.tables import StepConfig, Topology, world_row
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

HULL = wp.constant(int(ShapeType.HULL))
PLANE = wp.constant(int(ShapeType.PLANE))
NON_FINITE = wp.constant(int(WorldStatus.NON_FINITE))


class ShapeScratch(ScratchGroup, packed=False):
    """Placed shapes and the last step's contacts of one world."""

    x = scratch_array(wp.vec3d, "shapes")
    rot = scratch_array(wp.mat33, "shapes")
    lower = scratch_array(wp.vec3, "shapes")  # bounds relative to x, world axes
    upper = scratch_array(wp.vec3, "shapes")
    velocity = scratch_array(wp.vec3, "shapes")
    sweep = scratch_array(wp.float32, "shapes")  # speed that rotation adds to the surface [m/s]

    shape0 = scratch_array(wp.int32, "contacts")  # of the last step
    shape1 = scratch_array(wp.int32, "contacts")
    feature = scratch_array(wp.int32, "contacts")
    arm1 = scratch_array(wp.vec3, "contacts")
    impulse_w = scratch_array(wp.vec3, "contacts")
    moment_w = scratch_array(wp.vec3, "contacts")


GROUPS = (ShapeScratch, GridScratch, ManifoldScratch, RawContactScratch)
CollisionScratch = memory_struct("CollisionScratch", __name__, GROUPS)
pack_grid = slot_function("pack_grid", __name__, GridScratch, Grid, CollisionScratch)
pack_manifold = slot_function("pack_manifold", __name__, ManifoldScratch, Manifold, CollisionScratch)
pack_raw = slot_function("pack_raw", __name__, RawContactScratch, RawContacts, CollisionScratch)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CollisionSizes:
    """Lengths of the scratch of one world; `buckets` of the grid, 0 without one."""

    shapes: int
    contacts: int
    buckets: int

    @property
    def in_grid(self) -> int:
        """Shapes in the grid."""
        return self.shapes if self.buckets else 0

    @property
    def bucket_ends(self) -> int:
        """Buckets, and their end."""
        return self.buckets + 1


def collision_layouts(slots: int, sizes: CollisionSizes) -> dict[str, ArrayLayout]:
    """The arrays of the scratch."""
    return memory_layouts(GROUPS, slots, sizes)


def make_collision_scratch(device: wp.Device, slots: int, sizes: CollisionSizes) -> Any:
    """Allocates the scratch."""
    return make_memory(CollisionScratch, collision_layouts(slots, sizes), device)


@wp.func
def placed(
    shape: int, world: int, origin: wp.vec3d, scratch_slot: int, topology: Topology, parameters: Parameters,
    scratch: CollisionScratch,
) -> Shape:  # fmt: skip
    """The shape relative to an origin. A plane is moved along itself to the origin's foot, so that it stays near."""
    s = Shape()
    s.kind = topology.shape_type[shape]
    s.rot = scratch.rot[scratch_slot, shape]
    offset = scratch.x[scratch_slot, shape] - origin
    if s.kind == PLANE:
        n = wp.vec3d(wp.float64(s.rot[0, 2]), wp.float64(s.rot[1, 2]), wp.float64(s.rot[2, 2]))
        offset = n * (wp.dot(n, offset) / wp.dot(n, n))
    s.x = to_float(offset)
    s.size = parameters.shape_size[world_row(world, parameters.shape_size.shape[0]), shape]
    s.margin = parameters.shape_margin[world_row(world, parameters.shape_margin.shape[0]), shape]
    s.asset = parameters.shape_asset[world_row(world, parameters.shape_asset.shape[0]), shape]
    return s


@wp.func
def bounds_of(s: Shape, assets: Assets) -> Bounds:
    """Bounds of any shape."""
    b = Bounds()
    if is_triangle_surface(s.kind):
        b = triangle_surface_bounds(s, assets)
    else:
        b = shape_bounds(s, assets)
    return b


@wp.func
def place_shapes(
    world: int, scratch_slot: int, topology: Topology, parameters: Parameters, state: StateArrays, assets: Assets,
    scratch: CollisionScratch,
):  # fmt: skip
    """Poses, bounds and speeds of all shapes."""
    for shape in range(topology.shape_count):
        body = topology.shape_body[shape]
        x = parameters.shape_x[world_row(world, parameters.shape_x.shape[0]), shape]
        rot = wp.quat_to_matrix(parameters.shape_rot[world_row(world, parameters.shape_rot.shape[0]), shape])
        velocity = wp.vec3()
        omega = wp.vec3()
        if body >= 0:
            q = state.body_rot[world, body]
            arm = wp.quat_rotate(q, x)
            x = state.body_x[world, body] + arm
            rot = matrix_to_float(wp.quat_to_matrix(q)) * rot
            omega = state.body_omega[world, body]
            velocity = state.body_v[world, body] + wp.cross(omega, to_float(arm))
        scratch.x[scratch_slot, shape] = x
        scratch.rot[scratch_slot, shape] = rot
        scratch.velocity[scratch_slot, shape] = velocity
        geometry = placed(shape, world, x, scratch_slot, topology, parameters, scratch)
        bounds = Bounds()
        if body < 0 and geometry.kind == HULL:
            # a scene of many rocks: a ball about each costs one look, the exact box one for each of its corners
            r = core_radius(geometry, assets) + geometry.margin
            centre = inner_point(geometry, assets)
            bounds.lower = centre - wp.vec3(r, r, r)
            bounds.upper = centre + wp.vec3(r, r, r)
        else:
            bounds = bounds_of(geometry, assets)
        scratch.lower[scratch_slot, shape] = bounds.lower
        scratch.upper[scratch_slot, shape] = bounds.upper
        sweep = float(0.0)
        if body >= 0:
            sweep = wp.length(omega) * wp.length(wp.max(wp.abs(bounds.lower), wp.abs(bounds.upper)))
        scratch.sweep[scratch_slot, shape] = sweep


@wp.func
def keep_last_contacts(world: int, scratch_slot: int, contacts: ContactArrays, scratch: CollisionScratch) -> int:
    """Copies the last step's contacts aside, impulses in world axes; returns how many."""
    count = contacts.contact_count[world]
    for contact in range(count):
        frame = contact_frame(contacts.contact_normal_w[world, contact])
        scratch.shape0[scratch_slot, contact] = contacts.contact_shape0[world, contact]
        scratch.shape1[scratch_slot, contact] = contacts.contact_shape1[world, contact]
        scratch.feature[scratch_slot, contact] = contacts.contact_feature[world, contact]
        scratch.arm1[scratch_slot, contact] = contacts.contact_arm1[world, contact]
        scratch.impulse_w[scratch_slot, contact] = contacts.contact_impulse[world, contact] * frame
        m = contacts.contact_moment[world, contact]
        scratch.moment_w[scratch_slot, contact] = wp.vec3(m[2], m[0], m[1]) * frame
    return count


@wp.func
def free_slot(world: int, count: int, gap: float, contacts: ContactArrays) -> int:
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
    world: int, scratch_slot: int, shape0: int, shape1: int, first: int, end: int, cached: int, cursor: int,
    contacts: ContactArrays, scratch: CollisionScratch,
):  # fmt: skip
    """Hands the impulses of a pair's last contacts on: each to the new contact of the same feature, or to the nearest,
    so that what the pair carried as a whole is kept when its points change.
    """
    old = int(cursor)
    while old < cached and scratch.shape0[scratch_slot, old] == shape0 and scratch.shape1[scratch_slot, old] == shape1:
        matched = int(-1)
        nearest = float(1.0e30)
        for slot in range(first, end):
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
def keep_pair(
    world: int, scratch_slot: int, shape0: int, shape1: int, found: int, origin: wp.vec3d, slots: int, cached: int,
    cursor: int, topology: Topology, state: StateArrays, contacts: ContactArrays, scratch: CollisionScratch,
) -> int:  # fmt: skip
    """Writes the `found` contacts of a pair with their warm starts; returns the slots in use.

    `cursor` is the first cached contact of this pair or of a later one.
    """
    count = int(slots)
    for k in range(found):
        gap = scratch.pair_gap[scratch_slot, k]
        slot = free_slot(world, count, gap, contacts)
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
    match_contacts(world, scratch_slot, shape0, shape1, slots, count, cached, cursor, contacts, scratch)
    return count


@wp.func
def may_touch(scratch_slot: int, shape0: int, shape1: int, reach: float, scratch: CollisionScratch) -> bool:
    """True if the bounds of two shapes come within reach."""
    d = to_float(scratch.x[scratch_slot, shape1] - scratch.x[scratch_slot, shape0])
    lower = d + scratch.lower[scratch_slot, shape1] - scratch.upper[scratch_slot, shape0]
    upper = scratch.lower[scratch_slot, shape0] - d - scratch.upper[scratch_slot, shape1]
    return wp.max(wp.max(lower), wp.max(upper)) < reach


@wp.struct
class ContactProgress:
    """Slots in use, cached contacts passed, and the deepest penetration so far [m]."""

    count: int
    cursor: int
    deepest: float


@wp.func
def collide_pair(
    world: int, scratch_slot: int, shape0: int, shape1: int, reach: float, cached: int, progress: ContactProgress,
    topology: Topology, parameters: Parameters, assets: Assets, state: StateArrays, contacts: ContactArrays,
    scratch: CollisionScratch,
) -> ContactProgress:  # fmt: skip
    """The contacts of one pair of shapes."""
    now = progress
    ground = int(-1)
    convex = int(-1)
    origin = scratch.x[scratch_slot, shape0]
    if topology.shape_body[shape0] < 0:
        origin = scratch.x[scratch_slot, shape1]
    if is_triangle_surface(topology.shape_type[shape0]):
        ground = shape0
        convex = shape1
    elif is_triangle_surface(topology.shape_type[shape1]):
        ground = shape1
        convex = shape0
    if ground >= 0:
        origin = scratch.x[scratch_slot, convex]
    a = placed(shape0, world, origin, scratch_slot, topology, parameters, scratch)
    b = placed(shape1, world, origin, scratch_slot, topology, parameters, scratch)
    flip = int(0)
    if ground == shape1:
        swap = a
        a = b
        b = swap
        flip = 1
    g = TriangleSurface()
    g.kind = -1
    if ground >= 0:
        offset = scratch.x[scratch_slot, ground] - origin
        g = triangle_surface_of(
            a, offset, scratch.lower[scratch_slot, convex], scratch.upper[scratch_slot, convex], reach
        )
    found = pair_contacts(
        a, b, g, flip, reach, assets, pack_manifold(scratch, scratch_slot), pack_raw(scratch, scratch_slot)
    )
    if found > 0:
        while now.cursor < cached and (
            scratch.shape0[scratch_slot, now.cursor] < shape0
            or (
                scratch.shape0[scratch_slot, now.cursor] == shape0 and scratch.shape1[scratch_slot, now.cursor] < shape1
            )
        ):
            now.cursor = now.cursor + 1
        now.count = keep_pair(
            world, scratch_slot, shape0, shape1, found, origin, now.count, cached, now.cursor, topology, state,
            contacts, scratch,
        )  # fmt: skip
        for k in range(found):
            now.deepest = wp.max(now.deepest, -scratch.pair_gap[scratch_slot, k])
    return now


@wp.func
def collide_world(
    world: int, scratch_slot: int, config: StepConfig, topology: Topology, parameters: Parameters, assets: Assets,
    state: StateArrays, contacts: ContactArrays, scratch: CollisionScratch, grid: Grid,
):  # fmt: skip
    """The contacts of one world at its present poses, warm-started from the last ones."""
    cached = keep_last_contacts(world, scratch_slot, contacts, scratch)
    place_shapes(world, scratch_slot, topology, parameters, state, assets, scratch)
    contacts.contact_overflow[world] = 0
    gravity = parameters.gravity[world_row(world, parameters.gravity.shape[0])]
    near = config.contact_margin + wp.length(gravity) * config.dt * config.dt
    we = world_row(world, parameters.shape_enabled.shape[0])
    if topology.grid_buckets > 0:
        fastest = float(0.0)
        for shape in range(topology.shape_count):
            fastest = wp.max(
                fastest, wp.length(scratch.velocity[scratch_slot, shape]) + scratch.sweep[scratch_slot, shape]
            )
        fill_grid(
            near + config.dt * fastest,
            topology,
            scratch.x[scratch_slot],
            scratch.lower[scratch_slot],
            scratch.upper[scratch_slot],
            grid,
        )
    progress = ContactProgress()
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            approach = (
                wp.length(scratch.velocity[scratch_slot, shape1] - scratch.velocity[scratch_slot, shape0])
                + scratch.sweep[scratch_slot, shape0]
                + scratch.sweep[scratch_slot, shape1]
            )
            reach = near + config.dt * approach
            enabled = parameters.shape_enabled[we, shape0] * parameters.shape_enabled[we, shape1]
            if enabled != 0 and may_touch(scratch_slot, shape0, shape1, reach, scratch):
                progress = collide_pair(
                    world, scratch_slot, shape0, shape1, reach, cached, progress, topology, parameters, assets, state,
                    contacts, scratch,
                )  # fmt: skip
    contacts.contact_count[world] = progress.count
    contacts.penetration[world] = progress.deepest


@wp.kernel(enable_backward=False)
def collide_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    scratch: CollisionScratch,
    # in and out
    contacts: ContactArrays,
):
    """Finds the contacts of all worlds that are not frozen."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    collide_world(
        world,
        scratch_slot,
        config,
        topology,
        parameters,
        assets,
        state,
        contacts,
        scratch,
        pack_grid(scratch, scratch_slot),
    )
