"""Tires in ordinary contact, rigid or flexible: friction before a step, loads after it."""

import warp as wp

from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False})


@wp.kernel
def limit_friction(
    # inputs
    worlds: WorldRange,
    shapes: wp.array[int],  # of all wheels
    own_friction: wp.array[float],
    ground_friction: wp.array[float],
    # outputs
    shape_friction: wp.array2d[float],
):
    """The smaller of the tire's and the road's friction; dim (W, shapes). Where worlds share it, the first writes."""
    index, shape = wp.tid()
    world = worlds.first + index
    if world >= shape_friction.shape[0]:
        return
    ground = ground_friction[world_row(world, ground_friction.shape[0])]
    shape_friction[world, shapes[shape]] = wp.min(own_friction[shape], ground)


@wp.kernel
def measure_contact_tires(
    # inputs
    worlds: WorldRange,
    starts: wp.array[int],
    bodies: wp.array[int],
    body_contact_force: wp.array2d[wp.vec3],
    # outputs
    load: wp.array2d[float],
    force_w: wp.array2d[wp.vec3],
):
    """Force of the contacts on each wheel, which has several bodies or one (CSR), and its vertical part; dim (W,
    wheels).
    """
    index, wheel = wp.tid()
    world = worlds.first + index
    force = wp.vec3()
    for k in range(starts[wheel], starts[wheel + 1]):
        force += body_contact_force[world, bodies[k]]
    force_w[world, wheel] = force
    load[world, wheel] = force[2]
