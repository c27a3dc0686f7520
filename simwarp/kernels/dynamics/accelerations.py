"""Accelerations of the coordinates, for models that record `Diagnostics.joint_qdd`.

The step solves for the changes of the rates, in which no rate is rounded. They hold velocity products in the form of a
stabilisation velocity: what the velocities of the start violate at its poses, and C/h of the violation there. That is
right on the average over steps, but late by a step where a state was set, and a difference of rounded velocities over
h. Since the tree answers linearly, its answer to the difference between that and h times the velocity products in
closed form is added, and that of the couplings. With closed loops, whose rows have products of their own, it is not.
"""

import warp as wp

from simwarp.kernels.core.fields import Parameters, Reports, StateArrays
from simwarp.kernels.core.tables import Topology, Work
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.dynamics.bilateral_rows import coefficient_of, link_of, rate_of, respond_to_row, rows_residual
from simwarp.kernels.dynamics.dense_rows import solve_rows
from simwarp.kernels.dynamics.joints import (
    ANGLE0,
    ELASTIC,
    FREE,
    POINT_AXIS0,
    SHAFT,
    allowed_translation,
    joint_frames,
)
from simwarp.kernels.dynamics.tree import Wrench, backward_pass, forward_pass
from simwarp.kernels.meshes.mesh_links import NODE

wp.set_module_options({"enable_backward": False})


@wp.func
def velocity_products(
    link: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays, work: Work
) -> Wrench:
    """Acceleration of a link beyond that of its parent and its columns' [rad/s², m/s²], world axes.

    With the arms p and c of the parent and the link to the joint, and the joint's slide U as seen from body 0:
    x + c = x_parent + p, differentiated twice.
    """
    joint = topology.link_joint[link]
    above = topology.link_parent[link]
    forward = topology.link_sign[link] > 0.0
    frames = joint_frames(joint, world, topology, parameters, work)
    arm0 = to_float(frames.r0 + allowed_translation(topology.link_type[link], frames))
    arm1 = to_float(frames.r1)
    omega = work.o_ang[link]
    carrier = wp.vec3()
    if above >= 0:
        carrier = work.o_ang[above]
    omega0 = carrier
    omega1 = omega
    child = arm1
    parent = arm0
    if not forward:
        omega0 = omega
        omega1 = carrier
        child = arm0
        parent = arm1
    products = Wrench()
    slide = wp.vec3()
    for tree_dof in range(topology.link_tree_dof[link], topology.link_tree_dof[link + 1]):
        dof = topology.tree_dof_to_dof[tree_dof]
        rate = state.joint_qd[world, dof]
        if topology.dof_kind[dof] == POINT_AXIS0:
            slide += work.s_lin[tree_dof] * rate
        elif topology.dof_kind[dof] == ANGLE0:
            products.ang += wp.cross(omega0, work.s_ang[tree_dof]) * rate
        else:
            products.ang += wp.cross(omega1, work.s_ang[tree_dof]) * rate
    products.lin = 2.0 * wp.cross(omega0, slide) - wp.cross(products.ang, child)
    products.lin -= wp.cross(omega, wp.cross(omega, child))
    if above >= 0:
        products.lin += wp.cross(carrier, wp.cross(carrier, parent))
    return products


@wp.func
def add_changes(world: int, topology: Topology, work: Work, reports: Reports):
    """joint_qdd <- itself plus the changes of the rates in `work`, of floating roots those of their velocities."""
    for tree_dof in range(topology.tree_dof_count):
        dof = topology.tree_dof_to_dof[tree_dof]
        if dof >= 0:
            link = topology.tree_dof_link[tree_dof]
            change = work.qd[tree_dof]
            if topology.link_type[link] == FREE:
                local = tree_dof - topology.link_tree_dof[link]
                change = work.v_lin[link][local % 3]
                if local >= 3:
                    change = work.v_ang[link][local % 3]
            reports.joint_qdd[world, dof] = reports.joint_qdd[world, dof] + change


@wp.func
def add_coupling_response(world: int, topology: Topology, parameters: Parameters, work: Work, reports: Reports):
    """Adds the answer of the couplings to a motion in `work` that is not the step's, and is in joint_qdd with it.
    Rigid sums change by nothing at all: what they have violated, by rounding too, is not part of an acceleration.
    """
    rows_residual(topology, parameters, world, work)
    for coupling in range(topology.row_count - topology.joint_row_count):
        row = topology.coupling_row[coupling]
        step = work.row_b[row] + work.row_compliance[row] * work.row_impulse[row]
        work.row_r[row] = work.row_r[row] - step
        if work.row_compliance[row] == 0.0:
            work.row_r[row] = 0.0
            for term in range(topology.coupling_dof.shape[1]):
                dof = topology.coupling_dof[coupling, term]
                if dof >= 0:
                    change = coefficient_of(coupling, term, world, parameters) * reports.joint_qdd[world, dof]
                    work.row_r[row] = work.row_r[row] + change
    solve_rows(topology, work)
    for tree_dof in range(topology.tree_dof_count):
        work.xi[tree_dof] = 0.0
    for row in range(topology.row_count):
        respond_to_row(row, work.row_r[row], topology, work)
    for link in range(topology.link_count):
        work.stabilisation_ang[link] = wp.vec3()
        work.stabilisation_lin[link] = wp.vec3()
    forward_pass(topology, work)
    add_changes(world, topology, work, reports)


