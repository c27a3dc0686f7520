"""One step of one world: free motion, elimination of the joints, box constraints, pose update (docs/theory.md)."""

import warp as wp

from simwarp.kernels.cones.islands import enter_islands, leave_islands, world_report
from simwarp.kernels.cones.problem import ConeConfig, ConeProblem, SolveReport
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, Reports, StateArrays
from simwarp.kernels.core.tables import StepConfig, StepProgress, Topology, Work, world_row
from simwarp.kernels.core.vector_math import matrix_to_float
from simwarp.kernels.core.world_status import NON_FINITE
from simwarp.kernels.dynamics.accelerations import keep_changes, record_accelerations
from simwarp.kernels.dynamics.bilateral_rows import (
    apply_group,
    combination_laws,
    coupling_row,
    group_residual,
    loop_responses,
    loop_row_law,
    loop_row_wrenches,
    respond_without_law,
    rotation_rows,
    rows_residual,
)
from simwarp.kernels.dynamics.bodies import (
    apply_row_forces,
    load_bodies,
    load_combinations,
    load_distances,
    load_poses,
    load_tree_dofs,
    publish_coordinates,
    publish_motion,
    total_velocities,
)
from simwarp.kernels.dynamics.box_constraints import collect_boxes
from simwarp.kernels.dynamics.cone_rows import apply_cones
from simwarp.kernels.dynamics.contact_rows import publish_contacts
from simwarp.kernels.dynamics.dense_rows import factor_rows, solve_group
from simwarp.kernels.dynamics.elastic_links import resist_crossing
from simwarp.kernels.dynamics.joints import ELASTIC, FREE, SHAFT, joint_frames, link_geometry
from simwarp.kernels.dynamics.position_projection import project_positions
from simwarp.kernels.dynamics.reactions import record_reactions
from simwarp.kernels.dynamics.recovery import find_recovery, needs_recovery
from simwarp.kernels.dynamics.smooth_contacts import RIGID, apply_smooth_contacts
from simwarp.kernels.dynamics.tree import backward_pass, factor_tree, forward_pass
from simwarp.kernels.meshes.mesh_links import NODE, resist_glue

wp.set_module_options({"enable_backward": False})


@wp.func
def tree_geometry(
    world: int, inv_dt: float, topology: Topology, parameters: Parameters, config: StepConfig, work: Work
) -> float:
    """Columns, shifts and stabilisation of all links; returns the largest position violation [m or rad]."""
    worst = float(0.0)
    for link in range(topology.link_count):
        kind = topology.link_type[link]
        if kind != FREE and kind != SHAFT and kind != ELASTIC and kind != NODE:
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
    if topology.elastic_count > 0:
        for link in range(topology.link_count):
            resist_crossing(link, topology, work)
    resist_glue(topology, work)
    for tree_dof in range(topology.tree_dof_count):
        work.k_qd[tree_dof] = work.xi[tree_dof]
        work.k_effort[tree_dof] = work.effort[tree_dof]
        if work.gain[tree_dof] > 0.0:
            work.effort[tree_dof] = work.effort[tree_dof] - work.gain[tree_dof] * work.change[tree_dof]
    backward_pass(0.0, topology, work)
    for tree_dof in range(topology.tree_dof_count):
        if topology.link_type[topology.tree_dof_link[tree_dof]] != NODE:
            work.xi[tree_dof] = work.xi[tree_dof] + work.k_qd[tree_dof]
        work.effort[tree_dof] = work.k_effort[tree_dof]
    forward_pass(topology, work)


@wp.func
def has_rows(topology: Topology) -> bool:
    """Joints that close loops, couplings, or combinations with a law."""
    return topology.row_count > 0


@wp.func
def has_loop_rotations(topology: Topology) -> bool:
    """Balls or bushings with efforts on their rotation that close loops."""
    return topology.loop_rotation_count > 0


@wp.func
def has_cones(topology: Topology) -> bool:
    """Bounded impulses: contacts, limits, drives or friction."""
    return topology.box_count > 0 or topology.pair_count > 0


@wp.func
def has_contacts(topology: Topology, config: StepConfig) -> bool:
    """Rigid contacts."""
    return topology.pair_count > 0 and config.contact_model == RIGID


