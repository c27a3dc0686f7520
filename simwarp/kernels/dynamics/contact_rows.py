"""Contacts as blocks of the cone problem: material laws, right-hand sides, responses, and the forces afterwards.

The rows of a contact are the relative velocity of its two points along the normal and two tangents; with rolling or
spinning friction, the relative angular velocity about the tangents and the normal follows.
"""

import warp as wp

from simwarp.core.types import FrictionLaw
from simwarp.kernels.cones.problem import BOX, CONTACT, ROLLING, ConeProblem
from simwarp.kernels.core.fields import ContactArrays, Parameters
from simwarp.kernels.core.spatial import contact_frame
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.dynamics.bilateral_rows import link_of
from simwarp.kernels.dynamics.cone_rows import Wrenches, loop_share, walk_rows

wp.set_module_options({"enable_backward": False})

CONVEX = wp.constant(int(FrictionLaw.CONVEX))
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
def combined_surface(world: int, shape0: int, shape1: int, parameters: Parameters) -> ContactParameters:
    """The smaller friction, restitution, cohesion and damping of the two; compliances add up."""
    s = ContactParameters()
    w = world_row(world, parameters.shape_friction.shape[0])
    s.friction = wp.min(parameters.shape_friction[w, shape0], parameters.shape_friction[w, shape1])
    w = world_row(world, parameters.shape_rolling_friction.shape[0])
    s.rolling = wp.min(parameters.shape_rolling_friction[w, shape0], parameters.shape_rolling_friction[w, shape1])
    w = world_row(world, parameters.shape_spinning_friction.shape[0])
    s.spinning = wp.min(parameters.shape_spinning_friction[w, shape0], parameters.shape_spinning_friction[w, shape1])
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
def cross_matrix(arm: wp.vec3, frame: wp.mat33) -> wp.mat33:
    """Rows: arm x row of the frame."""
    return -frame * wp.skew(arm)


@wp.func
def point_velocity(link: int, arm: wp.vec3, ang: wp.array[wp.vec3], lin: wp.array[wp.vec3]) -> wp.vec3:
    """Velocity of a point of a link; zero for the world."""
    v = wp.vec3()
    if link >= 0:
        v = lin[link] + wp.cross(ang[link], arm)
    return v


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
    """Right-hand side of the normal row of a contact that does not bounce [m/s]."""
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


@wp.func
def contact_response(
    block: int, row: int, count: int, link0: int, link1: int, arm0: wp.vec3, arm1: wp.vec3, frame: wp.mat33,
    topology: Topology, work: Work, cone: ConeProblem,
):  # fmt: skip
    """Entries of a contact's rows and their diagonal."""
    w0 = Wrenches()
    w1 = Wrenches()
    w0.lin = -frame
    w0.ang = -cross_matrix(arm0, frame)
    w1.lin = frame
    w1.ang = cross_matrix(arm1, frame)
    entries = walk_rows(block, row, wp.min(count, 3), 0, link0, w0, link1, w1, topology, work, cone)
    if count == 6:
        turn0 = Wrenches()
        turn1 = Wrenches()
        about = wp.mat33(
            frame[1, 0], frame[1, 1], frame[1, 2], frame[2, 0], frame[2, 1], frame[2, 2],
            frame[0, 0], frame[0, 1], frame[0, 2],
        )  # fmt: skip
        turn0.ang = -about
        turn1.ang = about
        entries = walk_rows(block, row + 3, 3, 0, link0, turn0, link1, turn1, topology, work, cone)
    cone.block_entries[block] = entries
    loop_share(block, row, count, topology, work, cone)


