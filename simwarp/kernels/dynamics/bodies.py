"""Bodies: poses into scratch, momentum and free motion, pose update, published coordinates."""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import matrix_to_float, turned
from simwarp.kernels.core.world_status import SINGULAR
from simwarp.kernels.dynamics.bilateral_rows import (
    coefficient_of,
    combined_coordinate,
    combined_rate,
    link_of,
    rate_of,
    row_geometry,
)
from simwarp.kernels.dynamics.efforts import (
    PRESCRIBED_POSITION,
    applied_effort,
    dof_effort,
    is_prescribed,
    prescribed_rate,
    rotation_effort,
)
from simwarp.kernels.dynamics.elastic import frames_halfway
from simwarp.kernels.dynamics.joints import (
    COMBINATION,
    DISTANCE,
    ELASTIC,
    FREE,
    POINT_AXIS0,
    RELATIVE_ROTATION,
    SHAFT,
    SPHERICAL,
    coordinate,
    joint_frames,
    joint_rotation_vector,
    unwrapped,
    wraps,
)
from simwarp.kernels.dynamics.recovery import make_recovery
from simwarp.kernels.dynamics.tree import Wrench, has_held_rate

wp.set_module_options({"enable_backward": False})


@wp.func
def load_poses(world: int, topology: Topology, state: StateArrays, work: Work):
    """Poses of record into `x`, `quat`, `rot`."""
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            work.x[body] = state.body_x[world, body]
            q = state.body_rot[world, body]
            work.quat[body] = q
            work.rot[body] = wp.quat_to_matrix(q)


@wp.func(inline=True)
def total_velocities(topology: Topology, work: Work):
    """T <- velocity of the start plus its change."""
    for link in range(topology.link_count):
        work.t_ang[link] = work.o_ang[link] + (work.v_ang[link] + work.l_ang[link])
        work.t_lin[link] = work.o_lin[link] + (work.v_lin[link] + work.l_lin[link])


@wp.func
def advance_poses(world: int, dt: float, topology: Topology, state: StateArrays, work: Work):
    """`x`, `quat`, `rot` <- poses of record moved by dt times the link velocities (exponential map)."""
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            v = work.t_lin[link]
            h = wp.float64(dt)
            work.x[body] = state.body_x[world, body] + wp.vec3d(
                h * wp.float64(v[0]), h * wp.float64(v[1]), h * wp.float64(v[2])
            )
            q = turned(state.body_rot[world, body], work.t_ang[link] * dt)
            work.quat[body] = q
            work.rot[body] = wp.quat_to_matrix(q)


@wp.func
def gyroscopic_update(inertia: wp.mat33, omega: wp.vec3, dt: float) -> wp.vec3:
    """Change of the body rate [rad/s, body frame] in dt of free spin: implicit midpoint, which keeps energy and
    |momentum|.

    I d + dt/4 (2 w + d) x I (2 w + d) = 0 by Newton's method on the change d itself, which keeps its accuracy.
    """
    d = wp.vec3()
    scale = dt * wp.dot(omega, omega) * wp.trace(inertia)
    for _iteration in range(4):
        s = 2.0 * omega + d
        i_s = inertia * s
        f = inertia * d + (0.25 * dt) * wp.cross(s, i_s)
        if wp.length(f) <= 1.0e-8 * scale:
            return d
        jacobian = inertia + (0.25 * dt) * (wp.skew(s) * inertia - wp.skew(i_s))
        d -= wp.inverse(jacobian) * f
    return d


FAST_TURN = wp.constant(0.15)  # rad per step: the extrapolation grows by x^4 / 4 per step, here 1e-4


@wp.func
def gyroscopic_torque(alone: int, inertia: wp.mat33, omega: wp.vec3, omega_last: wp.vec3, dt: float) -> wp.vec3:
    """-omega x I omega at the middle of the two velocities that the step connects [N·m, body frame].

    A body that no joint touches spins by the implicit midpoint rule, which keeps its energy. A jointed one must not:
    what it would do alone has a component along its joints. There the rate is extrapolated by half a step, which is of
    second order and does no work on a fixed axis. Above `FAST_TURN` the extrapolation would be unstable.
    """
    if alone == 1 or dt * wp.length(omega) > FAST_TURN:
        return inertia * gyroscopic_update(inertia, omega, dt) / dt
    middle = 1.5 * omega - 0.5 * omega_last
    return -wp.cross(middle, inertia * middle)


@wp.func
def applied_force(world: int, body: int, rot: wp.mat33, control: ControlArrays) -> wp.vec3:
    """Force on a body from the user and from the model's force elements [N, world]."""
    return (
        control.body_force[world, body]
        + rot * control.body_force_b[world, body]
        + control.element_force[world_row(world, control.element_force.shape[0]), body]
    )


