"""Accelerated projected gradient descent, warm started (Nesterov; Mazhar et al. 2015).

The iterates are impulses; the metric is |x|^2 = sum of w_c x^2 with w_c the greatest diagonal of the block, which is
block scaling without touching S: one scalar per block keeps the cones. S y is extrapolated with y, so that a trial
costs one product. Backtracking and restart use the full gradient, and the restart test (y - x+)^T (x+ - x) > 0 is the
form that float32 can decide (O'Donoghue & Candès 2015).
"""

import warp as wp

from simwarp.kernels.cones.operator import multiply, natural_residual, refresh, set_scales, start_from_gamma
from simwarp.kernels.cones.problem import AX, BEST, BOX, LOW, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.projection import project_all
from simwarp.kernels.cones.proximal_newton import (
    FIRST_RHO,
    LAST_RHO,
    advance_proximally,
    can_step_by_newton,
    solve_proximally,
)
from simwarp.kernels.cones.vectors import copy
from simwarp.kernels.core.lanes import LANES, lane_of, meet
from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})

Y = wp.constant(6)
AY = wp.constant(7)
X_NEW = wp.constant(8)
D = wp.constant(9)
AD = wp.constant(10)

REFRESH = wp.constant(10)
"""Iterations between fresh products: the extrapolated S y drifts, to floors of 2.5e-4 m/s if left alone."""
SHIFT = wp.constant(2)
"""Iterations between updates of De Saxcé's term."""
TRUSTED = wp.constant(100)
"""Iterations up to which extrapolated products are good enough to pick the best iterate."""
TRIALS = wp.constant(30)
BEFORE_NEWTON = wp.constant(40)
"""Iterations until Newton steps are tried: those of a tall stack, the rest of which would take hundreds."""
MOST_NEWTON = wp.constant(30)
BEFORE_CHAIN = wp.constant(10)
"""The same of a long chain, and gradient steps after a proximal step that gains little."""
CHAIN_GROWTH = wp.constant(10.0)
LITTLE = wp.constant(0.7)
"""Share of the residual that a proximal step of a chain leaves, from which on it has gained little: what is left then
is De Saxcé's term, which gradient steps follow more closely."""


@wp.func_native(
    VIEWS
    + LANES
    + """
    const Floats y = row(vectors, 6), ay = row(vectors, 7), r = row(vectors, 3), x_new = row(vectors, 8);
    const Floats p = elements(scale);
#pragma clang loop vectorize_width(4) interleave_count(1)
    ROLLED for (int i = lane; i < n; i += stride) x_new[i] = y[i] - inverse * p[i] * (ay[i] + r[i]);
    meet_lanes();
"""
)
def descend(n: int, vectors: wp.array2d[float], scale: wp.array[float], inverse: float, lanes: int):
    """X_NEW <- Y - inverse * scale (AY + R_EFF)."""
    ...


@wp.func_native(
    """
#pragma clang fp reassociate(on)
"""
    + VIEWS
    + LANES
    + """
    const Floats x = row(vectors, 0), w = row(vectors, 4), y = row(vectors, 6), x_new = row(vectors, 8);
    const Floats d = row(vectors, 9);
    float square = 0.0f, along = 0.0f;
#pragma clang loop vectorize_width(4) interleave_count(1)
    ROLLED for (int i = lane; i < n; i += stride) {
        const float di = x_new[i] - y[i];
        const float wd = w[i] * di;
        d[i] = di;
        square += wd * di;
        along += wd * (x_new[i] - x[i]);
    }
    square = sum_of_lanes(square);
    along = sum_of_lanes(along);
    meet_lanes();
    return wp::vec_t<2, float>(square, along);
"""
)
def difference(n: int, vectors: wp.array2d[float], lanes: int) -> wp.vec2:
    """D <- X_NEW - Y; returns |D|^2 and D^T (X_NEW - X) in the metric of the weights."""
    ...


