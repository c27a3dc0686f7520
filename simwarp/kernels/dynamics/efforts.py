"""Efforts on coordinates, linearised for an implicit step: impulse = effort - gain x rate at its end.

Along one coordinate: with h the step, u0 and u the rates before and after it, k and d the slopes of a spring and a
damper, and f their effort at the step's start, -d u0 included. Positions belong to steps, rates to their middle:
q⁺ = q + h u. Hence u0 and u lie half a step before and after q, and with zeta = `numerical_damping` and
beta = `spring_average` = max(0, (1 - 2 zeta) / 4)

    impulse = h (f - d (1 + zeta)/2 (u - u0) - beta h k (u - u0) - zeta h k u)
    gain    = armature + h (1 + zeta)/2 d + h² (beta + zeta) k
    effort  = armature u0 + h (f + d u0) + start u0,    start = h² beta k - h (1 - zeta)/2 d

zeta = 1 is backward Euler on spring and damper, zeta = 0 the trapezoidal rule, of second order; both are stable however
stiff these are, with all between (docs/integrators.md has the derivation). Drives follow the same rule, but for those
of rotations. Rates that the
last step published are along the axes of its start; the last u0 of `effort` is measured along those of now.

On a rotation (of a ball joint, a bushing or a floating body), whose rotation vector is no coordinate that forces act
along: an effort proportional to its components would be the gradient of no energy. Each spring has a potential
U_i(theta_i) of the relative rotation theta = log(R R0^T), in axes of frame 0, where R turns frame 0 into frame 1 and
R0 = exp(rest). With u_i = -dU_i/dtheta_i the torque on frame 1 is the gradient J_r(theta)^-1 u (Chirikjian 2012,
section 10.8, for the inverse Jacobian of the logarithm). A drive is the same with its target for the rest. Damping,
armature and applied torques act on the relative angular velocity itself.
"""

import warp as wp

from simwarp.core.types import DriveMode, JointType
from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.piecewise_linear import segment_of
from simwarp.kernels.core.tables import StepConfig, Topology, world_row
from simwarp.kernels.core.vector_math import rotation_vector_of
from simwarp.kernels.dynamics.joints import ANGLE0

wp.set_module_options({"enable_backward": False})

POSITION = wp.constant(int(DriveMode.POSITION))
PRESCRIBED_POSITION = wp.constant(int(DriveMode.PRESCRIBED_POSITION))
PRESCRIBED_SPEED = wp.constant(int(DriveMode.PRESCRIBED_SPEED))
INFINITE_EFFORT = wp.constant(1.0e30)
TURNS = wp.constant(
    sum(1 << int(kind) for kind in (JointType.SPHERICAL, JointType.BUSHING, JointType.FREE))
)  # one bit for each type of joint whose last three coordinates are a rotation vector
LEAST_PIVOT = wp.constant(wp.float64(1.0e-12))  # of a gain, relative to the largest: some thousand roundings


@wp.struct
class ImplicitEffort:
    """gamma = -gain u + effort + start u0 [N·s or N·m·s]; `change` is effort + (start - gain) u0, in which the
    armature's momentum, larger than all else in a short step, has cancelled before it is rounded.
    """

    gain: float
    effort: float
    change: float
    start: float


@wp.func
def damping_weight(config: StepConfig) -> float:
    """Share of a damper's slope over the rate that counts after the step; the rest counts before it."""
    return 0.5 + 0.5 * config.numerical_damping


@wp.func
def stiffness_weight(config: StepConfig) -> float:
    """Share of a spring's slope in the gain."""
    return config.spring_average + config.numerical_damping


@wp.func
def start_gain(stiffness: float, damping: float, config: StepConfig) -> float:
    """Impulse per rate before the step, beyond that of backward Euler."""
    dt = config.dt
    return dt * (dt * (config.spring_average * stiffness) - (1.0 - damping_weight(config)) * damping)


@wp.func
def effort_bounds(dof: int, world: int, parameters: Parameters) -> wp.vec2:
    """Least and largest effort of a drive [N or N·m], at `INFINITE_EFFORT` where it has no limit."""
    upper = parameters.drive_effort_limit[world_row(world, parameters.drive_effort_limit.shape[0]), dof]
    lower = parameters.drive_effort_lower[world_row(world, parameters.drive_effort_lower.shape[0]), dof]
    if lower > 0.0:
        lower = -upper
    return wp.vec2(lower, upper)


@wp.func
def is_bounded(bounds: wp.vec2) -> bool:
    """True if an effort has a limit, at least on one side."""
    return bounds[0] > -INFINITE_EFFORT or bounds[1] < INFINITE_EFFORT


