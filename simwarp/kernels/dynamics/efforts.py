"""Efforts along one degree of freedom, linearised for an implicit step: gamma = -gain u + effort.

With h the step, k and d the slopes of the passive effort, and f its value at the start of the step,
gain = armature + h d + h² k (+ drive) and effort = armature u0 + h (f + d u0) (+ drive): backward Euler on the
spring and the damper, which stays stable however stiff they are.
"""

import warp as wp

from simwarp.core.types import DriveMode
from simwarp.kernels.core.fields import ControlArrays, Parameters
from simwarp.kernels.core.piecewise_linear import segment_of
from simwarp.kernels.core.tables import Topology, world_row

wp.set_module_options({"enable_backward": False})

POSITION = wp.constant(int(DriveMode.POSITION))
PRESCRIBED_POSITION = wp.constant(int(DriveMode.PRESCRIBED_POSITION))
PRESCRIBED_SPEED = wp.constant(int(DriveMode.PRESCRIBED_SPEED))
INFINITE_EFFORT = wp.constant(1.0e30)


@wp.struct
class ImplicitEffort:
    """gamma = -gain u + effort [N·s or N·m·s]; `change` is effort - gain u0, in which the armature's momentum, larger
    than all else in a short step, has cancelled before it is rounded.
    """

    gain: float
    effort: float
    change: float


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


@wp.func
def dof_effort(
    dof: int, world: int, dt: float, q: float, qd: float,
    topology: Topology, parameters: Parameters, control: ControlArrays,
) -> ImplicitEffort:  # fmt: skip
    """Armature, spring, damper, `joint_force`, and a PD drive without effort limit.

    Of a spring or damper by table, `joint_stiffness` or `joint_damping` is the factor of its table.
    """
    implicit = ImplicitEffort()
    armature = parameters.joint_armature[world_row(world, parameters.joint_armature.shape[0]), dof]
    k = parameters.joint_stiffness[world_row(world, parameters.joint_stiffness.shape[0]), dof]
    d = parameters.joint_damping[world_row(world, parameters.joint_damping.shape[0]), dof]
    stretch = q - parameters.joint_rest[world_row(world, parameters.joint_rest.shape[0]), dof]
    force = parameters.joint_preload[world_row(world, parameters.joint_preload.shape[0]), dof]
    spring_force = -k * stretch
    damper_force = -d * qd
    if topology.dof_table[dof, 0] >= 0:
        table = topology.dof_table[dof, 0]
        spring_force = -k * float(table_value(table, wp.float64(stretch), topology))
        k *= float(table_slope(table_segment(table, wp.float64(stretch), topology), topology))
    if topology.dof_table[dof, 1] >= 0:
        table = topology.dof_table[dof, 1]
        damper_force = -d * float(table_value(table, wp.float64(qd), topology))
        d *= float(table_slope(table_segment(table, wp.float64(qd), topology), topology))
    if topology.dof_table[dof, 3] >= 0:
        resistance = map_resistance(topology.dof_table[dof, 3], wp.float64(q), wp.float64(qd), topology)
        damper_force = -d * resistance[0]
        d *= resistance[1]
    # Where a law falls, its force counts as it is at the step's start: a negative gain stands for a prescribed motion
    k = wp.max(k, 0.0)
    d = wp.max(d, 0.0)
    force += spring_force + damper_force + applied_effort(world, dof, control)
    implicit.gain = armature + dt * d + dt * dt * k
    implicit.effort = armature * qd + dt * (force + d * qd)
    implicit.change = dt * force - dt * dt * k * qd
    if topology.dof_drive[dof] == POSITION:
        if not is_bounded(effort_bounds(dof, world, parameters)):
            drive = drive_effort(dof, world, dt, q, parameters, control)
            implicit.gain += drive.gain
            implicit.effort += drive.effort
            implicit.change += drive.effort - drive.gain * qd
    return implicit


@wp.func
def drive_effort(
    dof: int, world: int, dt: float, q: float, parameters: Parameters, control: ControlArrays
) -> ImplicitEffort:
    """The PD drive alone: stiffness (target_q - q⁺) + damping (target_qd - u)."""
    implicit = ImplicitEffort()
    stiffness = parameters.drive_stiffness[world_row(world, parameters.drive_stiffness.shape[0]), dof]
    damping = parameters.drive_damping[world_row(world, parameters.drive_damping.shape[0]), dof]
    implicit.gain = dt * (damping + dt * stiffness)
    implicit.effort = dt * (
        stiffness * (control.joint_target_q[world, dof] - q) + damping * control.joint_target_qd[world, dof]
    )
    return implicit


@wp.func
def prescribed_rate(
    dof: int, world: int, dt: float, time: wp.float64, q: wp.float64, limit: float, topology: Topology,
    control: ControlArrays,
) -> float:  # fmt: skip
    """Speed over the step that follows the motion: its own difference quotient plus the clamped correction."""
    table = topology.dof_table[dof, 2]
    h = wp.float64(dt)
    rate = control.joint_target_qd[world, dof]
    if topology.dof_drive[dof] == PRESCRIBED_SPEED:
        if table >= 0:
            rate = float(table_value(table, time + h, topology))
        return rate
    target = wp.float64(control.joint_target_q[world, dof])
    if table >= 0:
        target = table_value(table, time, topology)
        rate = float((table_value(table, time + h, topology) - target) / h)
    return rate + wp.clamp(float((target - q) / h), -limit, limit)
