"""Setting a state from joint coordinates: forward kinematics over the tree, Newton assembly of the loops."""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import to_float, turned
from simwarp.kernels.core.world_status import NOT_ASSEMBLED
from simwarp.kernels.dynamics.bilateral_rows import (
    apply_rows,
    combination_laws,
    combined_rate,
    coupling_row,
    dof_rate,
    loop_joint_rows,
    loop_responses,
    respond_to_row,
    rows_residual,
)
from simwarp.kernels.dynamics.bodies import load_bodies, load_poses, load_tree_dofs, publish_coordinates, publish_poses
from simwarp.kernels.dynamics.dense_rows import factor_rows, solve_rows
from simwarp.kernels.dynamics.efforts import PRESCRIBED_POSITION
from simwarp.kernels.dynamics.elastic import gain_stiffness, joint_rate, place_elastic
from simwarp.kernels.dynamics.joints import (
    CYLINDRICAL,
    ELASTIC,
    FREE,
    PLANAR,
    PRISMATIC,
    REVOLUTE,
    SHAFT,
    SPHERICAL,
    UNIVERSAL,
    joint_frames,
    link_geometry,
)
from simwarp.kernels.dynamics.position_projection import residual_rows, residual_stabilisation
from simwarp.kernels.dynamics.tree import backward_pass, factor_tree, forward_pass
from simwarp.kernels.meshes.mesh_links import NODE, load_loose_nodes

wp.set_module_options({"enable_backward": False})

NEWTON_ITERATIONS = wp.constant(30)
ASSEMBLED = wp.constant(1.0e-6)  # m or rad: the float32 solve reaches about 1e-7 of the lever arms
GIVEN_UP = wp.constant(1.0e-4)


@wp.func
def axis_rotation(axis: int, angle: wp.float64) -> wp.mat33d:
    """Rotation about a coordinate axis."""
    v = wp.vec3d()
    v[axis] = wp.float64(1.0)
    return wp.quat_to_matrix(wp.quat_from_axis_angle(v, angle))


@wp.func
def exponential(x: wp.float64, y: wp.float64, z: wp.float64) -> wp.mat33d:
    """Rotation of a rotation vector."""
    v = wp.vec3d(x, y, z)
    angle = wp.length(v)
    if angle < wp.float64(1e-12):
        return wp.identity(n=3, dtype=wp.float64)
    return wp.quat_to_matrix(wp.quat_from_axis_angle(v / angle, angle))


@wp.struct
class JointPose:
    """Frame 1 seen from frame 0."""

    p: wp.vec3d
    r: wp.mat33d


@wp.func
def joint_pose(kind: int, first: int, world: int, length: wp.float64, joint_q: wp.array2d[float]) -> JointPose:
    """Relative pose of a joint's frames for its coordinates; `length` is that of an elastic joint at rest [m]."""
    pose = JointPose()
    pose.r = wp.identity(n=3, dtype=wp.float64)
    if kind == REVOLUTE:
        pose.r = axis_rotation(2, wp.float64(joint_q[world, first]))
    elif kind == PRISMATIC:
        pose.p = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(joint_q[world, first]))
    elif kind == CYLINDRICAL:
        pose.p = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(joint_q[world, first]))
        pose.r = axis_rotation(2, wp.float64(joint_q[world, first + 1]))
    elif kind == UNIVERSAL:
        pose.r = axis_rotation(0, wp.float64(joint_q[world, first]))
        pose.r = pose.r * axis_rotation(1, wp.float64(joint_q[world, first + 1]))
    elif kind == PLANAR:
        pose.p = wp.vec3d(wp.float64(joint_q[world, first]), wp.float64(joint_q[world, first + 1]), wp.float64(0.0))
        pose.r = axis_rotation(2, wp.float64(joint_q[world, first + 2]))
    elif kind == SPHERICAL:
        pose.r = exponential(
            wp.float64(joint_q[world, first]),
            wp.float64(joint_q[world, first + 1]),
            wp.float64(joint_q[world, first + 2]),
        )
    elif kind == FREE:
        pose.p = wp.vec3d(
            wp.float64(joint_q[world, first]),
            wp.float64(joint_q[world, first + 1]),
            wp.float64(joint_q[world, first + 2]),
        )
        pose.r = exponential(
            wp.float64(joint_q[world, first + 3]),
            wp.float64(joint_q[world, first + 4]),
            wp.float64(joint_q[world, first + 5]),
        )
    elif kind == ELASTIC:
        x = wp.float64(joint_q[world, first + 3])
        y = wp.float64(joint_q[world, first + 4])
        z = wp.float64(joint_q[world, first + 5])
        half = wp.float64(0.5)
        pose.r = exponential(x, y, z)
        pose.p = exponential(half * x, half * y, half * z) * wp.vec3d(
            length + wp.float64(joint_q[world, first]),
            wp.float64(joint_q[world, first + 1]),
            wp.float64(joint_q[world, first + 2]),
        )
    return pose