@wp.func
def table_segment(table: int, x: wp.float64, topology: Topology) -> int:
    """Index of the first point of the segment that holds `x` (the end segments extrapolate)."""
    start = topology.table_start[table]
    return start + segment_of(topology.table_x, start, topology.table_start[table + 1] - start, 1, x)


@wp.func
def table_slope(segment: int, topology: Topology) -> wp.float64:
    """Slope of a segment."""
    return (topology.table_y[segment + 1] - topology.table_y[segment]) / (
        topology.table_x[segment + 1] - topology.table_x[segment]
    )


@wp.func
def table_value(table: int, x: wp.float64, topology: Topology) -> wp.float64:
    """Piecewise linear value at `x`; float64, so that late times keep their differences."""
    segment = table_segment(table, x, topology)
    return topology.table_y[segment] + table_slope(segment, topology) * (x - topology.table_x[segment])


@wp.func
def table_work(table: int, x: wp.float64, topology: Topology) -> wp.float64:
    """Integral of the values from the first point to `x`."""
    segment = table_segment(table, x, topology)
    half = wp.float64(0.5)
    total = wp.float64(0.0)
    for point in range(topology.table_start[table], segment):
        width = topology.table_x[point + 1] - topology.table_x[point]
        total += half * width * (topology.table_y[point] + topology.table_y[point + 1])
    return total + half * (x - topology.table_x[segment]) * (
        topology.table_y[segment] + table_value(table, x, topology)
    )


@wp.func
def map_resistance(places: int, q: wp.float64, qd: wp.float64, topology: Topology) -> wp.vec2:
    """Force of a damper map and its slope over the rate; `places` is the table of its tables."""
    point = table_segment(places, q, topology)
    part = (q - topology.table_x[point]) / (topology.table_x[point + 1] - topology.table_x[point])
    share = wp.clamp(part, wp.float64(0.0), wp.float64(1.0))
    lower = int(topology.table_y[point])
    upper = int(topology.table_y[point + 1])
    keep = wp.float64(1.0) - share
    force = keep * table_value(lower, qd, topology) + share * table_value(upper, qd, topology)
    slope = keep * table_slope(table_segment(lower, qd, topology), topology)
    slope += share * table_slope(table_segment(upper, qd, topology), topology)
    return wp.vec2(float(force), float(slope))


@wp.func
def applied_effort(world: int, dof: int, control: ControlArrays) -> float:
    """Effort along a coordinate from the user and from the model's force elements [N or N·m]."""
    return (
        control.joint_force[world, dof]
        + control.element_joint_force[world_row(world, control.element_joint_force.shape[0]), dof]
    )


@wp.struct
class PassiveLaw:
    """Spring and damper of a coordinate [N or N·m], with their slopes over the stretch and the rate, not negative."""

    spring: float
    stiffness: float
    damper: float
    damping: float


@wp.func
def passive_law(
    dof: int, world: int, q: float, qd: float, stretch: float, topology: Topology, parameters: Parameters
) -> PassiveLaw:
    """Spring and damper, where the spring is stretched by `stretch`: linear, or by table, of which `joint_stiffness` or
    `joint_damping` is the factor.
    """
    law = PassiveLaw()
    k = parameters.joint_stiffness[world_row(world, parameters.joint_stiffness.shape[0]), dof]
    d = parameters.joint_damping[world_row(world, parameters.joint_damping.shape[0]), dof]
    law.spring = -k * stretch
    law.damper = -d * qd
    if topology.dof_table[dof, 0] >= 0:
        table = topology.dof_table[dof, 0]
        law.spring = -k * float(table_value(table, wp.float64(stretch), topology))
        k *= float(table_slope(table_segment(table, wp.float64(stretch), topology), topology))
    if topology.dof_table[dof, 1] >= 0:
        table = topology.dof_table[dof, 1]
        law.damper = -d * float(table_value(table, wp.float64(qd), topology))
        d *= float(table_slope(table_segment(table, wp.float64(qd), topology), topology))
    if topology.dof_table[dof, 3] >= 0:
        resistance = map_resistance(topology.dof_table[dof, 3], wp.float64(q), wp.float64(qd), topology)
        law.damper = -d * resistance[0]
        d *= resistance[1]
    # Where a law falls, its force counts as it is at the step's start: a negative gain stands for a prescribed motion
    law.stiffness = wp.max(k, 0.0)
    law.damping = wp.max(d, 0.0)
    return law


@wp.func
def is_driven(dof: int, world: int, topology: Topology, parameters: Parameters) -> bool:
    """True where a PD drive without effort limit is part of the implicit effort."""
    return topology.dof_drive[dof] == POSITION and not is_bounded(effort_bounds(dof, world, parameters))


