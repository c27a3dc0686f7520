"""Contacts as blocks of the cone problem: material laws, right-hand sides, responses, and the forces afterwards.

The rows of a contact are the relative velocity of its two points along the normal and two tangents; with rolling or
spinning friction, the relative angular velocity about the tangents and the normal follows.
"""

import warp as wp

from simwarp.core.types import FrictionLaw, FrictionRule
from simwarp.kernels.cones.problem import BOX, CONTACT, ROLLING, ConeProblem
from simwarp.kernels.core.face_tables import face_of, face_side, has_face_code
from simwarp.kernels.core.fields import ContactArrays, Parameters
from simwarp.kernels.core.tables import StepConfig, StepProgress, Topology, Work, given_pair, world_row
from simwarp.kernels.core.vector_math import contact_frame
from simwarp.kernels.dynamics.bilateral_rows import link_of
from simwarp.kernels.dynamics.cone_rows import Wrenches, loop_share, walk_rows
from simwarp.kernels.dynamics.contact_points import (
    add_face_force,
    cross_matrix,
    face_velocity,
    leave_at_corners,
    point_velocity,
)
from simwarp.kernels.dynamics.recovery import recovery_speed

wp.set_module_options({"enable_backward": False})

CONVEX = wp.constant(int(FrictionLaw.CONVEX))
SMALLER = wp.constant(int(FrictionRule.MIN))
LARGER = wp.constant(int(FrictionRule.MAX))
MEAN = wp.constant(int(FrictionRule.MEAN))
PRODUCT = wp.constant(int(FrictionRule.PRODUCT))
FREE_MOBILITY = wp.constant(1.0e-12)  # [1/kg] below it neither side can move
STICKY = wp.constant(0.1)  # times the contact margin: gap up to which cohesion holds
UNBOUNDED = wp.constant(1.0e30)


@wp.struct
class ContactParameters:
    """Parameters of a contact, combined from two materials (`Material`)."""

    friction: float
    rolling: float
    spinning: float
    restitution: float
    cohesion: float
    compliance: float
    damping: float


@wp.func
def combined_friction(coefficient0: float, coefficient1: float, ahead: int, rule: int) -> float:
    """One coefficient of a contact: that of the shape which is `ahead` (1: shape 0, -1: shape 1), or by the rule."""
    if ahead > 0:
        return coefficient0
    if ahead < 0:
        return coefficient1
    if rule == LARGER:
        return wp.max(coefficient0, coefficient1)
    if rule == MEAN:
        return 0.5 * (coefficient0 + coefficient1)
    if rule == PRODUCT:
        return coefficient0 * coefficient1
    return wp.min(coefficient0, coefficient1)


@wp.func
def given_surface(pair: int, topology: Topology) -> ContactParameters:
    """The surface that a given pair of shapes has of its own."""
    s = ContactParameters()
    s.friction = topology.given_surface[pair, 0]
    s.rolling = topology.given_surface[pair, 1]
    s.spinning = topology.given_surface[pair, 2]
    s.restitution = topology.given_surface[pair, 3]
    s.cohesion = topology.given_surface[pair, 4]
    s.compliance = topology.given_surface[pair, 5]
    s.damping = topology.given_surface[pair, 6]
    return s


