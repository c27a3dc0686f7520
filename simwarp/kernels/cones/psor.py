"""Projected successive over-relaxation: block Gauss-Seidel, each block with the velocities that the last one left.

The step of a block is one over the mean of its diagonal where that is stable, else short enough that no step climbs:
two over a bound on the block's greatest eigenvalue is the limit, and strong coupling of normal and friction reaches it.
"""

import warp as wp

from simwarp.kernels.cones.operator import (
    add_row,
    natural_residual,
    refresh,
    row_sum,
    set_scales,
    start_from_gamma,
)
from simwarp.kernels.cones.problem import AX, BEST, BOX, EXACT, LOW, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.projection import project_all, project_blocks
from simwarp.kernels.cones.vectors import copy, dot_row_vector

wp.set_module_options({"enable_backward": False})

STEP = wp.constant(6)  # per row: the block's step
OLD = wp.constant(7)
CHECK = wp.constant(5)
"""Sweeps between looks at the residual, which costs as much as a sweep."""


@wp.func
def coupling(problem: ConeProblem, block: int, i: int, j: int) -> float:
    """S_ij of two rows of one block."""
    if problem.dense == 1:
        return problem.s[i, j]
    total = float(0.0)
    for e in range(problem.block_entries[block]):
        total += problem.y[i, e] * problem.y[j, e]
    if problem.loop_count > 0:
        for k in range(problem.block_loops[block, 1] + problem.block_loops[block, 3]):
            total -= problem.w[i, k] * problem.w[j, k]
    return total


@wp.func
def set_steps(problem: ConeProblem):
    """STEP <- step of every block; 0 where nothing moves."""
    for block in range(problem.block_count):
        first = problem.block_row[block]
        last = problem.block_row[block + 1]
        mean = float(0.0)
        bound = float(0.0)
        for i in range(first, last):
            mean += problem.diagonal[i] / float(last - first)
            total = problem.diagonal[i]
            for j in range(first, last):
                if j != i:
                    total += wp.abs(coupling(problem, block, i, j))
            bound = wp.max(bound, total)
        step = float(0.0)
        if problem.scale[first] > 0.0:
            step = wp.min(1.0 / mean, 1.9 / bound)
        for i in range(first, last):
            problem.vectors[STEP, i] = step


@wp.func
def velocity_of(problem: ConeProblem, block: int, row: int) -> float:
    """Velocity u of one row at X [m/s or rad/s]."""
    if problem.dense == 1:
        return problem.r[row] + dot_row_vector(problem.row_count, problem.s, row, problem.vectors, X)
    total = problem.r[row] + problem.compliance[row] * problem.vectors[X, row]
    return total + row_sum(problem, block, row)


@wp.func
def desaxce(problem: ConeProblem, block: int, first: int, velocities: int) -> float:
    """De Saxcé's term of a contact from its rows of vectors[velocities]."""
    u1 = problem.vectors[velocities, first + 1]
    u2 = problem.vectors[velocities, first + 2]
    term = problem.friction[block] * wp.sqrt(u1 * u1 + u2 * u2)
    if problem.block_row[block + 1] - first == 6:
        u3 = problem.vectors[velocities, first + 3]
        u4 = problem.vectors[velocities, first + 4]
        term += problem.rolling[block] * wp.sqrt(u3 * u3 + u4 * u4)
        term += problem.spinning[block] * wp.abs(problem.vectors[velocities, first + 5])
    return term


@wp.func
def sweep(problem: ConeProblem, friction_law: int):
    """Every block of X <- its projected step, in order."""
    values = problem.vectors[X]
    for block in range(problem.block_count):
        first = problem.block_row[block]
        last = problem.block_row[block + 1]
        if problem.scale[first] > 0.0:
            for row in range(first, last):
                problem.vectors[AX, row] = velocity_of(problem, block, row)
            if friction_law == EXACT and problem.block_kind[block] != BOX:
                problem.vectors[AX, first] += desaxce(problem, block, first, AX)
            for row in range(first, last):
                problem.vectors[OLD, row] = values[row]
                values[row] = values[row] - problem.vectors[STEP, row] * problem.vectors[AX, row]
            project_blocks(problem, values, block, block + 1)
            if problem.dense == 0:
                for row in range(first, last):
                    add_row(problem, block, row, values[row] - problem.vectors[OLD, row])


@wp.func
def solve_psor(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Sets gamma <- the solution, from the warm start in gamma."""
    report = SolveReport()
    n = problem.row_count
    set_scales(problem)
    set_steps(problem)
    start_from_gamma(problem, X)
    project_all(problem, problem.vectors[X])
    # Matrix-free, this product also leaves tree_dof_sum and loop_sum up to date for the sweeps.
    refresh(problem, X, AX)
    best = natural_residual(problem, X, AX, config.friction_law, 0)
    copy(n, problem.vectors, X, BEST, problem.lanes)
    iteration = int(0)
    while iteration < config.max_iterations and best > config.tolerance:
        iteration += 1
        sweep(problem, config.friction_law)
        if iteration % CHECK == 0 or iteration == config.max_iterations:
            refresh(problem, X, AX)
            now = natural_residual(problem, X, AX, config.friction_law, 0)
            if now < best:
                best = now
                copy(n, problem.vectors, X, BEST, problem.lanes)
    for row in range(n):
        problem.gamma[row] = problem.vectors[BEST, row]
        problem.vectors[LOW, row] = 0.0
    report.iterations = iteration
    report.residual = best
    return report