@wp.func
def dof_effort(
    dof: int, world: int, config: StepConfig, q: float, qd: float,
    topology: Topology, parameters: Parameters, control: ControlArrays,
) -> ImplicitEffort:  # fmt: skip
    """Armature, spring, damper, `joint_force`, and a PD drive without effort limit."""
    implicit = ImplicitEffort()
    dt = config.dt
    armature = parameters.joint_armature[world_row(world, parameters.joint_armature.shape[0]), dof]
    stretch = q - parameters.joint_rest[world_row(world, parameters.joint_rest.shape[0]), dof]
    force = parameters.joint_preload[world_row(world, parameters.joint_preload.shape[0]), dof]
    law = passive_law(dof, world, q, qd, stretch, topology, parameters)
    k = law.stiffness
    d = law.damping
    force += law.spring + law.damper + applied_effort(world, dof, control)
    implicit.gain = armature + dt * (damping_weight(config) * d) + dt * dt * (stiffness_weight(config) * k)
    implicit.effort = armature * qd + dt * (force + d * qd)
    implicit.change = dt * force - dt * dt * (config.numerical_damping * k) * qd
    implicit.start = start_gain(k, d, config)
    if is_driven(dof, world, topology, parameters):
        drive = drive_effort(dof, world, config, q, parameters, control)
        implicit.gain += drive.gain
        implicit.effort += drive.effort
        implicit.start += drive.start
        implicit.change += drive.effort + drive.start * qd - drive.gain * qd
    return implicit


@wp.func
def drive_effort(
    dof: int, world: int, config: StepConfig, q: float, parameters: Parameters, control: ControlArrays
) -> ImplicitEffort:
    """The PD drive alone, stiffness (target_q - q) + damping (target_qd - u); `change` is left out."""
    implicit = ImplicitEffort()
    dt = config.dt
    stiffness = parameters.drive_stiffness[world_row(world, parameters.drive_stiffness.shape[0]), dof]
    damping = parameters.drive_damping[world_row(world, parameters.drive_damping.shape[0]), dof]
    implicit.gain = dt * (damping_weight(config) * damping + dt * (stiffness_weight(config) * stiffness))
    implicit.effort = dt * (
        stiffness * (control.joint_target_q[world, dof] - q) + damping * control.joint_target_qd[world, dof]
    )
    implicit.start = start_gain(stiffness, damping, config)
    return implicit


@wp.func
def prescribed_rate(
    dof: int, world: int, config: StepConfig, time: wp.float64, q: wp.float64, limit: float, topology: Topology,
    control: ControlArrays,
) -> float:  # fmt: skip
    """Speed over the step that follows the motion: its own difference quotient plus the clamped correction. A table of
    speeds is read at the step's end, or the less `numerical_damping` there is, the nearer to its middle.
    """
    table = topology.dof_table[dof, 2]
    h = wp.float64(config.dt)
    rate = control.joint_target_qd[world, dof]
    if topology.dof_drive[dof] == PRESCRIBED_SPEED:
        if table >= 0:
            rate = float(table_value(table, time + wp.float64(damping_weight(config)) * h, topology))
        return rate
    target = wp.float64(control.joint_target_q[world, dof])
    if table >= 0:
        target = table_value(table, time, topology)
        rate = float((table_value(table, time + h, topology) - target) / h)
    return rate + wp.clamp(float((target - q) / h), -limit, limit)


@wp.func
def rotation_start(dof: int, topology: Topology) -> int:
    """First of the three coordinates of a rotation vector that `dof` is one of, -1: it is none."""
    joint = topology.dof_joint[dof]
    if topology.dof_kind[dof] == ANGLE0 and ((TURNS >> topology.joint_type[joint]) & 1) == 1:
        return topology.joint_dof[joint + 1] - 3
    return -1


@wp.func
def exponential_map(v: wp.vec3d) -> wp.quatd:
    """Quaternion of a rotation vector [rad]."""
    half = wp.float64(0.5) * wp.length(v)
    s = wp.float64(0.5) - half * half / wp.float64(12.0)
    if half > wp.float64(1.0e-4):
        s = wp.float64(0.5) * wp.sin(half) / half
    return wp.quatd(v[0] * s, v[1] * s, v[2] * s, wp.cos(half))


@wp.func
def relative_rotation(turn: wp.vec3d, rest: wp.vec3d) -> wp.vec3d:
    """log(exp(turn) exp(rest)^T), of at most half a turn [rad]."""
    if wp.length_sq(rest) == wp.float64(0.0):
        return turn
    return rotation_vector_of(exponential_map(turn) * exponential_map(-rest))


