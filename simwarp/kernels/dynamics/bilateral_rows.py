"""Scalar rows between two bodies, and the bilateral rows that the tree does not hold: loops, couplings, compliance.

The rows of closed loops, couplings and stiff springs form one small dense system, N + C with N = J M^-1 J^T in the
tree's metric and C their compliance, factorised by Cholesky with guarded pivots: a redundant row loses its pivot and
takes no impulse.
"""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import column, to_float
from simwarp.kernels.dynamics.efforts import (
    PRESCRIBED_POSITION,
    damping_weight,
    dof_effort,
    is_prescribed,
    prescribed_rate,
    rotation_effort,
    split_effort,
)
from simwarp.kernels.dynamics.joints import (
    ANGLE0,
    ANGLE1,
    DISTANCE,
    DOT,
    POINT_AXIS0,
    POINT_AXIS1,
    JointFrames,
    allowed_translation,
    curvature_term,
    joint_frames,
)
from simwarp.kernels.dynamics.tree import Wrench, project_tree_dof, walk_to_root

wp.set_module_options({"enable_backward": False})

LEAST_GAIN = wp.constant(1.0e-18)  # as a damper it is felt by nothing; its inverse squared is still a number


@wp.struct
class RowGeometry:
    """Wrenches of a row on body 0 and body 1 about their centres, and its value (violation or coordinate)."""

    w0: Wrench
    w1: Wrench
    value: wp.float64


@wp.func
def row_geometry(
    joint_type: int, kind: int, axis0: int, axis1: int, offset: wp.float64, frames: JointFrames
) -> RowGeometry:
    """One row of kind `kind` (RowKind). Each body is taken at its own anchor, plus the travel that the joint allows:
    a violation has no lever.
    """
    row = RowGeometry()
    if kind == DOT or kind == ANGLE0 or kind == ANGLE1:
        axis = wp.vec3d()
        if kind == DOT:
            e = column(frames.f0, axis0)
            f = column(frames.f1, axis1)
            axis = wp.cross(f, e)
            row.value = wp.dot(e, f)
        elif kind == ANGLE0:
            axis = column(frames.f0, axis0)
        else:
            axis = column(frames.f1, axis1)
        row.w1.ang = to_float(axis)
        row.w0.ang = -to_float(axis)
        return row
    u = wp.vec3d()
    lever0 = frames.r0 + allowed_translation(joint_type, frames)
    lever1 = frames.r1
    if kind == POINT_AXIS0:
        u = column(frames.f0, axis0)
        row.value = wp.dot(u, frames.d) - offset
    elif kind == POINT_AXIS1:
        u = column(frames.f1, axis1)
        lever0 = frames.r0
        lever1 = frames.r1 - frames.d
        row.value = wp.dot(u, frames.d) - offset
    elif kind == DISTANCE:
        length = wp.length(frames.d)
        if length > wp.float64(0.0):
            u = frames.d * (wp.float64(1.0) / length)
        lever0 = frames.r0
        row.value = length - offset
    row.w1.lin = to_float(u)
    row.w1.ang = to_float(wp.cross(lever1, u))
    row.w0.lin = -row.w1.lin
    row.w0.ang = -to_float(wp.cross(lever0, u))
    return row


@wp.func
def row_offset(kind: int, joint: int, world: int, parameters: Parameters) -> wp.float64:
    """The constant of a DISTANCE or POINT_AXIS1 row [m]."""
    offset = wp.float64(0.0)
    if kind == DISTANCE or kind == POINT_AXIS1:
        offset = parameters.joint_offset[world_row(world, parameters.joint_offset.shape[0]), joint]
    return offset


@wp.func
def row_speed(row: int, topology: Topology, work: Work, link0: int, link1: int) -> float:
    """J times the change of velocity."""
    speed = float(0.0)
    if link0 >= 0:
        speed += wp.dot(work.j0_ang[row], work.v_ang[link0]) + wp.dot(work.j0_lin[row], work.v_lin[link0])
    if link1 >= 0:
        speed += wp.dot(work.j1_ang[row], work.v_ang[link1]) + wp.dot(work.j1_lin[row], work.v_lin[link1])
    return speed