@wp.func
def combined_surface(
    world: int, shape0: int, shape1: int, topology: Topology, parameters: Parameters
) -> ContactParameters:
    """Friction of the shape of higher priority or by the rule, the smaller restitution, cohesion and damping of the
    two, the sum of their compliances; or the surface of a given pair.
    """
    if topology.given_count > 0:
        pair = given_pair(shape0, shape1, topology)
        if pair >= 0:
            if topology.given_surface[pair, 0] >= 0.0:
                return given_surface(pair, topology)
    ahead = int(0)
    if topology.shape_priority[shape0] > topology.shape_priority[shape1]:
        ahead = 1
    elif topology.shape_priority[shape0] < topology.shape_priority[shape1]:
        ahead = -1
    rule = topology.friction_rule
    s = ContactParameters()
    w = world_row(world, parameters.shape_friction.shape[0])
    s.friction = combined_friction(
        parameters.shape_friction[w, shape0], parameters.shape_friction[w, shape1], ahead, rule
    )
    if rule == PRODUCT:
        rule = SMALLER  # of levers: their product is no length
    w = world_row(world, parameters.shape_rolling_friction.shape[0])
    s.rolling = combined_friction(
        parameters.shape_rolling_friction[w, shape0], parameters.shape_rolling_friction[w, shape1], ahead, rule
    )
    w = world_row(world, parameters.shape_spinning_friction.shape[0])
    s.spinning = combined_friction(
        parameters.shape_spinning_friction[w, shape0], parameters.shape_spinning_friction[w, shape1], ahead, rule
    )
    w = world_row(world, parameters.shape_restitution.shape[0])
    s.restitution = wp.min(parameters.shape_restitution[w, shape0], parameters.shape_restitution[w, shape1])
    w = world_row(world, parameters.shape_cohesion.shape[0])
    s.cohesion = wp.min(parameters.shape_cohesion[w, shape0], parameters.shape_cohesion[w, shape1])
    w = world_row(world, parameters.shape_compliance.shape[0])
    s.compliance = parameters.shape_compliance[w, shape0] + parameters.shape_compliance[w, shape1]
    w = world_row(world, parameters.shape_damping.shape[0])
    s.damping = wp.min(parameters.shape_damping[w, shape0], parameters.shape_damping[w, shape1])
    return s


@wp.func
def impact_acts(
    dt: float, gap: float, incoming: float, free: float, surface: ContactParameters, config: StepConfig
) -> bool:
    """True if Newton's law of impact acts: the rebound is fast enough, and the step would close the gap.

    `incoming` is the normal velocity before the step, `free` that without contacts [m/s], negative when approaching.
    """
    rebound = surface.restitution * incoming
    return rebound < -config.restitution_threshold and gap + dt * wp.min(incoming, free) < 0.0


@wp.func
def normal_bias(dt: float, gap: float, surface: ContactParameters, config: StepConfig) -> float:
    """Right-hand side of the normal row of a contact that neither bounces nor recovers [m/s]."""
    if surface.compliance > 0.0:
        return gap / (dt + surface.damping)
    return wp.max(gap / dt, -config.max_depenetration_velocity)


@wp.func
def set_block(block: int, row: int, dt: float, surface: ContactParameters, cone: ConeProblem) -> int:
    """Kind, coefficients, bounds and compliance of a contact block; returns its number of rows."""
    cone.block_row[block] = row
    cone.friction[block] = surface.friction
    cone.rolling[block] = surface.rolling
    cone.spinning[block] = surface.spinning
    cone.cohesion[block] = dt * surface.cohesion
    compliance = surface.compliance / (dt * (dt + surface.damping))
    count = int(3)
    cone.block_kind[block] = CONTACT
    if surface.rolling > 0.0 or surface.spinning > 0.0:
        cone.block_kind[block] = ROLLING
        count = int(6)
    elif surface.friction == 0.0:
        cone.block_kind[block] = BOX
        count = int(1)
        cone.lower[row] = -dt * surface.cohesion
        cone.upper[row] = UNBOUNDED
    for i in range(count):
        cone.compliance[row + i] = 0.0
    cone.compliance[row] = compliance
    return count


@wp.struct
class ContactLinks:
    """Where a contact acts."""

    link0: int
    link1: int
    arm0: wp.vec3
    arm1: wp.vec3
    frame: wp.mat33
    face: int  # of a mesh, in the place of one of the links; -1: none
    side: int  # which of them
    shares: wp.vec3  # of the face's corners


@wp.func(inline=True)
def contact_links(world: int, contact: int, topology: Topology, contacts: ContactArrays) -> ContactLinks:
    """Links, arms and frame of a contact."""
    c = ContactLinks()
    c.link0 = link_of(topology.shape_body[contacts.contact_shape0[world, contact]], topology)
    c.link1 = link_of(topology.shape_body[contacts.contact_shape1[world, contact]], topology)
    c.arm0 = contacts.contact_arm0[world, contact]
    c.arm1 = contacts.contact_arm1[world, contact]
    c.frame = contact_frame(contacts.contact_normal_w[world, contact])
    if has_face_code():
        c.face = face_of(world, contact, topology, contacts)
        c.side = face_side(c.face, world, contact, topology, contacts)
        if c.face >= 0:
            c.shares = contacts.contact_weights[world, contact]
    return c


