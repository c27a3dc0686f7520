"""Engine, transmission and driveline torques of a vehicle, and its gear changes. Speeds are positive forwards."""

from enum import IntEnum

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.piecewise_linear import bounded_value

wp.set_module_options({"enable_backward": False})


class EngineKind(IntEnum):
    """Torque law of the engine."""

    NONE = 0
    SIMPLE = 1
    MAP = 2
    SHAFTS = 3


class TransmissionKind(IntEnum):
    """Transmission between the engine and the drive shaft."""

    NONE = 0
    AUTOMATIC_MAP = 1
    AUTOMATIC_SHAFTS = 2
    MANUAL_SHAFTS = 3
    CVT = 4


ENGINE_SIMPLE = wp.constant(int(EngineKind.SIMPLE))
ENGINE_MAP = wp.constant(int(EngineKind.MAP))
ENGINE_SHAFTS = wp.constant(int(EngineKind.SHAFTS))
AUTOMATIC_MAP = wp.constant(int(TransmissionKind.AUTOMATIC_MAP))
AUTOMATIC_SHAFTS = wp.constant(int(TransmissionKind.AUTOMATIC_SHAFTS))
MANUAL_SHAFTS = wp.constant(int(TransmissionKind.MANUAL_SHAFTS))
CVT = wp.constant(int(TransmissionKind.CVT))

CURVE_THROTTLE = wp.constant(0)
CURVE_IDLE = wp.constant(1)
CURVE_CAPACITY = wp.constant(2)
CURVE_RATIO = wp.constant(3)


@wp.struct
class Member:
    """One of a world's alike vehicles: its indices in the model are those of the first one, shifted."""

    world: int
    vehicle: int  # number in the world
    body: int  # shift of its bodies
    dof: int  # shift of its degrees of freedom
    coupling: int  # shift of its couplings


@wp.struct
class Powertrain:
    """Constant data, shared by all worlds; indices are those of the first vehicle. Curves: full throttle (or torque),
    zero throttle (or losses), capacity factor and torque ratio of the converter.
    """

    engine: int  # EngineKind
    transmission: int  # TransmissionKind
    motor_dof: int  # -1: the engine turns with the drive shaft
    input_dof: int
    drive_dof: int  # -1: a simple driveline
    slip_dof: int  # of a manual clutch, -1: none
    gear_coupling: int
    split_count: int
    gear_count: int  # forward gears
    max_torque: float
    max_power: float
    max_speed: float
    latency: float  # s
    clutch_limit: float  # N·m
    efficiency: float
    input_inertia: float  # kg·m²
    drive_inertia: float
    gear_reaction: float  # torque on the chassis about x per torque on the drive shaft
    shaft_reaction: float  # the same, of the driveline behind it
    wheel_reaction: float  # share of the wheels' torque that acts back on the chassis, of a simple driveline
    ratio_low: float  # of the CVT
    ratio_high: float
    speed_low: float
    speed_high: float

    curve_start: wp.array[int]  # CSR
    curve_x: wp.array[float]
    curve_y: wp.array[float]
    ratio: wp.array[float]  # reverse, neutral (0), forward gears
    shift_down: wp.array[float]  # rad/s, per forward gear
    shift_up: wp.array[float]
    split_dof: wp.array2d[int]  # (axles, 2): turn of the left and the right wheel
    split_share: wp.array[float]
    split_ratio: wp.array[float]
    split_bias: wp.array[float]


@wp.struct
class PowertrainState:
    """State and outputs of powertrains, (W, V) of V vehicles in each world."""

    gear: wp.array2d[int]  # -1 reverse, 0 neutral
    shift_time: wp.array2d[wp.float64]  # of the last gear change [s]
    engine_speed: wp.array2d[float]
    engine_torque: wp.array2d[float]
    drive_speed: wp.array2d[float]
    drive_torque: wp.array2d[float]
    last_input: wp.array2d[float]  # speeds one step ago [rad/s]
    last_drive: wp.array2d[float]


@wp.func
def curve_value(curve: int, x: float, powertrain: Powertrain) -> float:
    """One of the curves, constant beyond its ends."""
    return bounded_value(curve, x, powertrain.curve_start, powertrain.curve_x, powertrain.curve_y)