@wp.func
def start_speed(row: int, topology: Topology, work: Work, link0: int, link1: int) -> float:
    """J times the velocities of the step's start."""
    speed = float(0.0)
    if link0 >= 0:
        speed += wp.dot(work.j0_ang[row], work.o_ang[link0]) + wp.dot(work.j0_lin[row], work.o_lin[link0])
    if link1 >= 0:
        speed += wp.dot(work.j1_ang[row], work.o_ang[link1]) + wp.dot(work.j1_lin[row], work.o_lin[link1])
    return speed


@wp.func
def link_of(body: int, topology: Topology) -> int:
    """Link of a body, -1 for the world."""
    if body < 0:
        return -1
    return topology.body_link[body]


@wp.func
def rate_of(dof: int, joint: int, frames: JointFrames, topology: Topology, work: Work) -> float:
    """Rate of a coordinate from the total velocities: its row times V."""
    axis = topology.dof_axis[dof]
    row = row_geometry(topology.joint_type[joint], topology.dof_kind[dof], axis, axis, wp.float64(0.0), frames)
    link0 = link_of(topology.joint_body0[joint], topology)
    link1 = link_of(topology.joint_body1[joint], topology)
    rate = float(0.0)
    if link0 >= 0:
        rate += wp.dot(row.w0.ang, work.t_ang[link0]) + wp.dot(row.w0.lin, work.t_lin[link0])
    if link1 >= 0:
        rate += wp.dot(row.w1.ang, work.t_ang[link1]) + wp.dot(row.w1.lin, work.t_lin[link1])
    return rate


@wp.func
def dof_rate(dof: int, world: int, topology: Topology, parameters: Parameters, work: Work) -> float:
    """Rate of a coordinate that no tree degree of freedom holds, from the link velocities and the poses in `work`."""
    joint = topology.dof_joint[dof]
    frames = joint_frames(joint, world, topology, parameters, work)
    return rate_of(dof, joint, frames, topology, work)


@wp.func
def free_mobility(body: int, world: int, wrench: Wrench, parameters: Parameters) -> float:
    """Response of a row if the body were free of its joints: the scale against which a pivot is judged. Rows across
    a plane mechanism have a diagonal of pure rounding, so that their own diagonal would not do.
    """
    if body < 0:
        return 0.0
    force = wp.dot(wrench.lin, wrench.lin)
    if force > 0.0:
        return force / parameters.body_mass[world_row(world, parameters.body_mass.shape[0]), body]
    inertia = parameters.body_inertia_b[world_row(world, parameters.body_inertia_b.shape[0]), body]
    return 3.0 * wp.dot(wrench.ang, wrench.ang) / wp.trace(inertia)


@wp.func
def loop_row_limit(kind: int, config: StepConfig) -> float:
    """Fastest correction of a row [m/s or rad/s]."""
    limit = config.max_depenetration_velocity
    if kind == DOT or kind == ANGLE0 or kind == ANGLE1:
        limit = config.max_depenetration_rate
    return limit


@wp.func
def row_curvature_term(row: int, joint: int, dt: float, frames: JointFrames, topology: Topology, work: Work) -> float:
    """`curvature_term` of a row, with the velocities of the step's start."""
    link0 = link_of(topology.joint_body0[joint], topology)
    link1 = link_of(topology.joint_body1[joint], topology)
    omega0 = wp.vec3()
    omega1 = wp.vec3()
    speed = wp.vec3()
    if link0 >= 0:
        omega0 = work.o_ang[link0]
        speed -= work.o_lin[link0]
    if link1 >= 0:
        omega1 = work.o_ang[link1]
        speed += work.o_lin[link1]
    axis0 = topology.row_axis0[row]
    return curvature_term(topology.row_kind[row], axis0, topology.row_axis1[row], dt, omega0, omega1, speed, frames)


