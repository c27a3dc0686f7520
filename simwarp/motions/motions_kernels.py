"""Motion functions of time on the device, and what they drive before each sub-step.

All functions of a run stand in one tape of instructions. An instruction has an operation, the place of its first
number, and a count or the place of another instruction. Instructions push triples (value, rate, acceleration) on a
stack, or replace its last two by their sum or product. `SEQUENCE` and `REPEAT` push the time and set that of a part;
`LEAVE`, after the part, brings it back. Everything is float64, so that late times keep their differences.
"""

import warp as wp

from simwarp.core.types import DriveMode
from simwarp.kernels.core.fields import ControlArrays, StateArrays
from simwarp.kernels.core.piecewise_linear import segment_of
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.core.world_status import NON_FINITE
from simwarp.kernels.dynamics.efforts import POSITION, PRESCRIBED_POSITION

wp.set_module_options({"enable_backward": False})

END = wp.constant(0)
LINEAR = wp.constant(1)
SINE = wp.constant(2)
CONSTANT_ACCELERATION = wp.constant(3)
POLYNOMIAL_345 = wp.constant(4)
SPLINE = wp.constant(5)
SAMPLES = wp.constant(6)
ADD = wp.constant(7)
MULTIPLY = wp.constant(8)
SEQUENCE = wp.constant(9)
REPEAT = wp.constant(10)
JUMP = wp.constant(11)
LEAVE = wp.constant(12)
FORCE = wp.constant(int(DriveMode.NONE))
ONE = wp.constant(wp.float64(1.0))
HALF = wp.constant(wp.float64(0.5))
FULL_TURN = wp.constant(wp.float64(2.0 * wp.pi))


@wp.struct
class MotionTape:
    """Instructions of all functions, and their numbers in every world."""

    code: wp.array2d[int]  # (instructions, 3): operation, first number, count or instruction
    numbers: wp.array2d[wp.float64]  # (1 or W, numbers)
    stack: wp.array2d[wp.vec3d]  # (W, depth)


@wp.struct
class MotionTables:
    """What `M` functions drive, shared by all worlds."""

    start: wp.array[int]  # first instruction
    dof: wp.array[int]  # coordinate, -1: none
    mode: wp.array[int]  # DriveMode of the coordinate; NONE: a force along it
    body: wp.array[int]  # that a wrench acts on, -1: none
    force: wp.array[wp.vec3]  # times the function
    torque: wp.array[wp.vec3]
    point: wp.array[wp.vec3]  # of the force, from the body's centre of mass, body axes [m]
    turning: wp.array[int]  # 1: force and torque are in body axes
    own_dof: wp.array[int]  # entries of efforts that are set to zero first
    own_body: wp.array[int]


@wp.func
def sine(row: int, first: int, t: wp.float64, tape: MotionTape) -> wp.vec3d:
    """Amplitude, frequency [Hz], phase [rad]."""
    amplitude = tape.numbers[row, first]
    omega = FULL_TURN * tape.numbers[row, first + 1]
    angle = omega * t + tape.numbers[row, first + 2]
    s = amplitude * wp.sin(angle)
    return wp.vec3d(s, amplitude * omega * wp.cos(angle), -omega * omega * s)


@wp.func
def constant_acceleration(row: int, first: int, t: wp.float64, tape: MotionTape) -> wp.vec3d:
    """Rise, duration, and the shares of it that speed up and slow down."""
    zero = wp.float64(0.0)
    rise = tape.numbers[row, first]
    duration = tape.numbers[row, first + 1]
    starting = tape.numbers[row, first + 2] * duration
    stopping = tape.numbers[row, first + 3] * duration
    speed = rise / (duration - HALF * (starting + stopping))
    if t <= zero:
        return wp.vec3d(zero, zero, zero)
    if t < starting:
        a = speed / starting
        return wp.vec3d(HALF * a * t * t, a * t, a)
    left = duration - t
    if left > stopping:
        return wp.vec3d(speed * (t - HALF * starting), speed, zero)
    if left > zero:
        a = speed / stopping
        return wp.vec3d(rise - HALF * a * left * left, a * left, -a)
    return wp.vec3d(rise, zero, zero)


@wp.func
def polynomial_345(row: int, first: int, t: wp.float64, tape: MotionTape) -> wp.vec3d:
    """Rise and duration: h (10 x³ - 15 x⁴ + 6 x⁵), x = t / duration from 0 to 1."""
    rise = tape.numbers[row, first]
    duration = tape.numbers[row, first + 1]
    x = wp.clamp(t / duration, wp.float64(0.0), ONE)
    y = ONE - x
    value = x * x * x * (wp.float64(10.0) + x * (wp.float64(6.0) * x - wp.float64(15.0)))
    rate = wp.float64(30.0) * x * x * y * y / duration
    acceleration = wp.float64(60.0) * x * y * (y - x) / (duration * duration)
    return wp.vec3d(rise * value, rise * rate, rise * acceleration)


