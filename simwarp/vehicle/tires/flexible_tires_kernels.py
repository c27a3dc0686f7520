"""Loads of flexible tires after a step."""

import warp as wp

from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False})


@wp.kernel
def measure_flexible_tires(
    # inputs
    worlds: WorldRange,
    starts: wp.array[int],
    bodies: wp.array[int],
    body_contact_force: wp.array2d[wp.vec3],
    # outputs
    load: wp.array2d[float],
    force_w: wp.array2d[wp.vec3],
):
    """Force of the contacts on the nodes of each tire, and its vertical part; dim (W, wheels)."""
    index, wheel = wp.tid()
    world = worlds.first + index
    force = wp.vec3()
    for k in range(starts[wheel], starts[wheel + 1]):
        force += body_contact_force[world, bodies[k]]
    force_w[world, wheel] = force
    load[world, wheel] = force[2]
