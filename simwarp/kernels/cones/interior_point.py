"""Primal-dual interior point for boxes and friction cones: Nesterov-Todd scaling, Mehrotra's predictor and corrector.

    A x + q - z = 0,  x in K,  z in K*,  x o z -> 0;   (A + W^-2) dx = -r_d + W^-1 v,  dz = A dx + r_d

The iterates are double: x and z close in on the boundaries of their cones, and in float32 they stop at residuals of
3e-4 m/s. For the exact law the problem is solved a few times, each with De Saxcé's term of the time before. Accelerated
gradient steps finish the work.

Problems with rolling friction, where three cones share n, and matrix-free ones are not for it (`can_factorise`).
"""

import warp as wp

from simwarp.kernels.cones.apgd import accelerate
from simwarp.kernels.cones.newton import (
    BOUND,
    DU,
    DX,
    DZ,
    GAMMA,
    LO,
    ONE,
    PROD,
    PU,
    PX,
    PZ,
    RD,
    TMP,
    UNIT,
    UP,
    XI,
    ZERO,
    ZI,
    ZU,
    Q,
    impulses_from,
    is_cone,
    set_linear_term,
    set_right_side,
    set_scalings,
    set_start,
    set_triple,
    set_units,
    solve_newton,
    triple_at,
)
from simwarp.kernels.cones.operator import multiply_wide, natural_residual, set_scales
from simwarp.kernels.cones.problem import AX, BEST, EXACT, LOW, ROLLING, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.socp import longest_step, moved_inside_cone

wp.set_module_options({"enable_backward": False})

BACK_OFF = wp.constant(wp.float64(0.97))
STALLS = wp.constant(4)  # Newton steps without progress before it ends
EXACT_FINISH = wp.constant(1000)  # the same for the exact law, whose term they keep up to date
TERM_UPDATES = wp.constant(6)  # solves with an updated De Saxcé term, at most
FINISH = wp.constant(40)  # accelerated gradient steps at the end


@wp.func
def set_dual_residual(problem: ConeProblem) -> wp.float64:
    """RD <- A x + q - z; returns the mean complementarity."""
    n = problem.row_count
    for row in range(n):
        problem.wide[TMP, row] = problem.wide[UNIT, row] * problem.wide[XI, row]
    multiply_wide(n, problem.s, problem.wide, TMP, PROD)
    for row in range(n):
        dual = problem.wide[ZI, row] - problem.wide[ZU, row]
        problem.wide[RD, row] = problem.wide[UNIT, row] * problem.wide[PROD, row] + problem.wide[Q, row] - dual
    return mean_gap(problem, ZERO)


@wp.func
def mean_gap(problem: ConeProblem, step: wp.float64) -> wp.float64:
    """Mean complementarity after a step along DX, DZ, DU."""
    total = wp.float64(0.0)
    count = wp.float64(0.0)
    for block in range(problem.block_count):
        row = problem.block_row[block]
        if is_cone(problem, block):
            x = triple_at(problem, XI, row)
            z = triple_at(problem, ZI, row)
            if step > ZERO:
                x += step * triple_at(problem, DX, row)
                z += step * triple_at(problem, DZ, row)
            total += wp.dot(x, z)
            count += ONE
        else:
            for i in range(row, problem.block_row[block + 1]):
                x_i = problem.wide[XI, i]
                zl = problem.wide[ZI, i]
                zu = problem.wide[ZU, i]
                if step > ZERO:
                    x_i += step * problem.wide[DX, i]
                    zl += step * problem.wide[DZ, i]
                    zu += step * problem.wide[DU, i]
                if problem.wide[UP, i] > problem.wide[LO, i]:
                    if problem.wide[LO, i] > -BOUND:
                        total += (x_i - problem.wide[LO, i]) * zl
                        count += ONE
                    if problem.wide[UP, i] < BOUND:
                        total += (problem.wide[UP, i] - x_i) * zu
                        count += ONE
    return total / wp.max(count, ONE)


