"""Bodies that show the wheels of reduced vehicles are moved to where the wheels are."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.vector_math import to_double
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.inputs_kernels import VehicleTables, member_of
from simwarp.vehicle.reduced.reduced_tables_kernels import WHEELS, ReducedState, ReducedTables, corner
from simwarp.vehicle.reduced.reduced_vehicle_kernels import chassis_of, wheel_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def put_wheels(
    world: int, number: int, vehicle: VehicleTables, t: ReducedTables, bodies: wp.array[int],
    vehicle_input: wp.array3d[float], reduced: ReducedState, state: StateArrays,
):  # fmt: skip
    """The four wheels of a vehicle."""
    of = member_of(world, number, vehicle)
    body = of.body + vehicle.chassis
    c = chassis_of(world, body, state)
    steering = wp.clamp(vehicle_input[world, number, 0], -1.0, 1.0)
    for wheel in range(4):
        slot = WHEELS * number + wheel
        place = corner(wheel, reduced.travel[world, slot], steering, t)
        moving = wheel_at(c, place, reduced.travel_rate[world, slot], reduced.spin[world, slot])
        ahead = wp.normalize(wp.cross(place.axis, wp.vec3(0.0, 0.0, 1.0)))
        held = wp.matrix_from_cols(to_double(ahead), to_double(place.axis), to_double(wp.cross(ahead, place.axis)))
        half = wp.float64(0.5) * reduced.turn[world, slot]
        turn = wp.quatd(wp.float64(0.0), wp.sin(half), wp.float64(0.0), wp.cos(half))
        q = wp.normalize(state.body_rot[world, body] * wp.quat_from_matrix(held) * turn)
        shown = bodies[slot]
        state.body_x[world, shown] = moving.x
        state.body_rot[world, shown] = q
        state.body_v[world, shown] = moving.v
        state.body_omega[world, shown] = moving.omega_w
        state.body_omega_last[world, shown] = moving.omega_w
        state.body_v_low[world, shown] = wp.vec3()
        state.body_omega_low[world, shown] = wp.vec3()
        state.body_q[world, shown] = wp.transform(
            wp.vec3(float(moving.x[0]), float(moving.x[1]), float(moving.x[2])),
            wp.quat(float(q[0]), float(q[1]), float(q[2]), float(q[3])),
        )


@wp.kernel
def pose_wheels(
    # inputs
    worlds: WorldRange,
    vehicle: VehicleTables,
    t: ReducedTables,
    bodies: wp.array[int],  # (V · 4)
    vehicle_input: wp.array3d[float],
    reduced: ReducedState,
    # outputs
    state: StateArrays,
):
    """After a step; dim (W, V)."""
    index, number = wp.tid()
    put_wheels(worlds.first + index, number, vehicle, t, bodies, vehicle_input, reduced, state)


@wp.kernel
def pose_set_wheels(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    vehicle: VehicleTables,
    t: ReducedTables,
    bodies: wp.array[int],
    vehicle_input: wp.array3d[float],
    reduced: ReducedState,
    # outputs
    state: StateArrays,
):
    """Where somebody set the state of a world; dim (W, V)."""
    index, number = wp.tid()
    world = worlds.first + index
    if mask[world]:
        put_wheels(world, number, vehicle, t, bodies, vehicle_input, reduced, state)
