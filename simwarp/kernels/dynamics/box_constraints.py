"""Rows with bounded impulses on one degree of freedom: limits, dry friction, motors, drives with an effort limit.

Only rows that can act in this step enter: a limit that the free motion cannot reach is left out. Each is a block of
one row of the cone problem.
"""

import warp as wp

from simwarp.core.types import BoxKind
from simwarp.kernels.cones.problem import BOX, ConeProblem
from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.dynamics.bilateral_rows import dof_rate, free_combined_rate, is_length, link_of, row_geometry
from simwarp.kernels.dynamics.cone_rows import (
    Wrenches,
    loop_share,
    one_row,
    put_response,
    walk_rows,
    walk_tree_dof,
)
from simwarp.kernels.dynamics.efforts import (
    INFINITE_EFFORT,
    ImplicitEffort,
    drive_effort,
    drive_pull,
    effort_bounds,
    is_bounded,
    rotation_start,
)
from simwarp.kernels.dynamics.joints import RELATIVE_ROTATION, joint_frames
from simwarp.kernels.dynamics.recovery import recovery_speed

wp.set_module_options({"enable_backward": False})

LIMIT = wp.constant(int(BoxKind.LIMIT))
FRICTION = wp.constant(int(BoxKind.FRICTION))
MOTOR = wp.constant(int(BoxKind.MOTOR))
DRIVE = wp.constant(int(BoxKind.DRIVE))
TINY = wp.constant(1.0e-16)


@wp.struct
class Candidate:
    """A box constraint in the making: u = sign x rate + bias + compliance x gamma, lower <= gamma <= upper."""

    acts: int
    sign: float
    bias: float
    compliance: float
    lower: float
    upper: float
    recovery: float  # of a limit that is passed, by moving alone [m/s or rad/s]; 0: it only holds, -1: no limit


@wp.func
def bounded_drive(
    dof: int, world: int, q: float, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig,
) -> ImplicitEffort:  # fmt: skip
    """A PD drive with an effort limit: of a rotation, what the three of it pull about the coordinate's own axis."""
    first = rotation_start(dof, topology)
    if first < 0:
        drive = drive_effort(dof, world, config, q, parameters, control)
        drive.effort += drive.start * state.joint_qd[world, dof]
        return drive
    whole = drive_pull(first, world, 1, True, wp.float64(config.dt), topology, parameters, state, control)
    implicit = ImplicitEffort()
    implicit.gain = float(whole.gain[dof - first, dof - first])
    implicit.effort = float(whole.effort[dof - first])
    return implicit


@wp.func
def candidate(
    kind: int, dof: int, rate: float, world: int, dt: float, topology: Topology, parameters: Parameters,
    state: StateArrays, control: ControlArrays, config: StepConfig,
) -> Candidate:  # fmt: skip
    """Bounds and bias of one potential row for the free rate [m/s or rad/s] of its coordinate."""
    row = Candidate()
    row.sign = 1.0
    row.recovery = -1.0
    q = float(state.joint_x[world, dof])
    if kind == LIMIT:
        lower = q - parameters.joint_limit_lower[world_row(world, parameters.joint_limit_lower.shape[0]), dof]
        upper = parameters.joint_limit_upper[world_row(world, parameters.joint_limit_upper.shape[0]), dof] - q
        gap = lower
        # the stop that the free motion would pass further, not the nearer one: it may be leaving that
        if upper - dt * rate < lower + dt * rate:
            gap = upper
            row.sign = -1.0
        fastest = config.max_depenetration_rate
        if is_length(dof, topology):
            fastest = config.max_depenetration_velocity
        # the reserve is for speed that the other box constraints may add within the step
        if gap / dt + row.sign * rate < fastest:
            row.acts = 1
        row.recovery = 0.0
        if topology.joint_type[topology.dof_joint[dof]] != RELATIVE_ROTATION:  # which poses do not tell
            row.recovery = recovery_speed(dt, gap, fastest)
        if row.recovery == 0.0:
            row.bias = wp.max(gap / dt, -fastest)
        row.upper = INFINITE_EFFORT
    elif kind == FRICTION:
        row.upper = dt * parameters.joint_friction[world_row(world, parameters.joint_friction.shape[0]), dof]
        row.lower = -row.upper
    else:
        bounds = effort_bounds(dof, world, parameters)
        row.lower = dt * bounds[0]
        row.upper = dt * bounds[1]
        if bounds[0] <= -INFINITE_EFFORT:
            row.lower = -INFINITE_EFFORT  # solvers know it
        if bounds[1] >= INFINITE_EFFORT:
            row.upper = INFINITE_EFFORT
        if kind == MOTOR:
            row.bias = -control.joint_target_qd[world, dof]
        elif is_bounded(bounds):
            implicit = bounded_drive(dof, world, q, topology, parameters, state, control, config)
            gain = wp.max(implicit.gain, 1.0e-9)
            row.compliance = 1.0 / gain
            row.bias = -implicit.effort / gain
            if implicit.gain <= 0.0:  # neither stiffness nor damping: no effort
                row.lower = 0.0
                row.upper = 0.0
        else:
            row.lower = 0.0  # without an effort limit the drive is part of the tree
            row.upper = 0.0
    if kind != LIMIT and row.upper > row.lower:
        row.acts = 1
    return row


