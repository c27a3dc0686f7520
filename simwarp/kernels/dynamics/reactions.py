"""Reaction force and torque of every joint, from the balance of impulses of the step."""

import warp as wp

from simwarp.kernels.cones.problem import ConeProblem
from simwarp.kernels.core.face_tables import face_of, face_side, has_face_code
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, Reports, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import contact_frame, matrix_to_float, to_float
from simwarp.kernels.dynamics.bilateral_rows import coefficient_of, link_of, row_geometry
from simwarp.kernels.dynamics.bodies import applied_force, applied_torque, distance_dof, gyroscopic_torque
from simwarp.kernels.dynamics.contact_points import corner_arm
from simwarp.kernels.dynamics.efforts import applied_effort, dof_effort
from simwarp.kernels.dynamics.joints import FREE, SHAFT, joint_frames

wp.set_module_options({"enable_backward": False})


@wp.func
def subtract_wrench(link: int, ang: wp.vec3, lin: wp.vec3, scale: float, work: Work):
    """Removes a row's impulse from what the link's tree joint must have transmitted."""
    if link >= 0:
        work.f_ang[link] = work.f_ang[link] - ang * scale
        work.f_lin[link] = work.f_lin[link] - lin * scale


@wp.func
def subtract_contact(contact: int, world: int, topology: Topology, contacts: ContactArrays, work: Work):
    """A contact's impulse, off the account of the joints of both links."""
    frame = contact_frame(contacts.contact_normal_w[world, contact])
    impulse = contacts.contact_impulse[world, contact] * frame
    m = contacts.contact_moment[world, contact]
    moment = wp.vec3(m[2], m[0], m[1]) * frame
    link0 = link_of(topology.shape_body[contacts.contact_shape0[world, contact]], topology)
    link1 = link_of(topology.shape_body[contacts.contact_shape1[world, contact]], topology)
    if has_face_code():
        face = face_of(world, contact, topology, contacts)
        if face >= 0:
            sign = float(1.0)
            if face_side(face, world, contact, topology, contacts) == 0:
                sign = -1.0
                link0 = -1
            else:
                link1 = -1
            for k in range(3):
                point = topology.face[face, k]
                link = link_of(topology.face_point[point, 0], topology)
                part = contacts.contact_weights[world, contact][k] * impulse
                subtract_wrench(link, wp.cross(corner_arm(point, topology, work), part), part, sign, work)
    subtract_wrench(link0, wp.cross(contacts.contact_arm0[world, contact], impulse) + moment, impulse, -1.0, work)
    subtract_wrench(link1, wp.cross(contacts.contact_arm1[world, contact], impulse) + moment, impulse, 1.0, work)


@wp.func
def subtract_relative_rotations(coupling: int, dt: float, topology: Topology, work: Work, world: int, reports: Reports):
    """A coupling's impulses on the bodies that its RELATIVE_ROTATION terms name: reactions of those joints, off the
    account of the bodies' own.
    """
    for term in range(topology.coupling_wrench.shape[1]):
        entry = topology.coupling_wrench[coupling, term]
        if entry >= 0:
            joint = topology.dof_joint[topology.coupling_dof[coupling, term]]
            impulse = work.row_impulse[topology.coupling_row[coupling]]
            link0 = link_of(topology.joint_body0[joint], topology)
            link1 = link_of(topology.joint_body1[joint], topology)
            subtract_wrench(link0, work.j0_ang[entry], work.j0_lin[entry], impulse, work)
            subtract_wrench(link1, work.j1_ang[entry], work.j1_lin[entry], impulse, work)
            torque = work.j1_ang[entry] * (impulse / dt)
            reports.joint_reaction_torque[world, joint] = reports.joint_reaction_torque[world, joint] + torque


@wp.func
def subtract_from_shafts(
    coupling: int, impulse: float, world: int, dt: float, topology: Topology, parameters: Parameters, reports: Reports
):
    """What a coupling or combination gives to its shafts, off their account."""
    for term in range(topology.coupling_dof.shape[1]):
        dof = topology.coupling_dof[coupling, term]
        if dof >= 0:
            joint = topology.dof_joint[dof]
            if topology.joint_type[joint] == SHAFT:
                torque = wp.vec3(coefficient_of(coupling, term, world, parameters) * (impulse / dt), 0.0, 0.0)
                reports.joint_reaction_torque[world, joint] = reports.joint_reaction_torque[world, joint] - torque


