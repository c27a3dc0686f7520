"""Friction that comes up with the speed of slip, as penalty contacts have it: coefficients of the step to come."""

import warp as wp

from simwarp.kernels.core.fields import ContactArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import Topology
from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False})


@wp.func
def point_speed(world: int, shape: int, arm: wp.vec3, topology: Topology, state: StateArrays) -> wp.vec3:
    """Velocity of a point of a shape's body [m/s]; zero in the world."""
    body = topology.shape_body[shape]
    if body < 0:
        return wp.vec3()
    return state.body_v[world, body] + wp.cross(state.body_omega[world, body], arm)


@wp.kernel
def set_slip_friction(
    # inputs
    worlds: WorldRange,
    speed: float,  # [m/s]
    own: wp.array[float],  # (S,) coefficient of each shape with the rule, -1: of others
    topology: Topology,
    state: StateArrays,
    contacts: ContactArrays,
    # outputs
    parameters: Parameters,
):
    """Of each shape with the rule that touches something: its coefficient times tanh(slip / speed)."""
    world = worlds.first + wp.tid()
    for shape in range(own.shape[0]):
        if own[shape] >= 0.0:
            parameters.shape_friction[world, shape] = own[shape]
    for contact in range(contacts.contact_count[world]):
        shape0 = contacts.contact_shape0[world, contact]
        shape1 = contacts.contact_shape1[world, contact]
        v = point_speed(world, shape1, contacts.contact_arm1[world, contact], topology, state)
        v = v - point_speed(world, shape0, contacts.contact_arm0[world, contact], topology, state)
        normal = contacts.contact_normal_w[world, contact]
        slip = wp.length(v - wp.dot(v, normal) * normal)
        for side in range(2):
            shape = shape0
            other = shape1
            if side == 1:
                shape = shape1
                other = shape0
            if own[shape] >= 0.0:
                least = wp.min(own[shape], parameters.shape_friction[world, other])
                parameters.shape_friction[world, shape] = least * wp.tanh(slip / speed)