@wp.func_native(
    VIEWS
    + LANES
    + """
    const Floats x = row(vectors, 0), ax = row(vectors, 1), y = row(vectors, 6), ay = row(vectors, 7);
    const Floats x_new = row(vectors, 8), ad = row(vectors, 10);
#pragma clang loop vectorize_width(4) interleave_count(1)
    ROLLED for (int i = lane; i < n; i += stride) {
        const float xi = x_new[i];
        const float axi = ay[i] + ad[i];
        y[i] = xi + beta * (xi - x[i]);
        ay[i] = axi + beta * (axi - ax[i]);
        x[i] = xi;
        ax[i] = axi;
    }
    meet_lanes();
"""
)
def advance(n: int, vectors: wp.array2d[float], beta: float, lanes: int):
    """X <- X_NEW, Y <- extrapolated, and their products with S likewise."""
    ...


@wp.func
def solve_one_row(problem: ConeProblem):
    """A single BOX row in closed form."""
    if problem.diagonal[0] > 0.0:
        problem.gamma[0] = wp.clamp(-problem.r[0] / problem.diagonal[0], problem.lower[0], problem.upper[0])
    else:
        problem.gamma[0] = wp.clamp(0.0, problem.lower[0], problem.upper[0])
    problem.vectors[LOW, 0] = 0.0


@wp.func
def accelerate(problem: ConeProblem, config: ConeConfig, most: int) -> SolveReport:
    """APGD from X = BEST-to-be for at most `most` iterations; scales are set. BEST holds the result."""
    n = problem.row_count
    report = SolveReport()
    refresh(problem, X, AX)
    best = natural_residual(problem, X, AX, config.friction_law, 1)
    copy(n, problem.vectors, X, BEST, problem.lanes)
    copy(n, problem.vectors, X, Y, problem.lanes)
    copy(n, problem.vectors, AX, AY, problem.lanes)
    values = problem.vectors[X_NEW]
    lipschitz = float(1.0)
    theta = float(1.0)
    iteration = int(0)
    while iteration < most and best > config.tolerance:
        iteration += 1
        along = float(0.0)
        trial = int(0)
        while trial < TRIALS:
            descend(n, problem.vectors, problem.scale, 1.0 / lipschitz, problem.lanes)
            project_all(problem, values)
            moved = difference(n, problem.vectors, problem.lanes)
            along = moved[1]
            curvature = multiply(problem, D, AD)
            trial += 1
            if curvature <= lipschitz * moved[0] * 1.00001:
                trial = TRIALS
            else:
                lipschitz *= 2.0
        theta_new = 0.5 * (-theta * theta + theta * wp.sqrt(theta * theta + 4.0))
        beta = theta * (1.0 - theta) / (theta * theta + theta_new)
        # (y - x+)^T (x+ - x) > 0: the momentum points uphill.
        if along < 0.0:
            beta = float(0.0)
            theta_new = float(1.0)
        advance(n, problem.vectors, beta, problem.lanes)
        theta = theta_new
        lipschitz *= 0.9
        fresh = int(0)
        if iteration % REFRESH == 0:
            fresh = 1
            refresh(problem, X, AX)
            refresh(problem, Y, AY)
        shift = int(0)
        if iteration % SHIFT == 0:
            shift = 1
        now = natural_residual(problem, X, AX, config.friction_law, shift)
        if now <= config.tolerance and fresh == 0:
            fresh = 1
            refresh(problem, X, AX)
            now = natural_residual(problem, X, AX, config.friction_law, 0)
        # Late iterates are told apart by less than the drift of their products: only fresh ones count.
        if now < best and (fresh == 1 or iteration < TRUSTED):
            best = now
            copy(n, problem.vectors, X, BEST, problem.lanes)
    report.iterations = iteration
    report.residual = best
    return report


