"""Proximal alternating direction method of multipliers with an adaptive penalty (Boyd et al. 2011, §3.4).

In the metric w of the blocks: (S + rho w) x = rho w z - y - r with a dense factor, z = Pi(x + y / (rho w)) after
over-relaxation, y += rho w (x - z). It needs a dense S.
"""

import warp as wp

from simwarp.kernels.cones.dense import cholesky, cholesky_solve
from simwarp.kernels.cones.operator import natural_residual, refresh, set_scales, start_from_gamma
from simwarp.kernels.cones.problem import AX, BEST, LOW, R_EFF, WEIGHT, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.projection import project_all
from simwarp.kernels.cones.vectors import copy

wp.set_module_options({"enable_backward": False})

PRIMAL = wp.constant(6)  # the x above; X holds z
DUAL = wp.constant(7)  # y
LAST = wp.constant(8)  # z of the iteration before
FIRST_PENALTY = wp.constant(0.02)
RELAXATION = wp.constant(1.6)
ADAPT = wp.constant(20)
"""Iterations between looks at the balance of the residuals; a new penalty costs a factorisation."""
SHIFT = wp.constant(5)
LEAST_PIVOT = wp.constant(1.0e-7)


@wp.func
def factorise(problem: ConeProblem, penalty: float):
    """Sets factor <- Cholesky factor of S + penalty w."""
    for i in range(problem.row_count):
        for j in range(i + 1):
            problem.factor[i, j] = problem.s[i, j]
        # Rows that nothing moves get a one, so that they have a pivot.
        weight = problem.vectors[WEIGHT, i]
        if weight > 0.0:
            problem.factor[i, i] += penalty * weight
        else:
            problem.factor[i, i] = 1.0
    cholesky(problem.row_count, problem.factor, LEAST_PIVOT)


@wp.func
def iterate(problem: ConeProblem, penalty: float) -> wp.vec2:
    """One iteration; returns the squared primal and dual residuals in the metric of the blocks."""
    n = problem.row_count
    for row in range(n):
        weight = penalty * problem.vectors[WEIGHT, row]
        z = problem.vectors[X, row]
        problem.vectors[LAST, row] = z
        problem.vectors[PRIMAL, row] = weight * z - problem.vectors[DUAL, row] - problem.vectors[R_EFF, row]
        if weight == 0.0:
            problem.vectors[PRIMAL, row] = 0.0
    cholesky_solve(n, problem.factor, problem.vectors, PRIMAL)
    for row in range(n):
        mixed = RELAXATION * problem.vectors[PRIMAL, row] + (1.0 - RELAXATION) * problem.vectors[LAST, row]
        problem.vectors[PRIMAL, row] = mixed
        problem.vectors[X, row] = mixed + problem.vectors[DUAL, row] * problem.scale[row] / penalty
    project_all(problem, problem.vectors[X])
    primal = float(0.0)
    dual = float(0.0)
    for row in range(n):
        weight = problem.vectors[WEIGHT, row]
        gap = problem.vectors[PRIMAL, row] - problem.vectors[X, row]
        move = penalty * (problem.vectors[X, row] - problem.vectors[LAST, row])
        problem.vectors[DUAL, row] += penalty * weight * gap
        primal += weight * gap * gap
        dual += weight * move * move
    return wp.vec2(primal, dual)


@wp.func
def solve_padmm(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Sets gamma <- the solution, from the warm start in gamma."""
    report = SolveReport()
    n = problem.row_count
    set_scales(problem)
    start_from_gamma(problem, X)
    project_all(problem, problem.vectors[X])
    refresh(problem, X, AX)
    best = natural_residual(problem, X, AX, config.friction_law, 1)
    copy(n, problem.vectors, X, BEST, problem.lanes)
    for row in range(n):
        problem.vectors[DUAL, row] = -problem.vectors[AX, row] - problem.vectors[R_EFF, row]
    penalty = FIRST_PENALTY
    iteration = int(0)
    while iteration < config.max_iterations and best > config.tolerance:
        if iteration == 0:
            factorise(problem, penalty)
        iteration += 1
        residuals = iterate(problem, penalty)
        refresh(problem, X, AX)
        shift = int(0)
        if iteration % SHIFT == 0:
            shift = 1
        now = natural_residual(problem, X, AX, config.friction_law, shift)
        if now < best:
            best = now
            copy(n, problem.vectors, X, BEST, problem.lanes)
        if iteration % ADAPT == 0:
            ratio = wp.sqrt(wp.sqrt(residuals[0] / wp.max(residuals[1], 1.0e-30)))
            if ratio > 2.0 or ratio < 0.5:
                penalty = wp.clamp(penalty * wp.clamp(ratio, 0.2, 5.0), 1.0e-4, 1.0e2)
                factorise(problem, penalty)
    for row in range(n):
        problem.gamma[row] = problem.vectors[BEST, row]
        problem.vectors[LOW, row] = 0.0
    report.iterations = iteration
    report.residual = best
    return report