@wp.func(inline=True)
def relative_velocity(
    c: ContactLinks, ang: wp.array[wp.vec3], lin: wp.array[wp.vec3], topology: Topology, work: Work
) -> wp.vec3:
    """Of a contact's point on shape 1 against that on shape 0, in its frame [m/s]."""
    v1 = point_velocity(c.link1, c.arm1, ang, lin)
    v0 = point_velocity(c.link0, c.arm0, ang, lin)
    if has_face_code():
        if c.face >= 0:
            v = face_velocity(c.face, c.shares, ang, lin, topology, work)
            if c.side == 1:
                v1 = v
            else:
                v0 = v
    return c.frame * (v1 - v0)


@wp.struct
class ContactRows:
    """A contact in the making."""

    acts: int
    gap: float
    recovery: float  # of its overlap, by moving alone [m/s]; 0: there is none
    u: wp.vec3  # relative velocity without contacts, in the contact's frame [m/s]
    warm: wp.vec3
    warm_moment: wp.vec3
    surface: ContactParameters


@wp.func(inline=True)
def contact_rows(
    world: int, contact: int, dt: float, c: ContactLinks, topology: Topology, parameters: Parameters,
    contacts: ContactArrays, config: StepConfig, work: Work,
) -> ContactRows:  # fmt: skip
    """What a contact does in this step, whose impulses of before are taken from the arrays."""
    r = ContactRows()
    r.gap = contacts.contact_gap[world, contact]
    r.warm = contacts.contact_impulse[world, contact]
    r.warm_moment = contacts.contact_moment[world, contact]
    contacts.contact_impulse[world, contact] = wp.vec3()
    contacts.contact_moment[world, contact] = wp.vec3()
    r.u = relative_velocity(c, work.t_ang, work.t_lin, topology, work)
    r.surface = combined_surface(
        world, contacts.contact_shape0[world, contact], contacts.contact_shape1[world, contact], topology, parameters
    )
    if r.gap > STICKY * config.contact_margin:
        r.surface.cohesion = 0.0
    if r.surface.compliance == 0.0:  # else it is a spring
        r.recovery = recovery_speed(dt, r.gap, config.max_depenetration_velocity)
    closing = -wp.min(r.u[0], 0.0)
    if config.friction_law == CONVEX:
        closing += r.surface.friction * wp.sqrt(r.u[1] * r.u[1] + r.u[2] * r.u[2])  # sliding lifts by as much
    r.acts = wp.where(r.gap < config.contact_margin + dt * closing, 1, 0)
    return r


@wp.func(inline=True)
def fill_contact(
    row: int, count: int, dt: float, c: ContactLinks, r: ContactRows, config: StepConfig, topology: Topology,
    work: Work, cone: ConeProblem,
):  # fmt: skip
    """Right-hand sides and warm start of a contact's rows."""
    incoming = float(0.0)
    if r.surface.restitution > 0.0:
        before = relative_velocity(c, work.o_ang, work.o_lin, topology, work)
        incoming = before[0]
    if r.surface.restitution > 0.0 and impact_acts(dt, r.gap, incoming, r.u[0], r.surface, config):
        cone.compliance[row] = 0.0
        cone.r[row] = r.u[0] + r.surface.restitution * incoming
    elif r.recovery > 0.0:
        cone.r[row] = r.u[0]
    else:
        cone.r[row] = r.u[0] + normal_bias(dt, r.gap, r.surface, config)
    cone.gamma[row] = r.warm[0]
    if count >= 3:
        for i in range(1, 3):
            cone.r[row + i] = r.u[i]
            cone.gamma[row + i] = r.warm[i]
    if count == 6:
        turn = wp.vec3()
        if c.link1 >= 0:
            turn += work.t_ang[c.link1]
        if c.link0 >= 0:
            turn -= work.t_ang[c.link0]
        turn = c.frame * turn
        for i in range(3):
            cone.r[row + 3 + i] = turn[(i + 1) % 3]
            cone.gamma[row + 3 + i] = r.warm_moment[i]


