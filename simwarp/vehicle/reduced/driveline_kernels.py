"""Engine, gears, differentials and brakes of a reduced vehicle: the speeds of its wheels over one step.

All shafts behind the gears turn as the wheels do, so that they are part of one constant inertia. The slip behind the
gears, clutches and brakes are found together, implicitly, by projected Gauss-Seidel.
"""

import warp as wp

from simwarp.vehicle.powertrain_kernels import (
    AUTOMATIC_SHAFTS,
    Member,
    Powertrain,
    PowertrainState,
    converter_torques,
    differential_share,
    drive_directly,
    engaged_gear,
    engine_torque,
    geared_torque,
    shifted_gear,
)
from simwarp.vehicle.reduced.reduced_tables_kernels import ReducedState, ReducedTables

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

SWEEPS = wp.constant(12)  # of Gauss-Seidel where brakes or clutches hold


@wp.struct
class Drive:
    """What the powertrain does in a step."""

    motor: float  # speeds of its shafts without slip behind the gears [rad/s]
    input: float
    ratio: float  # drive shaft's speed per input shaft's; 0: neutral, or no shafts
    clutch: float  # torque that a manual clutch bears [N·m]
    torque: float  # on the drive shaft [N·m]
    direct: float  # 1: the torque acts on the driveline as it is


@wp.struct
class Turned:
    """The wheels after a step."""

    speed: wp.vec4  # seen from the chassis [rad/s]
    brake: wp.vec4  # mean torque of the brakes on the wheels [N·m]


@wp.func
def run_engine(
    of: Member, dt: float, throttle: float, clutch: float, time: wp.float64, t: ReducedTables, powertrain: Powertrain,
    memory: PowertrainState, state: ReducedState,
) -> Drive:  # fmt: skip
    """Torques of engine and transmission, and the gear for this step; `memory` knows the drive shaft's speed."""
    result = Drive()
    if t.motor_inertia == 0.0:
        result.torque = drive_directly(of, throttle, time, powertrain, memory)
        result.direct = 1.0
        return result
    motor = state.motor_speed[of.world, of.vehicle]
    turbine = state.input_speed[of.world, of.vehicle]
    gear = engaged_gear(memory.gear[of.world, of.vehicle], powertrain)
    torque = engine_torque(throttle, motor, powertrain)
    passed = float(0.0)
    if powertrain.transmission == AUTOMATIC_SHAFTS:
        pair = converter_torques(motor, turbine, powertrain)
        result.motor = motor + dt * (torque + pair[0]) / t.motor_inertia
        result.input = turbine + dt * pair[1] / t.input_inertia
        passed = pair[1]
        gear = shifted_gear(of, turbine, time, powertrain, memory)
    else:
        result.motor = motor + dt * torque / t.motor_inertia
        result.input = turbine
        result.clutch = powertrain.clutch_limit * (1.0 - clutch)
        passed = wp.clamp(torque, -result.clutch, result.clutch)
    result.ratio = powertrain.ratio[gear + 1]
    result.torque = geared_torque(of, dt, passed, turbine, result.ratio, powertrain, memory)
    memory.engine_speed[of.world, of.vehicle] = motor
    memory.engine_torque[of.world, of.vehicle] = torque
    memory.drive_torque[of.world, of.vehicle] = result.torque
    return result


@wp.func
def biased(speed: wp.vec4, torque: float, t: ReducedTables, powertrain: Powertrain) -> wp.vec4:
    """What the differentials of a simple driveline take from one wheel and give to the other [N·m]."""
    result = wp.vec4()
    for axle in range(powertrain.split_count):
        left = powertrain.split_dof[axle, 0]
        right = powertrain.split_dof[axle, 1]
        part = torque * powertrain.split_share[axle] / powertrain.split_ratio[axle]
        more = (differential_share(speed[left], speed[right], powertrain.split_bias[axle]) - 0.5) * part
        if wp.abs(speed[left]) >= wp.abs(speed[right]):
            more = -more
        result[left] = more
        result[right] = -more
    return result


@wp.func
def turn_wheels(
    of: Member, dt: float, drive: Drive, speed: wp.vec4, torque: wp.vec4, caliper: wp.vec4, braking: float,
    lock: wp.array3d[float], t: ReducedTables, state: ReducedState,
) -> Turned:  # fmt: skip
    """Speeds of the wheels and of the powertrain's shafts after a step.

    Args:
        of: vehicle.
        dt: step [s].
        drive: of `run_engine`.
        speed: of the wheels at the start, seen from the chassis [rad/s].
        torque: on the wheels, but for the gears', brakes' and clutches' [N·m].
        caliper: speed of the brakes' calipers about the wheels' axes, seen from the chassis [rad/s].
        braking: 0..1.
        lock: (W, V, locks) 0..1.
        t: tables.
        state: whose shafts are turned.
    """
    u = speed + dt * (t.spin_compliance * torque)
    motor = drive.motor
    turbine = drive.input
    geared = t.motor_inertia > 0.0 and drive.ratio != 0.0
    answer = t.spin_compliance * t.drive
    give = 1.0 / wp.max(t.gear_damping * dt, 1.0e-12)
    share = float(0.0)
    friction = float(0.0)
    if t.motor_inertia > 0.0:
        share = 1.0 / (drive.ratio * drive.ratio / t.input_inertia + wp.dot(t.drive, answer) + give)
        friction = 1.0 / (1.0 / t.motor_inertia + 1.0 / t.input_inertia)
    gear_impulse = float(0.0)
    clutch_impulse = float(0.0)
    brakes = wp.vec4()
    clutches = wp.vec4()
    sweeps = int(1)
    if braking > 0.0 or t.locks > 0 or drive.clutch > 0.0:
        sweeps = SWEEPS
    for _ in range(sweeps):
        if geared:
            change = (drive.ratio * turbine - wp.dot(t.drive, u) - gear_impulse * give) * share
            gear_impulse += change
            turbine -= drive.ratio * change / t.input_inertia
            u += change * answer
        if drive.clutch > 0.0:
            most = drive.clutch * dt
            now = wp.clamp(clutch_impulse + (motor - turbine) * friction, -most, most)
            motor -= (now - clutch_impulse) / t.motor_inertia
            turbine += (now - clutch_impulse) / t.input_inertia
            clutch_impulse = now
        if braking > 0.0:
            for wheel in range(4):
                most = braking * t.brake_torque[wheel] * dt
                stop = (caliper[wheel] - u[wheel]) / t.spin_compliance[wheel, wheel]
                now = wp.clamp(brakes[wheel] + stop, -most, most)
                u += (now - brakes[wheel]) * t.spin_compliance[wheel]
                brakes[wheel] = now
        for each in range(t.locks):
            closed = wp.clamp(lock[of.world, of.vehicle, each], 0.0, 1.0)
            most = (t.lock_held[each] + closed * t.lock_torque[each]) * dt
            now = wp.clamp(clutches[each] - wp.dot(t.lock_row[each], u) * t.lock_inertia[each], -most, most)
            u += (now - clutches[each]) * t.lock_answer[each]
            clutches[each] = now
    if t.motor_inertia > 0.0:
        state.motor_speed[of.world, of.vehicle] = motor
        state.input_speed[of.world, of.vehicle] = turbine
    result = Turned()
    result.speed = u
    result.brake = brakes / dt
    return result