@wp.func
def box_response(
    block: int, row: int, dof: int, sign: float, world: int, topology: Topology, parameters: Parameters, work: Work,
    cone: ConeProblem,
):  # fmt: skip
    """Entries of a row along one coordinate, and its diagonal."""
    tree_dof = topology.dof_to_tree_dof[dof]
    if tree_dof >= 0:
        walk_tree_dof(block, row, tree_dof, sign, topology, work, cone)
    elif topology.dof_sum[dof] >= 0:
        put_response(block, row, topology.coupling_row[topology.dof_sum[dof]], sign, topology, work, cone)
    else:
        joint = topology.dof_joint[dof]
        frames = joint_frames(joint, world, topology, parameters, work)
        axis = topology.dof_axis[dof]
        geometry = row_geometry(topology.joint_type[joint], topology.dof_kind[dof], axis, axis, wp.float64(0.0), frames)
        w0 = Wrenches()
        w1 = Wrenches()
        w0.ang = one_row(geometry.w0.ang * sign)
        w0.lin = one_row(geometry.w0.lin * sign)
        w1.ang = one_row(geometry.w1.ang * sign)
        w1.lin = one_row(geometry.w1.lin * sign)
        cone.block_entries[block] = walk_rows(
            block, row, 1, 0, link_of(topology.joint_body0[joint], topology), w0,
            link_of(topology.joint_body1[joint], topology), w1, topology, work, cone,
        )  # fmt: skip
    loop_share(block, row, 1, topology, work, cone)


@wp.func
def collect_boxes(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig, work: Work, cone: ConeProblem,
) -> int:  # fmt: skip
    """Active rows as blocks of one row, with r, bounds and warm start from the free velocities in `work`; returns how
    many.
    """
    count = int(0)
    for index in range(topology.box_count):
        dof = topology.box_dof[index]
        tree_dof = topology.dof_to_tree_dof[dof]
        rate = float(0.0)
        if tree_dof >= 0:
            rate = work.qd[tree_dof]
        elif topology.dof_sum[dof] >= 0:
            rate = free_combined_rate(dof, world, topology, parameters, work)
        else:
            rate = dof_rate(dof, world, topology, parameters, work)
        row = candidate(topology.box_kind[index], dof, rate, world, dt, topology, parameters, state, control, config)
        if row.acts == 1:
            box_response(count, count, dof, row.sign, world, topology, parameters, work, cone)
            if cone.diagonal[count] > TINY:  # a coordinate that cannot move takes no impulse
                work.active[count] = index
                work.b_sign[count] = row.sign
                work.recovery[count] = row.recovery
                cone.block_row[count] = count
                cone.block_kind[count] = BOX
                cone.friction[count] = 0.0
                cone.r[count] = row.sign * rate + row.bias
                cone.lower[count] = row.lower
                cone.upper[count] = row.upper
                cone.compliance[count] = row.compliance
                cone.diagonal[count] = cone.diagonal[count] + row.compliance
                cone.gamma[count] = wp.clamp(row.sign * state.box_impulse[world, index], row.lower, row.upper)
                count += 1
    return count