@wp.func
def unexplained_torque(
    joint: int, world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, work: Work
) -> wp.vec3:
    """Change of a shaft's momentum over the step's time, in x [N·m]; zero of other joints."""
    if topology.joint_type[joint] != SHAFT:
        return wp.vec3()
    dof = topology.joint_dof[joint]
    inertia = parameters.joint_armature[world_row(world, parameters.joint_armature.shape[0]), dof]
    change = work.qd[topology.dof_to_tree_dof[dof]] - state.joint_qd[world, dof]
    return wp.vec3(inertia * (change / dt), 0.0, 0.0)


@wp.func
def subtract_distance_spring(
    index: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays, control: ControlArrays,
    config: StepConfig, work: Work, reports: Reports,
):  # fmt: skip
    """The impulse of a spring on a tree degree of freedom: its own reaction, off the account of the joint."""
    dof = topology.distance_dof[index, 0]
    joint = topology.dof_joint[dof]
    line = distance_dof(index, world, topology, parameters, work)
    tree_dof = topology.distance_dof[index, 1]
    before = line.lever * state.joint_qd[world, topology.tree_dof_to_dof[tree_dof]]
    implicit = dof_effort(
        dof, world, config, state.joint_q[world, dof], state.joint_qd[world, dof], topology, parameters, control
    )
    dt = config.dt
    impulse = implicit.effort + implicit.start * before - implicit.gain * line.lever * work.qd[tree_dof]
    subtract_wrench(link_of(topology.joint_body0[joint], topology), line.w0.ang, line.w0.lin, impulse, work)
    subtract_wrench(link_of(topology.joint_body1[joint], topology), line.w1.ang, line.w1.lin, impulse, work)
    frames = joint_frames(joint, world, topology, parameters, work)
    force = line.w1.lin * (impulse / dt)
    reports.joint_reaction_force[world, joint] = force
    reports.joint_reaction_torque[world, joint] = line.w1.ang * (impulse / dt) - wp.cross(to_float(frames.r1), force)


@wp.func
def subtract_dof_impulse(
    dof: int, impulse: float, world: int, dt: float, topology: Topology, parameters: Parameters, work: Work,
    reports: Reports,
):  # fmt: skip
    """An impulse along a coordinate of a loop joint: part of that joint's reaction, off the tree's account."""
    joint = topology.dof_joint[dof]
    frames = joint_frames(joint, world, topology, parameters, work)
    axis = topology.dof_axis[dof]
    row = row_geometry(topology.joint_type[joint], topology.dof_kind[dof], axis, axis, wp.float64(0.0), frames)
    subtract_wrench(link_of(topology.joint_body0[joint], topology), row.w0.ang, row.w0.lin, impulse, work)
    subtract_wrench(link_of(topology.joint_body1[joint], topology), row.w1.ang, row.w1.lin, impulse, work)
    if topology.joint_type[joint] != FREE:
        force = row.w1.lin * (impulse / dt)
        torque = row.w1.ang * (impulse / dt) - wp.cross(to_float(frames.r1), force)
        reports.joint_reaction_force[world, joint] = reports.joint_reaction_force[world, joint] + force
        reports.joint_reaction_torque[world, joint] = reports.joint_reaction_torque[world, joint] + torque


@wp.func
def unexplained_impulses(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, control: ControlArrays,
    config: StepConfig, work: Work,
):  # fmt: skip
    """F <- change of momentum minus applied impulses of every body [N·s, N·m·s], about its centre."""
    gravity = parameters.gravity[world_row(world, parameters.gravity.shape[0])]
    for link in range(topology.link_count):
        body = topology.link_body[link]
        work.f_ang[link] = wp.vec3()
        work.f_lin[link] = wp.vec3()
        if body >= 0:
            rot = matrix_to_float(wp.quat_to_matrix(state.body_rot[world, body]))
            mass = parameters.body_mass[world_row(world, parameters.body_mass.shape[0]), body]
            inertia_b = parameters.body_inertia_b[world_row(world, parameters.body_inertia_b.shape[0]), body]
            torque_b = control.body_torque_b[world, body]
            if config.gyroscopic == 1 and mass > 0.0:
                torque_b += gyroscopic_torque(
                    topology.link_alone[link],
                    inertia_b,
                    work.o_ang[link] * rot,
                    state.body_omega_last[world, body] * rot,
                    dt,
                )
            change = inertia_b * (work.v_ang[link] * rot) - dt * torque_b
            work.f_ang[link] = rot * change - dt * applied_torque(world, body, control)
            force = applied_force(world, body, rot, control) + mass * gravity
            work.f_lin[link] = mass * work.v_lin[link] - dt * force
            if control.element_mass.shape[0] > 0:  # an implicit element's force is F - D dv / h
                dv = work.v_lin[link]
                domega = work.v_ang[link]
                block = control.element_coupling[world, body]
                work.f_ang[link] = work.f_ang[link] + control.element_inertia[world, body] * domega + block * dv
                work.f_lin[link] = work.f_lin[link] + control.element_mass[world, body] * dv + domega * block