@wp.func
def collect_contacts(
    world: int, dt: float, blocks: int, rows: int, topology: Topology, parameters: Parameters, contacts: ContactArrays,
    config: StepConfig, work: Work, cone: ConeProblem,
) -> int:  # fmt: skip
    """Appends the contacts that can act in this step as blocks; returns the number of blocks then.

    A contact further away than the margin takes part if the free motion would close it.
    """
    block = int(blocks)
    row = int(rows)
    for contact in range(contacts.contact_count[world]):
        shape0 = contacts.contact_shape0[world, contact]
        shape1 = contacts.contact_shape1[world, contact]
        link0 = link_of(topology.shape_body[shape0], topology)
        link1 = link_of(topology.shape_body[shape1], topology)
        arm0 = contacts.contact_arm0[world, contact]
        arm1 = contacts.contact_arm1[world, contact]
        gap = contacts.contact_gap[world, contact]
        frame = contact_frame(contacts.contact_normal_w[world, contact])
        warm = contacts.contact_impulse[world, contact]
        warm_moment = contacts.contact_moment[world, contact]
        contacts.contact_impulse[world, contact] = wp.vec3()
        contacts.contact_moment[world, contact] = wp.vec3()
        u = frame * (point_velocity(link1, arm1, work.t_ang, work.t_lin)
                     - point_velocity(link0, arm0, work.t_ang, work.t_lin))  # fmt: skip
        surface = combined_surface(world, shape0, shape1, parameters)
        if gap > STICKY * config.contact_margin:
            surface.cohesion = 0.0
        closing = -wp.min(u[0], 0.0)
        if config.friction_law == CONVEX:
            closing += surface.friction * wp.sqrt(u[1] * u[1] + u[2] * u[2])  # sliding lifts by as much
        if gap < config.contact_margin + dt * closing:
            count = set_block(block, row, dt, surface, cone)
            contact_response(block, row, count, link0, link1, arm0, arm1, frame, topology, work, cone)
            if cone.diagonal[row] > FREE_MOBILITY:
                incoming = float(0.0)
                if surface.restitution > 0.0:
                    before = frame * (point_velocity(link1, arm1, work.o_ang, work.o_lin)
                                      - point_velocity(link0, arm0, work.o_ang, work.o_lin))  # fmt: skip
                    incoming = before[0]
                if surface.restitution > 0.0 and impact_acts(dt, gap, incoming, u[0], surface, config):
                    cone.compliance[row] = 0.0
                    cone.r[row] = u[0] + surface.restitution * incoming
                else:
                    cone.r[row] = u[0] + normal_bias(dt, gap, surface, config)
                cone.diagonal[row] = cone.diagonal[row] + cone.compliance[row]
                cone.gamma[row] = warm[0]
                if count >= 3:
                    for i in range(1, 3):
                        cone.r[row + i] = u[i]
                        cone.gamma[row + i] = warm[i]
                if count == 6:
                    turn = wp.vec3()
                    if link1 >= 0:
                        turn += work.t_ang[link1]
                    if link0 >= 0:
                        turn -= work.t_ang[link0]
                    turn = frame * turn
                    for i in range(3):
                        cone.r[row + 3 + i] = turn[(i + 1) % 3]
                        cone.gamma[row + 3 + i] = warm_moment[i]
                for i in range(count):
                    cone.diagonal[row + i] = wp.max(cone.diagonal[row + i], FREE_MOBILITY)
                work.active[block] = topology.box_count + contact
                block += 1
                row += count
    cone.block_row[block] = row
    return block


@wp.func
def publish_contacts(
    world: int, dt: float, first: int, blocks: int, topology: Topology, contacts: ContactArrays, work: Work,
    cone: ConeProblem,
):  # fmt: skip
    """Impulses of the contacts from their blocks, and the forces that they add up to."""
    for block in range(first, blocks):
        contact = work.active[block] - topology.box_count
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
            shape0 = contacts.contact_shape0[world, contact]
            shape1 = contacts.contact_shape1[world, contact]
            contacts.shape_contact_force[world, shape0] = contacts.shape_contact_force[world, shape0] - force
            contacts.shape_contact_force[world, shape1] = contacts.shape_contact_force[world, shape1] + force
            body0 = topology.shape_body[shape0]
            body1 = topology.shape_body[shape1]
            if body0 >= 0:
                contacts.body_contact_force[world, body0] = contacts.body_contact_force[world, body0] - force
            if body1 >= 0:
                contacts.body_contact_force[world, body1] = contacts.body_contact_force[world, body1] + force