@wp.func
def gradient_map(theta: wp.vec3d) -> wp.mat33d:
    """J_r(theta)^-1: column i is the gradient of theta_i over a turn of frame 1 about the axes of frame 0."""
    square = wp.length_sq(theta)
    c = wp.float64(1.0 / 12.0) + square / wp.float64(720.0)
    if square > wp.float64(1.0e-4):
        half = wp.float64(0.5) * wp.sqrt(square)
        c = (wp.float64(1.0) - half * wp.cos(half) / wp.sin(half)) / square
    cross = wp.skew(theta)
    return wp.identity(3, dtype=wp.float64) + wp.float64(0.5) * cross + c * (cross * cross)


@wp.func
def turn_of(first: int, world: int, state: StateArrays) -> wp.vec3d:
    """The rotation vector of record."""
    return wp.vec3d(state.joint_x[world, first], state.joint_x[world, first + 1], state.joint_x[world, first + 2])


@wp.func
def rest_of(first: int, world: int, parameters: Parameters) -> wp.vec3d:
    """Rotation vector at which the springs are at rest."""
    row = world_row(world, parameters.joint_rest.shape[0])
    rest = parameters.joint_rest
    return wp.vec3d(wp.float64(rest[row, first]), wp.float64(rest[row, first + 1]), wp.float64(rest[row, first + 2]))


@wp.func
def target_of(first: int, world: int, control: ControlArrays) -> wp.vec3d:
    """Rotation vector of the drives' target."""
    target = control.joint_target_q
    return wp.vec3d(
        wp.float64(target[world, first]), wp.float64(target[world, first + 1]), wp.float64(target[world, first + 2])
    )


@wp.func
def spring_stretch(dof: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays) -> wp.float64:
    """What the potential of a coordinate's spring depends on [m or rad]."""
    first = rotation_start(dof, topology)
    if first >= 0:
        return relative_rotation(turn_of(first, world, state), rest_of(first, world, parameters))[dof - first]
    rest = parameters.joint_rest[world_row(world, parameters.joint_rest.shape[0]), dof]
    return state.joint_x[world, dof] - wp.float64(rest)


@wp.func
def tangent_stiffness(stiffness: wp.vec3d, gradients: wp.mat33d, diagonal: int) -> wp.mat33d:
    """Symmetric stiffness that the step takes implicitly, positive semi-definite and not below half the true one.

    The sum of k_i (gradient of theta_i) (the same)^T lacks the curvature of theta_i alone. Where all k_i are equal,
    k itself is nearer, and a multiple of the identity. So is the largest, wherever `diagonal` is 1: larger than it has
    to be, where stiffnesses differ.
    """
    most = wp.max(stiffness)
    if diagonal == 1 or wp.min(stiffness) == most:
        return wp.diag(wp.vec3d(most, most, most))
    return gradients * wp.diag(stiffness) * wp.transpose(gradients)


@wp.struct
class RotationEffort:
    """impulse = effort - gain omega [N·m·s] on frame 1, axes of frame 0; `change` is effort - gain omega0, in which
    large terms have cancelled before they are rounded. omega0 is as published.
    """

    gain: wp.mat33d
    effort: wp.vec3d
    change: wp.vec3d


@wp.func
def is_prescribed(dof: int, topology: Topology) -> bool:
    """True where the motion is given: neither spring nor drive acts."""
    return topology.dof_drive[dof] >= PRESCRIBED_POSITION


@wp.func
def drive_pull(
    first: int, world: int, diagonal: int, bounded: bool, h: wp.float64, topology: Topology, parameters: Parameters,
    state: StateArrays, control: ControlArrays,
) -> RotationEffort:  # fmt: skip
    """The PD drives of a rotation alone, those with an effort limit or those without: backward Euler, whatever the
    numerical damping. `change` is left out.
    """
    pull = RotationEffort()
    theta = relative_rotation(turn_of(first, world, state), target_of(first, world, control))
    gradients = gradient_map(theta)
    stiffness = wp.vec3d()
    force = wp.vec3d()
    for i in range(3):
        dof = first + i
        driven = is_driven(dof, world, topology, parameters)
        if bounded:
            driven = topology.dof_drive[dof] == POSITION and is_bounded(effort_bounds(dof, world, parameters))
        if driven:
            k = wp.float64(parameters.drive_stiffness[world_row(world, parameters.drive_stiffness.shape[0]), dof])
            d = wp.float64(parameters.drive_damping[world_row(world, parameters.drive_damping.shape[0]), dof])
            stiffness[i] = k
            force[i] = -k * theta[i]
            pull.gain[i, i] = h * d
            pull.effort[i] = h * d * wp.float64(control.joint_target_qd[world, dof])
    pull.gain = pull.gain + (h * h) * tangent_stiffness(stiffness, gradients, diagonal)
    pull.effort = pull.effort + h * (gradients * force)
    return pull


