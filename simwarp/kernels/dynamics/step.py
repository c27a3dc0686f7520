"""One step of one world: free motion, elimination of the joints, box constraints, pose update (docs/theory.md)."""

import warp as wp

from simwarp.core.types import WorldStatus
from simwarp.kernels.cones.islands import leave_islands
from simwarp.kernels.cones.problem import ConeConfig, ConeProblem
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.spatial import matrix_to_float
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.dynamics.bilateral_rows import (
    apply_group,
    combination_laws,
    coupling_row,
    group_residual,
    loop_joint_rows,
    loop_responses,
    rows_residual,
    silent_responses,
)
from simwarp.kernels.dynamics.bodies import (
    apply_row_forces,
    load_bodies,
    load_combinations,
    load_distances,
    load_poses,
    load_tree_dofs,
    publish,
    total_velocities,
)
from simwarp.kernels.dynamics.box_constraints import collect_boxes
from simwarp.kernels.dynamics.cone_rows import apply_cones
from simwarp.kernels.dynamics.contact_rows import collect_contacts, publish_contacts
from simwarp.kernels.dynamics.dense_rows import factor_rows, solve_group
from simwarp.kernels.dynamics.joints import FREE, SHAFT, link_geometry
from simwarp.kernels.dynamics.smooth import RIGID, apply_smooth_contacts
from simwarp.kernels.dynamics.tree import backward_pass, factor_tree, forward_pass
from simwarp.kernels.recovery.recovery import find_recovery, wants_recovery

wp.set_module_options({"enable_backward": False})

NON_FINITE = wp.constant(int(WorldStatus.NON_FINITE))


@wp.func
def tree_geometry(
    world: int, inv_dt: float, topology: Topology, parameters: Parameters, config: StepConfig, work: Work
) -> float:
    """Columns, shifts and stabilisation of all links; returns the largest position violation [m or rad]."""
    worst = float(0.0)
    for link in range(topology.link_count):
        kind = topology.link_type[link]
        if kind != FREE and kind != SHAFT:
            worst = wp.max(worst, link_geometry(link, world, inv_dt, topology, parameters, config, work))
    return worst


@wp.func
def enforce_rows(
    world: int, passes: int, topology: Topology, parameters: Parameters, config: StepConfig, work: Work
) -> float:
    """Velocities that obey the bilateral rows, and the residual left [m/s or rad/s].

    Every pass is one solve on the true residual, as in iterative refinement; it stops when the rows hold to the
    solver's tolerance. That is asked group by group, of those that are due: a vehicle takes no notice of others.
    """
    residual = rows_residual(topology, parameters, world, work)
    done = int(0)
    # the first pass also serves the compliant rows, which the residual does not show
    while done < passes and (done == 0 or residual > config.row_tolerance):
        for group in range(topology.group_count):
            if work.group_due[group] == 1 and (
                done == 0 or group_residual(group, topology, work) > config.row_tolerance
            ):
                solve_group(group, topology, work)
                apply_group(group, topology, work)
        forward_pass(topology, work)
        residual = rows_residual(topology, parameters, world, work)
        done += 1
    return residual


@wp.func
def refine_free_motion(world: int, topology: Topology, parameters: Parameters, work: Work):
    """One step of iterative refinement on the free motion: what the rigid bodies' own momentum balance still lacks
    goes through the tree's factor again. The factor of a light body under a heavy one has lost the light one's digits;
    the balance has not.
    """
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            rot = matrix_to_float(work.rot[body])
            mass = parameters.body_mass[world_row(world, parameters.body_mass.shape[0]), body]
            inertia_b = parameters.body_inertia_b[world_row(world, parameters.body_inertia_b.shape[0]), body]
            work.p_ang[link] = work.f_ang[link] - rot * (inertia_b * (work.v_ang[link] * rot))
            work.p_lin[link] = work.f_lin[link] - mass * work.v_lin[link]
    for tree_dof in range(topology.tree_dof_count):
        work.k_qd[tree_dof] = work.xi[tree_dof]
        work.k_effort[tree_dof] = work.effort[tree_dof]
        if work.gain[tree_dof] > 0.0:
            work.effort[tree_dof] = work.effort[tree_dof] - work.gain[tree_dof] * work.change[tree_dof]
    backward_pass(0.0, topology, work)
    for tree_dof in range(topology.tree_dof_count):
        work.xi[tree_dof] = work.xi[tree_dof] + work.k_qd[tree_dof]
        work.effort[tree_dof] = work.k_effort[tree_dof]
    forward_pass(topology, work)


@wp.struct
class StepProgress:
    """Results that one part of a step passes to the next: blocks of the cone problem, and residuals."""

    limits: int  # blocks on coordinates, in front until islands are formed
    blocks: int  # all
    islands: int  # of the cone problem; 0: one that moves everything
    row_residual: float  # of the bilateral rows [m/s or rad/s]
    position_error: float  # of the joints [m or rad]
    recovers: int  # 1: overlaps and passed limits recover by moving alone


@wp.func
def cone_config(config: StepConfig) -> ConeConfig:
    """Numbers of the cone solve."""
    numbers = ConeConfig()
    numbers.friction_law = config.friction_law
    numbers.solver = config.solver
    numbers.max_iterations = config.max_iterations
    numbers.tolerance = config.tolerance
    return numbers


