"""Accelerated projected gradient descent on a small dense system with interval bounds.

min 1/2 g^T S g + r^T g over lower <= g <= upper, Jacobi-scaled. The gradient is extrapolated with the iterate, so that
a trial costs one product; backtracking and the restart test use the full gradient (Nesterov; O'Donoghue & Candès 2015
for the restart, in the form (y - x+)^T (x+ - x) > 0 that float32 can decide).
"""

import warp as wp

from simwarp.kernels.tables import StepConfig, Work

wp.set_module_options({"enable_backward": False})

X = wp.constant(0)
Y = wp.constant(1)
X_NEW = wp.constant(2)
AX = wp.constant(3)
AY = wp.constant(4)
AX_NEW = wp.constant(5)
BEST = wp.constant(6)


@wp.struct
class SolveReport:
    """Iterations done and the residual of the impulses returned [m/s or rad/s]."""

    iterations: int
    residual: float


@wp.func
def multiply(count: int, source: int, target: int, work: Work):
    """solver[target] <- scaled S times solver[source]."""
    for r in range(count):
        total = float(0.0)
        for c in range(count):
            total += work.s[r, c] * work.b_scale[c] * work.solver[source, c]
        work.solver[target, r] = total * work.b_scale[r]


@wp.func
def residual_of(count: int, x: int, ax: int, work: Work) -> float:
    """Max over rows of S_rr |g - clamp(g - u / S_rr)| with u = S g + r."""
    worst = float(0.0)
    for r in range(count):
        diagonal = work.s[r, r]
        gamma = work.solver[x, r] * work.b_scale[r]
        u = work.solver[ax, r] / work.b_scale[r] + work.b_r[r]
        moved = wp.clamp(gamma - u / diagonal, work.b_lower[r], work.b_upper[r])
        worst = wp.max(worst, diagonal * wp.abs(gamma - moved))
    return worst


@wp.func
def solve_bounded(count: int, config: StepConfig, work: Work) -> SolveReport:
    """Gamma <- the solution, from the warm start in gamma. One row is solved in closed form."""
    report = SolveReport()
    for r in range(count):
        work.b_scale[r] = 1.0 / wp.sqrt(wp.max(work.s[r, r], 1.0e-20))
    if count == 1:
        work.gamma[0] = wp.clamp(-work.b_r[0] / wp.max(work.s[0, 0], 1.0e-20), work.b_lower[0], work.b_upper[0])
        return report
    for r in range(count):
        start = work.gamma[r] / work.b_scale[r]
        work.solver[X, r] = start
        work.solver[Y, r] = start
        work.solver[BEST, r] = start
    multiply(count, X, AX, work)
    for r in range(count):
        work.solver[AY, r] = work.solver[AX, r]
    best = residual_of(count, X, AX, work)
    lipschitz = float(1.0)
    theta = float(1.0)
    iteration = int(0)
    while iteration < config.max_iterations and best > config.tolerance:
        iteration += 1
        trial = int(0)
        accepted = int(0)
        while accepted == 0:
            for r in range(count):
                gradient = work.solver[AY, r] + work.b_r[r] * work.b_scale[r]
                step = work.solver[Y, r] - gradient / lipschitz
                work.solver[X_NEW, r] = wp.clamp(
                    step, work.b_lower[r] / work.b_scale[r], work.b_upper[r] / work.b_scale[r]
                )
            multiply(count, X_NEW, AX_NEW, work)
            curvature = float(0.0)
            square = float(0.0)
            for r in range(count):
                d = work.solver[X_NEW, r] - work.solver[Y, r]
                curvature += d * (work.solver[AX_NEW, r] - work.solver[AY, r])
                square += d * d
            trial += 1
            if curvature <= lipschitz * square * 1.00001 or trial > 12:
                accepted = 1
            else:
                lipschitz *= 2.0
        theta_new = 0.5 * (-theta * theta + theta * wp.sqrt(theta * theta + 4.0))
        beta = theta * (1.0 - theta) / (theta * theta + theta_new)
        uphill = float(0.0)
        for r in range(count):
            move = work.solver[X_NEW, r] - work.solver[X, r]
            uphill += (work.solver[Y, r] - work.solver[X_NEW, r]) * move
        if uphill > 0.0:
            beta = float(0.0)
            theta_new = float(1.0)
        for r in range(count):
            x_new = work.solver[X_NEW, r]
            ax_new = work.solver[AX_NEW, r]
            work.solver[Y, r] = x_new + beta * (x_new - work.solver[X, r])
            work.solver[AY, r] = ax_new + beta * (ax_new - work.solver[AX, r])
            work.solver[X, r] = x_new
            work.solver[AX, r] = ax_new
        theta = theta_new
        lipschitz *= 0.9
        now = residual_of(count, X, AX, work)
        if now < best:
            best = now
            for r in range(count):
                work.solver[BEST, r] = work.solver[X, r]
    for r in range(count):
        work.gamma[r] = work.solver[BEST, r] * work.b_scale[r]
    report.iterations = iteration
    report.residual = best
    return report
