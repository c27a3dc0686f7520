"""The kernel of posts below the wheels of a vehicle: the vertical law of its tires, and bristles that hold the patches.

Interface: launch `push_posts` once before each step with dim = (W, wheels). A post is a level plane that moves
vertically; the wheel is taken relative to it, so that its damper sees the post's speed too.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.tires.common_kernels import standstill_force, vertical_load
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.parameter_vector_kernels import Common, TireContact
from simwarp.vehicle.tires.patch_kernels import Envelopes, find_patch
from simwarp.vehicle.tires.tires_kernels import TireTables, wheel_state

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.kernel
def push_posts(
    worlds: WorldRange, dt: float,
    tables: TireTables,
    tire_parameter: wp.array3d[float],
    grip: float,
    plane: TerrainTables,
    assets: Assets,
    height: wp.array2d[float],
    speed: wp.array2d[float],
    state: StateArrays,
    tire_state: wp.array3d[float],
    load: wp.array2d[float],
    applied_force: wp.array2d[wp.vec3],
    applied_torque: wp.array2d[wp.vec3],
):  # fmt: skip
    """Forces of all posts; dim (W, wheels).

    Args:
        worlds: of this launch.
        dt: step over which the forces will act [s].
        tables: of the wheels.
        tire_parameter: (1, wheels, P).
        grip: friction between a tire and its post, over that on which the tire was measured.
        plane: z = 0.
        assets: none.
        height: (W, wheels) of the posts [m].
        speed: (W, wheels) of the posts, upwards [m/s].
        state: of the bodies.
        tire_state: (W, wheels, S) in and out: deflections of bristles [m].
        load: (W, wheels) out [N].
        applied_force: (W, B) out [N], world axes, at the centre of mass: entries of the wheels are overwritten.
        applied_torque: (W, B) out [N·m].
    """
    index, wheel = wp.tid()
    world = worlds.first + index
    p = tire_parameter[0, wheel]
    z = tire_state[world, wheel]
    moving = wheel_state(world, wheel, tables, state)
    rise = wp.float64(height[world, wheel])
    moving.x = moving.x - wp.vec3d(wp.float64(0.0), wp.float64(0.0), rise)
    moving.v = moving.v - wp.vec3(0.0, 0.0, speed[world, wheel])
    patch = find_patch(world, wheel, moving, TireContact.SINGLE_POINT, p, plane, Envelopes(), assets)
    force = wp.vec3()
    torque = wp.vec3()
    if patch.touching == 1:
        patch.load = vertical_load(patch, p)
    if patch.load > 0.0:
        patch.friction = grip * p[Common.REFERENCE_FRICTION]
        held = standstill_force(patch, patch.load, p, z, dt)
        axes = wp.matrix_from_cols(patch.forward, patch.left, patch.normal)
        force = axes * wp.vec3(held[0], held[1], patch.load)
        torque = wp.cross(patch.arm, force)
    else:
        for slot in range(z.shape[0]):
            z[slot] = 0.0
    body = tables.body[wheel]
    below = state.body_x[world, body] - moving.x
    lever = to_float(wp.vec3d(-below[0], -below[1], rise - below[2]))
    load[world, wheel] = patch.load
    applied_force[world, body] = force
    applied_torque[world, body] = torque + wp.cross(lever, force)