@wp.func
def spline(row: int, first: int, count: int, t: wp.float64, tape: MotionTape) -> wp.vec3d:
    """Knots, then four coefficients of each piece, highest power first; straight on beyond the ends."""
    inside = wp.clamp(t, tape.numbers[row, first], tape.numbers[row, first + count - 1])
    piece = segment_of(tape.numbers[row], first, count, 1, inside)
    x = inside - tape.numbers[row, first + piece]
    at = first + count + 4 * piece
    a = tape.numbers[row, at]
    b = tape.numbers[row, at + 1]
    c = tape.numbers[row, at + 2]
    value = ((a * x + b) * x + c) * x + tape.numbers[row, at + 3]
    rate = (wp.float64(3.0) * a * x + wp.float64(2.0) * b) * x + c
    acceleration = wp.float64(6.0) * a * x + wp.float64(2.0) * b
    if inside != t:
        return wp.vec3d(value + rate * (t - inside), rate, wp.float64(0.0))
    return wp.vec3d(value, rate, acceleration)


@wp.func
def samples(row: int, first: int, count: int, t: wp.float64, tape: MotionTape) -> wp.vec3d:
    """Start, interval, then values, between which it is linear; constant beyond the ends."""
    zero = wp.float64(0.0)
    interval = tape.numbers[row, first + 1]
    last = wp.float64(count - 1)
    x = (t - tape.numbers[row, first]) / interval
    inside = wp.clamp(x, zero, last)
    piece = wp.min(int(inside), count - 2)
    y = tape.numbers[row, first + 2 + piece]
    step = tape.numbers[row, first + 3 + piece] - y
    rate = step / interval
    if x < zero or x >= last:
        rate = zero
    return wp.vec3d(y + step * (inside - wp.float64(piece)), rate, zero)


@wp.func
def product(f: wp.vec3d, g: wp.vec3d) -> wp.vec3d:
    """Of two functions, with its derivatives."""
    return wp.vec3d(f[0] * g[0], f[1] * g[0] + f[0] * g[1], f[2] * g[0] + wp.float64(2.0) * f[1] * g[1] + f[0] * g[2])


@wp.func
def leaf(operation: int, row: int, first: int, count: int, t: wp.float64, tape: MotionTape) -> wp.vec3d:
    """Value, rate and acceleration of a function without parts."""
    if operation == SINE:
        return sine(row, first, t, tape)
    if operation == CONSTANT_ACCELERATION:
        return constant_acceleration(row, first, t, tape)
    if operation == POLYNOMIAL_345:
        return polynomial_345(row, first, t, tape)
    if operation == SPLINE:
        return spline(row, first, count, t, tape)
    if operation == SAMPLES:
        return samples(row, first, count, t, tape)
    rate = tape.numbers[row, first + 1]
    return wp.vec3d(tape.numbers[row, first] + rate * t, rate, wp.float64(0.0))


@wp.func
def evaluate(start: int, row: int, place: int, time: wp.float64, tape: MotionTape) -> wp.vec3d:
    """Value, rate and acceleration at a time [s] of the function that begins at instruction `start`.

    `row` is that of its numbers, `place` that of its stack.
    """
    t = time
    zero = wp.float64(0.0)
    at = int(start)
    top = int(-1)
    operation = tape.code[at, 0]
    while operation != END:
        first = tape.code[at, 1]
        other = tape.code[at, 2]
        at += 1
        if operation == ADD or operation == MULTIPLY:
            f = tape.stack[place, top - 1]
            g = tape.stack[place, top]
            top -= 1
            if operation == ADD:
                tape.stack[place, top] = f + g
            else:
                tape.stack[place, top] = product(f, g)
        elif operation == JUMP:
            at = other
        elif operation == LEAVE:
            top -= 1
            t = tape.stack[place, top][0]
            tape.stack[place, top] = tape.stack[place, top + 1]
            at = other
        elif operation == SEQUENCE or operation == REPEAT:
            top += 1
            tape.stack[place, top] = wp.vec3d(t, zero, zero)
            if operation == REPEAT:
                period = tape.numbers[row, first]
                t = t - wp.floor(t / period) * period
            else:
                part = int(0)
                while part < other - 1 and t >= tape.numbers[row, first + part]:
                    t = t - tape.numbers[row, first + part]
                    part += 1
                at += part
        else:
            top += 1
            tape.stack[place, top] = leaf(operation, row, first, other, t, tape)
        operation = tape.code[at, 0]
    return tape.stack[place, top]