@wp.func
def engine_torque(throttle: float, speed: float, powertrain: Powertrain) -> float:
    """Torque on the motor shaft [N·m]."""
    torque = float(0.0)
    if powertrain.engine == ENGINE_SIMPLE:
        if speed < powertrain.max_speed:
            torque = throttle * wp.min(powertrain.max_torque, powertrain.max_power / wp.max(speed, 1.0e-3))
    elif powertrain.engine == ENGINE_MAP:
        w = wp.clamp(speed, 0.0, powertrain.max_speed)
        idle = curve_value(CURVE_IDLE, w, powertrain)
        torque = idle + throttle * (curve_value(CURVE_THROTTLE, w, powertrain) - idle)
    elif powertrain.engine == ENGINE_SHAFTS:
        torque = throttle * curve_value(CURVE_THROTTLE, speed, powertrain) + curve_value(CURVE_IDLE, speed, powertrain)
    return torque


@wp.func
def converter_torques(impeller: float, turbine: float, powertrain: Powertrain) -> wp.vec2:
    """Torques of a hydrodynamic converter on its impeller and its turbine [N·m].

    The impeller takes (speed / K)², the turbine gets this times the torque ratio; K and the ratio depend on the speed
    ratio. A turbine that overruns drives the impeller back without multiplication.
    """
    if impeller < 0.0:
        return wp.vec2()
    ratio = float(0.0)
    if impeller > 1.0e-8 and wp.abs(turbine) > 1.0e-8:
        ratio = turbine / impeller
    overrun = int(0)
    if ratio > 1.0:
        ratio = 2.0 - ratio
        overrun = 1
    ratio = wp.max(ratio, 0.0)
    share = impeller / curve_value(CURVE_CAPACITY, ratio, powertrain)
    torque = share * share
    if overrun == 1:
        return wp.vec2(torque, -torque)
    return wp.vec2(-torque, curve_value(CURVE_RATIO, ratio, powertrain) * torque)


@wp.func
def next_gear(gear: int, speed: float, elapsed: float, powertrain: Powertrain) -> int:
    """The forward gear for a speed of the shaft before the gears [rad/s]."""
    following = gear
    if gear >= 1 and elapsed >= powertrain.latency:
        if speed > powertrain.shift_up[gear - 1] and gear < powertrain.gear_count:
            following = gear + 1
        elif speed < powertrain.shift_down[gear - 1] and gear > 1:
            following = gear - 1
    return following


@wp.func
def engaged_gear(gear: int, powertrain: Powertrain) -> int:
    """What somebody wrote, held to the gears that there are."""
    return wp.clamp(gear, -1, powertrain.gear_count)


@wp.func
def engage(of: Member, ratio: float, powertrain: Powertrain, coefficient: wp.array3d[float]):
    """Sets the gears' viscous coupling to a ratio; neutral (0) couples nothing."""
    row = of.coupling + powertrain.gear_coupling
    if coefficient[of.world, row, 0] == ratio:
        return
    engaged = wp.where(ratio == 0.0, 0.0, -1.0)
    coefficient[of.world, row, 0] = ratio
    if powertrain.drive_dof >= 0:
        coefficient[of.world, row, 1] = engaged
    for axle in range(powertrain.split_count):
        part = 0.5 * powertrain.split_share[axle] / powertrain.split_ratio[axle]
        coefficient[of.world, row, 1 + 2 * axle] = engaged * part
        coefficient[of.world, row, 2 + 2 * axle] = engaged * part


@wp.func
def differential_share(slower: float, faster: float, max_bias: float) -> float:
    """Share of the torque that goes to the slower wheel of a biasing differential."""
    difference = wp.abs(faster) - wp.abs(slower)
    bias = 1.0 + (max_bias - 1.0) * wp.clamp((wp.abs(difference) - 0.25) / 0.25, 0.0, 1.0)
    return bias / (1.0 + bias)


@wp.func
def split_speed(of: Member, powertrain: Powertrain, state: StateArrays) -> float:
    """Speed of the drive shaft of a simple driveline [rad/s]."""
    speed = float(0.0)
    for axle in range(powertrain.split_count):
        left = state.joint_qd[of.world, of.dof + powertrain.split_dof[axle, 0]]
        right = state.joint_qd[of.world, of.dof + powertrain.split_dof[axle, 1]]
        speed += powertrain.split_share[axle] * 0.5 * (left + right) / powertrain.split_ratio[axle]
    return speed


