"""Smooth contact: penalty forces on the same contacts, explicit in the step, instead of rows of the cone problem.

Normal law of Hertz or Hooke with the damping of a given restitution (Tsuji et al. 1992), tangential spring with a
history of displacement, limited by Coulomb's law (Cundall & Strack 1979). Steps have to resolve the collision time.
"""

import warp as wp

from simwarp.core.types import ContactModel, ShapeType
from simwarp.kernels.core.fields import ContactArrays, Parameters
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import contact_frame
from simwarp.kernels.dynamics.bilateral_rows import link_of
from simwarp.kernels.dynamics.contact_points import point_velocity
from simwarp.kernels.dynamics.contact_rows import ContactParameters, combined_surface

wp.set_module_options({"enable_backward": False})

RIGID = wp.constant(int(ContactModel.RIGID))
HOOKE = wp.constant(int(ContactModel.SMOOTH_HOOKE))
PLANE = wp.constant(int(ShapeType.PLANE))
HEIGHT_FIELD = wp.constant(int(ShapeType.HEIGHT_FIELD))
BOX = wp.constant(int(ShapeType.BOX))
HULL = wp.constant(int(ShapeType.HULL))
FLAT_RADIUS = wp.constant(0.1)  # [m] stands for the curvature of flat faces
LEAST_RESTITUTION = wp.constant(0.01)
PI = wp.constant(3.14159265)


@wp.struct
class Stiffness:
    """Springs [N/m] and dampers [N·s/m] along and across the normal."""

    kn: float
    kt: float
    gn: float
    gt: float


@wp.func
def curvature(shape: int, world: int, topology: Topology, parameters: Parameters) -> float:
    """1/radius of a shape's surface [1/m]; 0 for what counts as ground, and for arcs of sprockets, which are wide."""
    kind = topology.shape_type[shape]
    result = float(0.0)
    if kind == BOX or kind == HULL:
        result = 1.0 / FLAT_RADIUS
    elif kind != PLANE and kind < HEIGHT_FIELD:
        result = 1.0 / parameters.shape_size[world_row(world, parameters.shape_size.shape[0]), shape][0]
    return result


@wp.func
def inverse_mass(shape: int, world: int, topology: Topology, parameters: Parameters) -> float:
    """1/mass of a shape's body [1/kg]; 0 for the world."""
    body = topology.shape_body[shape]
    if body < 0:
        return 0.0
    return 1.0 / parameters.body_mass[world_row(world, parameters.body_mass.shape[0]), body]


@wp.func
def stiffness_of(
    world: int, shape0: int, shape1: int, depth: float, restitution: float, model: int, topology: Topology,
    parameters: Parameters,
) -> Stiffness:  # fmt: skip
    """Springs and dampers of a contact that is `depth` [m] deep."""
    young0 = parameters.shape_young_modulus[world_row(world, parameters.shape_young_modulus.shape[0]), shape0]
    young1 = parameters.shape_young_modulus[world_row(world, parameters.shape_young_modulus.shape[0]), shape1]
    nu0 = parameters.shape_poisson_ratio[world_row(world, parameters.shape_poisson_ratio.shape[0]), shape0]
    nu1 = parameters.shape_poisson_ratio[world_row(world, parameters.shape_poisson_ratio.shape[0]), shape1]
    modulus = 1.0 / ((1.0 - nu0 * nu0) / young0 + (1.0 - nu1 * nu1) / young1)
    shear = 0.5 / ((2.0 - nu0) * (1.0 + nu0) / young0 + (2.0 - nu1) * (1.0 + nu1) / young1)
    bend = curvature(shape0, world, topology, parameters) + curvature(shape1, world, topology, parameters)
    radius = 1.0 / wp.max(bend, 1.0e-6)
    mass = 1.0 / wp.max(
        inverse_mass(shape0, world, topology, parameters) + inverse_mass(shape1, world, topology, parameters), 1.0e-12
    )
    log_e = wp.log(wp.max(restitution, LEAST_RESTITUTION))
    s = Stiffness()
    if model == HOOKE:
        # stiffness that Hertz' law has on the average at an impact of 1 m/s
        scale = 16.0 / 15.0 * wp.sqrt(radius) * modulus
        s.kn = scale * wp.pow(mass / scale, 0.2)
        s.kt = s.kn
        s.gn = wp.sqrt(4.0 * mass * s.kn / (1.0 + (PI / wp.min(log_e, -1.0e-6)) * (PI / wp.min(log_e, -1.0e-6))))
        s.gt = s.gn
    else:
        width = wp.sqrt(radius * depth)
        ratio = -log_e / wp.sqrt(log_e * log_e + PI * PI)
        slope = 2.0 * modulus * width
        s.kn = 2.0 / 3.0 * slope
        s.kt = 8.0 * shear * width
        s.gn = 2.0 * wp.sqrt(5.0 / 6.0) * ratio * wp.sqrt(slope * mass)
        s.gt = 2.0 * wp.sqrt(5.0 / 6.0) * ratio * wp.sqrt(s.kt * mass)
    return s