@wp.func
def place_links(world: int, topology: Topology, parameters: Parameters, joint_q: wp.array2d[float], work: Work):
    """Poses of the tree from its coordinates; floating roots without a named joint stay where they are."""
    for link in range(topology.link_count):
        joint = topology.link_joint[link]
        body = topology.link_body[link]
        if joint >= 0 and body >= 0:
            length = parameters.joint_offset[world_row(world, parameters.joint_offset.shape[0]), joint]
            pose = joint_pose(topology.link_type[link], topology.joint_dof[joint], world, length, joint_q)
            frames = joint_frames(joint, world, topology, parameters, work)
            anchor0 = parameters.joint_anchor0[world_row(world, parameters.joint_anchor0.shape[0]), joint]
            anchor1 = parameters.joint_anchor1[world_row(world, parameters.joint_anchor1.shape[0]), joint]
            frame0 = parameters.joint_frame0[world_row(world, parameters.joint_frame0.shape[0]), joint]
            frame1 = parameters.joint_frame1[world_row(world, parameters.joint_frame1.shape[0]), joint]
            rot = wp.mat33d()
            x = wp.vec3d()
            if topology.link_sign[link] > 0.0:
                origin = frames.r0
                if topology.joint_body0[joint] >= 0:
                    origin += work.x[topology.joint_body0[joint]]
                rot = frames.f0 * pose.r * wp.transpose(frame1)
                x = origin + frames.f0 * pose.p - rot * anchor1
            else:
                origin = frames.r1
                if topology.joint_body1[joint] >= 0:
                    origin += work.x[topology.joint_body1[joint]]
                f0 = frames.f1 * wp.transpose(pose.r)
                rot = f0 * wp.transpose(frame0)
                x = origin - f0 * pose.p - rot * anchor0
            work.x[body] = x
            work.rot[body] = rot
            work.quat[body] = wp.normalize(wp.quat_from_matrix(rot))


@wp.func
def clear_velocities(topology: Topology, work: Work):
    """Start velocities of zero: an assembly moves positions only."""
    for link in range(topology.link_count):
        work.o_ang[link] = wp.vec3()
        work.o_lin[link] = wp.vec3()


@wp.func
def place_joints(world: int, topology: Topology, parameters: Parameters, config: StepConfig, work: Work):
    """Columns and shifts of all tree joints at the poses in `work`, without stabilisation."""
    for link in range(topology.link_count):
        kind = topology.link_type[link]
        if kind == ELASTIC:
            place_elastic(link, world, topology, parameters, work)
        elif kind != FREE and kind != SHAFT and kind != NODE:
            link_geometry(link, world, 0.0, topology, parameters, config, work)


@wp.func
def factor_at_poses(
    world: int, topology: Topology, parameters: Parameters, state: StateArrays, control: ControlArrays,
    config: StepConfig, work: Work,
):  # fmt: skip
    """Tree and row factors at the poses in `work`."""
    dt = config.dt
    time = state.world_time[world]
    load_bodies(world, dt, topology, parameters, state, control, config, work)
    clear_velocities(topology, work)
    load_tree_dofs(world, time, topology, parameters, state, control, config, work)
    place_joints(world, topology, parameters, config, work)
    gain_stiffness(world, topology, parameters, config, work)
    for tree_dof in range(topology.tree_dof_count):
        work.rate[tree_dof] = 0.0
        work.effort[tree_dof] = 0.0
    load_loose_nodes(topology, work)
    factor_tree(topology, work)
    for index in range(topology.loop_joint_count):
        loop_joint_rows(index, world, dt, time, topology, parameters, state, control, config, work)
    combination_laws(world, time, topology, parameters, state, control, config, work)
    loop_responses(topology, work)
    for coupling in range(topology.row_count - topology.joint_row_count):
        coupling_row(coupling, world, dt, topology, parameters, state, config, work)
    factor_rows(topology, config.pivot_tolerance, work)