@wp.kernel
def evaluate_times(
    # inputs
    start: int,
    times: wp.array2d[wp.float64],  # (1 or R, n)
    tape: MotionTape,
    # outputs
    values: wp.array2d[wp.vec3d],  # (R, n)
):
    """A function at many times, for each row of its numbers; dim (R, n), with a stack for each."""
    row, index = wp.tid()
    time = times[world_row(row, times.shape[0]), index]
    numbers = world_row(row, tape.numbers.shape[0])
    values[row, index] = evaluate(start, numbers, row * times.shape[1] + index, time, tape)


@wp.func
def value_at(motion: int, world: int, time: wp.float64, tables: MotionTables, tape: MotionTape) -> wp.vec3d:
    """Value, rate and acceleration of a function in a world."""
    return evaluate(tables.start[motion], world_row(world, tape.numbers.shape[0]), world, time, tape)


@wp.func
def set_target(
    motion: int, world: int, dof: int, time: wp.float64, h: wp.float64, tables: MotionTables, tape: MotionTape,
    control: ControlArrays,
):  # fmt: skip
    """Target of a coordinate's drive: position and rate, or a speed, at the sub-step's end.

    A prescribed position gets the one at its start. The rate is the difference quotient to the end, from the target as
    float32 holds it: what the step's correction misses for that reason, the rate brings.
    """
    mode = tables.mode[motion]
    end = value_at(motion, world, time + h, tables, tape)
    if mode == PRESCRIBED_POSITION:
        target = float(value_at(motion, world, time, tables, tape)[0])
        control.joint_target_q[world, dof] = target
        control.joint_target_qd[world, dof] = float((end[0] - wp.float64(target)) / h)
    elif mode == POSITION:
        control.joint_target_q[world, dof] = float(end[0])
        control.joint_target_qd[world, dof] = float(end[1])
    else:
        control.joint_target_qd[world, dof] = float(end[0])


@wp.func
def add_wrench(
    motion: int, world: int, body: int, factor: float, tables: MotionTables, state: StateArrays, control: ControlArrays
):
    """Adds the wrench of a body, in world axes about its centre of mass."""
    rotation = state.body_rot[world, body]
    axes = wp.quat(float(rotation[0]), float(rotation[1]), float(rotation[2]), float(rotation[3]))
    force = factor * tables.force[motion]
    torque = factor * tables.torque[motion]
    if tables.turning[motion] == 1:
        force = wp.quat_rotate(axes, force)
        torque = wp.quat_rotate(axes, torque)
    arm = wp.quat_rotate(axes, tables.point[motion])
    control.element_force[world, body] = control.element_force[world, body] + force
    control.element_torque[world, body] = control.element_torque[world, body] + torque + wp.cross(arm, force)


@wp.func
def drive_world(
    world: int, dt: float, tables: MotionTables, tape: MotionTape, state: StateArrays, control: ControlArrays
):
    """Targets, forces and wrenches of all functions for a sub-step that begins at the world's time."""
    time = state.world_time[world]
    for index in range(tables.own_dof.shape[0]):
        control.element_joint_force[world, tables.own_dof[index]] = 0.0
    for index in range(tables.own_body.shape[0]):
        control.element_force[world, tables.own_body[index]] = wp.vec3()
        control.element_torque[world, tables.own_body[index]] = wp.vec3()
    for motion in range(tables.start.shape[0]):
        dof = tables.dof[motion]
        body = tables.body[motion]
        if dof >= 0 and tables.mode[motion] != FORCE:
            set_target(motion, world, dof, time, wp.float64(dt), tables, tape, control)
        elif dof >= 0 or body >= 0:
            factor = float(value_at(motion, world, time, tables, tape)[0])
            if dof >= 0:
                control.element_joint_force[world, dof] = control.element_joint_force[world, dof] + factor
            else:
                add_wrench(motion, world, body, factor, tables, state, control)


@wp.kernel
def drive_motions(
    # inputs
    worlds: WorldRange,
    dt: float,
    tables: MotionTables,
    tape: MotionTape,
    state: StateArrays,
    # outputs
    control: ControlArrays,
):
    """Before a sub-step; frozen worlds stay as they are."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) == 0:
        drive_world(world, dt, tables, tape, state, control)


@wp.kernel
def publish_motions(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    dt: float,
    tables: MotionTables,
    tape: MotionTape,
    state: StateArrays,
    # outputs
    control: ControlArrays,
):
    """Where the state of worlds was set: whoever sets rates next finds the targets of their time."""
    world = worlds.first + wp.tid()
    if mask[world]:
        drive_world(world, dt, tables, tape, state, control)


@wp.kernel
def write_signal(
    # inputs
    worlds: WorldRange,
    motion: int,
    column: int,
    tables: MotionTables,
    tape: MotionTape,
    state: StateArrays,
    # outputs
    signal: wp.array2d[float],  # (W, ...)
):
    """The value of a function in a column of an array, before a sub-step."""
    world = worlds.first + wp.tid()
    signal[world, column] = float(value_at(motion, world, state.world_time[world], tables, tape)[0])