@wp.func
def applied_torque(world: int, body: int, control: ControlArrays) -> wp.vec3:
    """The same of torques about the centre of mass [N·m], but for `body_torque_b`, which joins the gyroscopic one."""
    return (
        control.body_torque[world, body]
        + control.element_torque[world_row(world, control.element_torque.shape[0]), body]
    )


@wp.func
def load_bodies(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, control: ControlArrays,
    config: StepConfig, work: Work,
):  # fmt: skip
    """Rigid inertias about the centres of mass, velocities of the start, and the step's applied impulses, world axes.

    The step solves for the change of velocity: a momentum that nothing changes is not rounded at all.
    """
    gravity = parameters.gravity[world_row(world, parameters.gravity.shape[0])]
    wm = world_row(world, parameters.body_mass.shape[0])
    wi = world_row(world, parameters.body_inertia_b.shape[0])
    for link in range(topology.link_count):
        work.o_ang[link] = wp.vec3()
        work.o_lin[link] = wp.vec3()
        work.l_ang[link] = wp.vec3()
        work.l_lin[link] = wp.vec3()
        body = topology.link_body[link]
        if body >= 0:
            rot = matrix_to_float(work.rot[body])
            mass = parameters.body_mass[wm, body]
            inertia_b = parameters.body_inertia_b[wi, body]
            omega = state.body_omega[world, body]
            work.o_ang[link] = omega
            work.o_lin[link] = state.body_v[world, body]
            work.l_ang[link] = state.body_omega_low[world, body]
            work.l_lin[link] = state.body_v_low[world, body]
            torque_b = control.body_torque_b[world, body]
            if config.gyroscopic == 1 and mass > 0.0:
                torque_b += gyroscopic_torque(
                    topology.link_alone[link], inertia_b, omega * rot, state.body_omega_last[world, body] * rot, dt
                )
            work.inertia[link] = rot * inertia_b * wp.transpose(rot)
            work.coupling[link] = wp.mat33()
            work.mass[link] = wp.mat33(mass, 0.0, 0.0, 0.0, mass, 0.0, 0.0, 0.0, mass)
            if control.element_mass.shape[0] > 0:
                work.inertia[link] = work.inertia[link] + control.element_inertia[world, body]
                work.coupling[link] = control.element_coupling[world, body]
                work.mass[link] = work.mass[link] + control.element_mass[world, body]
            force = applied_force(world, body, rot, control) + mass * gravity
            work.p_ang[link] = dt * (rot * torque_b + applied_torque(world, body, control))
            work.p_lin[link] = dt * force


@wp.func
def load_tree_dofs(
    world: int, time: wp.float64, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig, work: Work,
):  # fmt: skip
    """Gain, effort and prescribed rate of every tree degree of freedom."""
    for tree_dof in range(topology.tree_dof_count):
        dof = topology.tree_dof_to_dof[tree_dof]
        link = topology.tree_dof_link[tree_dof]
        kind = topology.link_type[link]
        work.gain[tree_dof] = 0.0
        work.effort[tree_dof] = 0.0
        work.rate[tree_dof] = 0.0
        work.start[tree_dof] = 0.0
        if dof >= 0:
            q = state.joint_x[world, dof]
            if topology.dof_drive[dof] >= PRESCRIBED_POSITION:
                limit = config.max_depenetration_rate
                if topology.dof_kind[dof] == POINT_AXIS0:
                    limit = config.max_depenetration_velocity
                work.gain[tree_dof] = -1.0
                work.rate[tree_dof] = prescribed_rate(dof, world, config, time, q, limit, topology, control)
            elif kind == SPHERICAL:
                work.rate[tree_dof] = state.joint_qd[world, dof]
            elif kind != FREE and kind != ELASTIC:
                rate = state.joint_qd[world, dof]
                implicit = dof_effort(dof, world, config, float(q), rate, topology, parameters, control)
                work.gain[tree_dof] = implicit.gain
                work.effort[tree_dof] = implicit.change
                work.start[tree_dof] = implicit.start
                work.rate[tree_dof] = rate
            last = tree_dof + 1 == topology.link_tree_dof[link + 1]
            if kind == SPHERICAL and last and topology.link_sprung[link] == 0:
                load_rotation(tree_dof - 2, world, topology, parameters, state, control, config, work)


@wp.func
def load_rotation(
    first: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, config: StepConfig, work: Work,
):  # fmt: skip
    """Gains and efforts of the three tree degrees of freedom of a ball whose springs pull alike about all axes."""
    dof = topology.tree_dof_to_dof[first]
    implicit = rotation_effort(dof, world, config, 1, topology, parameters, state, control)
    for i in range(3):
        if not is_prescribed(dof + i, topology):
            work.gain[first + i] = float(implicit.gain[i, i])
            work.effort[first + i] = float(implicit.change[i])