@wp.func
def has_islands(topology: Topology) -> bool:
    """Several units, which may be islands of the cone problem."""
    return topology.unit_count > 1 and (topology.box_count > 0 or topology.pair_count > 0)


@wp.func
def has_projection(config: StepConfig) -> bool:
    """Positions are projected."""
    return config.projection_iterations > 0


@wp.func
def has_accelerations(config: StepConfig) -> bool:
    """Accelerations are asked for."""
    return config.accelerations == 1


@wp.func
def has_reactions(config: StepConfig) -> bool:
    """Reactions are asked for."""
    return config.reactions == 1


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
def load_state(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    state: StateArrays, contacts: ContactArrays, progress: StepProgress, work: Work,
):  # fmt: skip
    """Bodies, their forces, and the tree's geometry at the present state."""
    dt = config.dt
    progress.limits[world] = 0
    progress.blocks[world] = 0
    progress.islands[world] = 0
    progress.recovers[world] = 0
    progress.row_residual[world] = 0.0
    load_poses(world, topology, state, work)
    load_bodies(world, dt, topology, parameters, state, control, config, work)
    apply_row_forces(world, dt, topology, parameters, control, work)
    if config.contact_model != RIGID and topology.pair_count > 0:
        apply_smooth_contacts(world, dt, topology, parameters, contacts, config, work)
    load_tree_dofs(world, state.world_time[world], topology, parameters, state, control, config, work)
    progress.position_error[world] = tree_geometry(world, 1.0 / dt, topology, parameters, config, work)
    load_distances(world, topology, parameters, state, control, config, work)
    load_combinations(world, dt, topology, parameters, control, work)


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
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, progress: StepProgress, work: Work
):
    """Wrenches of the rows of loop joints, and what they lack in `row_b` [m or rad]."""
    worst = progress.position_error[world]
    for row in range(topology.row_count):
        work.row_impulse[row] = 0.0
    for index in range(topology.loop_joint_count):
        joint = topology.loop_joint[index]
        frames = joint_frames(joint, world, topology, parameters, work)
        for row in range(topology.loop_row[index, 0], topology.loop_row[index, 2]):
            value = float(loop_row_wrenches(row, joint, world, config.dt, frames, topology, parameters, work))
            work.row_b[row] = value
            if topology.row_dof[row] < 0:
                worst = wp.max(worst, wp.abs(value))
    progress.position_error[world] = worst


@wp.func(inline=True)
def bias_rows(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    state: StateArrays, work: Work,
):  # fmt: skip
    """Right-hand sides of the rows of loop joints and of combinations, but for efforts on rotations."""
    time = state.world_time[world]
    for index in range(topology.loop_joint_count):
        joint = topology.loop_joint[index]
        for row in range(topology.loop_row[index, 0], topology.loop_row[index, 1]):
            loop_row_law(
                row, joint, world, config.dt, time, wp.float64(work.row_b[row]), topology, parameters, state, control,
                config, work,
            )  # fmt: skip
    combination_laws(world, time, topology, parameters, state, control, config, work)


@wp.func(inline=True)
def bias_rotations(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    state: StateArrays, work: Work,
):  # fmt: skip
    """Right-hand sides of the rows that carry efforts on rotations: three of a ball or bushing."""
    for index in range(topology.loop_joint_count):
        if topology.loop_row[index, 1] < topology.loop_row[index, 2]:
            rotation_rows(index, world, state.world_time[world], topology, parameters, state, control, config, work)


