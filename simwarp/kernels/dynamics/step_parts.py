"""A step as several kernels, one after the other: what a GPU runs. The functions are those of the one kernel of a CPU.

One kernel with everything inlined would need five minutes to compile for a GPU, spill its registers and overflow
the instruction cache. Between the kernels the intermediate values stay in the scratch, where every world has a slot.
"""

import functools
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.cones.problem import SolveReport
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, Reports, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.dynamics.bodies import load_poses, total_velocities
from simwarp.kernels.dynamics.position_projection import project_positions
from simwarp.kernels.dynamics.reactions import record_reactions
from simwarp.kernels.dynamics.step import (
    NON_FINITE,
    StepProgress,
    answer_rows,
    collect_cones,
    cone_config,
    cone_problem,
    enforce_rows,
    finish_step,
    form_rows,
    load_step,
    move_freely,
    take_impulses,
)
from simwarp.kernels.dynamics.world import (
    MODULE_OPTIONS,
    Scratch,
    pack,
    pack_cone,
    report_progress,
    solve_or_fall_back,
    solve_quickly,
)

wp.set_module_options(MODULE_OPTIONS)

PART: dict[str, Any] = {"enable_backward": False, "module": "unique", "module_options": MODULE_OPTIONS}


@wp.struct
class StepState:
    """What the kernels of a step hand on, per world, beside the scratch."""

    limits: wp.array[int]
    blocks: wp.array[int]
    iterations: wp.array[int]
    row_residual: wp.array[float]
    position_error: wp.array[float]
    cone_residual: wp.array[float]


def step_state_layouts(worlds: int) -> dict[str, ArrayLayout]:
    """The arrays of a `StepState`."""
    whole = ("limits", "blocks", "iterations")
    names = [*whole, "row_residual", "position_error", "cone_residual"]
    return {name: ArrayLayout((worlds,), wp.int32 if name in whole else wp.float32) for name in names}


@wp.func
def progress_of(world: int, step: StepState) -> StepProgress:
    """What earlier kernels found in a world."""
    progress = StepProgress()
    progress.limits = step.limits[world]
    progress.blocks = step.blocks[world]
    progress.row_residual = step.row_residual[world]
    progress.position_error = step.position_error[world]
    return progress


@wp.func
def keep_progress(world: int, progress: StepProgress, step: StepState):
    """For the kernels that follow."""
    step.limits[world] = progress.limits
    step.blocks[world] = progress.blocks
    step.row_residual[world] = progress.row_residual
    step.position_error[world] = progress.position_error


@wp.kernel(**PART)
def load_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    contacts: ContactArrays,
    # outputs
    step: StepState,
):
    """Bodies, forces and geometry (`load_step`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    progress = load_step(world, config, topology, parameters, control, state, contacts, work)
    step.iterations[world] = 0
    step.cone_residual[world] = 0.0
    keep_progress(world, progress, step)


@wp.kernel(**PART)
def move_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
):
    """The free motion of the trees (`move_freely`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    move_freely(world, config, topology, parameters, pack(scratch, scratch_slot_of(world, worlds)))


@wp.kernel(**PART)
def form_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    step: StepState,
):
    """Rows of closed loops (`form_rows`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    progress = form_rows(world, progress_of(world, step), config, topology, parameters, control, state, work)
    keep_progress(world, progress, step)


@wp.kernel(**PART)
def answer_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
):
    """Their responses, those of couplings, and the factor (`answer_rows`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    answer_rows(world, config, topology, parameters, state, pack(scratch, scratch_slot_of(world, worlds)))


@wp.kernel(**PART)
def hold_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    step: StepState,
):
    """Velocities that obey the rows (`enforce_rows`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    step.row_residual[world] = enforce_rows(world, 2, topology, parameters, config, work)


@wp.kernel(**PART)
def collect_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    contacts: ContactArrays,
    step: StepState,
):
    """The rows of the cone problems (`collect_cones`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    progress = collect_cones(
        world, progress_of(world, step), config, topology, parameters, control, state, contacts,
        pack(scratch, scratch_slot), pack_cone(scratch, scratch_slot),
    )  # fmt: skip
    keep_progress(world, progress, step)


@functools.cache
def solve_worlds_kernel(all_solvers: bool) -> wp.Kernel:
    """The cone problems, with accelerated gradient descent as the only solver or with all of them."""
    solve = solve_or_fall_back if all_solvers else solve_quickly

    @wp.kernel(**PART)
    def solve_worlds(
        # inputs
        worlds: WorldRange,
        config: StepConfig,
        topology: Topology,
        scratch: Scratch,
        # in and out
        state: StateArrays,
        step: StepState,
    ):
        """Solves the cone problems of all worlds that have one."""
        world = worlds.first + wp.tid()
        if (state.world_status[world] & NON_FINITE) != 0 or step.blocks[world] == 0:
            return
        scratch_slot = scratch_slot_of(world, worlds)
        problem = cone_problem(step.blocks[world], topology, config, pack_cone(scratch, scratch_slot))
        solution = solve(problem, cone_config(config), scratch.kept[scratch_slot])
        step.iterations[world] = solution.iterations
        step.cone_residual[world] = solution.residual

    return solve_worlds


@wp.kernel(**PART)
def push_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    contacts: ContactArrays,
    step: StepState,
):
    """Velocities after the impulses (`take_impulses`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    progress = take_impulses(
        world, progress_of(world, step), config, topology, parameters, state, contacts, pack(scratch, scratch_slot),
        pack_cone(scratch, scratch_slot),
    )  # fmt: skip
    keep_progress(world, progress, step)


@wp.kernel(**PART)
def project_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    step: StepState,
):
    """Positions back onto the joints (`project_positions`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    total_velocities(topology, work)
    step.position_error[world] = project_positions(world, config.dt, topology, parameters, state, config, work)


@wp.kernel(**PART)
def weigh_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    scratch: Scratch,
    step: StepState,
    # in and out
    state: StateArrays,
    contacts: ContactArrays,
    # outputs
    reports: Reports,
):
    """Forces and torques in the joints (`record_reactions`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    work = pack(scratch, scratch_slot)
    total_velocities(topology, work)
    if config.projection_iterations > 0:
        load_poses(world, topology, state, work)
    record_reactions(
        world, config.dt, step.limits[world], step.blocks[world], topology, parameters, state, control, contacts,
        config, work, pack_cone(scratch, scratch_slot), reports,
    )  # fmt: skip


@wp.kernel(**PART)
def publish_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    step: StepState,
    # in and out
    state: StateArrays,
    # outputs
    reports: Reports,
):
    """The state after the step, and the numbers that users read (`finish_step`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    total_velocities(topology, work)
    solution = SolveReport()
    solution.iterations = step.iterations[world]
    solution.residual = step.cone_residual[world]
    report_progress(world, progress_of(world, step), solution, reports)
    moved = int(0)
    if config.projection_iterations > 0 and config.reactions == 0:
        moved = 1
    finish_step(world, moved, config, topology, parameters, state, work)


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """All parts, with the large solver."""
    return [
        load_worlds, move_worlds, form_worlds, answer_worlds, hold_worlds, collect_worlds, solve_worlds_kernel(False),
        solve_worlds_kernel(True), push_worlds, project_worlds, weigh_worlds, publish_worlds,
    ]  # fmt: skip
