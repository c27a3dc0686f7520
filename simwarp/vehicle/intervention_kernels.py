"""What a test does to a driver's inputs from a moment on, in every world."""

from enum import IntEnum

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.piecewise_linear import bounded_value
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False})


class PedalUse(IntEnum):
    """What becomes of the driver's pedals."""

    DRIVER = 0
    RELEASED = 1
    HELD = 2


RELEASED = wp.constant(int(PedalUse.RELEASED))
HELD = wp.constant(int(PedalUse.HELD))


@wp.struct
class InterventionTables:
    """Constant data of interventions, shared by all worlds."""

    chassis: int
    reference: wp.vec3  # the vehicle's frame from the chassis' centre of mass, body axes [m]
    start: wp.array[int]  # CSR over the patterns, steering and braking of each intervention
    time: wp.array[float]  # since the intervention began [s]
    value: wp.array[float]  # shares of the world's amplitudes


@wp.struct
class InterventionRow:
    """One intervention."""

    patterns: int  # number of its steering's pattern; that of its brakes follows
    after: float  # earliest time of the simulation [s]
    steers: int  # 1: the steering is the held one and a pattern, 0: the driver's
    pedals: int  # PedalUse
    pause: float  # time of the pattern at which its clock stops [s]; negative: never
    calm: float  # roll rate below which it goes on [rad/s]


@wp.struct
class InterventionState:
    """State of an intervention, per world."""

    begun: wp.array[int]  # 1: it has begun
    since: wp.array[float]  # of the intervention, by the simulation [s]
    clock: wp.array[float]  # of the steering's pattern, which may pause [s]
    steering: wp.array[float]  # when it began
    throttle: wp.array[float]  # when it began


@wp.kernel
def intervene(
    # inputs
    worlds: WorldRange,
    dt: float,
    tables: InterventionTables,
    rows: wp.array[InterventionRow],  # (1 or W,)
    beyond: wp.array[float],  # (W,) least x of the vehicle's frame [m]
    steering: wp.array[float],  # (W,) factors of the steering's pattern
    braking: wp.array[float],  # (W,) factors of the brakes' pattern
    state: StateArrays,
    # outputs
    memory: InterventionState,
    vehicle_input: wp.array2d[float],
):
    """Overwrites steering, throttle and braking of the worlds in which the intervention has begun."""
    world = worlds.first + wp.tid()
    row = rows[world_row(world, rows.shape[0])]
    q = state.body_rot[world, tables.chassis]
    rotation = wp.quat(float(q[0]), float(q[1]), float(q[2]), float(q[3]))
    if memory.begun[world] == 0:
        offset = wp.quat_rotate(rotation, tables.reference)
        x = float(state.body_x[world, tables.chassis][0]) + offset[0]
        # half a step: time adds up rounded steps
        if float(state.world_time[world]) < row.after - 0.5 * dt or x < beyond[world]:
            return
        memory.begun[world] = 1
        memory.since[world] = 0.0
        memory.clock[world] = 0.0
        memory.steering[world] = vehicle_input[world, 0]
        memory.throttle[world] = vehicle_input[world, 1]
    clock = memory.clock[world]
    since = memory.since[world]
    if row.steers != 0:
        pattern = bounded_value(row.patterns, clock, tables.start, tables.time, tables.value)
        vehicle_input[world, 0] = wp.clamp(memory.steering[world] + steering[world] * pattern, -1.0, 1.0)
    if row.pedals == RELEASED:
        vehicle_input[world, 1] = 0.0
    elif row.pedals == HELD:
        vehicle_input[world, 1] = memory.throttle[world]
    if row.pedals != 0:
        brakes = bounded_value(row.patterns + 1, since, tables.start, tables.time, tables.value)
        vehicle_input[world, 2] = wp.clamp(braking[world] * brakes, 0.0, 1.0)
    memory.since[world] = since + dt
    if row.pause >= 0.0 and clock <= row.pause and clock + dt > row.pause:
        roll_rate = wp.dot(state.body_omega[world, tables.chassis], wp.quat_rotate(rotation, wp.vec3(1.0, 0.0, 0.0)))
        if wp.abs(roll_rate) >= row.calm:
            return
    memory.clock[world] = clock + dt
