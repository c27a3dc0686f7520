"""Engine, gears, differentials and brakes of a reduced vehicle: the speeds of its wheels over one step.

All shafts behind the gears turn as the wheels do, so that they are part of one constant inertia. The slip behind the
gears, clutches and brakes are found together, implicitly, by projected Gauss-Seidel.
"""

import warp as wp

from simwarp.vehicle.powertrain_kernels import (
    AUTOMATIC_MAP,
    AUTOMATIC_SHAFTS,
    CVT,
    Member,
    Powertrain,
    PowertrainState,
    converter_torques,
    differential_share,
    engaged_gear,
    engine_torque,
    next_gear,
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
    of: Member, dt: float, throttle: float, clutch: float, drive_speed: float, time: wp.float64, t: ReducedTables,
    powertrain: Powertrain, memory: PowertrainState, state: ReducedState,
) -> Drive:  # fmt: skip
    """Torques of engine and transmission, and the gear for this step."""
    result = Drive()
    gear = engaged_gear(memory.gear[of.world, of.vehicle], powertrain)
    torque = float(0.0)
    if t.motor_inertia > 0.0:
        motor = state.motor_speed[of.world, of.vehicle]
        turbine = state.input_speed[of.world, of.vehicle]
        torque = engine_torque(throttle, motor, powertrain)
        passed = float(0.0)
        if powertrain.transmission == AUTOMATIC_SHAFTS:
            pair = converter_torques(motor, turbine, powertrain)
            result.motor = motor + dt * (torque + pair[0]) / t.motor_inertia
            result.input = turbine + dt * pair[1] / t.input_inertia
            passed = pair[1]
            elapsed = float(time - memory.shift_time[of.world, of.vehicle])
            gear = next_gear(gear, turbine, elapsed, powertrain)
            if gear != memory.gear[of.world, of.vehicle]:
                memory.gear[of.world, of.vehicle] = gear
                memory.shift_time[of.world, of.vehicle] = time
        else:
            result.motor = motor + dt * torque / t.motor_inertia
            result.input = turbine
            result.clutch = powertrain.clutch_limit * (1.0 - clutch)
            passed = wp.clamp(torque, -result.clutch, result.clutch)
        result.ratio = powertrain.ratio[gear + 1]
        if result.ratio != 0.0:
            # what accelerates the input shaft does not reach the drive shaft
            change = powertrain.input_inertia * (turbine - memory.last_input[of.world, of.vehicle]) / dt
            result.torque = (passed - change) / result.ratio
        memory.last_input[of.world, of.vehicle] = turbine
        memory.engine_speed[of.world, of.vehicle] = motor
    else:
        ratio = powertrain.ratio[gear + 1]
        efficiency = float(1.0)
        if powertrain.transmission == CVT:
            part = (wp.abs(drive_speed) - powertrain.speed_low) / (powertrain.speed_high - powertrain.speed_low)
            forward = powertrain.ratio_low + wp.clamp(part, 0.0, 1.0) * (powertrain.ratio_high - powertrain.ratio_low)
            ratio = float(gear) * forward
            efficiency = powertrain.efficiency
        motor_speed = float(0.0)
        if ratio != 0.0:
            motor_speed = wp.abs(drive_speed / ratio)
            torque = engine_torque(throttle, motor_speed, powertrain)
            if drive_speed / ratio < 0.0 and torque < 0.0:
                torque = -torque  # losses oppose an engine that the wheels turn backwards
            result.torque = efficiency * torque / ratio
        result.direct = 1.0
        if powertrain.transmission == AUTOMATIC_MAP:
            memory.gear[of.world, of.vehicle] = next_gear(gear, motor_speed, float(time), powertrain)
        memory.engine_speed[of.world, of.vehicle] = motor_speed
    memory.engine_torque[of.world, of.vehicle] = torque
    memory.drive_torque[of.world, of.vehicle] = result.torque
    return result


@wp.func
def reaction(
    of: Member, dt: float, torque: float, speed: float, powertrain: Powertrain, memory: PowertrainState
) -> wp.vec3:
    """Torque of the powertrain on the chassis, in its axes, beside that of the wheels (powertrain_kernels.py)."""
    onward = torque - powertrain.drive_inertia * (speed - memory.last_drive[of.world, of.vehicle]) / dt
    memory.last_drive[of.world, of.vehicle] = speed
    pitching = float(0.0)
    for axle in range(powertrain.split_count):
        pitching += torque * powertrain.split_share[axle] / powertrain.split_ratio[axle]
    rolling = powertrain.gear_reaction * torque + powertrain.shaft_reaction * onward
    return wp.vec3(rolling, (1.0 - powertrain.wheel_reaction) * pitching, 0.0)


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
            row = t.lock_row[each]
            held = t.spin_compliance * row
            closed = wp.clamp(lock[of.world, of.vehicle, each], 0.0, 1.0)
            most = (t.lock_held[each] + closed * t.lock_torque[each]) * dt
            now = wp.clamp(clutches[each] - wp.dot(row, u) / wp.dot(row, held), -most, most)
            u += (now - clutches[each]) * held
            clutches[each] = now
    if t.motor_inertia > 0.0:
        state.motor_speed[of.world, of.vehicle] = motor
        state.input_speed[of.world, of.vehicle] = turbine
    result = Turned()
    result.speed = u
    result.brake = brakes / dt
    return result
