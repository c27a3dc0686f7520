"""Rows with bounded impulses on one degree of freedom: limits, dry friction, motors, drives with an effort limit.

Only rows that can act in this step enter: a limit that the free motion cannot reach is left out. They see the Schur
complement of everything bilateral, S = Y Y^T - Y Y_l^T (N + C)^-1 Y_l Y^T.
"""

import warp as wp

from simwarp.kernels.bodies import total_velocities
from simwarp.kernels.joints import DISTANCE, POINT_AXIS0, joint_frames
from simwarp.kernels.laws import INFINITE_EFFORT, drive_law
from simwarp.kernels.rows import dof_rate, link_of, row_geometry, solve_rows
from simwarp.kernels.tables import ControlArrays, Parameters, StateArrays, StepConfig, Topology, Work
from simwarp.kernels.tree import project_slot, walk_to_root
from simwarp.types import BoundedKind

wp.set_module_options({"enable_backward": False})

LIMIT = wp.constant(int(BoundedKind.LIMIT))
FRICTION = wp.constant(int(BoundedKind.FRICTION))
MOTOR = wp.constant(int(BoundedKind.MOTOR))
DRIVE = wp.constant(int(BoundedKind.DRIVE))
TINY = wp.constant(1.0e-16)


@wp.struct
class Candidate:
    """A bounded row in the making: u = sign x rate + bias + compliance x gamma, lower <= gamma <= upper."""

    acts: int
    sign: float
    bias: float
    compliance: float
    lower: float
    upper: float


@wp.func
def candidate(
    kind: int, dof: int, rate: float, world: int, dt: float, topology: Topology, parameters: Parameters,
    state: StateArrays, control: ControlArrays, config: StepConfig,
) -> Candidate:  # fmt: skip
    """Bounds and bias of one potential row for the free rate [m/s or rad/s] of its coordinate."""
    row = Candidate()
    row.sign = 1.0
    q = float(state.joint_x[world, dof])
    if kind == LIMIT:
        lower = q - parameters.joint_limit_lower[world % parameters.joint_limit_lower.shape[0], dof]
        upper = parameters.joint_limit_upper[world % parameters.joint_limit_upper.shape[0], dof] - q
        gap = lower
        # the stop that the free motion would pass further, not the nearer one: it may be leaving that
        if upper - dt * rate < lower + dt * rate:
            gap = upper
            row.sign = -1.0
        recovery = config.recovery_rate
        if topology.dof_kind[dof] == POINT_AXIS0 or topology.dof_kind[dof] == DISTANCE:
            recovery = config.recovery_speed
        # the reserve is for speed that the other bounded rows may add within the step
        if gap / dt + row.sign * rate < recovery:
            row.acts = 1
        row.bias = wp.max(gap / dt, -recovery)
        row.upper = INFINITE_EFFORT
    elif kind == FRICTION:
        row.upper = dt * parameters.joint_friction[world % parameters.joint_friction.shape[0], dof]
        row.lower = -row.upper
    else:
        limit = parameters.drive_effort_limit[world % parameters.drive_effort_limit.shape[0], dof]
        row.upper = dt * limit
        row.lower = -row.upper
        if kind == MOTOR:
            row.bias = -control.joint_target_qd[world, dof]
        elif limit < INFINITE_EFFORT:
            law = drive_law(dof, world, dt, q, parameters, control)
            gain = wp.max(law.gain, 1.0e-9)
            row.compliance = 1.0 / gain
            row.bias = -law.effort / gain
        else:
            row.upper = 0.0  # without an effort limit the drive is part of the tree
    if kind != LIMIT and row.upper > 0.0:
        row.acts = 1
    return row


@wp.func
def bounded_response(
    index: int, dof: int, sign: float, world: int, topology: Topology, parameters: Parameters, work: Work
):
    """b_y, b_w and row `index` of S."""
    slot = topology.dof_slot[dof]
    for k in range(topology.slot_count):
        work.b_y[index, k] = 0.0
    if slot >= 0:
        project_slot(index, slot, sign, topology, work, work.b_y)
    else:
        joint = topology.dof_joint[dof]
        frames = joint_frames(joint, world, topology, parameters, work)
        axis = topology.dof_axis[dof]
        geometry = row_geometry(topology.joint_type[joint], topology.dof_kind[dof], axis, axis, wp.float64(0.0), frames)
        geometry.w0.ang = geometry.w0.ang * sign
        geometry.w0.lin = geometry.w0.lin * sign
        geometry.w1.ang = geometry.w1.ang * sign
        geometry.w1.lin = geometry.w1.lin * sign
        walk_to_root(
            index, link_of(topology.joint_body0[joint], topology), geometry.w0,
            link_of(topology.joint_body1[joint], topology), geometry.w1, topology, work, work.b_y,
        )  # fmt: skip
    for row in range(topology.row_count):
        total = float(0.0)
        for entry in range(topology.row_path[row], topology.row_path[row + 1]):
            k = topology.path_slot[entry]
            total += work.y[row, k] * work.b_y[index, k]
        work.row_t[row] = total
        work.row_r[row] = total
    solve_rows(topology, work)
    for row in range(topology.row_count):
        work.b_w[index, row] = -work.row_r[row]
    for other in range(index + 1):
        total = float(0.0)
        for k in range(topology.slot_count):
            total += work.b_y[index, k] * work.b_y[other, k]
        for row in range(topology.row_count):
            total += work.row_t[row] * work.b_w[other, row]
        work.s[index, other] = total
        work.s[other, index] = total


@wp.func
def collect_bounded(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig, work: Work,
) -> int:  # fmt: skip
    """Active rows and their S, r, bounds and warm start, from the free velocity in `work`; returns how many."""
    total_velocities(topology, work)
    count = int(0)
    for index in range(topology.bounded_count):
        dof = topology.bounded_dof[index]
        slot = topology.dof_slot[dof]
        rate = float(0.0)
        if slot >= 0:
            rate = work.qd[slot]
        else:
            rate = dof_rate(dof, world, topology, parameters, work)
        row = candidate(
            topology.bounded_kind[index], dof, rate, world, dt, topology, parameters, state, control, config
        )
        if row.acts == 1:
            work.active[count] = index
            work.b_sign[count] = row.sign
            work.b_r[count] = row.sign * rate + row.bias
            work.b_lower[count] = row.lower
            work.b_upper[count] = row.upper
            work.gamma[count] = wp.clamp(row.sign * state.bounded_impulse[world, index], row.lower, row.upper)
            bounded_response(count, dof, row.sign, world, topology, parameters, work)
            if work.s[count, count] > TINY:  # a coordinate that cannot move takes no impulse
                work.s[count, count] = work.s[count, count] + row.compliance
                count += 1
    return count


@wp.func
def apply_bounded(count: int, topology: Topology, work: Work):
    """Impulses of the bounded rows and of the bilateral rows that answer them, into `xi` and `row_impulse`."""
    for row in range(topology.row_count):
        total = float(0.0)
        for index in range(count):
            total += work.b_w[index, row] * work.gamma[index]
        work.row_impulse[row] = work.row_impulse[row] + total
        for entry in range(topology.row_path[row], topology.row_path[row + 1]):
            slot = topology.path_slot[entry]
            work.xi[slot] = work.xi[slot] + work.y[row, slot] * total
    for index in range(count):
        gamma = work.gamma[index]
        for slot in range(topology.slot_count):
            work.xi[slot] = work.xi[slot] + work.b_y[index, slot] * gamma
