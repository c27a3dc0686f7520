"""Newton systems of the interior point: units, bounds, scalings, right sides, and their solution.

In x with gamma = T x the cone of a contact becomes the standard one and diagonals about one; A = T S T. S and the
Cholesky factor are float32. The factor of A + W^-2 has more condition than that holds where contacts are redundant, so
that it preconditions a few conjugate gradient steps in double precision.
"""

import warp as wp

from simwarp.kernels.cones.dense import cholesky, cholesky_solve
from simwarp.kernels.cones.operator import multiply_wide
from simwarp.kernels.cones.problem import BOX, CONTACT, OWN, R_EFF, ConeProblem, X
from simwarp.kernels.cones.socp import FAR, jordan, jordan_divide, reflected, scaled, scaling_point, scaling_size

wp.set_module_options({"enable_backward": False})

# Rows of `wide`.
UNIT = wp.constant(0)  # T
Q = wp.constant(1)
XI = wp.constant(2)
ZI = wp.constant(3)  # dual of the cone, or of the lower bound
ZU = wp.constant(4)  # dual of the upper bound
LO = wp.constant(5)  # bounds of x in rows that are no cone's; equal where x is fixed
UP = wp.constant(6)
RD = wp.constant(7)
DX = wp.constant(8)
DZ = wp.constant(9)
DU = wp.constant(10)
RHS = wp.constant(11)
W = wp.constant(12)  # scaling points of the cones
ETA = wp.constant(13)  # on the first row of a cone; 0 in all rows that are no cone's
H = wp.constant(14)  # addition of the scaling to the diagonal of rows that are no cone's
PX = wp.constant(15)  # predictor: dx, dz, du
PZ = wp.constant(16)
PU = wp.constant(17)
CR = wp.constant(18)  # conjugate gradients
CP = wp.constant(19)
CH = wp.constant(20)
TMP = wp.constant(21)
PROD = wp.constant(22)
GAMMA = wp.constant(23)  # impulses of the best iterate

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
FIXED = wp.constant(wp.float64(1.0e12))
BOUND = wp.constant(wp.float64(1.0e18))
REGULAR = wp.constant(wp.float64(1.0e-6))
LEAST_PIVOT = wp.constant(1.0e-7)
GRADIENTS = wp.constant(40)  # conjugate gradient steps per Newton step, at most


@wp.func
def triple_at(problem: ConeProblem, vector: int, row: int) -> wp.vec3d:
    """Three rows of a wide vector."""
    return wp.vec3d(problem.wide[vector, row], problem.wide[vector, row + 1], problem.wide[vector, row + 2])


@wp.func
def set_triple(problem: ConeProblem, vector: int, row: int, value: wp.vec3d):
    """Three rows of a wide vector <- value."""
    problem.wide[vector, row] = value[0]
    problem.wide[vector, row + 1] = value[1]
    problem.wide[vector, row + 2] = value[2]


@wp.func
def is_cone(problem: ConeProblem, block: int) -> bool:
    """True if the block is treated as a second-order cone; without friction a contact is a bound and two zeros."""
    row = problem.block_row[block]
    return problem.block_kind[block] == CONTACT and problem.friction[block] > 0.0 and problem.scale[row] > 0.0


@wp.func
def set_units(problem: ConeProblem):
    """UNIT, LO, UP, ETA <- the problem in x."""
    for block in range(problem.block_count):
        row = problem.block_row[block]
        unit = wp.sqrt(wp.float64(problem.scale[row]))
        for i in range(row, problem.block_row[block + 1]):
            problem.wide[UNIT, i] = unit
            problem.wide[ETA, i] = ZERO
            problem.wide[LO, i] = ZERO
            problem.wide[UP, i] = ZERO
        if problem.scale[row] > 0.0:
            if is_cone(problem, block):
                problem.wide[UNIT, row] = unit / wp.float64(problem.friction[block])
                problem.wide[ETA, row] = ONE
            elif problem.block_kind[block] == BOX:
                problem.wide[LO, row] = wp.float64(problem.lower[row]) / unit
                problem.wide[UP, row] = wp.float64(problem.upper[row]) / unit
            else:
                problem.wide[UP, row] = FAR


@wp.func
def impulses_from(problem: ConeProblem, source: int):
    """GAMMA-like TMP, and X in single precision <- impulses of the x in wide[source]."""
    for block in range(problem.block_count):
        row = problem.block_row[block]
        for i in range(row, problem.block_row[block + 1]):
            value = problem.wide[UNIT, i] * problem.wide[source, i]
            if i == row and problem.block_kind[block] == CONTACT:
                value -= wp.float64(problem.cohesion[block])
            problem.wide[TMP, i] = value
            problem.vectors[X, i] = float(value)