@wp.func(inline=True)
def finish_diagonal(row: int, count: int, cone: ConeProblem):
    """Adds the compliance of a contact; rows along which nothing moves take part all the same."""
    cone.diagonal[row] = cone.diagonal[row] + cone.compliance[row]
    for i in range(count):
        cone.diagonal[row + i] = wp.max(cone.diagonal[row + i], FREE_MOBILITY)


@wp.func(inline=True)
def force_wrenches(arm: wp.vec3, frame: wp.mat33) -> Wrenches:
    """A contact's force rows on its shape 1."""
    w = Wrenches()
    w.lin = frame
    w.ang = cross_matrix(arm, frame)
    return w


@wp.func(inline=True)
def turn_wrenches(frame: wp.mat33) -> Wrenches:
    """Its rows of rolling and spinning."""
    w = Wrenches()
    w.ang = wp.mat33(
        frame[1, 0], frame[1, 1], frame[1, 2], frame[2, 0], frame[2, 1], frame[2, 2],
        frame[0, 0], frame[0, 1], frame[0, 2],
    )  # fmt: skip
    return w


@wp.func(inline=True)
def opposite(w: Wrenches) -> Wrenches:
    """The same rows on shape 0."""
    other = Wrenches()
    other.lin = -w.lin
    other.ang = -w.ang
    return other


@wp.func(inline=True)
def collect_contacts(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, contacts: ContactArrays,
    progress: StepProgress, work: Work, cone: ConeProblem,
):  # fmt: skip
    """Appends the contacts that can act in this step as blocks, without their responses.

    A contact further away than the margin takes part if the free motion would close it.
    """
    dt = config.dt
    block = int(progress.limits[world])
    row = int(block)
    for contact in range(contacts.contact_count[world]):
        c = contact_links(world, contact, topology, contacts)
        r = contact_rows(world, contact, dt, c, topology, parameters, contacts, config, work)
        if r.acts == 1:
            count = set_block(block, row, dt, r.surface, cone)
            fill_contact(row, count, dt, c, r, config, topology, work, cone)
            work.active[block] = topology.box_count + contact
            work.recovery[block] = r.recovery
            block += 1
            row += count
    cone.block_row[block] = row
    progress.blocks[world] = block


@wp.func
def move_block(source: int, source_row: int, count: int, block: int, row: int, work: Work, cone: ConeProblem):
    """A listed contact takes the place of an earlier one that was dropped."""
    work.active[block] = work.active[source]
    work.recovery[block] = work.recovery[source]
    cone.block_kind[block] = cone.block_kind[source]
    cone.friction[block] = cone.friction[source]
    cone.rolling[block] = cone.rolling[source]
    cone.spinning[block] = cone.spinning[source]
    cone.cohesion[block] = cone.cohesion[source]
    cone.block_row[block] = row
    for i in range(count):
        cone.lower[row + i] = cone.lower[source_row + i]
        cone.upper[row + i] = cone.upper[source_row + i]
        cone.compliance[row + i] = cone.compliance[source_row + i]
        cone.r[row + i] = cone.r[source_row + i]
        cone.gamma[row + i] = cone.gamma[source_row + i]
    cone.block_entries[block] = cone.block_entries[source]
    for entry in range(cone.block_entries[source]):
        cone.block_tree_dof[block, entry] = cone.block_tree_dof[source, entry]
        for i in range(count):
            cone.y[row + i, entry] = cone.y[source_row + i, entry]