@wp.struct
class DistanceGeometry:
    """A line between a body and its parent in the tree, which one coordinate moves: its wrenches on body 0 and body 1,
    and its lever, the length's rate per rate of that coordinate.
    """

    w0: Wrench
    w1: Wrench
    lever: float


@wp.func
def distance_dof(index: int, world: int, topology: Topology, parameters: Parameters, work: Work) -> DistanceGeometry:
    """Geometry of a line at the poses in `work`."""
    joint = topology.dof_joint[topology.distance_dof[index, 0]]
    tree_dof = topology.distance_dof[index, 1]
    frames = joint_frames(joint, world, topology, parameters, work)
    row = row_geometry(topology.joint_type[joint], DISTANCE, 0, 0, wp.float64(0.0), frames)
    line = DistanceGeometry()
    line.w0 = row.w0
    line.w1 = row.w1
    ang = row.w0.ang
    lin = row.w0.lin
    if topology.joint_body1[joint] == topology.link_body[topology.tree_dof_link[tree_dof]]:
        ang = row.w1.ang
        lin = row.w1.lin
    line.lever = wp.dot(work.s_ang[tree_dof], ang) + wp.dot(work.s_lin[tree_dof], lin)
    return line


@wp.func
def load_distances(
    world: int, topology: Topology, parameters: Parameters, state: StateArrays, control: ControlArrays,
    config: StepConfig, work: Work,
):  # fmt: skip
    """Springs and dampers along lines as efforts of the one coordinate that they depend on: no row is needed."""
    for index in range(topology.distance_count):
        dof = topology.distance_dof[index, 0]
        tree_dof = topology.distance_dof[index, 1]
        if work.gain[tree_dof] >= 0.0:  # not prescribed
            line = distance_dof(index, world, topology, parameters, work)
            implicit = dof_effort(
                dof, world, config, state.joint_q[world, dof], state.joint_qd[world, dof], topology, parameters, control
            )
            effort = implicit.effort + implicit.start * (line.lever * work.rate[tree_dof])
            gain = line.lever * line.lever * implicit.gain
            work.gain[tree_dof] = work.gain[tree_dof] + gain
            work.effort[tree_dof] = work.effort[tree_dof] + line.lever * effort - gain * work.rate[tree_dof]


@wp.func
def load_combinations(
    world: int, dt: float, topology: Topology, parameters: Parameters, control: ControlArrays, work: Work
):
    """`joint_force` on combinations without a law, as efforts of their terms."""
    for row in range(topology.row_count, topology.response_count):
        index = row - topology.joint_row_count
        force = applied_effort(world, topology.coupling_law[index], control)
        if force != 0.0:
            for term in range(topology.coupling_dof.shape[1]):
                part = topology.coupling_dof[index, term]
                if part >= 0:
                    tree_dof = topology.dof_to_tree_dof[part]
                    if work.gain[tree_dof] >= 0.0:  # not prescribed
                        coefficient = coefficient_of(index, term, world, parameters)
                        work.effort[tree_dof] = work.effort[tree_dof] + dt * (coefficient * force)


@wp.func
def apply_force(link: int, wrench: Wrench, impulse: float, work: Work):
    """Adds an applied impulse to a link."""
    if link >= 0:
        work.p_ang[link] = work.p_ang[link] + wrench.ang * impulse
        work.p_lin[link] = work.p_lin[link] + wrench.lin * impulse


@wp.func
def apply_row_forces(
    world: int, dt: float, topology: Topology, parameters: Parameters, control: ControlArrays, work: Work
):
    """`joint_force` on coordinates that neither the tree nor a compliant row holds: floating and loop joints."""
    for index in range(topology.loop_dof_count):
        dof = topology.loop_dof[index]
        force = applied_effort(world, dof, control)
        if force != 0.0:
            joint = topology.dof_joint[dof]
            frames = joint_frames(joint, world, topology, parameters, work)
            axis = topology.dof_axis[dof]
            row = row_geometry(topology.joint_type[joint], topology.dof_kind[dof], axis, axis, wp.float64(0.0), frames)
            apply_force(link_of(topology.joint_body0[joint], topology), row.w0, dt * force, work)
            apply_force(link_of(topology.joint_body1[joint], topology), row.w1, dt * force, work)


