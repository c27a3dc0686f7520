"""Gathers the motion of the bodies of the shown worlds, so that one copy brings it to the host."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays

wp.set_module_options({"enable_backward": False})


@wp.kernel
def gather_bodies(worlds: wp.array[int], state: StateArrays, rows: wp.array3d[wp.float64]):
    """Write (S, B, 10): centre of mass, orientation xyzw, velocity."""
    row, body = wp.tid()
    world = worlds[row]
    place, turn, velocity = state.body_x[world, body], state.body_rot[world, body], state.body_v[world, body]
    for axis in range(3):
        rows[row, body, axis] = place[axis]
        rows[row, body, 7 + axis] = wp.float64(velocity[axis])
    for axis in range(4):
        rows[row, body, 3 + axis] = wp.float64(turn[axis])