@wp.func
def close_loops(
    world: int, topology: Topology, parameters: Parameters, state: StateArrays, control: ControlArrays,
    config: StepConfig, work: Work,
) -> float:  # fmt: skip
    """Newton's method on the positions in the mass metric; returns the violation left [m or rad]."""
    error = float(1.0e30)
    iteration = int(0)
    while iteration < NEWTON_ITERATIONS and error > ASSEMBLED:
        iteration += 1
        factor_at_poses(world, topology, parameters, state, control, config, work)
        error = residual_stabilisation(world, 1.0, topology, parameters, work)
        backward_pass(1.0, topology, work)
        forward_pass(topology, work)
        error = wp.max(error, residual_rows(world, 1.0, topology, parameters, work))
        solve_rows(topology, work)
        for row in range(topology.row_count):
            respond_to_row(row, work.row_r[row], topology, work)
        forward_pass(topology, work)
        for link in range(topology.link_count):
            body = topology.link_body[link]
            if body >= 0:
                v = work.v_lin[link]
                work.x[body] = work.x[body] + wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))
                q = turned(work.quat[body], work.v_ang[link])
                work.quat[body] = q
                work.rot[body] = wp.quat_to_matrix(q)
    return error


@wp.func
def link_rates(
    world: int, topology: Topology, parameters: Parameters, joint_qd: wp.array2d[float], state: StateArrays,
    work: Work,
):  # fmt: skip
    """Link velocities from the tree's rates, root to leaf; leaves momentum in `p` (rigid inertias in place)."""
    for link in range(topology.link_count):
        joint = topology.link_joint[link]
        body = topology.link_body[link]
        parent = topology.link_parent[link]
        kind = topology.link_type[link]
        ang = wp.vec3()
        lin = wp.vec3()
        if kind == NODE:
            lin = state.body_v[world, body]
        elif kind == FREE:
            ang = state.body_omega[world, body]
            lin = state.body_v[world, body]
            if joint >= 0:
                first = topology.joint_dof[joint]
                ang = wp.vec3(joint_qd[world, first + 3], joint_qd[world, first + 4], joint_qd[world, first + 5])
                lin = wp.vec3(joint_qd[world, first], joint_qd[world, first + 1], joint_qd[world, first + 2])
                frames = joint_frames(joint, world, topology, parameters, work)
                lin -= wp.cross(ang, to_float(frames.r1))
        elif kind == SHAFT:
            tree_dof = topology.link_tree_dof[link]
            work.effort[tree_dof] = work.gain[tree_dof] * joint_qd[world, topology.tree_dof_to_dof[tree_dof]]
        else:
            if parent >= 0:
                ang = work.v_ang[parent]
                lin = work.v_lin[parent] + wp.cross(ang, work.shift[link])
            for tree_dof in range(topology.link_tree_dof[link], topology.link_tree_dof[link + 1]):
                rate = joint_qd[world, topology.tree_dof_to_dof[tree_dof]]
                ang += work.s_ang[tree_dof] * rate
                lin += work.s_lin[tree_dof] * rate
        work.v_ang[link] = ang
        work.v_lin[link] = lin


@wp.func
def place_world(
    world: int, topology: Topology, parameters: Parameters, joint_q: wp.array2d[float], state: StateArrays, work: Work
):
    """Poses of one world's tree from its coordinates, and the coordinates that were asked for."""
    load_poses(world, topology, state, work)
    place_links(world, topology, parameters, joint_q, work)
    for dof in range(topology.dof_count):
        # turns are counted from what was asked for
        state.joint_x[world, dof] = wp.float64(joint_q[world, dof])
        state.joint_q[world, dof] = joint_q[world, dof]
        state.joint_qd[world, dof] = 0.0


@wp.func
def publish_placed(
    world: int, error: float, topology: Topology, parameters: Parameters, state: StateArrays, work: Work
):
    """Poses and coordinates of a world that was placed, with `error` left in its loops; its impulses are forgotten."""
    publish_poses(world, topology, state, work)
    publish_coordinates(world, 0.0, topology, parameters, state, work)
    status = int(0)
    if error > GIVEN_UP:
        status = NOT_ASSEMBLED
    state.world_status[world] = status
    for row in range(state.box_impulse.shape[1]):
        state.box_impulse[world, row] = 0.0


@wp.func
def set_tree_velocities(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    joint_qd: wp.array2d[float], state: StateArrays, work: Work,
):  # fmt: skip
    """Velocities of the links at the poses in `work`, from the rates of the tree alone."""
    clear_velocities(topology, work)
    load_tree_dofs(world, state.world_time[world], topology, parameters, state, control, config, work)
    for tree_dof in range(topology.tree_dof_count):
        work.rate[tree_dof] = 0.0
    place_joints(world, topology, parameters, config, work)
    link_rates(world, topology, parameters, joint_qd, state, work)
    for link in range(topology.link_count):
        work.t_ang[link] = work.v_ang[link]
        work.t_lin[link] = work.v_lin[link]