@wp.func(inline=True)
def factor_constraints(
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
def solve_bilateral(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, progress: StepProgress, work: Work
):
    """Velocities that obey the bilateral rows."""
    progress.row_residual[world] = enforce_rows(world, 2, topology, parameters, config, work)


@wp.func(inline=True)
def collect_bounds(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    state: StateArrays, progress: StepProgress, work: Work, cone: ConeProblem,
):  # fmt: skip
    """The rows of bounded impulses on coordinates, in front of those of contacts."""
    total_velocities(topology, work)
    for tree_dof in range(topology.tree_dof_count):
        cone.tree_dof_sum[tree_dof] = 0.0
    respond_without_law(world, topology, parameters, work)
    limits = collect_boxes(world, config.dt, topology, parameters, state, control, config, work, cone)
    for index in range(topology.box_count):
        state.box_impulse[world, index] = 0.0
    progress.limits[world] = limits
    progress.blocks[world] = limits
    cone.block_row[limits] = limits


@wp.func(inline=True)
def build_islands(world: int, topology: Topology, progress: StepProgress, work: Work, cone: ConeProblem):
    """Islands of the cone problem."""
    if progress.blocks[world] > 0:
        progress.islands[world] = enter_islands(progress.blocks[world], topology, work, cone)


@wp.func(inline=True)
def apply_impulses(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, state: StateArrays,
    contacts: ContactArrays, progress: StepProgress, work: Work, cone: ConeProblem,
):  # fmt: skip
    """Velocities after the impulses of the cone problem, and the forces of the contacts."""
    blocks = progress.blocks[world]
    if blocks > 0:
        leave_islands(progress.islands[world], cone)
        apply_cones(cone, blocks, topology, work)
        forward_pass(topology, work)
        if topology.row_count > 0:
            progress.row_residual[world] = enforce_rows(world, 1, topology, parameters, config, work)
        for block in range(blocks):
            if work.active[block] < topology.box_count:
                impulse = work.b_sign[block] * cone.gamma[cone.block_row[block]]
                state.box_impulse[world, work.active[block]] = impulse
        if needs_recovery(blocks, work):
            progress.recovers[world] = find_recovery(world, blocks, topology, parameters, contacts, work, cone)
    if topology.pair_count > 0:
        publish_contacts(world, config.dt, blocks, topology, contacts, work, cone)


@wp.func(inline=True)
def keep_rate_changes(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, state: StateArrays, reports: Reports,
    work: Work,
):  # fmt: skip
    """Changes of the rates, before the projection."""
    keep_changes(world, config.dt, topology, parameters, state, work, reports)


@wp.func(inline=True)
def project_onto_joints(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, state: StateArrays, reports: Reports,
    progress: StepProgress, work: Work,
):  # fmt: skip
    """Positions back onto the joints."""
    total_velocities(topology, work)
    progress.position_error[world] = project_positions(
        world, config.dt, topology, parameters, state, config, work, reports
    )


@wp.func(inline=True)
def compute_accelerations(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, state: StateArrays, reports: Reports,
    work: Work,
):  # fmt: skip
    """Accelerations of the coordinates."""
    total_velocities(topology, work)
    if config.projection_iterations > 0:
        load_poses(world, topology, state, work)
    record_accelerations(world, config.dt, topology, parameters, state, work, reports)


@wp.func(inline=True)
def compute_reactions(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    state: StateArrays, contacts: ContactArrays, reports: Reports, progress: StepProgress, work: Work,
    cone: ConeProblem,
):  # fmt: skip
    """Forces and torques in the joints."""
    total_velocities(topology, work)
    if config.projection_iterations > 0:
        load_poses(world, topology, state, work)
    record_reactions(
        world, config.dt, progress.blocks[world], topology, parameters, state, control, contacts, config, work, cone,
        reports,
    )  # fmt: skip


@wp.func(inline=True)
def publish_bodies(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, state: StateArrays, reports: Reports,
    progress: StepProgress, work: Work, cone: ConeProblem,
):  # fmt: skip
    """Velocities and poses after the step, and the numbers that users read."""
    total_velocities(topology, work)
    solution = SolveReport()
    if progress.blocks[world] > 0:
        solution = world_report(progress.islands[world], cone)
    reports.constraint_count[world] = progress.blocks[world]
    reports.iterations[world] = solution.iterations
    reports.cone_residual[world] = solution.residual
    reports.row_residual[world] = progress.row_residual[world]
    reports.position_error[world] = progress.position_error[world]
    moved = int(0)
    if config.projection_iterations > 0 and config.reactions == 0 and config.accelerations == 0:
        moved = 1
    if publish_motion(world, moved, progress.recovers[world], topology, parameters, config, state, work) == 0:
        state.world_status[world] = state.world_status[world] | NON_FINITE


@wp.func(inline=True)
def publish_joints(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, state: StateArrays, work: Work
):
    """Coordinates of the joints at these poses, and the time."""
    if (state.world_status[world] & NON_FINITE) == 0:
        publish_coordinates(world, config.dt, topology, parameters, state, work)
        state.world_time[world] = state.world_time[world] + wp.float64(config.dt)
