"""The kernel that finds all tire forces: one thread per wheel of a world.

Wheels are independent, so that a GPU fills with W x wheels threads, and on a CPU, whose threads are the turns of one
loop, the choice costs nothing: a launch costs the same either way.

Interface: launch `apply_tires` once before each step with dim = (W, wheels); the arguments are described there, the
arrays in `TireTables`, `TireReports` and `TerrainTables` (ground_kernels.py). At most one tire stands on a body.
`reset_tires` zeroes the state of worlds that start anew.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.tires.common_kernels import vertical_load
from simwarp.vehicle.tires.ground_kernels import TerrainTables, friction_at
from simwarp.vehicle.tires.laws.fiala_kernels import fiala_force
from simwarp.vehicle.tires.laws.lugre_kernels import lugre_force
from simwarp.vehicle.tires.laws.pac02_kernels import pac02_force
from simwarp.vehicle.tires.laws.pac89_kernels import pac89_force
from simwarp.vehicle.tires.laws.tmeasy_kernels import tmeasy_force
from simwarp.vehicle.tires.laws.tmsimple_kernels import tmsimple_force
from simwarp.vehicle.tires.parameter_vector_kernels import Common, TireModel
from simwarp.vehicle.tires.patch_kernels import (
    Envelopes,
    Patch,
    TireForce,
    Wheel,
    contact_point,
    find_patch,
    slip_angle,
    slip_ratio,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class TireTables:
    """Constant tables of the wheels, shared by all worlds. First axis: wheel."""

    body: wp.array[int]  # the spindle
    model: wp.array[int]  # TireModel
    contact: wp.array[int]  # TireContact
    mirrored: wp.array[int]  # 1: measured on the other side of the vehicle, so that its asymmetries change their sign
    offset_b: wp.array[wp.vec3]  # of the wheel's centre from the body's centre of mass, body axes [m]


@wp.struct
class TireReports:
    """Outputs of tires, (W, wheels); zero for a wheel off the ground."""

    load: wp.array2d[float]  # normal force [N]
    slip_ratio: wp.array2d[float]  # positive when driving
    slip_angle: wp.array2d[float]  # positive when the wheel drifts to the left [rad]
    camber: wp.array2d[float]  # positive: the upper side leans to the right [rad]
    deflection: wp.array2d[float]  # [m]
    force_w: wp.array2d[wp.vec3]  # on the wheel, at its centre [N]
    torque_w: wp.array2d[wp.vec3]  # about its centre [N·m]


@wp.func
def wheel_state(world: int, wheel: int, tables: TireTables, state: StateArrays) -> Wheel:
    """Place and motion of a wheel, whose axis is the y axis of its body."""
    body = tables.body[wheel]
    q = state.body_rot[world, body]
    offset = wp.quat_rotate(q, to_double(tables.offset_b[wheel]))
    result = Wheel()
    result.x = state.body_x[world, body] + offset
    result.axis = to_float(wp.quat_rotate(q, wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))))
    result.omega_w = state.body_omega[world, body]
    result.v = state.body_v[world, body] + wp.cross(result.omega_w, to_float(offset))
    result.spin = wp.dot(result.omega_w, result.axis)
    return result


@wp.func
def model_force(
    model: int, patch: Patch, mirrored: int, p: wp.array[float], z: wp.array[float], dt: float
) -> TireForce:  # fmt: skip
    """Force of a model that acts on one patch: all but LuGre."""
    mirror = float(1 - 2 * mirrored)
    if model == TireModel.TMSIMPLE:
        return tmsimple_force(patch, p, z, dt)
    if model == TireModel.FIALA:
        return fiala_force(patch, p, z, dt)
    if model == TireModel.PAC89:
        return pac89_force(patch, mirror, p, z, dt)
    if model == TireModel.PAC02:
        return pac02_force(patch, mirror, p, z, dt)
    return tmeasy_force(patch, p, z, dt)


@wp.struct
class GroundForce:
    """What the ground does to a wheel; world axes."""

    patch: Patch
    force: wp.vec3  # at its centre [N]
    torque: wp.vec3  # about its centre [N·m]


@wp.func
def ground_force(
    world: int, wheel: int, moving: Wheel, dt: float, tables: TireTables, p: wp.array[float], z: wp.array[float],
    ground_friction: wp.array[float], terrain: TerrainTables, envelopes: Envelopes, assets: Assets,
) -> GroundForce:  # fmt: skip
    """Force on a wheel that moves so, for a step of `dt`; its state is advanced."""
    result = GroundForce()
    if tables.model[wheel] == TireModel.LUGRE:
        discs = lugre_force(
            world, wheel, moving, tables.contact[wheel], p, z, ground_friction, terrain, envelopes, assets, dt
        )  # fmt: skip
        result.patch = discs.patch
        result.force = discs.force
        result.torque = discs.torque
        return result
    patch = find_patch(world, wheel, moving, tables.contact[wheel], p, terrain, envelopes, assets)
    if patch.touching == 1:
        patch.load = vertical_load(patch, p)
    if patch.load > 0.0:
        friction = friction_at(world, contact_point(moving, patch), ground_friction, terrain)
        patch.friction = wp.clamp(friction, p[Common.FRICTION_LOWER], p[Common.FRICTION_UPPER])
        local = model_force(tables.model[wheel], patch, tables.mirrored[wheel], p, z, dt)
        axes = wp.matrix_from_cols(patch.forward, patch.left, patch.normal)
        result.force = axes * local.force
        result.torque = axes * local.torque + wp.cross(patch.arm, result.force)
    else:
        for slot in range(z.shape[0]):
            z[slot] = 0.0
    result.patch = patch
    return result


@wp.func
def report_tire(world: int, wheel: int, on: GroundForce, reports: TireReports):
    """Publishes what the ground does to a wheel."""
    ratio = float(0.0)
    angle = float(0.0)
    if on.patch.load > 0.0:
        ratio = slip_ratio(on.patch)
        angle = slip_angle(on.patch)
    reports.load[world, wheel] = on.patch.load
    reports.slip_ratio[world, wheel] = ratio
    reports.slip_angle[world, wheel] = angle
    reports.camber[world, wheel] = on.patch.camber
    reports.deflection[world, wheel] = on.patch.deflection
    reports.force_w[world, wheel] = on.force
    reports.torque_w[world, wheel] = on.torque


@wp.kernel
def apply_tires(
    worlds: WorldRange, dt: float,
    tables: TireTables,
    tire_parameter: wp.array3d[float],
    ground_friction: wp.array[float],
    terrain: TerrainTables,
    envelopes: Envelopes,
    assets: Assets,
    state: StateArrays,
    tire_state: wp.array3d[float],
    reports: TireReports,
    applied_force: wp.array2d[wp.vec3],
    applied_torque: wp.array2d[wp.vec3],
):  # fmt: skip
    """Forces of all tires; dim (W, wheels).

    Args:
        dt: step over which the forces will act [s].
        tables: see there.
        tire_parameter: (1 or W, wheels, P), parameter_vector_kernels.py.
        ground_friction: (1 or W,) friction of the road.
        terrain: see ground_kernels.py.
        envelopes: of `find_envelopes` (tire_obstacles_kernels.py); empty where no tire asks for them.
        assets: height fields and meshes.
        state: of the bodies.
        tire_state: (W, wheels, S) in and out: deflections of bristles [m], and lagged slips.
        reports: out.
        applied_force: (W, B) out [N], world axes, at the centre of mass: entries of bodies with tires are overwritten.
        applied_torque: (W, B) out [N·m].
    """
    index, wheel = wp.tid()
    world = worlds.first + index
    p = tire_parameter[world_row(world, tire_parameter.shape[0]), wheel]
    moving = wheel_state(world, wheel, tables, state)
    on = ground_force(
        world, wheel, moving, dt, tables, p, tire_state[world, wheel], ground_friction, terrain, envelopes, assets
    )  # fmt: skip
    report_tire(world, wheel, on, reports)
    body = tables.body[wheel]
    shifted = wp.vec3()
    if on.patch.load > 0.0:
        shifted = on.torque + wp.cross(to_float(moving.x - state.body_x[world, body]), on.force)
    applied_force[world, body] = on.force
    applied_torque[world, body] = shifted


@wp.kernel
def reset_tires(world_mask: wp.array[bool], tire_state: wp.array3d[float]):
    """Zeroes the state of the worlds in the mask; dim (W, wheels)."""
    world, wheel = wp.tid()
    if world_mask[world]:
        for slot in range(tire_state.shape[2]):
            tire_state[world, wheel, slot] = 0.0