@wp.func(inline=True)
def publish_motion(
    world: int, projected: int, recovers: int, topology: Topology, parameters: Parameters, config: StepConfig,
    state: StateArrays, work: Work,
) -> int:  # fmt: skip
    """Rates at the old poses, then poses of record; 0 if any value is not finite (nothing written).

    `projected` is 1 where `work` no longer holds the poses of the step's start, `recovers` where a recovery is to be
    made.
    """
    finite = int(1)
    for link in range(topology.link_count):
        total = wp.length(work.t_ang[link]) + wp.length(work.t_lin[link])
        body = topology.link_body[link]
        place = wp.float64(0.0)
        if body >= 0:
            x = state.body_x[world, body]
            q = state.body_rot[world, body]
            place = x[0] + x[1] + x[2] + q[0] + q[1] + q[2] + q[3]
        if not wp.isfinite(total) or not wp.isfinite(place):
            finite = int(0)
    for tree_dof in range(topology.tree_dof_count):
        if not wp.isfinite(work.xi[tree_dof]):
            finite = int(0)
    if finite == 0:
        return 0
    if projected == 1:
        load_poses(world, topology, state, work)
    publish_rates(world, topology, parameters, state, work)
    if topology.massless_count > 0 and has_held_rate(topology, work):
        state.world_status[world] = state.world_status[world] | SINGULAR
    advance_poses(world, config.dt, topology, state, work)
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            state.body_omega_last[world, body] = state.body_omega[world, body]
            state.body_omega_low[world, body] = (work.v_ang[link] + work.l_ang[link]) - (
                work.t_ang[link] - work.o_ang[link]
            )
            state.body_v_low[world, body] = (work.v_lin[link] + work.l_lin[link]) - (
                work.t_lin[link] - work.o_lin[link]
            )
            state.body_v[world, body] = work.t_lin[link]
            state.body_omega[world, body] = work.t_ang[link]
    if recovers == 1:
        make_recovery(world, topology, config, state, work)
    publish_poses(world, topology, state, work)
    return 1


@wp.func
def publish_poses(world: int, topology: Topology, state: StateArrays, work: Work):
    """Poses of record and their float32 view from `x` and `quat`."""
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            x = work.x[body]
            q = work.quat[body]
            state.body_x[world, body] = x
            state.body_rot[world, body] = q
            state.body_q[world, body] = wp.transform(
                wp.vec3(float(x[0]), float(x[1]), float(x[2])),
                wp.quat(float(q[0]), float(q[1]), float(q[2]), float(q[3])),
            )


@wp.func
def publish_rates(world: int, topology: Topology, parameters: Parameters, state: StateArrays, work: Work):
    """joint_qd: what the step solved for in the tree; measured in the frames of the step's start elsewhere."""
    for joint in range(topology.joint_count):
        first = topology.joint_dof[joint]
        end = topology.joint_dof[joint + 1]
        if topology.joint_type[joint] == COMBINATION:
            state.joint_qd[world, first] = combined_rate(first, world, topology, parameters, state)
        elif end > first:
            if topology.dof_to_tree_dof[first] >= 0 and topology.joint_type[joint] != FREE:
                for dof in range(first, end):
                    state.joint_qd[world, dof] = work.qd[topology.dof_to_tree_dof[dof]]
            else:
                frames = joint_frames(joint, world, topology, parameters, work)
                for dof in range(first, end):
                    state.joint_qd[world, dof] = rate_of(dof, joint, frames, topology, work)


@wp.func
def publish_coordinates(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, work: Work
):
    """joint_x and joint_q measured at the poses in `work`; shafts are integrated. The terms of a combination come
    before it.
    """
    for joint in range(topology.joint_count):
        kind = topology.joint_type[joint]
        first = topology.joint_dof[joint]
        end = topology.joint_dof[joint + 1]
        if kind == SHAFT or kind == RELATIVE_ROTATION:
            q = state.joint_x[world, first] + wp.float64(dt) * wp.float64(state.joint_qd[world, first])
            state.joint_x[world, first] = q
            state.joint_q[world, first] = float(q)
        elif kind == COMBINATION:
            total = combined_coordinate(first, world, topology, parameters, state)
            state.joint_x[world, first] = total
            state.joint_q[world, first] = float(total)
        elif end > first:
            frames = joint_frames(joint, world, topology, parameters, work)
            angles = joint_rotation_vector(kind, frames)
            if kind == ELASTIC:
                row = world_row(world, parameters.joint_offset.shape[0])
                frames = frames_halfway(frames, angles, parameters.joint_offset[row, joint])
            for dof in range(first, end):
                value = coordinate(kind, dof - first, topology.dof_coupled[dof], frames, angles)
                if wraps(kind, topology.dof_kind[dof]):
                    near = state.joint_x[world, dof] + wp.float64(dt) * wp.float64(state.joint_qd[world, dof])
                    value = unwrapped(value, near)
                state.joint_x[world, dof] = value
                state.joint_q[world, dof] = float(value)