@wp.func(inline=True)
def respond_to_contacts(
    world: int, topology: Topology, contacts: ContactArrays, progress: StepProgress, work: Work, cone: ConeProblem
):
    """Entries of the rows of the contacts: what these move in the trees."""
    for source in range(progress.limits[world], progress.blocks[world]):
        # one call for both halves of the rows, and nothing kept over it, takes fewer registers
        for half in range((cone.block_row[source + 1] - cone.block_row[source] + 2) // 3):
            row = cone.block_row[source]
            count = cone.block_row[source + 1] - row
            contact = work.active[source] - topology.box_count
            link0 = link_of(topology.shape_body[contacts.contact_shape0[world, contact]], topology)
            link1 = link_of(topology.shape_body[contacts.contact_shape1[world, contact]], topology)
            frame = contact_frame(contacts.contact_normal_w[world, contact])
            w0 = Wrenches()
            w1 = Wrenches()
            if half == 0:
                # written out: through `force_wrenches` it takes 234 registers instead of 168
                w0.lin = -frame
                w0.ang = -cross_matrix(contacts.contact_arm0[world, contact], frame)
                w1.lin = frame
                w1.ang = cross_matrix(contacts.contact_arm1[world, contact], frame)
                if has_face_code():
                    face = face_of(world, contact, topology, contacts)
                    if face >= 0:
                        shares = contacts.contact_weights[world, contact]
                        if face_side(face, world, contact, topology, contacts) == 1:
                            w1.lin = frame * leave_at_corners(face, shares, frame, topology, work)
                        else:
                            w0.lin = frame * -leave_at_corners(face, shares, -frame, topology, work)
            else:
                w1.ang = turn_wrenches(frame).ang
                w0.ang = -w1.ang
            cone.block_entries[source] = walk_rows(
                source, row + 3 * half, wp.min(count, 3), 0, link0, w0, link1, w1, topology, work, cone
            )


@wp.func(inline=True)
def reduce_contacts(world: int, topology: Topology, progress: StepProgress, work: Work, cone: ConeProblem):
    """The loops' share of them; contacts that can move nothing are dropped."""
    first = progress.limits[world]
    block = int(first)
    row = cone.block_row[first]
    end = int(row)
    for source in range(first, progress.blocks[world]):
        source_row = end
        end = cone.block_row[source + 1]
        count = end - source_row
        if source > block:
            move_block(source, source_row, count, block, row, work, cone)
        loop_share(block, row, count, topology, work, cone)
        if cone.diagonal[row] > FREE_MOBILITY:
            finish_diagonal(row, count, cone)
            block += 1
            row += count
    cone.block_row[block] = row
    progress.blocks[world] = block


@wp.func
def publish_contacts(
    world: int, dt: float, blocks: int, topology: Topology, contacts: ContactArrays, work: Work, cone: ConeProblem
):
    """Impulses of the contacts from their blocks, and the forces that they add up to."""
    for block in range(blocks):
        contact = work.active[block] - topology.box_count
        if contact >= 0:
            row = cone.block_row[block]
            count = cone.block_row[block + 1] - row
            impulse = wp.vec3(cone.gamma[row], 0.0, 0.0)
            if count >= 3:
                impulse = wp.vec3(cone.gamma[row], cone.gamma[row + 1], cone.gamma[row + 2])
            if count == 6:
                contacts.contact_moment[world, contact] = wp.vec3(
                    cone.gamma[row + 3], cone.gamma[row + 4], cone.gamma[row + 5]
                )
            contacts.contact_impulse[world, contact] = impulse
    sum_forces(world, dt, topology, contacts)


@wp.func
def sum_forces(world: int, dt: float, topology: Topology, contacts: ContactArrays):
    """Forces on shapes and bodies."""
    for shape in range(topology.shape_count):
        contacts.shape_contact_force[world, shape] = wp.vec3()
    for body in range(contacts.body_contact_force.shape[1]):
        contacts.body_contact_force[world, body] = wp.vec3()
    for contact in range(contacts.contact_count[world]):
        impulse = contacts.contact_impulse[world, contact]
        contacts.contact_force_w[world, contact] = wp.vec3()
        if impulse[0] != 0.0:
            force = (impulse * contact_frame(contacts.contact_normal_w[world, contact])) / dt
            contacts.contact_force_w[world, contact] = force
            face = face_of(world, contact, topology, contacts)
            side = face_side(face, world, contact, topology, contacts)
            for k in range(2):
                push = wp.where(k == 0, -force, force)
                if k == side:
                    add_face_force(world, contact, face, push, topology, contacts)
                else:
                    shape = contacts.contact_shape0[world, contact]
                    if k == 1:
                        shape = contacts.contact_shape1[world, contact]
                    contacts.shape_contact_force[world, shape] = contacts.shape_contact_force[world, shape] + push
                    body = topology.shape_body[shape]
                    if body >= 0:
                        contacts.body_contact_force[world, body] = contacts.body_contact_force[world, body] + push
