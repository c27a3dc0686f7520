"""Projection of positions onto the joints, in the mass metric: after a step, and to assemble a set state."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, Reports, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.dynamics.accelerations import add_changes
from simwarp.kernels.dynamics.bilateral_rows import link_of, respond_to_row, row_geometry, row_offset, row_speed
from simwarp.kernels.dynamics.bodies import advance_poses, total_velocities
from simwarp.kernels.dynamics.dense_rows import solve_rows
from simwarp.kernels.dynamics.joints import (
    FREE,
    SHAFT,
    allowed_translation,
    joint_frames,
    misalignment,
)
from simwarp.kernels.dynamics.tree import backward_pass, forward_pass
from simwarp.kernels.meshes.mesh_links import NODE

wp.set_module_options({"enable_backward": False})


@wp.func
def residual_stabilisation(world: int, inv_dt: float, topology: Topology, parameters: Parameters, work: Work) -> float:
    """Drift of the tree joints at the poses in `work`, alone: no momentum, no effort, no prescribed rate.

    Returns the largest violation [m or rad].
    """
    worst = float(0.0)
    for link in range(topology.link_count):
        kind = topology.link_type[link]
        work.p_ang[link] = wp.vec3()
        work.p_lin[link] = wp.vec3()
        work.stabilisation_ang[link] = wp.vec3()
        work.stabilisation_lin[link] = wp.vec3()
        if kind != FREE and kind != SHAFT and kind != NODE:
            sign = topology.link_sign[link]
            frames = joint_frames(topology.link_joint[link], world, topology, parameters, work)
            legal = allowed_translation(kind, frames)
            e_lin = to_float(frames.d - legal)
            e_ang = to_float(misalignment(kind, frames))
            child = to_float(frames.r1)
            if sign < 0.0:
                child = to_float(frames.r0 + legal)
            ang = e_ang * (-sign * inv_dt)
            work.stabilisation_ang[link] = ang
            work.stabilisation_lin[link] = e_lin * (-sign * inv_dt) - wp.cross(ang, child)
            worst = wp.max(worst, wp.max(wp.length(e_lin), wp.length(e_ang)))
    for tree_dof in range(topology.tree_dof_count):
        work.effort[tree_dof] = 0.0
        work.rate[tree_dof] = 0.0
    return worst


@wp.func
def residual_rows(world: int, inv_dt: float, topology: Topology, parameters: Parameters, work: Work) -> float:
    """row_r <- J dV + C / dt of the rigid loop rows at the poses in `work`, others 0; returns the largest C."""
    worst = float(0.0)
    for row in range(topology.row_count):
        work.row_r[row] = 0.0
    for index in range(topology.loop_joint_count):
        joint = topology.loop_joint[index]
        frames = joint_frames(joint, world, topology, parameters, work)
        link0 = link_of(topology.joint_body0[joint], topology)
        link1 = link_of(topology.joint_body1[joint], topology)
        for row in range(topology.loop_row[index, 0], topology.loop_row[index, 2]):
            if topology.row_dof[row] < 0:
                kind = topology.row_kind[row]
                offset = row_offset(kind, joint, world, parameters)
                geometry = row_geometry(
                    topology.joint_type[joint], kind, topology.row_axis0[row], topology.row_axis1[row], offset, frames
                )
                value = float(geometry.value)
                work.row_r[row] = row_speed(row, topology, work, link0, link1) + value * inv_dt
                worst = wp.max(worst, wp.abs(value))
    return worst


@wp.func
def correct_velocity(
    world: int, dt: float, topology: Topology, parameters: Parameters, config: StepConfig, work: Work, reports: Reports
) -> float:
    """Adds to the velocities the motion that removes the violation at the poses in `work`, with the factors of
    the step's start; returns that violation [m or rad].
    """
    for link in range(topology.link_count):
        work.f_ang[link] = work.v_ang[link]
        work.f_lin[link] = work.v_lin[link]
    worst = residual_stabilisation(world, 1.0 / dt, topology, parameters, work)
    backward_pass(1.0, topology, work)
    forward_pass(topology, work)
    if topology.row_count > 0:
        worst = wp.max(worst, residual_rows(world, 1.0 / dt, topology, parameters, work))
        solve_rows(topology, work)
        for row in range(topology.row_count):
            work.row_impulse[row] = work.row_impulse[row] - work.row_r[row]
            respond_to_row(row, work.row_r[row], topology, work)
        forward_pass(topology, work)
    if config.accelerations == 1 and topology.joint_row_count > 0:
        # without loops the changes have the velocity products already, which this motion makes up for
        add_changes(world, topology, work, reports)
    for link in range(topology.link_count):
        work.v_ang[link] = work.f_ang[link] + work.v_ang[link]
        work.v_lin[link] = work.f_lin[link] + work.v_lin[link]
    total_velocities(topology, work)
    return worst


@wp.func
def project_positions(
    world: int, dt: float, topology: Topology, parameters: Parameters, state: StateArrays, config: StepConfig,
    work: Work, reports: Reports,
) -> float:  # fmt: skip
    """Moves the end-of-step poses onto the joints along the rows of the step's start.

    The correction enters the velocity as well, which makes the scheme SHAKE (Ryckaert, Ciccotti & Berendsen 1977)
    and keeps the energy; the velocity is then the chord of the step. Returns the violation before the last pass.
    """
    for tree_dof in range(topology.tree_dof_count):
        work.k_qd[tree_dof] = work.qd[tree_dof]
    error = float(0.0)
    for _ in range(config.projection_iterations):
        advance_poses(world, dt, topology, state, work)
        error = correct_velocity(world, dt, topology, parameters, config, work, reports)
        for tree_dof in range(topology.tree_dof_count):
            work.k_qd[tree_dof] = work.k_qd[tree_dof] + work.qd[tree_dof]
    for tree_dof in range(topology.tree_dof_count):
        work.qd[tree_dof] = work.k_qd[tree_dof]
    return error