@wp.func
def bind_velocities(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    joint_qd: wp.array2d[float], state: StateArrays, work: Work,
):  # fmt: skip
    """Change the velocities of `set_tree_velocities` to the nearest, in the mass metric, that rows of loops allow."""
    factor_at_poses(world, topology, parameters, state, control, config, work)
    for row in range(topology.row_count):
        work.row_b[row] = 0.0
        work.row_impulse[row] = 0.0
    for tree_dof in range(topology.tree_dof_count):
        dof = topology.tree_dof_to_dof[tree_dof]
        work.xi[tree_dof] = 0.0
        work.k_qd[tree_dof] = 0.0
        if dof >= 0:
            work.k_qd[tree_dof] = joint_qd[world, dof]
            work.qd[tree_dof] = joint_qd[world, dof]
    rows_residual(topology, parameters, world, work)
    for row in range(topology.row_count):
        # efforts of springs and drives are no part of a set state; prescribed motions are
        dof = topology.row_dof[row]
        if dof >= 0:
            if topology.dof_drive[dof] < PRESCRIBED_POSITION:
                work.row_r[row] = 0.0
    for coupling in range(topology.row_count - topology.joint_row_count):
        row = topology.coupling_row[coupling]
        if work.row_compliance[row] > 0.0 or topology.coupling_law[coupling] >= 0:
            work.row_r[row] = 0.0  # a viscous coupling, or a combination
    solve_rows(topology, work)
    apply_rows(topology, work)
    for link in range(topology.link_count):
        work.stabilisation_ang[link] = wp.vec3()
        work.stabilisation_lin[link] = wp.vec3()
    forward_pass(topology, work)
    for link in range(topology.link_count):
        work.t_ang[link] = work.t_ang[link] + work.v_ang[link]
        work.t_lin[link] = work.t_lin[link] + work.v_lin[link]
    for tree_dof in range(topology.tree_dof_count):
        work.k_qd[tree_dof] = work.k_qd[tree_dof] + work.qd[tree_dof]


@wp.func
def publish_set_velocities(
    world: int, topology: Topology, parameters: Parameters, joint_qd: wp.array2d[float], state: StateArrays,
    work: Work,
):  # fmt: skip
    """Velocities of bodies and joints that were set."""
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            state.body_v[world, body] = work.t_lin[link]
            state.body_omega[world, body] = work.t_ang[link]
            state.body_omega_last[world, body] = work.t_ang[link]
            state.body_omega_low[world, body] = wp.vec3()
            state.body_v_low[world, body] = wp.vec3()
    publish_set_rates(world, topology, parameters, joint_qd, state, work)


@wp.func
def publish_set_rates(
    world: int, topology: Topology, parameters: Parameters, joint_qd: wp.array2d[float], state: StateArrays,
    work: Work,
):  # fmt: skip
    """joint_qd of the velocities in `work`."""
    for dof in range(topology.dof_count):
        tree_dof = topology.dof_to_tree_dof[dof]
        rate = joint_qd[world, dof]
        if topology.dof_sum[dof] >= 0:
            rate = combined_rate(dof, world, topology, parameters, state)
        elif tree_dof < 0:
            rate = dof_rate(dof, world, topology, parameters, work)
        elif topology.row_count > 0:
            rate = work.k_qd[tree_dof]
            if topology.link_type[topology.tree_dof_link[tree_dof]] == FREE:  # rows move roots too
                rate = dof_rate(dof, world, topology, parameters, work)
        state.joint_qd[world, dof] = rate


@wp.func
def measure_world(world: int, topology: Topology, parameters: Parameters, state: StateArrays, work: Work):
    """Coordinates, rates and the float32 view of the poses and velocities of record."""
    load_poses(world, topology, state, work)
    publish_poses(world, topology, state, work)
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            work.t_ang[link] = state.body_omega[world, body]
            work.t_lin[link] = state.body_v[world, body]
            state.body_omega_last[world, body] = state.body_omega[world, body]
            state.body_omega_low[world, body] = wp.vec3()
            state.body_v_low[world, body] = wp.vec3()
    publish_coordinates(world, 0.0, topology, parameters, state, work)
    for dof in range(topology.dof_count):
        if topology.dof_sum[dof] >= 0:
            state.joint_qd[world, dof] = combined_rate(dof, world, topology, parameters, state)
        elif topology.joint_type[topology.dof_joint[dof]] == ELASTIC:
            joint = topology.dof_joint[dof]
            local = dof - topology.joint_dof[joint]
            rates = joint_rate(joint, world, topology, parameters, work)
            state.joint_qd[world, dof] = wp.where(local < 3, rates.lin[local % 3], rates.ang[local % 3])
        elif topology.joint_type[topology.dof_joint[dof]] != SHAFT:
            state.joint_qd[world, dof] = dof_rate(dof, world, topology, parameters, work)