@wp.func
def rotation_effort(
    first: int, world: int, config: StepConfig, diagonal: int, topology: Topology, parameters: Parameters,
    state: StateArrays, control: ControlArrays,
) -> RotationEffort:  # fmt: skip
    """Armature, springs, dampers, `joint_force`, and PD drives without effort limit, of the three coordinates from
    `first` on. With `diagonal` = 1 the stiffness of springs is a multiple of the identity.
    """
    implicit = RotationEffort()
    h = wp.float64(config.dt)
    theta = relative_rotation(turn_of(first, world, state), rest_of(first, world, parameters))
    gradients = gradient_map(theta)
    stiffness = wp.vec3d()
    pull = wp.vec3d()
    omega = wp.vec3d()
    driven = bool(False)
    for i in range(3):
        dof = first + i
        rate = state.joint_qd[world, dof]
        omega[i] = wp.float64(rate)
        if not is_prescribed(dof, topology):
            law = passive_law(dof, world, state.joint_q[world, dof], rate, float(theta[i]), topology, parameters)
            preload = parameters.joint_preload[world_row(world, parameters.joint_preload.shape[0]), dof]
            armature = wp.float64(parameters.joint_armature[world_row(world, parameters.joint_armature.shape[0]), dof])
            stiffness[i] = wp.float64(law.stiffness)
            pull[i] = wp.float64(preload + law.spring)
            damping = h * wp.float64(law.damping)
            start = wp.float64(start_gain(0.0, law.damping, config))
            force = h * wp.float64(law.damper + applied_effort(world, dof, control))
            implicit.gain[i, i] = armature + wp.float64(damping_weight(config)) * damping
            implicit.effort[i] = (armature + damping) * omega[i] + force + start * omega[i]
            implicit.change[i] = force
            driven = driven or is_driven(dof, world, topology, parameters)
    torque = h * (gradients * pull)
    spring = (h * h) * tangent_stiffness(stiffness, gradients, diagonal)
    implicit.gain = implicit.gain + wp.float64(stiffness_weight(config)) * spring
    implicit.effort = implicit.effort + torque + wp.float64(config.spring_average) * (spring * omega)
    implicit.change = implicit.change + torque - wp.float64(config.numerical_damping) * (spring * omega)
    if driven:
        drive = drive_pull(first, world, diagonal, False, h, topology, parameters, state, control)
        implicit.gain = implicit.gain + drive.gain
        implicit.effort = implicit.effort + drive.effort
        implicit.change = implicit.change + drive.effort - drive.gain * omega
    return implicit


@wp.struct
class SplitEffort:
    """A `RotationEffort` as three scalar laws: row j acts along column j of `direction` (axes of frame 0), with its own
    gain and effort.
    """

    direction: wp.mat33d
    gain: wp.vec3d
    effort: wp.vec3d


@wp.func
def split_effort(whole: RotationEffort, held: wp.vec3i) -> SplitEffort:
    """Pivoted Cholesky: gain = sum of gain_j direction_j direction_j^T. Row j is that of axis j; axes that are `held`
    (1) have none, and take no part.
    """
    parts = SplitEffort()
    gain = whole.gain
    effort = whole.effort
    used = held
    for i in range(3):
        if held[i] == 1:
            effort[i] = wp.float64(0.0)
            for k in range(3):
                gain[i, k] = wp.float64(0.0)
                gain[k, i] = wp.float64(0.0)
    scale = LEAST_PIVOT * wp.trace(gain)
    for _step in range(3):
        axis = int(-1)
        most = wp.float64(-1.0e300)
        for i in range(3):
            if used[i] == 0 and gain[i, i] > most:
                most = gain[i, i]
                axis = i
        if axis >= 0:
            used[axis] = 1
            direction = wp.vec3d()
            direction[axis] = wp.float64(1.0)
            pivot = wp.float64(0.0)
            if most > scale:
                pivot = most
                direction = wp.vec3d(gain[0, axis], gain[1, axis], gain[2, axis]) / most
            own = effort[axis]
            effort = effort - direction * own
            gain = gain - wp.outer(direction, direction) * pivot
            for i in range(3):
                parts.direction[i, axis] = direction[i]
            parts.gain[axis] = pivot
            parts.effort[axis] = own
    return parts
