"""Rigid tires, which are shapes in contact: friction before a step, loads after it."""

import warp as wp

from simwarp.kernels.core.tables import world_row

wp.set_module_options({"enable_backward": False})


@wp.kernel
def limit_friction(
    # inputs
    shapes: wp.array[int],
    own_friction: wp.array[float],
    ground_friction: wp.array[float],
    # outputs
    shape_friction: wp.array2d[float],
):
    """The smaller of the tire's and the road's friction; dim (copies of shape_friction, wheels)."""
    world, wheel = wp.tid()
    ground = ground_friction[world_row(world, ground_friction.shape[0])]
    shape_friction[world, shapes[wheel]] = wp.min(own_friction[wheel], ground)


@wp.kernel
def measure_rigid_tires(
    # inputs
    bodies: wp.array[int],
    body_contact_force: wp.array2d[wp.vec3],
    # outputs
    load: wp.array2d[float],
    force_w: wp.array2d[wp.vec3],
):
    """Force of the contacts on each wheel, and its vertical part; dim (W, wheels)."""
    world, wheel = wp.tid()
    force = body_contact_force[world, bodies[wheel]]
    force_w[world, wheel] = force
    load[world, wheel] = force[2]
