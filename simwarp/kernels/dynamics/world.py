"""The one kernel that works on worlds: a step, an assembly, or a measurement, one thread per world.

All sizes are data, so one compiled kernel serves every model. Intermediate values live in a scratch of few slots,
packed under names as a `Work`: a world writes everything that it reads there, so that slots can be reused.
"""

import dataclasses
import functools
from enum import IntEnum
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.cones.apgd import solve_apgd
from simwarp.kernels.cones.problem import ConeConfig, ConeProblem, ConeScratch, SolveReport
from simwarp.kernels.cones.solve import solve_with_fallback
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, Reports, StateArrays
from simwarp.kernels.core.scratch import (
    ScratchGroup,
    make_memory,
    memory_layouts,
    memory_struct,
    scratch_array,
    slot_function,
)
from simwarp.kernels.core.tables import StepConfig, Topology, Work, WorkScratch
from simwarp.kernels.dynamics.assembly import assemble_world, measure_world
from simwarp.kernels.dynamics.dense_rows import padded
from simwarp.kernels.dynamics.step import NON_FINITE, begin_step, cone_config, cone_problem, finish_step

# Warp's own flags, with fused multiply-adds (accuracy and speed) and without the superword pass, which slows this
# kernel of table loops down and takes seconds to compile.
CPU_FLAGS = (
    "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
    " -ffp-contract=fast -fno-slp-vectorize"
)

MODULE_OPTIONS = {"enable_backward": False, "max_unroll": 0, "cpu_compiler_flags": CPU_FLAGS}

wp.set_module_options(MODULE_OPTIONS)


class Operation(IntEnum):
    """Operation that a launch performs."""

    STEP = 0
    ASSEMBLE = 1
    MEASURE = 2


OP_STEP = wp.constant(int(Operation.STEP))
OP_ASSEMBLE = wp.constant(int(Operation.ASSEMBLE))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScratchSizes:
    """Workspace sizes of a model, per world.

    `dense_rows` is the size of the largest dense Schur complement, `factor_rows` that of its factor. `kept_rows` are
    all cone rows where another solver may follow the first, whatever is dense: both solutions are compared.
    """

    links: int
    tree_dofs: int
    rows: int
    relative_rotations: int
    blocks: int
    cone_rows: int
    dense_rows: int
    factor_rows: int
    kept_rows: int
    entries: int

    @property
    def padded_rows(self) -> int:
        """Length of an array of rows that wide loads run over."""
        return padded(self.rows)

    @property
    def wrench_rows(self) -> int:
        """Rows, and relative rotations of couplings."""
        return self.rows + self.relative_rotations

    @property
    def block_ends(self) -> int:
        """Blocks, and their end."""
        return self.blocks + 1


class KeptScratch(ScratchGroup):
    """Impulses of the first solver, while another one tries."""

    kept = scratch_array(wp.float32, "kept_rows")


GROUPS = (WorkScratch, ConeScratch, KeptScratch)
Scratch = memory_struct("Scratch", __name__, GROUPS)
pack = slot_function("pack", __name__, WorkScratch, Work, Scratch)
pack_cone = slot_function("pack_cone", __name__, ConeScratch, ConeProblem, Scratch)


def scratch_layouts(slots: int, sizes: ScratchSizes) -> dict[str, ArrayLayout]:
    """The arrays of the scratch."""
    return memory_layouts(GROUPS, slots, sizes)


def make_scratch(device: wp.Device, slots: int, sizes: ScratchSizes) -> Any:
    """Allocates the scratch: on a CPU one slot, which stays in the cache, serves all worlds in turn."""
    return make_memory(Scratch, scratch_layouts(slots, sizes), device)


@wp.func
def solve_quickly(problem: ConeProblem, config: ConeConfig, kept: wp.array[float]) -> SolveReport:
    """Accelerated gradient descent alone."""
    return solve_apgd(problem, config)


@wp.func
def solve_or_fall_back(problem: ConeProblem, config: ConeConfig, kept: wp.array[float]) -> SolveReport:
    """The solver of the configuration, and the interior point for what it leaves above the tolerance."""
    return solve_with_fallback(problem, config, 1, kept)