@wp.func
def set_direction(problem: ConeProblem, aim: wp.float64, correct: int):
    """DX, DZ, DU <- the Newton direction towards complementarity `aim`."""
    n = problem.row_count
    set_right_side(problem, aim, correct)
    solve_newton(problem, DX)
    for row in range(n):
        problem.wide[TMP, row] = problem.wide[UNIT, row] * problem.wide[DX, row]
    multiply_wide(n, problem.s, problem.wide, TMP, PROD)
    for block in range(problem.block_count):
        row = problem.block_row[block]
        if is_cone(problem, block):
            for i in range(row, row + 3):
                problem.wide[DZ, i] = problem.wide[UNIT, i] * problem.wide[PROD, i] + problem.wide[RD, i]
                problem.wide[DU, i] = ZERO
        else:
            for i in range(row, problem.block_row[block + 1]):
                set_bound_duals(problem, i, aim, correct)


@wp.func
def set_bound_duals(problem: ConeProblem, row: int, aim: wp.float64, correct: int):
    """DZ, DU of a box constraint <- from its linearised complementarity."""
    low = problem.wide[LO, row]
    high = problem.wide[UP, row]
    x = problem.wide[XI, row]
    dx = problem.wide[DX, row]
    problem.wide[DZ, row] = ZERO
    problem.wide[DU, row] = ZERO
    if not (high > low):
        problem.wide[DX, row] = ZERO
        return
    if low > -BOUND:
        c = aim - problem.wide[ZI, row] * (x - low + dx)
        if correct == 1:
            c -= problem.wide[PX, row] * problem.wide[PZ, row]
        problem.wide[DZ, row] = c / (x - low)
    if high < BOUND:
        d = aim - problem.wide[ZU, row] * (high - x - dx)
        if correct == 1:
            d += problem.wide[PX, row] * problem.wide[PU, row]
        problem.wide[DU, row] = d / (high - x)


@wp.func
def shorter(step: wp.float64, value: wp.float64, change: wp.float64) -> wp.float64:
    """The step that keeps value + step * change positive."""
    if change < ZERO:
        return wp.min(step, BACK_OFF * value / -change)
    return step


@wp.func
def step_length(problem: ConeProblem) -> wp.float64:
    """The step along the direction that stays inside, at most one."""
    step = wp.float64(1.0)
    for block in range(problem.block_count):
        row = problem.block_row[block]
        if is_cone(problem, block):
            step = wp.min(step, BACK_OFF * longest_step(triple_at(problem, XI, row), triple_at(problem, DX, row)))
            step = wp.min(step, BACK_OFF * longest_step(triple_at(problem, ZI, row), triple_at(problem, DZ, row)))
        else:
            for i in range(row, problem.block_row[block + 1]):
                if problem.wide[UP, i] > problem.wide[LO, i]:
                    dx = problem.wide[DX, i]
                    if problem.wide[LO, i] > -BOUND:
                        step = shorter(step, problem.wide[XI, i] - problem.wide[LO, i], dx)
                        step = shorter(step, problem.wide[ZI, i], problem.wide[DZ, i])
                    if problem.wide[UP, i] < BOUND:
                        step = shorter(step, problem.wide[UP, i] - problem.wide[XI, i], -dx)
                        step = shorter(step, problem.wide[ZU, i], problem.wide[DU, i])
    return step


@wp.func
def newton_step(problem: ConeProblem):
    """One predictor and corrector step of XI, ZI, ZU."""
    gap = set_dual_residual(problem)
    set_scalings(problem)
    set_direction(problem, ZERO, 0)
    ratio = mean_gap(problem, step_length(problem)) / wp.max(gap, wp.float64(1.0e-200))
    for row in range(problem.row_count):
        problem.wide[PX, row] = problem.wide[DX, row]
        problem.wide[PZ, row] = problem.wide[DZ, row]
        problem.wide[PU, row] = problem.wide[DU, row]
    centre = wp.clamp(ratio * ratio * ratio, wp.float64(1.0e-4), ONE)
    set_direction(problem, centre * gap, 1)
    step = step_length(problem)
    for row in range(problem.row_count):
        problem.wide[XI, row] += step * problem.wide[DX, row]
        problem.wide[ZI, row] += step * problem.wide[DZ, row]
        problem.wide[ZU, row] += step * problem.wide[DU, row]
    for block in range(problem.block_count):
        if is_cone(problem, block):
            row = problem.block_row[block]
            set_triple(problem, XI, row, moved_inside_cone(triple_at(problem, XI, row)))
            set_triple(problem, ZI, row, moved_inside_cone(triple_at(problem, ZI, row)))


