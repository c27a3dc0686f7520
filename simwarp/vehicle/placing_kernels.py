"""A vehicle is moved to another place as one rigid whole."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.vector_math import to_double, to_float

wp.set_module_options({"enable_backward": False})


@wp.kernel
def move_vehicles(
    # inputs
    mask: wp.array[wp.bool],
    bodies: wp.array[int],  # of the vehicle, the chassis first
    reference: wp.vec3d,  # origin of the vehicle's frame from the chassis' centre of mass, body axes [m]
    position: wp.array2d[wp.float64],  # (W, 2 or 3) of that origin, world [m]
    heading: wp.array[wp.float64],  # (W,) [rad]
    # outputs
    state: StateArrays,
):
    """Turn the vehicles of the mask about the vertical and shift them; velocities turn with them."""
    world = wp.tid()
    if not mask[world]:
        return
    q = state.body_rot[world, bodies[0]]
    origin = state.body_x[world, bodies[0]] + wp.quat_rotate(q, reference)
    ahead = wp.quat_rotate(q, wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0)))
    half = wp.float64(0.5) * (heading[world] - wp.atan2(ahead[1], ahead[0]))
    turn = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.sin(half), wp.cos(half))
    place = wp.vec3d(position[world, 0], position[world, 1], origin[2])
    if position.shape[1] == 3:
        place = wp.vec3d(place[0], place[1], position[world, 2])
    for k in range(bodies.shape[0]):
        body = bodies[k]
        state.body_x[world, body] = place + wp.quat_rotate(turn, state.body_x[world, body] - origin)
        state.body_rot[world, body] = wp.normalize(turn * state.body_rot[world, body])
        state.body_v[world, body] = to_float(wp.quat_rotate(turn, to_double(state.body_v[world, body])))
        state.body_omega[world, body] = to_float(wp.quat_rotate(turn, to_double(state.body_omega[world, body])))