@wp.func
def split_torque(
    of: Member, torque: float, even: float, powertrain: Powertrain, state: StateArrays, joint_force: wp.array2d[float]
):  # fmt: skip
    """The drive shaft's torque on the wheels of a simple driveline; `even`: each wheel's share of its axle's torque
    that the gears' coupling brings already, 0 or one half.
    """
    for axle in range(powertrain.split_count):
        left = of.dof + powertrain.split_dof[axle, 0]
        right = of.dof + powertrain.split_dof[axle, 1]
        part = torque * powertrain.split_share[axle] / powertrain.split_ratio[axle]
        w_left = state.joint_qd[of.world, left]
        w_right = state.joint_qd[of.world, right]
        slow = differential_share(w_left, w_right, powertrain.split_bias[axle])
        if wp.abs(w_left) < wp.abs(w_right):
            joint_force[of.world, left] = (slow - even) * part
            joint_force[of.world, right] = (1.0 - slow - even) * part
        else:
            joint_force[of.world, left] = (1.0 - slow - even) * part
            joint_force[of.world, right] = (slow - even) * part


@wp.func
def shifted_gear(
    of: Member, speed: float, time: wp.float64, powertrain: Powertrain, memory: PowertrainState
) -> int:  # fmt: skip
    """The gear of an automatic with shafts for a speed of the one before the gears [rad/s]; it is engaged."""
    elapsed = float(time - memory.shift_time[of.world, of.vehicle])
    gear = next_gear(engaged_gear(memory.gear[of.world, of.vehicle], powertrain), speed, elapsed, powertrain)
    if gear != memory.gear[of.world, of.vehicle]:
        memory.gear[of.world, of.vehicle] = gear
        memory.shift_time[of.world, of.vehicle] = time
    return gear


@wp.func
def geared_torque(
    of: Member, dt: float, torque: float, speed: float, ratio: float, powertrain: Powertrain, memory: PowertrainState
) -> float:
    """Torque on the drive shaft, of one on the input shaft, which turns with `speed` [rad/s]; none in neutral [N·m]."""
    onward = float(0.0)
    if ratio != 0.0:
        # what accelerates the input shaft does not reach the drive shaft
        change = powertrain.input_inertia * (speed - memory.last_input[of.world, of.vehicle]) / dt
        onward = (torque - change) / ratio
    memory.last_input[of.world, of.vehicle] = speed
    return onward


@wp.func
def drive_shafts(
    of: Member, dt: float, throttle: float, clutch: float, time: wp.float64, powertrain: Powertrain,
    memory: PowertrainState, parameters: Parameters, state: StateArrays, joint_force: wp.array2d[float],
):  # fmt: skip
    """Transmissions with shafts of their own: torques on motor and input shaft, gears as a coupling."""
    motor_speed = state.joint_qd[of.world, of.dof + powertrain.motor_dof]
    input_speed = state.joint_qd[of.world, of.dof + powertrain.input_dof]
    torque = engine_torque(throttle, motor_speed, powertrain)
    drive_torque = float(0.0)
    if powertrain.transmission == AUTOMATIC_SHAFTS:
        pair = converter_torques(motor_speed, input_speed, powertrain)
        joint_force[of.world, of.dof + powertrain.motor_dof] = torque + pair[0]
        joint_force[of.world, of.dof + powertrain.input_dof] = pair[1]
        drive_torque = pair[1]
        shifted_gear(of, input_speed, time, powertrain, memory)
    else:
        joint_force[of.world, of.dof + powertrain.motor_dof] = torque
        limit = powertrain.clutch_limit * (1.0 - clutch)
        parameters.joint_friction[of.world, of.dof + powertrain.slip_dof] = limit
        drive_torque = wp.clamp(torque, -limit, limit)
    ratio = powertrain.ratio[engaged_gear(memory.gear[of.world, of.vehicle], powertrain) + 1]
    engage(of, ratio, powertrain, parameters.coupling_coefficient)
    drive_torque = geared_torque(of, dt, drive_torque, input_speed, ratio, powertrain, memory)
    split_torque(of, drive_torque, 0.5, powertrain, state, joint_force)
    memory.engine_speed[of.world, of.vehicle] = motor_speed
    memory.engine_torque[of.world, of.vehicle] = torque
    memory.drive_torque[of.world, of.vehicle] = drive_torque


