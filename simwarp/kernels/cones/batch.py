"""Batches of dense cone problems: one thread eliminates, solves and measures one problem."""

import dataclasses
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.cones.eliminate import (
    DenseSystem,
    bilateral_from_cones,
    cone_velocity,
    factor_bilateral,
    find_compliance,
    form_rows,
    reduce_delassus,
    reduce_mechanics,
    write_velocity,
)
from simwarp.kernels.cones.operator import refresh
from simwarp.kernels.cones.problem import AX, LOW, SOLVER_VECTORS, WIDE_VECTORS, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.solve import solve_with_fallback
from simwarp.kernels.core.scratch import ScratchGroup, make_memory, memory_layouts, memory_struct, scratch_array
from simwarp.kernels.dynamics.world import CPU_FLAGS

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "cpu_compiler_flags": CPU_FLAGS})


CORRECTIONS = wp.constant(2)
"""Solves against the velocities of the whole problem, after the first, where bilateral rows were eliminated."""


@wp.struct
class BatchInput:
    """The problems: first axis the problem. Arrays that are not given have one element per axis."""

    rows: int
    bilateral: int
    blocks: int
    velocities: int
    fallback: int  # 1: what misses the tolerance is solved again by the interior point

    n: wp.array3d[float]
    r: wp.array2d[float]
    friction: wp.array2d[float]  # per block; of limits 0
    jacobian: wp.array3d[float]
    inverse_mass: wp.array3d[float]
    free_velocity: wp.array2d[float]
    start: wp.array2d[float]

    # the same for all problems
    block_row: wp.array[int]
    block_kind: wp.array[int]
    lower: wp.array[float]
    upper: wp.array[float]
    zeros: wp.array[float]


class ProblemScratch(ScratchGroup, packed=False):
    """Room for one problem of a batch."""

    s = scratch_array(wp.float32, "cones", "cones")
    factor = scratch_array(wp.float32, "cones", "cones")
    cone_rows = scratch_array(wp.float32, 5, "cones")  # r, diagonal, gamma, scale, gamma kept
    vectors = scratch_array(wp.float32, SOLVER_VECTORS, "cones")
    wide = scratch_array(wp.float64, WIDE_VECTORS, "cones")
    n_bb = scratch_array(wp.float32, "bilateral", "bilateral")
    c = scratch_array(wp.float32, "cones", "bilateral")
    root = scratch_array(wp.float32, "velocities", "velocities")
    a = scratch_array(wp.float32, "rows", "velocities")
    y = scratch_array(wp.float32, "cones", "velocities")
    change = scratch_array(wp.float32, 1, "velocities")
    compliance = scratch_array(wp.float32, "rows")
    work = scratch_array(wp.float32, 2, "rows")
    gamma = scratch_array(wp.float32, 2, "rows")


