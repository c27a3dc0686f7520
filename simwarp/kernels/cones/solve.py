"""One entry for all cone solvers."""

import warp as wp

from simwarp.core.types import ConeSolver
from simwarp.kernels.cones.apgd import solve_apgd
from simwarp.kernels.cones.interior_point import can_factorise, solve_interior_point
from simwarp.kernels.cones.padmm import solve_padmm
from simwarp.kernels.cones.problem import LOW, ConeConfig, ConeProblem, SolveReport
from simwarp.kernels.cones.psor import solve_psor
from simwarp.kernels.cones.spg import solve_spg

wp.set_module_options({"enable_backward": False})

APGD = wp.constant(int(ConeSolver.APGD))
PSOR = wp.constant(int(ConeSolver.PSOR))
SPG = wp.constant(int(ConeSolver.SPG))
PADMM = wp.constant(int(ConeSolver.PADMM))
INTERIOR_POINT = wp.constant(int(ConeSolver.INTERIOR_POINT))

FALLBACK = wp.constant(40)
"""Accelerated gradient steps in the place of one Newton step."""
FALLBACK_STEPS = wp.constant(25)
"""Newton steps of the fallback solver."""


@wp.func
def solver_of(problem: ConeProblem, config: ConeConfig) -> int:
    """The solver of the configuration, or accelerated gradient descent where that cannot do it: there is no dense S
    (PADMM, interior point), or rolling friction (interior point).
    """
    if config.solver == INTERIOR_POINT and not can_factorise(problem):
        return APGD
    if config.solver == PADMM and problem.dense == 0:
        return APGD
    return config.solver


@wp.func
def gradient_config(config: ConeConfig) -> ConeConfig:
    """Numbers of accelerated gradient descent, which may stand in for the interior point."""
    chosen = ConeConfig()
    chosen.friction_law = config.friction_law
    chosen.tolerance = config.tolerance
    chosen.max_iterations = config.max_iterations
    if config.solver == INTERIOR_POINT:
        chosen.max_iterations = FALLBACK * config.max_iterations
    return chosen


@wp.func
def solve(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Sets gamma <- the solution by the solver of the configuration (`solver_of`), from the warm start in gamma."""
    solver = solver_of(problem, config)
    report = SolveReport()
    if solver == PSOR:
        report = solve_psor(problem, config)
    elif solver == SPG:
        report = solve_spg(problem, config)
    elif solver == PADMM:
        report = solve_padmm(problem, config)
    elif solver == INTERIOR_POINT:
        report = solve_interior_point(problem, config)
    else:
        report = solve_apgd(problem, gradient_config(config))
    return report


@wp.func
def solve_with_fallback(problem: ConeProblem, config: ConeConfig, fallback: int, kept: wp.array[float]) -> SolveReport:
    """As `solve`; with `fallback`, the interior point solves what misses the tolerance, and the better one is kept."""
    chosen = ConeConfig()
    chosen.friction_law = config.friction_law
    chosen.solver = config.solver
    chosen.tolerance = config.tolerance
    chosen.max_iterations = config.max_iterations
    best = SolveReport()
    attempt = int(0)
    while attempt <= fallback:
        # One call for both solves: the code of the solvers is large.
        report = solve(problem, chosen)
        best.iterations += report.iterations
        if attempt == 0 or report.residual < best.residual:
            best.residual = report.residual
        else:
            for row in range(problem.row_count):
                problem.gamma[row] = kept[row]
                problem.vectors[LOW, row] = 0.0
        attempt += 1
        if best.residual <= config.tolerance or not can_factorise(problem):
            attempt = 2
        for row in range(problem.row_count):
            kept[row] = problem.gamma[row]
        chosen.solver = INTERIOR_POINT
        chosen.max_iterations = FALLBACK_STEPS
    return best
