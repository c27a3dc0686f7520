"""Batches of dense cone problems: one thread eliminates, solves and measures one problem."""

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


@wp.struct
class BatchScratch:
    """Room for a few problems at a time ("lanes"): first axis the lane."""

    s: wp.array3d[float]
    factor: wp.array3d[float]
    cone_rows: wp.array3d[float]  # (lanes, 5, cone rows): r, diagonal, gamma, scale, gamma kept
    vectors: wp.array3d[float]
    wide: wp.array3d[wp.float64]
    n_bb: wp.array3d[float]
    c: wp.array3d[float]
    root: wp.array3d[float]
    a: wp.array3d[float]
    y: wp.array3d[float]
    change: wp.array3d[float]
    compliance: wp.array2d[float]
    work: wp.array3d[float]
    gamma: wp.array3d[float]


def batch_layouts(lanes: int, rows: int, bilateral: int, velocities: int) -> dict[str, ArrayLayout]:
    """The arrays of the scratch of problems of one size."""
    cones = rows - bilateral
    shapes: dict[str, tuple[int, ...]] = {
        "s": (cones, cones),
        "factor": (cones, cones),
        "wide": (WIDE_VECTORS, cones),
        "cone_rows": (5, cones),
        "vectors": (SOLVER_VECTORS, cones),
        "n_bb": (bilateral, bilateral),
        "c": (cones, bilateral),
        "root": (velocities, velocities),
        "a": (rows, velocities),
        "y": (cones, velocities),
        "change": (1, velocities),
        "compliance": (rows,),
        "work": (2, rows),
        "gamma": (2, rows),
    }
    return {
        name: ArrayLayout((lanes, *(max(length, 1) for length in shape)), wp.float64 if name == "wide" else wp.float32)
        for name, shape in shapes.items()
    }


def make_batch_scratch(device: wp.Device, lanes: int, rows: int, bilateral: int, velocities: int) -> BatchScratch:
    """Allocates the scratch of problems of one size."""
    scratch = BatchScratch()
    for name, layout in batch_layouts(lanes, rows, bilateral, velocities).items():
        setattr(scratch, name, wp.zeros(layout.shape, dtype=layout.dtype, device=device))
    return scratch


@wp.func
def pack_system(index: int, lane: int, batch: BatchInput, scratch: BatchScratch) -> DenseSystem:
    """One problem and its lane."""
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
    system.gamma = scratch.gamma[lane]
    system.root = scratch.root[lane]
    system.a = scratch.a[lane]
    system.y = scratch.y[lane]
    system.change = scratch.change[lane]
    system.compliance = scratch.compliance[lane]
    system.n_bb = scratch.n_bb[lane]
    system.c = scratch.c[lane]
    system.work = scratch.work[lane]
    return system


@wp.func
def pack_cones(index: int, lane: int, batch: BatchInput, scratch: BatchScratch) -> ConeProblem:
    """The cone problem of a lane."""
    problem = ConeProblem()
    problem.row_count = batch.rows - batch.bilateral
    problem.block_count = batch.blocks
    problem.dense = 1
    problem.slot_count = 0
    problem.loop_count = 0
    problem.block_row = batch.block_row
    problem.block_kind = batch.block_kind
    problem.friction = batch.friction[index]
    problem.rolling = batch.zeros
    problem.spinning = batch.zeros
    problem.cohesion = batch.zeros
    problem.lower = batch.lower
    problem.upper = batch.upper
    problem.s = scratch.s[lane]
    problem.factor = scratch.factor[lane]
    problem.r = scratch.cone_rows[lane, 0]
    problem.diagonal = scratch.cone_rows[lane, 1]
    problem.gamma = scratch.cone_rows[lane, 2]
    problem.scale = scratch.cone_rows[lane, 3]
    problem.vectors = scratch.vectors[lane]
    problem.wide = scratch.wide[lane]
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
    lanes = scratch.vectors.shape[0]
    lane = index % lanes
    system = pack_system(index, lane, batch, scratch)
    problem = pack_cones(index, lane, batch, scratch)
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
    kept = scratch.cone_rows[lane, 4]
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