@wp.func
def measure_residual(problem: ConeProblem, friction_law: int, shift: int) -> float:
    """Residual at XI; X, AX and TMP (impulses) are set."""
    n = problem.row_count
    impulses_from(problem, XI)
    multiply_wide(n, problem.s, problem.wide, TMP, PROD)
    for row in range(n):
        problem.vectors[AX, row] = float(problem.wide[PROD, row])
    return natural_residual(problem, X, AX, friction_law, shift)


@wp.func
def solve_convex(problem: ConeProblem, config: ConeConfig, friction_law: int) -> SolveReport:
    """Newton steps for the r in R_EFF, which stays; GAMMA <- the impulses of the least residual under the law."""
    report = SolveReport()
    set_linear_term(problem)
    set_start(problem)
    best = float(1.0e30)
    stalled = int(0)
    step = int(0)
    while step < config.max_iterations and stalled < STALLS and best > 0.1 * config.tolerance:
        step += 1
        stalled += 1
        newton_step(problem)
        now = measure_residual(problem, friction_law, 0)
        if now < best:
            if now < 0.7 * best:
                stalled = 0
            best = now
            for row in range(problem.row_count):
                problem.wide[GAMMA, row] = problem.wide[TMP, row]
    report.iterations = step
    report.residual = best
    return report


@wp.func
def can_factorise(problem: ConeProblem) -> bool:
    """True if the problem is dense, has no rolling friction, and the workspace is allocated."""
    if problem.dense == 0 or problem.wide.shape[0] == 0:
        return False
    for block in range(problem.block_count):
        if problem.block_kind[block] == ROLLING:
            return False
    return True


@wp.func
def load_start(problem: ConeProblem, friction_law: int) -> float:
    """X, AX <- those of GAMMA, R_EFF <- De Saxcé's term there; returns the residual."""
    n = problem.row_count
    for row in range(n):
        problem.vectors[X, row] = float(problem.wide[GAMMA, row])
    multiply_wide(n, problem.s, problem.wide, GAMMA, PROD)
    for row in range(n):
        problem.vectors[AX, row] = float(problem.wide[PROD, row])
    return natural_residual(problem, X, AX, friction_law, 1)


@wp.func
def start_interior_point(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """The Newton steps of `solve_interior_point`; gamma and LOW <- their result."""
    report = SolveReport()
    n = problem.row_count
    set_scales(problem)
    set_units(problem)
    for row in range(n):
        problem.wide[GAMMA, row] = wp.float64(problem.gamma[row])
    load_start(problem, config.friction_law)
    updates = int(1)
    if config.friction_law == EXACT:
        updates = int(TERM_UPDATES)
    inner = float(1.0e30)
    law = int(0)
    while law < updates and inner > config.tolerance:
        law += 1
        inside = solve_convex(problem, config, config.friction_law)
        report.iterations += inside.iterations
        inner = load_start(problem, config.friction_law)
    report.residual = inner
    for row in range(n):
        # The double iterate, of which float32 takes two numbers: what follows may need the room.
        gamma = float(problem.wide[GAMMA, row])
        problem.gamma[row] = gamma
        problem.vectors[LOW, row] = float(problem.wide[GAMMA, row] - wp.float64(gamma))
    return report


@wp.func
def finish_interior_point(problem: ConeProblem, config: ConeConfig, newton: SolveReport) -> SolveReport:
    """Its accelerated gradient steps at the end; gamma <- the better of the two."""
    report = SolveReport()
    most = int(FINISH)
    if config.friction_law == EXACT:
        most = int(EXACT_FINISH)
    inner = newton.residual
    finish = accelerate(problem, config, most)
    report.iterations = newton.iterations + finish.iterations
    report.residual = wp.min(inner, finish.residual)
    if not inner <= 2.0 * finish.residual:
        for row in range(problem.row_count):
            problem.gamma[row] = problem.vectors[BEST, row]
            problem.vectors[LOW, row] = 0.0
    return report


@wp.func
def solve_interior_point(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Sets gamma <- the solution, in max_iterations Newton steps per solve; the start only serves De Saxcé.

    The problem has to pass `can_factorise`.
    """
    return finish_interior_point(problem, config, start_interior_point(problem, config))