@wp.func(inline=True)
def loop_row_wrenches(
    row: int, joint: int, world: int, dt: float, frames: JointFrames, topology: Topology, parameters: Parameters,
    work: Work,
) -> wp.float64:  # fmt: skip
    """Wrenches of one row of a loop joint, its curvature, and the scale of its pivot; returns its value."""
    kind = topology.row_kind[row]
    axis0 = topology.row_axis0[row]
    axis1 = topology.row_axis1[row]
    offset = wp.float64(0.0)
    if topology.row_dof[row] < 0:
        offset = row_offset(kind, joint, world, parameters)
        work.curvature_term[row] = row_curvature_term(row, joint, dt, frames, topology, work)
    geometry = row_geometry(topology.joint_type[joint], kind, axis0, axis1, offset, frames)
    work.j0_ang[row] = geometry.w0.ang
    work.j0_lin[row] = geometry.w0.lin
    work.j1_ang[row] = geometry.w1.ang
    work.j1_lin[row] = geometry.w1.lin
    work.row_scale[row] = free_mobility(topology.joint_body0[joint], world, geometry.w0, parameters) + free_mobility(
        topology.joint_body1[joint], world, geometry.w1, parameters
    )
    return geometry.value


@wp.struct
class RowLaw:
    """Right-hand side of a row, and its compliance."""

    bias: float
    compliance: float


@wp.func
def effort_law(gain: float, effort: float) -> RowLaw:
    """Law of the impulse effort - gain x rate."""
    law = RowLaw()
    # an effort without stiffness is a plain impulse: written as an almost infinitely compliant row
    least = wp.max(gain, LEAST_GAIN)
    law.compliance = 1.0 / least
    law.bias = -effort / least
    return law


@wp.func
def dof_law(
    dof: int, world: int, config: StepConfig, time: wp.float64, limit: float, before: float, topology: Topology,
    parameters: Parameters, state: StateArrays, control: ControlArrays,
) -> RowLaw:  # fmt: skip
    """Law of a row that carries a coordinate: its prescribed motion, or its effort; `before` is the rate of the
    step's start along its axes.
    """
    law = RowLaw()
    if topology.dof_drive[dof] >= PRESCRIBED_POSITION:
        law.bias = -prescribed_rate(dof, world, config, time, state.joint_x[world, dof], limit, topology, control)
    else:
        implicit = dof_effort(
            dof, world, config, state.joint_q[world, dof], state.joint_qd[world, dof], topology, parameters, control
        )
        law = effort_law(implicit.gain, implicit.effort + implicit.start * before)
    return law


@wp.func(inline=True)
def loop_row_law(
    row: int, joint: int, world: int, dt: float, time: wp.float64, value: wp.float64, topology: Topology,
    parameters: Parameters, state: StateArrays, control: ControlArrays, config: StepConfig, work: Work,
):  # fmt: skip
    """Right-hand side and compliance of one row, whose wrenches are there: rigid, prescribed, or an effort."""
    dof = topology.row_dof[row]
    limit = loop_row_limit(topology.row_kind[row], config)
    law = RowLaw()
    link0 = link_of(topology.joint_body0[joint], topology)
    link1 = link_of(topology.joint_body1[joint], topology)
    before = start_speed(row, topology, work, link0, link1)
    if dof < 0:
        # as `corrected` in joints.py
        bend = work.curvature_term[row]
        law.bias = wp.clamp(float(value) / dt - (1.0 - config.curvature_share) * bend, -limit, limit) + bend
    else:
        law = dof_law(dof, world, config, time, limit, before, topology, parameters, state, control)
    work.row_b[row] = law.bias + before
    work.row_compliance[row] = law.compliance


@wp.func
def rotation_rows(
    index: int, world: int, time: wp.float64, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig, work: Work,
):  # fmt: skip
    """Right-hand sides and compliances of the rows of a rotation's efforts, which turn into directions in which these
    do not depend on each other; or its prescribed motions. Wrenches about the joint's own axes are there.
    """
    joint = topology.loop_joint[index]
    first = topology.joint_dof[joint + 1] - 3
    link0 = link_of(topology.joint_body0[joint], topology)
    link1 = link_of(topology.joint_body1[joint], topology)
    held = wp.vec3i(1, 1, 1)
    axes = wp.mat33()
    for row in range(topology.loop_row[index, 1], topology.loop_row[index, 2]):
        local = topology.row_dof[row] - first
        axis = work.j1_ang[row]
        for k in range(3):
            axes[k, local] = axis[k]
        if not is_prescribed(first + local, topology):
            held[local] = 0
    whole = rotation_effort(first, world, config, 0, topology, parameters, state, control)
    parts = split_effort(whole, held)
    for row in range(topology.loop_row[index, 1], topology.loop_row[index, 2]):
        local = topology.row_dof[row] - first
        law = RowLaw()
        if held[local] == 1:
            law = dof_law(
                first + local, world, config, time, config.max_depenetration_rate, 0.0, topology, parameters, state,
                control,
            )  # fmt: skip
        else:
            direction = axes * to_float(column(parts.direction, local))
            work.j0_ang[row] = -direction
            work.j1_ang[row] = direction
            law = effort_law(float(parts.gain[local]), float(parts.effort[local]))
        work.row_b[row] = law.bias + start_speed(row, topology, work, link0, link1)
        work.row_compliance[row] = law.compliance