@wp.func
def record_reactions(
    world: int, dt: float, blocks: int, topology: Topology, parameters: Parameters, state: StateArrays,
    control: ControlArrays, contacts: ContactArrays, config: StepConfig, work: Work, cone: ConeProblem,
    reports: Reports,
):  # fmt: skip
    """Reaction of each joint on its second body, at anchor 1, world axes: drives and limits included. Of shafts the
    torque along them, in x: drives, prescribed motions, springs, friction, limits and `joint_force`, not couplings.
    """
    unexplained_impulses(world, dt, topology, parameters, state, control, config, work)
    for joint in range(topology.joint_count):
        reports.joint_reaction_force[world, joint] = wp.vec3()
        reports.joint_reaction_torque[world, joint] = unexplained_torque(
            joint, world, dt, topology, parameters, state, work
        )
    for index in range(topology.loop_joint_count):
        joint = topology.loop_joint[index]
        link0 = link_of(topology.joint_body0[joint], topology)
        link1 = link_of(topology.joint_body1[joint], topology)
        force = wp.vec3()
        torque = wp.vec3()
        for row in range(topology.loop_row[index, 0], topology.loop_row[index, 2]):
            impulse = work.row_impulse[row]
            subtract_wrench(link0, work.j0_ang[row], work.j0_lin[row], impulse, work)
            subtract_wrench(link1, work.j1_ang[row], work.j1_lin[row], impulse, work)
            force += work.j1_lin[row] * impulse
            torque += work.j1_ang[row] * impulse
        frames = joint_frames(joint, world, topology, parameters, work)
        reports.joint_reaction_force[world, joint] = force / dt
        reports.joint_reaction_torque[world, joint] = (torque - wp.cross(to_float(frames.r1), force)) / dt
    for coupling in range(topology.row_count - topology.joint_row_count):
        subtract_relative_rotations(coupling, dt, topology, work, world, reports)
        row = topology.coupling_row[coupling]
        subtract_from_shafts(coupling, work.row_impulse[row], world, dt, topology, parameters, reports)
    for index in range(topology.distance_count):
        subtract_distance_spring(index, world, topology, parameters, state, control, config, work, reports)
    for block in range(blocks):
        index = work.active[block]
        if index >= topology.box_count:
            subtract_contact(index - topology.box_count, world, topology, contacts, work)
        else:
            dof = topology.box_dof[index]
            impulse = work.b_sign[block] * cone.gamma[cone.block_row[block]]
            # what bounds a combination acts along coordinates of the tree, as drives and limits of these do
            if topology.dof_sum[dof] >= 0:
                subtract_from_shafts(topology.dof_sum[dof], impulse, world, dt, topology, parameters, reports)
            elif topology.dof_to_tree_dof[dof] < 0:
                subtract_dof_impulse(dof, impulse, world, dt, topology, parameters, work, reports)
    for index in range(topology.loop_dof_count):
        dof = topology.loop_dof[index]
        subtract_dof_impulse(
            dof, dt * applied_effort(world, dof, control), world, dt, topology, parameters, work, reports
        )
    for index in range(topology.link_count):
        link = topology.link_count - 1 - index
        parent = topology.link_parent[link]
        joint = topology.link_joint[link]
        ang = work.f_ang[link]
        lin = work.f_lin[link]
        if topology.link_body[link] >= 0 and joint >= 0:
            frames = joint_frames(joint, world, topology, parameters, work)
            sign = topology.link_sign[link]
            lever = to_float(frames.r1)
            if sign < 0.0:
                # the joint's second body is the parent: the reaction on it, at its anchor
                lever = to_float(frames.r0 + frames.d)
            force = lin * (sign / dt)
            torque = (ang - wp.cross(lever, lin)) * (sign / dt)
            if topology.link_sprung[link] == 1:  # beside what its own rows carry
                force += reports.joint_reaction_force[world, joint]
                torque += reports.joint_reaction_torque[world, joint]
            reports.joint_reaction_force[world, joint] = force
            reports.joint_reaction_torque[world, joint] = torque
        if parent >= 0:
            work.f_ang[parent] = work.f_ang[parent] + ang + wp.cross(work.shift[link], lin)
            work.f_lin[parent] = work.f_lin[parent] + lin
