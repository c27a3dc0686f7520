"""A step as several kernels, one after the other: what a GPU runs. The functions are those of the one kernel of a CPU.

One kernel with everything inlined would need five minutes to compile for a GPU, spill its registers and overflow
the instruction cache. Between the kernels the intermediate values stay in the scratch, where every world has a slot.
"""

from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.cones.islands import enter_islands, world_report
from simwarp.kernels.cones.problem import SolveReport
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, Reports, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.dynamics.accelerations import keep_changes, record_accelerations
from simwarp.kernels.dynamics.bilateral_rows import (
    combination_laws,
    loop_row_law,
    loop_row_wrenches,
    rotation_rows,
)
from simwarp.kernels.dynamics.bodies import load_poses, publish_coordinates, publish_motion, total_velocities
from simwarp.kernels.dynamics.contact_rows import list_contacts, settle_contacts, walk_contacts
from simwarp.kernels.dynamics.joints import joint_frames
from simwarp.kernels.dynamics.position_projection import project_positions
from simwarp.kernels.dynamics.reactions import record_reactions
from simwarp.kernels.dynamics.smooth import RIGID
from simwarp.kernels.dynamics.step import (
    NON_FINITE,
    StepProgress,
    answer_rows,
    collect_bounds,
    enforce_rows,
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
)

wp.set_module_options(MODULE_OPTIONS)

PART: dict[str, Any] = {"enable_backward": False, "module": "unique", "module_options": MODULE_OPTIONS}


@wp.struct
class StepState:
    """What the kernels of a step hand on, per world, beside the scratch."""

    limits: wp.array[int]
    blocks: wp.array[int]
    islands: wp.array[int]
    recovers: wp.array[int]
    row_residual: wp.array[float]
    position_error: wp.array[float]


def step_state_layouts(worlds: int) -> dict[str, ArrayLayout]:
    """The arrays of a `StepState`."""
    whole = ("limits", "blocks", "islands", "recovers")
    names = [*whole, "row_residual", "position_error"]
    return {name: ArrayLayout((worlds,), wp.int32 if name in whole else wp.float32) for name in names}


@wp.func
def progress_of(world: int, step: StepState) -> StepProgress:
    """What earlier kernels found in a world."""
    progress = StepProgress()
    progress.limits = step.limits[world]
    progress.blocks = step.blocks[world]
    progress.islands = step.islands[world]
    progress.recovers = step.recovers[world]
    progress.row_residual = step.row_residual[world]
    progress.position_error = step.position_error[world]
    return progress