@wp.func
def add_product_response(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, work: Work, reports: Reports
):
    """Adds the tree's answer to the velocity products, and to changes of prescribed rates, in place of the
    stabilisation, which holds both. `k_effort` holds the rates.
    """
    for link in range(topology.link_count):
        kind = topology.link_type[link]
        work.f_ang[link] = work.stabilisation_ang[link]
        work.f_lin[link] = work.stabilisation_lin[link]
        work.p_ang[link] = wp.vec3()
        work.p_lin[link] = wp.vec3()
        if kind != FREE and kind != SHAFT and kind != ELASTIC and kind != NODE:  # whose rates are differences
            products = velocity_products(link, world, topology, parameters, state, work)
            ang = dt * products.ang
            lin = dt * products.lin
            for tree_dof in range(topology.link_tree_dof[link], topology.link_tree_dof[link + 1]):
                change = work.k_effort[tree_dof] - state.joint_qd[world, topology.tree_dof_to_dof[tree_dof]]
                ang += work.s_ang[tree_dof] * change
                lin += work.s_lin[tree_dof] * change
            work.stabilisation_ang[link] = ang - work.f_ang[link]
            work.stabilisation_lin[link] = lin - work.f_lin[link]
    for tree_dof in range(topology.tree_dof_count):
        work.effort[tree_dof] = 0.0
    backward_pass(1.0, topology, work)
    forward_pass(topology, work)
    add_changes(world, topology, work, reports)
    if topology.row_count > 0:
        add_coupling_response(world, topology, parameters, work, reports)
    for link in range(topology.link_count):
        work.stabilisation_ang[link] = work.f_ang[link]
        work.stabilisation_lin[link] = work.f_lin[link]


@wp.func
def keep_changes(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, work: Work, reports: Reports
):
    """joint_qdd <- changes of the rates of the tree, after the solve and before any projection. Velocities, rates and
    `xi` are left as they were.
    """
    for dof in range(topology.dof_count):
        reports.joint_qdd[world, dof] = 0.0
    for tree_dof in range(topology.tree_dof_count):
        dof = topology.tree_dof_to_dof[tree_dof]
        rate = work.rate[tree_dof]
        if dof >= 0 and topology.link_type[topology.tree_dof_link[tree_dof]] != FREE:
            reports.joint_qdd[world, dof] = rate - state.joint_qd[world, dof]  # not zero where it is prescribed
        work.k_effort[tree_dof] = rate
        work.k_qd[tree_dof] = work.xi[tree_dof]
        work.rate[tree_dof] = 0.0
    forward_pass(topology, work)
    add_changes(world, topology, work, reports)
    if topology.joint_row_count == 0:
        add_product_response(world, dt, topology, parameters, state, work, reports)
    for tree_dof in range(topology.tree_dof_count):
        work.rate[tree_dof] = work.k_effort[tree_dof]
        work.xi[tree_dof] = work.k_qd[tree_dof]
    forward_pass(topology, work)


@wp.func
def record_accelerations(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, work: Work, reports: Reports
):
    """joint_qdd, at the poses of the step's start in `work`: the changes that were kept over the step's time; at the
    anchor of a floating body also what the turn of its arm adds; of loop joints the difference of the measured rates.
    """
    for joint in range(topology.joint_count):
        first = topology.joint_dof[joint]
        end = topology.joint_dof[joint + 1]
        if end > first:
            frames = joint_frames(joint, world, topology, parameters, work)
            if topology.dof_to_tree_dof[first] < 0:
                for dof in range(first, end):
                    change = rate_of(dof, joint, frames, topology, work) - state.joint_qd[world, dof]
                    reports.joint_qdd[world, dof] = change / dt
            else:
                for dof in range(first, end):
                    reports.joint_qdd[world, dof] = reports.joint_qdd[world, dof] / dt
                if topology.joint_type[joint] == FREE:
                    omega = work.o_ang[link_of(topology.joint_body1[joint], topology)]
                    ang = wp.vec3()
                    for k in range(3):
                        ang[k] = reports.joint_qdd[world, first + 3 + k]
                    arm = to_float(frames.r1)
                    lin = wp.cross(ang, arm) + wp.cross(omega, wp.cross(omega, arm))
                    for k in range(3):
                        reports.joint_qdd[world, first + k] = reports.joint_qdd[world, first + k] + lin[k]