GROUPS = (ProblemScratch,)
BatchScratch = memory_struct("BatchScratch", __name__, GROUPS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BatchSizes:
    """Lengths of problems of one size."""

    rows: int
    bilateral: int
    velocities: int

    @property
    def cones(self) -> int:
        """Rows that are left when the bilateral ones are eliminated."""
        return self.rows - self.bilateral


def batch_layouts(slots: int, sizes: BatchSizes) -> dict[str, ArrayLayout]:
    """The arrays of the scratch of problems of one size."""
    return memory_layouts(GROUPS, slots, sizes)


def make_batch_scratch(device: wp.Device, slots: int, sizes: BatchSizes) -> Any:
    """Allocates the scratch of problems of one size."""
    return make_memory(BatchScratch, batch_layouts(slots, sizes), device)


@wp.func
def pack_system(index: int, scratch_slot: int, batch: BatchInput, scratch: BatchScratch) -> DenseSystem:
    """One problem and its slot."""
    system = DenseSystem()
    system.rows = batch.rows
    system.bilateral = batch.bilateral
    system.velocities = batch.velocities
    system.n = batch.n[index]
    system.r = batch.r[index]
    if batch.velocities > 0:
        system.jacobian = batch.jacobian[index]
        system.inverse_mass = batch.inverse_mass[index]
        system.free_velocity = batch.free_velocity[index]
    system.gamma = scratch.gamma[scratch_slot]
    system.root = scratch.root[scratch_slot]
    system.a = scratch.a[scratch_slot]
    system.y = scratch.y[scratch_slot]
    system.change = scratch.change[scratch_slot]
    system.compliance = scratch.compliance[scratch_slot]
    system.n_bb = scratch.n_bb[scratch_slot]
    system.c = scratch.c[scratch_slot]
    system.work = scratch.work[scratch_slot]
    return system


@wp.func
def pack_cones(index: int, scratch_slot: int, batch: BatchInput, scratch: BatchScratch) -> ConeProblem:
    """The cone problem of a slot."""
    problem = ConeProblem()
    problem.row_count = batch.rows - batch.bilateral
    problem.block_count = batch.blocks
    problem.dense = 1
    problem.tree_dof_count = 0
    problem.loop_count = 0
    problem.rolling_count = 0
    problem.block_row = batch.block_row
    problem.block_kind = batch.block_kind
    problem.friction = batch.friction[index]
    problem.rolling = batch.zeros
    problem.spinning = batch.zeros
    problem.cohesion = batch.zeros
    problem.lower = batch.lower
    problem.upper = batch.upper
    problem.s = scratch.s[scratch_slot]
    problem.factor = scratch.factor[scratch_slot]
    problem.r = scratch.cone_rows[scratch_slot, 0]
    problem.diagonal = scratch.cone_rows[scratch_slot, 1]
    problem.gamma = scratch.cone_rows[scratch_slot, 2]
    problem.scale = scratch.cone_rows[scratch_slot, 3]
    problem.vectors = scratch.vectors[scratch_slot]
    problem.wide = scratch.wide[scratch_slot]
    return problem


@wp.func
def correct(system: DenseSystem, problem: ConeProblem):
    """All impulses <- from the cones'; r of the cone problem <- so that its u is that of the whole problem."""
    nb = system.bilateral
    for row in range(problem.row_count):
        system.gamma[0, nb + row] = problem.gamma[row]
        system.gamma[1, nb + row] = problem.vectors[LOW, row]
    bilateral_from_cones(system)
    if nb > 0:
        for row in range(problem.row_count):
            problem.vectors[X, row] = problem.gamma[row]
        refresh(problem, X, AX)
        for row in range(problem.row_count):
            problem.r[row] = cone_velocity(system, row) - problem.vectors[AX, row]


@wp.kernel(enable_backward=False)
def solve_batch(
    # inputs
    config: ConeConfig,
    batch: BatchInput,
    scratch: BatchScratch,
    # outputs
    impulse: wp.array2d[float],
    velocity: wp.array2d[float],
    residual: wp.array[float],
    iterations: wp.array[int],
):
    """Solves one problem per thread."""
    index = wp.tid()
    scratch_slots = scratch.vectors.shape[0]
    scratch_slot = index % scratch_slots
    system = pack_system(index, scratch_slot, batch, scratch)
    problem = pack_cones(index, scratch_slot, batch, scratch)
    nb = system.bilateral
    if system.velocities > 0:
        form_rows(system)
        find_compliance(system)
    factor_bilateral(system)
    if system.velocities > 0 and nb > 0:
        reduce_mechanics(system, problem.s, problem.r, problem.diagonal)
    else:
        reduce_delassus(system, problem.s, problem.r, problem.diagonal)
    for row in range(problem.row_count):
        problem.gamma[row] = batch.start[index, nb + row]
    turns = int(1)
    if nb > 0:
        # The reduced problem has the rounding of its elimination; u of the whole problem, for `correct`, has not.
        turns = 1 + CORRECTIONS
    kept = scratch.cone_rows[scratch_slot, 4]
    total = SolveReport()
    for _ in range(turns):
        report = solve_with_fallback(problem, config, batch.fallback, kept)
        total.iterations += report.iterations
        total.residual = report.residual
        correct(system, problem)
    if system.velocities > 0:
        write_velocity(system, velocity[index])
    for row in range(system.rows):
        impulse[index, row] = system.gamma[0, row]
    residual[index] = total.residual
    iterations[index] = total.iterations