@wp.func(inline=True)
def load_step(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    state: StateArrays, contacts: ContactArrays, work: Work,
) -> StepProgress:  # fmt: skip
    """Bodies, their forces, and the tree's geometry at the present state."""
    dt = config.dt
    progress = StepProgress()
    load_poses(world, topology, state, work)
    load_bodies(world, dt, topology, parameters, state, control, config, work)
    apply_row_forces(world, dt, topology, parameters, control, work)
    if config.contact_model != RIGID and topology.pair_count > 0:
        apply_smooth_contacts(world, dt, topology, parameters, contacts, config, work)
    load_tree_dofs(world, dt, state.world_time[world], topology, parameters, state, control, config, work)
    progress.position_error = tree_geometry(world, 1.0 / dt, topology, parameters, config, work)
    load_distances(world, dt, topology, parameters, state, control, work)
    load_combinations(world, dt, topology, parameters, control, work)
    return progress


@wp.func(inline=True)
def move_freely(world: int, config: StepConfig, topology: Topology, parameters: Parameters, work: Work):
    """The motion with the joints of the tree in force, and nothing else."""
    factor_tree(topology, work)
    for link in range(topology.link_count):
        work.f_ang[link] = work.p_ang[link]
        work.f_lin[link] = work.p_lin[link]
    backward_pass(1.0, topology, work)
    forward_pass(topology, work)
    for _ in range(config.refinement):
        refine_free_motion(world, topology, parameters, work)


@wp.func(inline=True)
def form_rows(
    world: int, before: StepProgress, config: StepConfig, topology: Topology, parameters: Parameters,
    control: ControlArrays, state: StateArrays, work: Work,
) -> StepProgress:  # fmt: skip
    """Wrenches and right-hand sides of the rows of loop joints, right-hand sides of those of combinations."""
    progress = before
    for row in range(topology.row_count):
        work.row_impulse[row] = 0.0
    for index in range(topology.loop_joint_count):
        error = loop_joint_rows(
            index, world, config.dt, state.world_time[world], topology, parameters, state, control, config, work
        )
        progress.position_error = wp.max(progress.position_error, error)
    combination_laws(world, config.dt, state.world_time[world], topology, parameters, state, control, config, work)
    return progress


@wp.func(inline=True)
def answer_rows(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, state: StateArrays, work: Work
):
    """Responses of the loop and coupling rows, and their factor."""
    loop_responses(topology, work)
    for coupling in range(topology.row_count - topology.joint_row_count):
        coupling_row(coupling, world, config.dt, topology, parameters, state, config, work)
    factor_rows(topology, config.pivot_tolerance, work)
    for group in range(topology.group_count):
        work.group_due[group] = 1


@wp.func(inline=True)
def collect_bounds(
    world: int, before: StepProgress, config: StepConfig, topology: Topology, parameters: Parameters,
    control: ControlArrays, state: StateArrays, work: Work, cone: ConeProblem,
) -> StepProgress:  # fmt: skip
    """The rows of bounded impulses on coordinates, in front of those of contacts."""
    progress = before
    total_velocities(topology, work)
    for tree_dof in range(topology.tree_dof_count):
        cone.tree_dof_sum[tree_dof] = 0.0
    silent_responses(world, topology, parameters, work)
    limits = collect_boxes(world, config.dt, topology, parameters, state, control, config, work, cone)
    for index in range(topology.box_count):
        state.box_impulse[world, index] = 0.0
    progress.limits = limits
    progress.blocks = limits
    cone.block_row[limits] = limits
    return progress


@wp.func(inline=True)
def collect_cones(
    world: int, before: StepProgress, config: StepConfig, topology: Topology, parameters: Parameters,
    control: ControlArrays, state: StateArrays, contacts: ContactArrays, work: Work, cone: ConeProblem,
) -> StepProgress:  # fmt: skip
    """The rows that the cone problem has to decide on: limits, drives, friction and contacts."""
    progress = collect_bounds(world, before, config, topology, parameters, control, state, work, cone)
    limits = progress.limits
    if config.contact_model == RIGID:
        progress.blocks = collect_contacts(
            world, config.dt, limits, limits, topology, parameters, contacts, config, work, cone
        )
    return progress


@wp.func(inline=True)
def take_impulses(
    world: int, before: StepProgress, config: StepConfig, topology: Topology, parameters: Parameters,
    state: StateArrays, contacts: ContactArrays, work: Work, cone: ConeProblem,
) -> StepProgress:  # fmt: skip
    """Velocities after the impulses of the cone problem, and the forces of the contacts."""
    progress = before
    if progress.blocks > 0:
        leave_islands(progress.islands, cone)
        apply_cones(cone, progress.blocks, topology, work)
        forward_pass(topology, work)
        if topology.row_count > 0:
            progress.row_residual = enforce_rows(world, 1, topology, parameters, config, work)
        for block in range(progress.blocks):
            if work.active[block] < topology.box_count:
                impulse = work.b_sign[block] * cone.gamma[cone.block_row[block]]
                state.box_impulse[world, work.active[block]] = impulse
        if wants_recovery(progress.blocks, work):
            progress.recovers = find_recovery(world, progress.blocks, topology, parameters, contacts, work, cone)
    if topology.pair_count > 0:
        publish_contacts(world, config.dt, progress.blocks, topology, contacts, work, cone)
    return progress


@wp.func(inline=True)
def finish_step(
    world: int, moved: int, recovers: int, config: StepConfig, topology: Topology, parameters: Parameters,
    state: StateArrays, work: Work,
):  # fmt: skip
    """Publishes the state after the step; `moved` = 1: its positions were projected already; `recovers` = 1: there is
    a recovery to make.
    """
    if publish(world, moved, recovers, topology, parameters, config, state, work) == 0:
        state.world_status[world] = state.world_status[world] | NON_FINITE
    else:
        state.world_time[world] = state.world_time[world] + wp.float64(config.dt)