@wp.func
def set_linear_term(problem: ConeProblem):
    """Q <- T (r + S times the impulses at x = 0: the apices of the cones)."""
    for row in range(problem.row_count):
        problem.wide[Q, row] = ZERO
    impulses_from(problem, Q)
    multiply_wide(problem.row_count, problem.s, problem.wide, TMP, PROD)
    for row in range(problem.row_count):
        q = wp.float64(problem.vectors[R_EFF, row]) + problem.wide[PROD, row]
        problem.wide[Q, row] = problem.wide[UNIT, row] * q


@wp.func
def set_start(problem: ConeProblem):
    """XI, ZI, ZU <- well inside."""
    size = wp.float64(1.0e-9)
    for row in range(problem.row_count):
        size = wp.max(size, wp.float64(10.0) * wp.abs(problem.wide[Q, row]))
    for row in range(problem.row_count):
        problem.wide[XI, row] = ZERO
        problem.wide[ZI, row] = ZERO
        problem.wide[ZU, row] = ZERO
        if problem.wide[ETA, row] > ZERO:
            problem.wide[XI, row] = size
            problem.wide[ZI, row] = size
    for block in range(problem.block_count):
        if not is_cone(problem, block):
            for row in range(problem.block_row[block], problem.block_row[block + 1]):
                start_bounds(problem, row, size)


@wp.func
def start_bounds(problem: ConeProblem, row: int, size: wp.float64):
    """XI, ZI, ZU of a box constraint <- between the bounds."""
    low = problem.wide[LO, row]
    high = problem.wide[UP, row]
    below = low > -BOUND
    above = high < BOUND
    if not (high > low):
        problem.wide[XI, row] = low
        return
    if below and above:
        scratch_array = wp.float64(0.5) * (high - low)
        problem.wide[XI, row] = wp.clamp(ZERO, low + wp.min(size, scratch_array), high - wp.min(size, scratch_array))
    elif below:
        problem.wide[XI, row] = low + size
    elif above:
        problem.wide[XI, row] = high - size
    if below:
        problem.wide[ZI, row] = size
    if above:
        problem.wide[ZU, row] = size


@wp.func
def set_scalings(problem: ConeProblem):
    """W, ETA, H <- for the present pairs; `factor` <- Cholesky factor of A + W^-2, its columns scaled by OWN."""
    n = problem.row_count
    for i in range(n):
        for j in range(i + 1):
            problem.factor[i, j] = float(problem.wide[UNIT, i] * wp.float64(problem.s[i, j]) * problem.wide[UNIT, j])
    for block in range(problem.block_count):
        row = problem.block_row[block]
        if is_cone(problem, block):
            x = triple_at(problem, XI, row)
            z = triple_at(problem, ZI, row)
            w = scaling_point(x, z)
            eta = scaling_size(x, z)
            set_triple(problem, W, row, w)
            problem.wide[ETA, row] = eta
            m = reflected(w)
            f = ONE / (eta * eta)
            for i in range(3):
                for j in range(i + 1):
                    extra = wp.float64(2.0) * m[i] * m[j]
                    if i == j:
                        extra += ONE
                        if i == 0:
                            extra -= wp.float64(2.0)
                    problem.factor[row + i, row + j] += float(f * extra)
        else:
            for i in range(row, problem.block_row[block + 1]):
                extra = bound_stiffness(problem, i)
                problem.wide[H, i] = extra
                problem.factor[i, i] += float(extra)
    for i in range(n):
        problem.vectors[OWN, i] = 1.0 / wp.sqrt(wp.max(problem.factor[i, i], 1.0e-30))
    for i in range(n):
        for j in range(i):
            problem.factor[i, j] = problem.factor[i, j] * (problem.vectors[OWN, i] * problem.vectors[OWN, j])
        problem.factor[i, i] = 1.0 + float(REGULAR)
    cholesky(n, problem.factor, LEAST_PIVOT)


@wp.func
def bound_stiffness(problem: ConeProblem, row: int) -> wp.float64:
    """Sum of dual over slack of a box constraint."""
    low = problem.wide[LO, row]
    high = problem.wide[UP, row]
    if not (high > low):
        return FIXED
    total = wp.float64(0.0)
    if low > -BOUND:
        total += problem.wide[ZI, row] / (problem.wide[XI, row] - low)
    if high < BOUND:
        total += problem.wide[ZU, row] / (high - problem.wide[XI, row])
    return total