@wp.func
def loop_joint_rows(
    index: int, world: int, dt: float, time: wp.float64, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig, work: Work,
) -> float:  # fmt: skip
    """Wrenches and right-hand sides of one loop joint's rows; returns its largest violation."""
    joint = topology.loop_joint[index]
    frames = joint_frames(joint, world, topology, parameters, work)
    violation = float(0.0)
    rotation = topology.loop_row[index, 1]
    for row in range(topology.loop_row[index, 0], topology.loop_row[index, 2]):
        value = loop_row_wrenches(row, joint, world, dt, frames, topology, parameters, work)
        if topology.row_dof[row] < 0:
            violation = wp.max(violation, wp.abs(float(value)))
        if row < rotation:
            loop_row_law(row, joint, world, dt, time, value, topology, parameters, state, control, config, work)
    if rotation < topology.loop_row[index, 2]:
        rotation_rows(index, world, time, topology, parameters, state, control, config, work)
    return violation


@wp.func
def loop_responses(topology: Topology, work: Work):
    """Y of the rows of loop joints, whose wrenches are there: what they move."""
    for index in range(topology.loop_joint_count):
        joint = topology.loop_joint[index]
        link0 = link_of(topology.joint_body0[joint], topology)
        link1 = link_of(topology.joint_body1[joint], topology)
        for row in range(topology.loop_row[index, 0], topology.loop_row[index, 2]):
            for entry in range(topology.row_path[row], topology.row_path[row + 1]):
                work.y[row, topology.path_column[entry]] = 0.0
            w0 = Wrench()
            w0.ang = work.j0_ang[row]
            w0.lin = work.j0_lin[row]
            w1 = Wrench()
            w1.ang = work.j1_ang[row]
            w1.lin = work.j1_lin[row]
            walk_to_root(row, link0, w0, link1, w1, topology, work, work.y)


@wp.func
def turn_term(
    row: int, coupling: int, term: int, coefficient: float, world: int, topology: Topology, parameters: Parameters,
    work: Work,
) -> float:  # fmt: skip
    """A coupling's term on the rotation between two bodies: its wrenches and response; returns its rate at the start
    of the step [rad/s].
    """
    joint = topology.dof_joint[topology.coupling_dof[coupling, term]]
    link0 = link_of(topology.joint_body0[joint], topology)
    link1 = link_of(topology.joint_body1[joint], topology)
    frames = joint_frames(joint, world, topology, parameters, work)
    axis = to_float(column(frames.f1, 2)) * coefficient
    w0 = Wrench()
    w1 = Wrench()
    w0.ang = -axis
    w1.ang = axis
    entry = topology.coupling_wrench[coupling, term]
    work.j0_ang[entry] = w0.ang
    work.j0_lin[entry] = w0.lin
    work.j1_ang[entry] = w1.ang
    work.j1_lin[entry] = w1.lin
    walk_to_root(row, link0, w0, link1, w1, topology, work, work.y)
    return start_speed(entry, topology, work, link0, link1)