@wp.func
def drive_directly(
    of: Member, throttle: float, time: wp.float64, powertrain: Powertrain, memory: PowertrainState
) -> float:  # fmt: skip
    """Transmissions whose engine turns with the drive shaft: the torque on that, and the gear for the next step."""
    speed = memory.drive_speed[of.world, of.vehicle]
    gear = engaged_gear(memory.gear[of.world, of.vehicle], powertrain)
    ratio = powertrain.ratio[gear + 1]
    efficiency = float(1.0)
    if powertrain.transmission == CVT:
        part = (wp.abs(speed) - powertrain.speed_low) / (powertrain.speed_high - powertrain.speed_low)
        forward = powertrain.ratio_low + wp.clamp(part, 0.0, 1.0) * (powertrain.ratio_high - powertrain.ratio_low)
        ratio = float(gear) * forward
        efficiency = powertrain.efficiency
    motor_speed = float(0.0)
    torque = float(0.0)
    drive_torque = float(0.0)
    if ratio != 0.0:
        motor_speed = wp.abs(speed / ratio)
        torque = engine_torque(throttle, motor_speed, powertrain)
        if speed / ratio < 0.0 and torque < 0.0:
            torque = -torque  # losses oppose an engine that the wheels turn backwards
        drive_torque = efficiency * torque / ratio
    if powertrain.transmission == AUTOMATIC_MAP:
        memory.gear[of.world, of.vehicle] = next_gear(gear, motor_speed, float(time), powertrain)
    memory.engine_speed[of.world, of.vehicle] = motor_speed
    memory.engine_torque[of.world, of.vehicle] = torque
    memory.drive_torque[of.world, of.vehicle] = drive_torque
    return drive_torque


@wp.func
def chassis_reaction(of: Member, dt: float, powertrain: Powertrain, memory: PowertrainState) -> wp.vec3:
    """Torque of this step's drive torque on the chassis in its own axes, beside that of the wheels [N·m]."""
    torque = memory.drive_torque[of.world, of.vehicle]
    speed = memory.drive_speed[of.world, of.vehicle]
    onward = torque - powertrain.drive_inertia * (speed - memory.last_drive[of.world, of.vehicle]) / dt
    memory.last_drive[of.world, of.vehicle] = speed
    rolling = powertrain.gear_reaction * torque + powertrain.shaft_reaction * onward
    pitching = float(0.0)
    for axle in range(powertrain.split_count):
        pitching += torque * powertrain.split_share[axle] / powertrain.split_ratio[axle]
    return wp.vec3(rolling, (1.0 - powertrain.wheel_reaction) * pitching, 0.0)


@wp.func
def run_powertrain(
    of: Member, dt: float, throttle: float, clutch: float, powertrain: Powertrain, memory: PowertrainState,
    parameters: Parameters, control: ControlArrays, state: StateArrays,
) -> wp.vec3:  # fmt: skip
    """Torques of this step into `element_joint_force`, and the gear for it; returns a torque on the chassis in its own
    axes.

    In a closed balance it is zero: shafts turn in the chassis, so that the torques between them cancel, and what drives
    the wheels acts back on it through their relative rotations. The reactions stand for arrangements that are described
    by no body of their own, such as a counter-rotating driveline.
    """
    if powertrain.drive_dof >= 0:
        memory.drive_speed[of.world, of.vehicle] = state.joint_qd[of.world, of.dof + powertrain.drive_dof]
    else:
        memory.drive_speed[of.world, of.vehicle] = split_speed(of, powertrain, state)
    if powertrain.engine == 0:
        return wp.vec3()
    time = state.world_time[of.world]
    if powertrain.motor_dof >= 0:
        drive_shafts(of, dt, throttle, clutch, time, powertrain, memory, parameters, state, control.element_joint_force)
    else:
        direct = drive_directly(of, throttle, time, powertrain, memory)
        if powertrain.drive_dof >= 0:
            control.element_joint_force[of.world, of.dof + powertrain.drive_dof] = direct
        else:
            split_torque(of, direct, 0.0, powertrain, state, control.element_joint_force)
    return chassis_reaction(of, dt, powertrain, memory)