@wp.func
def descend_first(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """BEST <- the solution, from the warm start in gamma, or what is reached before Newton steps are worth a try."""
    if problem.row_count == 1 and problem.block_kind[0] == BOX:
        if lane_of(problem.lanes) == 0:
            solve_one_row(problem)
            problem.vectors[BEST, 0] = problem.gamma[0]
        meet(problem.lanes)
        return SolveReport()
    set_scales(problem)
    start_from_gamma(problem, X)
    project_all(problem, problem.vectors[X])
    most = int(config.max_iterations)
    if most > BEFORE_NEWTON and can_step_by_newton(problem):
        most = wp.where(problem.chain == 1, BEFORE_CHAIN, BEFORE_NEWTON)
    return accelerate(problem, config, most)


@wp.func
def needs_newton(problem: ConeProblem, config: ConeConfig, residual: float) -> bool:
    """True if `descend_first` has left something to Newton steps."""
    return not residual <= config.tolerance and config.max_iterations > BEFORE_NEWTON and can_step_by_newton(problem)


@wp.func
def solve_chain(problem: ConeProblem, config: ConeConfig, most: int) -> SolveReport:
    """BEST <- a better solution of a long chain, from BEST, in at most about `most` Newton steps; scales are set.

    The weight of the proximal term falls faster than elsewhere, since the start is close.
    """
    n = problem.row_count
    report = SolveReport()
    copy(n, problem.vectors, BEST, X, problem.lanes)
    refresh(problem, X, AX)
    report.residual = natural_residual(problem, X, AX, config.friction_law, 1)
    rho = float(FIRST_RHO)
    newton = int(0)
    while report.residual > config.tolerance and newton < most:
        last = report.residual
        step = advance_proximally(problem, config, rho, last)
        copy(n, problem.vectors, X, BEST, problem.lanes)
        rho = wp.min(rho * CHAIN_GROWTH, LAST_RHO)
        newton += step.iterations
        report.iterations += step.iterations
        report.residual = step.residual
        if step.residual > config.tolerance and step.residual > LITTLE * last:
            between = accelerate(problem, config, BEFORE_CHAIN)
            report.iterations += between.iterations
            copy(n, problem.vectors, BEST, X, problem.lanes)
            refresh(problem, X, AX)
            report.residual = natural_residual(problem, X, AX, config.friction_law, 1)
    return report


@wp.func
def step_newton(problem: ConeProblem, config: ConeConfig, before: SolveReport) -> SolveReport:
    """BEST <- what Newton steps make of it."""
    report = SolveReport()
    if problem.chain == 1:
        report = solve_chain(problem, config, MOST_NEWTON)
    else:
        report = solve_proximally(problem, config, MOST_NEWTON)
    report.iterations += before.iterations
    return report


@wp.func
def descend_rest(problem: ConeProblem, config: ConeConfig, before: SolveReport) -> SolveReport:
    """BEST <- what the rest of the iterations make of it."""
    copy(problem.row_count, problem.vectors, BEST, X, problem.lanes)
    report = accelerate(problem, config, wp.max(config.max_iterations - before.iterations, 0))
    report.iterations += before.iterations
    return report


@wp.func_native(
    VIEWS
    + LANES
    + """
    const Floats out = elements(gamma), best = row(vectors, 2), low = row(vectors, 5);
#pragma clang loop vectorize_width(4) interleave_count(1)
    ROLLED for (int i = lane; i < n; i += stride) {
        out[i] = best[i];
        low[i] = 0.0f;
    }
    meet_lanes();
"""
)
def return_best(n: int, vectors: wp.array2d[float], gamma: wp.array[float], lanes: int):
    """Sets gamma <- BEST, and LOW <- 0."""
    ...


@wp.func
def keep_best(problem: ConeProblem):
    """Sets gamma <- BEST."""
    return_best(problem.row_count, problem.vectors, problem.gamma, problem.lanes)


@wp.func
def solve_apgd(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Sets gamma <- the solution, from the warm start in gamma.

    Newton steps try what is not solved after some iterations; the rest of the iterations take what these leave.
    """
    report = descend_first(problem, config)
    if needs_newton(problem, config, report.residual):
        report = step_newton(problem, config, report)
        if not report.residual <= config.tolerance:
            report = descend_rest(problem, config, report)
    keep_best(problem)
    return report