@wp.func
def keep_progress(world: int, progress: StepProgress, step: StepState):
    """For the kernels that follow."""
    step.limits[world] = progress.limits
    step.blocks[world] = progress.blocks
    step.islands[world] = progress.islands
    step.recovers[world] = progress.recovers
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
    scratch: Scratch,
    # in and out
    state: StateArrays,
    step: StepState,
):
    """Wrenches of the rows of closed loops, the first half of `form_rows`."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    worst = step.position_error[world]
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
    step.position_error[world] = worst


@wp.kernel(**PART)
def bias_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    scratch: Scratch,
    # in and out
    state: StateArrays,
):
    """Their right-hand sides, the second half."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    for index in range(topology.loop_joint_count):
        joint = topology.loop_joint[index]
        for row in range(topology.loop_row[index, 0], topology.loop_row[index, 1]):
            value = wp.float64(work.row_b[row])
            loop_row_law(
                row, joint, world, config.dt, state.world_time[world], value, topology, parameters, state, control,
                config, work,
            )  # fmt: skip
        if topology.loop_row[index, 1] < topology.loop_row[index, 2]:
            rotation_rows(
                index, world, config.dt, state.world_time[world], topology, parameters, state, control, config, work
            )
    combination_laws(world, config.dt, state.world_time[world], topology, parameters, state, control, config, work)


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
    step: StepState,
):
    """Bounded impulses on coordinates as rows of the cone problem (`collect_bounds`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    progress = collect_bounds(
        world, progress_of(world, step), config, topology, parameters, control, state,
        pack(scratch, scratch_slot), pack_cone(scratch, scratch_slot),
    )  # fmt: skip
    keep_progress(world, progress, step)


@wp.kernel(**PART)
def meet_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    state: StateArrays,
    # in and out
    contacts: ContactArrays,
    step: StepState,
):
    """The contacts that can act in this step (`list_contacts`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0 or config.contact_model != RIGID:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    limits = step.limits[world]
    step.blocks[world] = list_contacts(
        world, config.dt, limits, limits, topology, parameters, contacts, config, pack(scratch, scratch_slot),
        pack_cone(scratch, scratch_slot),
    )  # fmt: skip


@wp.kernel(**PART)
def respond_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    scratch: Scratch,
    state: StateArrays,
    contacts: ContactArrays,
    step: StepState,
):
    """What these contacts move (`walk_contacts`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0 or config.contact_model != RIGID:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    walk_contacts(
        world, step.limits[world], step.blocks[world], topology, contacts, pack(scratch, scratch_slot),
        pack_cone(scratch, scratch_slot),
    )  # fmt: skip


@wp.kernel(**PART)
def settle_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    scratch: Scratch,
    state: StateArrays,
    # in and out
    step: StepState,
):
    """What the loops take of it, and the contacts that can move at all (`settle_contacts`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0 or config.contact_model != RIGID:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    step.blocks[world] = settle_contacts(
        step.limits[world], step.blocks[world], topology, pack(scratch, scratch_slot),
        pack_cone(scratch, scratch_slot),
    )  # fmt: skip


@wp.kernel(**PART)
def part_worlds(
    # inputs
    worlds: WorldRange,
    topology: Topology,
    scratch: Scratch,
    state: StateArrays,
    # in and out
    step: StepState,
):
    """Islands of the cone problem (`enter_islands`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0 or step.blocks[world] == 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    step.islands[world] = enter_islands(
        step.blocks[world], topology, pack(scratch, scratch_slot), pack_cone(scratch, scratch_slot)
    )


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
def change_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    state: StateArrays,
    # outputs
    reports: Reports,
):
    """Changes of the rates, before the projection (`keep_changes`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    keep_changes(world, config.dt, topology, parameters, state, work, reports)


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
    reports: Reports,
):
    """Positions back onto the joints (`project_positions`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    total_velocities(topology, work)
    step.position_error[world] = project_positions(world, config.dt, topology, parameters, state, config, work, reports)


@wp.kernel(**PART)
def accelerate_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    # outputs
    reports: Reports,
):
    """Accelerations of the coordinates (`record_accelerations`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    total_velocities(topology, work)
    if config.projection_iterations > 0:
        load_poses(world, topology, state, work)
    record_accelerations(world, config.dt, topology, parameters, state, work, reports)


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
        world,
        config.dt,
        step.blocks[world],
        topology,
        parameters,
        state,
        control,
        contacts,
        config,
        work,
        pack_cone(scratch, scratch_slot),
        reports,
    )


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
    """Velocities and poses after the step, and the numbers that users read (`publish_motion`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    work = pack(scratch, scratch_slot)
    total_velocities(topology, work)
    solution = SolveReport()
    if step.blocks[world] > 0:
        solution = world_report(step.islands[world], pack_cone(scratch, scratch_slot))
    report_progress(world, progress_of(world, step), solution, reports)
    moved = int(0)
    if config.projection_iterations > 0 and config.reactions == 0 and config.accelerations == 0:
        moved = 1
    if publish_motion(world, moved, step.recovers[world], topology, parameters, config, state, work) == 0:
        state.world_status[world] = state.world_status[world] | NON_FINITE


@wp.kernel(**PART)
def finish_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
):
    """Coordinates of the joints at these poses, and the time (`finish_step`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    publish_coordinates(world, config.dt, topology, parameters, state, work)
    state.world_time[world] = state.world_time[world] + wp.float64(config.dt)


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """All parts but the solvers."""
    return [
        load_worlds, move_worlds, form_worlds, bias_worlds, answer_worlds, hold_worlds, collect_worlds, meet_worlds,
        respond_worlds, settle_worlds, part_worlds, push_worlds,
        change_worlds, project_worlds, accelerate_worlds, weigh_worlds, publish_worlds, finish_worlds,
    ]  # fmt: skip