@wp.func
def apply_force_at(link: int, arm: wp.vec3, impulse: wp.vec3, work: Work):
    """Adds an applied impulse [N·s] at a point of a link."""
    if link >= 0:
        work.p_ang[link] = work.p_ang[link] + wp.cross(arm, impulse)
        work.p_lin[link] = work.p_lin[link] + impulse


@wp.func
def contact_force(
    u: wp.vec3, depth: float, dt: float, slip: wp.vec3, s: Stiffness, surface: ContactParameters
) -> wp.mat33:  # fmt: skip
    """Rows: force (n, t1, t2) [N] on shape 1, and the displacement (0, s1, s2) [m] that the tangential spring keeps."""
    normal = wp.max(s.kn * depth - s.gn * u[0], 0.0) - surface.cohesion
    s1 = slip[1] + dt * u[1]
    s2 = slip[2] + dt * u[2]
    t1 = -s.kt * s1 - s.gt * u[1]
    t2 = -s.kt * s2 - s.gt * u[2]
    size = wp.sqrt(t1 * t1 + t2 * t2)
    limit = surface.friction * wp.max(normal + surface.cohesion, 0.0)
    if size > limit:
        t1 *= limit / size
        t2 *= limit / size
        s1 = -t1 / s.kt
        s2 = -t2 / s.kt
    return wp.mat33(normal, t1, t2, 0.0, s1, s2, 0.0, 0.0, 0.0)


@wp.func
def apply_smooth_contacts(
    world: int, dt: float, topology: Topology, parameters: Parameters, contacts: ContactArrays, config: StepConfig,
    work: Work,
):  # fmt: skip
    """Forces of all contacts at the velocities of the step's start, as applied impulses."""
    for contact in range(contacts.contact_count[world]):
        gap = contacts.contact_gap[world, contact]
        moment = contacts.contact_moment[world, contact]
        contacts.contact_impulse[world, contact] = wp.vec3()
        contacts.contact_moment[world, contact] = wp.vec3()
        if gap < 0.0:
            shape0 = contacts.contact_shape0[world, contact]
            shape1 = contacts.contact_shape1[world, contact]
            link0 = link_of(topology.shape_body[shape0], topology)
            link1 = link_of(topology.shape_body[shape1], topology)
            arm0 = contacts.contact_arm0[world, contact]
            arm1 = contacts.contact_arm1[world, contact]
            frame = contact_frame(contacts.contact_normal_w[world, contact])
            u = frame * (point_velocity(link1, arm1, work.o_ang, work.o_lin)
                         - point_velocity(link0, arm0, work.o_ang, work.o_lin))  # fmt: skip
            surface = combined_surface(world, shape0, shape1, topology, parameters)
            s = stiffness_of(
                world, shape0, shape1, -gap, surface.restitution, config.contact_model, topology, parameters
            )
            force = contact_force(u, -gap, dt, wp.vec3(0.0, moment[0], moment[1]), s, surface)
            local = wp.vec3(force[0, 0], force[0, 1], force[0, 2]) * dt
            contacts.contact_impulse[world, contact] = local
            contacts.contact_moment[world, contact] = wp.vec3(force[1, 1], force[1, 2], 0.0)
            impulse = local * frame
            apply_force_at(link0, arm0, -impulse, work)
            apply_force_at(link1, arm1, impulse, work)