@wp.func
def apply_newton(problem: ConeProblem, source: int, target: int):
    """wide[target] <- (A + W^-2) wide[source]."""
    for row in range(problem.row_count):
        problem.wide[TMP, row] = problem.wide[UNIT, row] * problem.wide[source, row]
    multiply_wide(problem.row_count, problem.s, problem.wide, TMP, PROD)
    for block in range(problem.block_count):
        row = problem.block_row[block]
        if is_cone(problem, block):
            m = reflected(triple_at(problem, W, row))
            v = triple_at(problem, source, row)
            eta = problem.wide[ETA, row]
            added = (wp.float64(2.0) * wp.dot(m, v) * m - reflected(v)) / (eta * eta)
            for i in range(3):
                problem.wide[target, row + i] = problem.wide[UNIT, row + i] * problem.wide[PROD, row + i] + added[i]
        else:
            for i in range(row, problem.block_row[block + 1]):
                problem.wide[target, i] = (
                    problem.wide[UNIT, i] * problem.wide[PROD, i] + problem.wide[H, i] * problem.wide[source, i]
                )


@wp.func
def precondition(problem: ConeProblem) -> wp.float64:
    """vectors[OWN + 1] <- factor^-1 CR; returns their product."""
    n = problem.row_count
    for row in range(n):
        problem.vectors[OWN + 1, row] = problem.vectors[OWN, row] * float(problem.wide[CR, row])
    cholesky_solve(n, problem.factor, problem.vectors, OWN + 1)
    total = wp.float64(0.0)
    for row in range(n):
        problem.vectors[OWN + 1, row] = problem.vectors[OWN + 1, row] * (problem.vectors[OWN, row])
        total += wp.float64(problem.vectors[OWN + 1, row]) * problem.wide[CR, row]
    return total


@wp.func
def solve_newton(problem: ConeProblem, target: int):
    """wide[target] <- (A + W^-2)^-1 RHS by preconditioned conjugate gradients."""
    n = problem.row_count
    for row in range(n):
        problem.wide[target, row] = ZERO
        problem.wide[CR, row] = problem.wide[RHS, row]
    rz = precondition(problem)
    first = rz
    for row in range(n):
        problem.wide[CP, row] = wp.float64(problem.vectors[OWN + 1, row])
    step = int(0)
    while step < GRADIENTS and rz > wp.float64(1.0e-12) * first:
        step += 1
        apply_newton(problem, CP, CH)
        along = wp.float64(0.0)
        for row in range(n):
            along += problem.wide[CP, row] * problem.wide[CH, row]
        if not (along > ZERO):
            return
        length = rz / along
        for row in range(n):
            problem.wide[target, row] += length * problem.wide[CP, row]
            problem.wide[CR, row] -= length * problem.wide[CH, row]
        last = rz
        rz = precondition(problem)
        for row in range(n):
            problem.wide[CP, row] = wp.float64(problem.vectors[OWN + 1, row]) + rz / last * problem.wide[CP, row]


@wp.func
def set_right_side(problem: ConeProblem, aim: wp.float64, correct: int):
    """RHS <- -r_d + W^-1 v for complementarity `aim`; with `correct` the predictor's second-order term is in v."""
    for block in range(problem.block_count):
        row = problem.block_row[block]
        if is_cone(problem, block):
            w = triple_at(problem, W, row)
            eta = problem.wide[ETA, row]
            lam = eta * scaled(w, triple_at(problem, ZI, row))
            target = wp.vec3d(aim, ZERO, ZERO) - jordan(lam, lam)
            if correct == 1:
                dx = scaled(reflected(w), triple_at(problem, PX, row))
                dz = scaled(w, triple_at(problem, PZ, row))
                target -= jordan(dx, dz)
            v = scaled(reflected(w), jordan_divide(lam, target)) / eta
            set_triple(problem, RHS, row, v - triple_at(problem, RD, row))
        else:
            for i in range(row, problem.block_row[block + 1]):
                low = problem.wide[LO, i]
                high = problem.wide[UP, i]
                x = problem.wide[XI, i]
                total = -problem.wide[RD, i]
                if not (high > low):
                    total = wp.float64(0.0)
                else:
                    if low > -BOUND:
                        c = aim - (x - low) * problem.wide[ZI, i]
                        if correct == 1:
                            c -= problem.wide[PX, i] * problem.wide[PZ, i]
                        total += c / (x - low)
                    if high < BOUND:
                        d = aim - (high - x) * problem.wide[ZU, i]
                        if correct == 1:
                            d += problem.wide[PX, i] * problem.wide[PU, i]
                        total -= d / (high - x)
                problem.wide[RHS, i] = total