@functools.cache
def run_worlds_kernel(all_solvers: bool) -> wp.Kernel:
    """The kernel, with accelerated gradient descent as its only solver, or with all of them (twice the code)."""
    solve = solve_or_fall_back if all_solvers else solve_quickly

    @wp.kernel(enable_backward=False, module="unique", module_options=MODULE_OPTIONS)
    def run_worlds(
        # inputs
        operation: int,
        config: StepConfig,
        topology: Topology,
        parameters: Parameters,
        control: ControlArrays,
        mask: wp.array[wp.bool],
        joint_q: wp.array2d[float],
        joint_qd: wp.array2d[float],
        scratch: Scratch,
        # in and out
        state: StateArrays,
        contacts: ContactArrays,
        # outputs
        reports: Reports,
    ):
        """Steps, assembles or measures (`Operation`) the worlds: all that are not frozen, or those in the mask."""
        world = wp.tid()
        if operation == OP_STEP:
            if (state.world_status[world] & NON_FINITE) != 0:
                return
        elif not mask[world]:
            return
        scratch_slot = world % scratch.x.shape[0]
        work = pack(scratch, scratch_slot)
        if operation == OP_STEP:
            cone = pack_cone(scratch, scratch_slot)
            progress = begin_step(world, config, topology, parameters, control, state, contacts, work, cone)
            solution = SolveReport()
            if progress.blocks > 0:
                problem = cone_problem(progress.blocks, topology, config, cone)
                solution = solve(problem, cone_config(config), scratch.kept[scratch_slot])
            finish_step(
                world, progress, solution, config, topology, parameters, control, state, contacts, reports, work, cone
            )
        elif operation == OP_ASSEMBLE:
            assemble_world(world, config, topology, parameters, control, joint_q, joint_qd, state, work)
        else:
            measure_world(world, topology, parameters, state, work)

    return run_worlds


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """The small one: minutes of compilation. The solvers that the other one adds are those of `cones.batch`."""
    return [run_worlds_kernel(False)]


@wp.kernel(enable_backward=False)
def copy_rows(
    # inputs
    mask: wp.array[wp.bool],
    source: wp.array2d[int],
    # outputs
    target: wp.array2d[int],
):
    """Masked reset of any array whose rows belong to worlds, seen as whole words."""
    world = wp.tid()
    if mask[world]:
        for word in range(source.shape[1]):
            target[world, word] = source[world, word]


@wp.kernel(enable_backward=False)
def flag_worlds(
    # inputs
    mask: wp.array[wp.bool],
    joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float],
    # in and out
    world_status: wp.array[int],
):
    """Freezes the worlds of the mask that were given coordinates or rates which are not finite."""
    world = wp.tid()
    if not mask[world]:
        return
    for dof in range(joint_q.shape[1]):
        if not (wp.isfinite(joint_q[world, dof]) and wp.isfinite(joint_qd[world, dof])):
            world_status[world] = world_status[world] | NON_FINITE


@wp.kernel(enable_backward=False)
def copy_worlds(
    # inputs
    mask: wp.array[wp.bool],
    source: StateArrays,
    # outputs
    target: StateArrays,
    contacts: ContactArrays,
):
    """Masked reset: every array of the state, for the worlds in the mask, which forget their contacts."""
    world = wp.tid()
    if not mask[world]:
        return
    for body in range(source.body_x.shape[1]):
        target.body_x[world, body] = source.body_x[world, body]
        target.body_rot[world, body] = source.body_rot[world, body]
        target.body_q[world, body] = source.body_q[world, body]
        target.body_v[world, body] = source.body_v[world, body]
        target.body_omega[world, body] = source.body_omega[world, body]
        target.body_omega_last[world, body] = source.body_omega_last[world, body]
        target.body_v_low[world, body] = source.body_v_low[world, body]
        target.body_omega_low[world, body] = source.body_omega_low[world, body]
    for dof in range(source.joint_x.shape[1]):
        target.joint_x[world, dof] = source.joint_x[world, dof]
        target.joint_q[world, dof] = source.joint_q[world, dof]
        target.joint_qd[world, dof] = source.joint_qd[world, dof]
    for row in range(source.box_impulse.shape[1]):
        target.box_impulse[world, row] = source.box_impulse[world, row]
    contacts.contact_count[world] = 0
    contacts.contact_overflow[world] = 0
    contacts.penetration[world] = 0.0
    for shape in range(contacts.shape_contact_force.shape[1]):
        contacts.shape_contact_force[world, shape] = wp.vec3()
    for body in range(contacts.body_contact_force.shape[1]):
        contacts.body_contact_force[world, body] = wp.vec3()
    target.world_time[world] = source.world_time[world]
    target.world_status[world] = source.world_status[world]