@wp.func
def coupling_row(
    coupling: int, world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays,
    config: StepConfig, work: Work,
):  # fmt: skip
    """Response and right-hand side of one coupling: sum of coefficient x rate = 0, with stabilisation. The right-hand
    side of a combination's law is there already (`combination_laws`).
    """
    row = topology.coupling_row[coupling]
    for entry in range(topology.row_path[row], topology.row_path[row + 1]):
        work.y[row, topology.path_column[entry]] = 0.0
    start = float(0.0)  # rate of the step's start that the row's speed lacks
    rate = float(0.0)  # the whole one
    value = -parameters.coupling_offset[world_row(world, parameters.coupling_offset.shape[0]), coupling]
    limit = config.max_depenetration_rate
    wc = world_row(world, parameters.coupling_coefficient.shape[0])
    for term in range(topology.coupling_dof.shape[1]):
        dof = topology.coupling_dof[coupling, term]
        if dof >= 0:
            coefficient = parameters.coupling_coefficient[wc, coupling, term]
            value += wp.float64(coefficient) * state.joint_x[world, dof]
            if topology.dof_kind[dof] == POINT_AXIS0:
                limit = config.max_depenetration_velocity
            if topology.dof_to_tree_dof[dof] >= 0:
                rate += coefficient * state.joint_qd[world, dof]
                project_tree_dof(row, topology.dof_to_tree_dof[dof], coefficient, topology, work, work.y)
            else:
                start += turn_term(row, coupling, term, coefficient, world, topology, parameters, work)
    bias = wp.clamp(float(value) / dt, -limit, limit)
    compliance = float(0.0)
    damping = parameters.coupling_damping[world_row(world, parameters.coupling_damping.shape[0]), coupling]
    if damping > 0.0:
        after = damping_weight(config)
        bias = (1.0 - after) / after * (rate + start)
        compliance = 1.0 / (after * damping * dt)
    if topology.coupling_law[coupling] < 0:
        work.row_b[row] = bias + start
        work.row_compliance[row] = compliance
    work.row_scale[row] = 0.0


@wp.func
def is_length(dof: int, topology: Topology) -> bool:
    """True for a coordinate whose stop is approached in m/s: a length, or a combination with a length in it."""
    kind = topology.dof_kind[dof]
    length = kind == POINT_AXIS0 or kind == DISTANCE
    index = topology.dof_sum[dof]
    if index >= 0:
        for term in range(topology.coupling_dof.shape[1]):
            part = topology.coupling_dof[index, term]
            if part >= 0:
                length = length or topology.dof_kind[part] == POINT_AXIS0
    return length


@wp.func
def combination_laws(
    world: int, time: wp.float64, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig, work: Work,
):  # fmt: skip
    """Right-hand sides of the rows of combinations: their rates are those of the tree, starts included."""
    for coupling in range(topology.row_count - topology.joint_row_count):
        dof = topology.coupling_law[coupling]
        if dof >= 0:
            limit = config.max_depenetration_rate
            if is_length(dof, topology):
                limit = config.max_depenetration_velocity
            rate = state.joint_qd[world, dof]
            law = dof_law(dof, world, config, time, limit, rate, topology, parameters, state, control)
            work.row_b[topology.coupling_row[coupling]] = law.bias
            work.row_compliance[topology.coupling_row[coupling]] = law.compliance


@wp.func
def coefficient_of(coupling: int, term: int, world: int, parameters: Parameters) -> float:
    """Factor of a term."""
    return parameters.coupling_coefficient[world_row(world, parameters.coupling_coefficient.shape[0]), coupling, term]


@wp.func
def combined_rate(dof: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays) -> float:
    """Rate of a combination from the published rates of its terms."""
    index = topology.dof_sum[dof]
    rate = float(0.0)
    for term in range(topology.coupling_dof.shape[1]):
        part = topology.coupling_dof[index, term]
        if part >= 0:
            rate += coefficient_of(index, term, world, parameters) * state.joint_qd[world, part]
    return rate


@wp.func
def combined_coordinate(
    dof: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays
) -> wp.float64:
    """A combination from the coordinates of record of its terms."""
    index = topology.dof_sum[dof]
    value = wp.float64(0.0)
    for term in range(topology.coupling_dof.shape[1]):
        part = topology.coupling_dof[index, term]
        if part >= 0:
            value += wp.float64(coefficient_of(index, term, world, parameters)) * state.joint_x[world, part]
    return value


