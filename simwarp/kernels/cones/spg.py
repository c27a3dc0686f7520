"""Spectral projected gradient (Barzilai-Borwein) with a non-monotone line search (Birgin, Martínez & Raydan 2000).

Values of the quadratic are followed by their changes, which are exact along a line, instead of being evaluated: the
difference of two values is lost in float32 long before the solution is reached. The search compares with the greatest
of the last values, starting from the first, so that it can reject; what rounding of x alone changes is no reason to.
"""

import warp as wp

from simwarp.kernels.cones.operator import multiply, natural_residual, refresh, set_scales, start_from_gamma
from simwarp.kernels.cones.problem import AX, BEST, EXACT, LOW, R_EFF, WEIGHT, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.projection import project_all
from simwarp.kernels.cones.vectors import copy

wp.set_module_options({"enable_backward": False})

TRIAL = wp.constant(6)
D = wp.constant(7)
AD = wp.constant(8)
MEMORY = wp.constant(10)
ARMIJO = wp.constant(1.0e-4)
REFRESH = wp.constant(10)
SHIFT = wp.constant(5)
EPSILON = wp.constant(5.0e-7)
LEAST = wp.constant(1.0e-3)
MOST = wp.constant(1.0e3)
TRUSTED = wp.constant(100)

Values = wp.types.vector(length=10, dtype=float)


@wp.func
def set_direction(problem: ConeProblem, alpha: float) -> wp.vec3:
    """D <- projected spectral step from X; returns D^T g, |D|^2 in the metric, and the noise of D^T g."""
    for row in range(problem.row_count):
        gradient = problem.vectors[AX, row] + problem.vectors[R_EFF, row]
        problem.vectors[TRIAL, row] = problem.vectors[X, row] - alpha * problem.scale[row] * gradient
    project_all(problem, problem.vectors[TRIAL])
    slope = float(0.0)
    square = float(0.0)
    noise = float(0.0)
    for row in range(problem.row_count):
        gradient = problem.vectors[AX, row] + problem.vectors[R_EFF, row]
        d = problem.vectors[TRIAL, row] - problem.vectors[X, row]
        problem.vectors[D, row] = d
        slope += d * gradient
        noise += EPSILON * wp.abs(problem.vectors[X, row] * gradient)
        square += problem.vectors[WEIGHT, row] * d * d
    return wp.vec3(slope, square, noise)


@wp.func
def search(slope: float, curvature: float, scratch_array: float) -> float:
    """Step along D that satisfies Armijo's condition with `scratch_array` above the present value."""
    step = float(1.0)
    for _ in range(20):
        change = step * slope + 0.5 * step * step * curvature
        if change <= scratch_array + ARMIJO * step * slope:
            return step
        # Least of the parabola through the value, its slope and this trial, kept within [0.1, 0.9] of the step.
        least = -0.5 * step * step * slope / wp.max(change - step * slope, 1.0e-30)
        step = wp.clamp(least, 0.1 * step, 0.9 * step)
    return step


@wp.func
def spectral_step(problem: ConeProblem, square: float, curvature: float, even: bool) -> float:
    """Barzilai and Borwein's two steps in turn, from D and A D."""
    if curvature <= 1.0e-12 * square:
        return MOST
    if even:
        return wp.clamp(square / curvature, LEAST, MOST)
    bend = float(0.0)
    for row in range(problem.row_count):
        bend += problem.scale[row] * problem.vectors[AD, row] * problem.vectors[AD, row]
    return wp.clamp(curvature / wp.max(bend, 1.0e-30), LEAST, MOST)


@wp.func
def solve_spg(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Sets gamma <- the solution, from the warm start in gamma."""
    report = SolveReport()
    n = problem.row_count
    set_scales(problem)
    start_from_gamma(problem, X)
    project_all(problem, problem.vectors[X])
    refresh(problem, X, AX)
    best = natural_residual(problem, X, AX, config.friction_law, 1)
    copy(n, problem.vectors, X, BEST, problem.lanes)
    history = Values()
    value = float(0.0)
    alpha = float(1.0)
    iteration = int(0)
    while iteration < config.max_iterations and best > config.tolerance:
        iteration += 1
        moved = set_direction(problem, alpha)
        curvature = multiply(problem, D, AD)
        greatest = value
        for k in range(wp.min(MEMORY, iteration)):
            greatest = wp.max(greatest, history[k])
        step = search(moved[0], curvature, greatest - value + moved[2])
        value += step * moved[0] + 0.5 * step * step * curvature
        for row in range(n):
            problem.vectors[X, row] += step * problem.vectors[D, row]
            problem.vectors[AX, row] += step * problem.vectors[AD, row]
        alpha = spectral_step(problem, moved[1], curvature, iteration % 2 == 0)
        history[iteration % MEMORY] = value
        fresh = iteration % REFRESH == 0
        if fresh:
            # A sum of steps inside a convex set stays inside but for rounding, which is removed here.
            project_all(problem, problem.vectors[X])
            refresh(problem, X, AX)
        shift = int(0)
        if iteration % SHIFT == 0 and config.friction_law == EXACT:
            # The function has changed: values of the old one are no reference.
            shift = 1
            value = float(0.0)
            for k in range(MEMORY):
                history[k] = 0.0
        now = natural_residual(problem, X, AX, config.friction_law, shift)
        if now <= config.tolerance and not fresh:
            fresh = True
            refresh(problem, X, AX)
            now = natural_residual(problem, X, AX, config.friction_law, 0)
        if now < best and (fresh or iteration < TRUSTED):
            best = now
            copy(n, problem.vectors, X, BEST, problem.lanes)
    for row in range(n):
        problem.gamma[row] = problem.vectors[BEST, row]
        problem.vectors[LOW, row] = 0.0
    report.iterations = iteration
    report.residual = best
    return report