@wp.func
def free_combined_rate(dof: int, world: int, topology: Topology, parameters: Parameters, work: Work) -> float:
    """Rate of a combination from the rates that the step has solved for so far."""
    index = topology.dof_sum[dof]
    rate = float(0.0)
    for term in range(topology.coupling_dof.shape[1]):
        part = topology.coupling_dof[index, term]
        if part >= 0:
            rate += coefficient_of(index, term, world, parameters) * work.qd[topology.dof_to_tree_dof[part]]
    return rate


@wp.func
def respond_without_law(world: int, topology: Topology, parameters: Parameters, work: Work):
    """Y of the combinations without a law: what their bounded impulses move."""
    for row in range(topology.row_count, topology.response_count):
        index = row - topology.joint_row_count
        for entry in range(topology.row_path[row], topology.row_path[row + 1]):
            work.y[row, topology.path_column[entry]] = 0.0
        for term in range(topology.coupling_dof.shape[1]):
            part = topology.coupling_dof[index, term]
            if part >= 0:
                coefficient = coefficient_of(index, term, world, parameters)
                project_tree_dof(row, topology.dof_to_tree_dof[part], coefficient, topology, work, work.y)


@wp.func
def rows_residual(topology: Topology, parameters: Parameters, world: int, work: Work) -> float:
    """row_r <- J V + b + C lambda; returns the largest entry among rigid rows that have a pivot [m/s or rad/s]."""
    worst = float(0.0)
    for index in range(topology.loop_joint_count):
        joint = topology.loop_joint[index]
        link0 = link_of(topology.joint_body0[joint], topology)
        link1 = link_of(topology.joint_body1[joint], topology)
        for row in range(topology.loop_row[index, 0], topology.loop_row[index, 2]):
            work.row_r[row] = row_speed(row, topology, work, link0, link1)
    wc = world_row(world, parameters.coupling_coefficient.shape[0])
    for coupling in range(topology.row_count - topology.joint_row_count):
        speed = float(0.0)
        for term in range(topology.coupling_dof.shape[1]):
            dof = topology.coupling_dof[coupling, term]
            if dof >= 0:
                tree_dof = topology.dof_to_tree_dof[dof]
                if tree_dof >= 0:
                    speed += parameters.coupling_coefficient[wc, coupling, term] * work.qd[tree_dof]
                else:
                    turn = topology.dof_joint[dof]
                    speed += row_speed(
                        topology.coupling_wrench[coupling, term], topology, work,
                        link_of(topology.joint_body0[turn], topology), link_of(topology.joint_body1[turn], topology),
                    )  # fmt: skip
        work.row_r[topology.coupling_row[coupling]] = speed
    for row in range(topology.row_count):
        work.row_r[row] = work.row_r[row] + work.row_b[row] + work.row_compliance[row] * work.row_impulse[row]
        if work.row_compliance[row] == 0.0 and work.inv_pivot[row] > 0.0:
            worst = wp.max(worst, wp.abs(work.row_r[row]))
    return worst


@wp.func
def group_residual(group: int, topology: Topology, work: Work) -> float:
    """The largest entry of row_r among a group's rigid rows that have a pivot [m/s or rad/s]."""
    worst = float(0.0)
    for row in range(topology.group_row[group], topology.group_row[group + 1]):
        if work.row_compliance[row] == 0.0 and work.inv_pivot[row] > 0.0:
            worst = wp.max(worst, wp.abs(work.row_r[row]))
    return worst


@wp.func
def respond_to_row(row: int, change: float, topology: Topology, work: Work):
    """Takes the response to an impulse of a row from `xi`."""
    for index in range(topology.row_path[row], topology.row_path[row + 1]):
        tree_dof = topology.path_tree_dof[index]
        work.xi[tree_dof] = work.xi[tree_dof] - work.y[row, topology.path_column[index]] * change


@wp.func
def apply_group(group: int, topology: Topology, work: Work):
    """Takes the correction in row_r of a group's rows: impulses, and their response in `xi`."""
    for row in range(topology.group_row[group], topology.group_row[group + 1]):
        change = work.row_r[row]
        work.row_impulse[row] = work.row_impulse[row] - change
        respond_to_row(row, change, topology, work)


@wp.func
def apply_rows(topology: Topology, work: Work):
    """Takes the correction in row_r of all rows."""
    for group in range(topology.group_count):
        apply_group(group, topology, work)
