"""Proximal Newton steps in the velocities of the tree, for problems that keep accelerated gradient busy (tall stacks).

A proximal step, with w the greatest diagonal of a block,

    gamma+ = argmin over the cones of  1/2 gamma^T S gamma + r^T gamma + sum of (w / 2 rho) |gamma - gamma_k|^2

has a dual in z = Y^T gamma+, one number per degree of freedom, without constraints: with p the projection onto the
cones,

    F(z) = z - Y^T p(gamma_k - rho/w (Y z + r)) = 0,   gamma+ = p(...)

F is the gradient of a convex function that is quadratic in pieces, with the Hessian 1 + Y^T P Y, where P = (rho/w) p'.
Newton steps with a search along the line end after a few, from any start (Li, Sun & Toh 2018, SIAM J. Optim. 28, 433).
The Hessian of a stack is a narrow band, and its zeros are passed over; it is factorised in float32, as a direction only
has to descend. Rows and velocities are double: rho magnifies the rounding of Y z.

For problems without loop rows, rolling friction and compliance (`can_step_by_newton`).
"""

import warp as wp

from simwarp.core.types import BlockKind
from simwarp.kernels.cones.operator import natural_residual, refresh
from simwarp.kernels.cones.problem import AX, BEST, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.vectors import copy
from simwarp.kernels.core.lanes import LANES, lane_of, meet, stride_of
from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})

NEWTON_VECTORS = 8
"""Rows of `wide` that it uses: gamma_k, point, its projection p, Y z, Y dz; z, F, dz."""
MOST_DOFS = 256
"""Degrees of freedom of a tree, at most."""
NEWTON_ROWS = 8 * MOST_DOFS
"""Rows of a problem that it has room for, at most."""
LARGEST = wp.constant(MOST_DOFS)

FIRST_RHO = wp.constant(100.0)
LAST_RHO = wp.constant(1.0e4)  # float32 still tells 1 from the rounding of rho in the Hessian
GROWTH = wp.constant(3.0)
INNER = wp.constant(12)  # Newton steps of one proximal step, at most
INNER_SHARE = wp.constant(0.3)  # of the residual before, or of the tolerance, left by one proximal step
TRIALS = wp.constant(8)  # of a search along the line
LONG_CHAIN = wp.constant(64)  # rows of a chain that begins with Newton steps, at least
KEPT_VECTORS = wp.constant(NEWTON_VECTORS)
STALLS = wp.constant(3)  # proximal steps without progress before it gives up

_NAMES = f"""
    constexpr int BOX = {int(BlockKind.BOX)}, CONTACT = {int(BlockKind.CONTACT)};
""" + VIEWS + LANES + """
    const Doubles gamma = row(wide, 0), point = row(wide, 1), image = row(wide, 2), yz = row(wide, 3);
    const Doubles yd = row(wide, 4), z = row(wide, 5), f = row(wide, 6), dz = row(wide, 7);
    const Ints rows = elements(block_row);
"""  # fmt: skip

_ROWS = """
    const Ints counts = elements(entries);
    // to <- Y from
    auto rows_of = [&](auto from, auto to) {
        ROLLED for (int b = lane; b < blocks; b += stride) {
            const Ints at = row(tree_dof, b);
            const int count = counts[b], r = rows[b];
            const Floats y0 = row(y, r);
            double a0 = 0.0, a1 = 0.0, a2 = 0.0;
            if (rows[b + 1] - r == 3) {
                const Floats y1 = row(y, r + 1), y2 = row(y, r + 2);
                for (int e = 0; e < count; ++e) {
                    const double value = from[at[e]];
                    a0 += y0[e] * value;
                    a1 += y1[e] * value;
                    a2 += y2[e] * value;
                }
                to[r + 1] = a1;
                to[r + 2] = a2;
            } else {
                for (int e = 0; e < count; ++e) a0 += y0[e] * from[at[e]];
            }
            to[r] = a0;
        }
        meet_lanes();
    };
    // to <- to + sign Y^T from
    auto add_columns = [&](auto from, auto to, double sign) {
        for (int b = 0; b < blocks; ++b) {
            const Ints at = row(tree_dof, b);
            const int count = counts[b], r = rows[b];
            const Floats y0 = row(y, r);
            const double x0 = sign * from[r];
            if (rows[b + 1] - r == 3) {
                const Floats y1 = row(y, r + 1), y2 = row(y, r + 2);
                const double x1 = sign * from[r + 1], x2 = sign * from[r + 2];
                if (x0 == 0.0 && x1 == 0.0 && x2 == 0.0) continue;
                ROLLED for (int e = lane; e < count; e += stride) to[at[e]] += y0[e] * x0 + y1[e] * x1 + y2[e] * x2;
            } else {
                ROLLED for (int e = lane; e < count; e += stride) to[at[e]] += y0[e] * x0;
            }
            meet_lanes();  // the next block has other degrees of freedom in these places
        }
    };
"""


@wp.func_native(
    _NAMES
    + _ROWS
    + """
    const Floats x = row(vectors, 0);
    ROLLED for (int r = lane; r < rows[blocks]; r += stride) gamma[r] = x[r];
    ROLLED for (int i = lane; i < tree_dofs; i += stride) z[i] = dz[i] = 0.0;
    ROLLED for (int r = lane; r < rows[blocks]; r += stride) yd[r] = 0.0;
    meet_lanes();
    add_columns(gamma, z, 1.0);
    rows_of(z, yz);
"""
)
def begin(
    blocks: int, tree_dofs: int, block_row: wp.array[int], entries: wp.array[int], tree_dof: wp.array2d[int],
    y: wp.array2d[float], vectors: wp.array2d[float], wide: wp.array2d[wp.float64], lanes: int,
):  # fmt: skip
    """gamma_k <- X, z <- Y^T gamma_k, and Y z; no direction yet."""
    ...


@wp.func_native(
    _NAMES
    + """
    const Floats r_eff = row(vectors, 3), scales = elements(scale), slopes = elements(friction);
    const Floats apexes = elements(cohesion), lows = elements(lower), highs = elements(upper);
    const Ints kinds = elements(block_kind);
    double along = 0.0;
    ROLLED for (int i = lane; i < tree_dofs; i += stride) along += (z[i] + length * dz[i]) * dz[i];
    ROLLED for (int b = lane; b < blocks; b += stride) {
        const int first = rows[b], end = rows[b + 1];
        for (int r = first; r < end; ++r)
            point[r] = gamma[r] - (double)rho * scales[r] * (yz[r] + length * yd[r] + r_eff[r]);
        if (kinds[b] == CONTACT) {
            const double slope = slopes[b], apex = apexes[b];
            const double n = point[first] + apex, t1 = point[first + 1], t2 = point[first + 2];
            const double t = sqrt(t1 * t1 + t2 * t2);
            double normal = n, pull = 1.0;
            if (slope * t <= -n) {
                normal = pull = 0.0;
            } else if (t > slope * n) {
                normal = (n + slope * t) / (1.0 + slope * slope);
                pull = slope * normal / t;
            }
            image[first] = normal - apex;
            image[first + 1] = pull * t1;
            image[first + 2] = pull * t2;
        } else {
            const double low = lows[first], high = highs[first], x = point[first];
            image[first] = x < low ? low : (x > high ? high : x);
        }
        for (int r = first; r < end; ++r) along -= image[r] * yd[r];
    }
    along = sum_of_lanes(along);
    meet_lanes();
    return (float)along;
"""
)
def try_length(
    blocks: int, tree_dofs: int, block_row: wp.array[int], block_kind: wp.array[int], friction: wp.array[float],
    cohesion: wp.array[float], lower: wp.array[float], upper: wp.array[float], scale: wp.array[float],
    vectors: wp.array2d[float], rho: float, length: float, wide: wp.array2d[wp.float64], lanes: int,
) -> float:  # fmt: skip
    """Sets point and p at z + length dz; returns F . dz there: zero where the search along the line is done."""
    ...


@wp.func_native(
    _NAMES
    + _ROWS
    + """
    ROLLED for (int i = lane; i < tree_dofs; i += stride) {
        z[i] += length * dz[i];
        f[i] = z[i];
    }
    ROLLED for (int r = lane; r < rows[blocks]; r += stride) yz[r] += length * yd[r];
    meet_lanes();
    add_columns(image, f, -1.0);
    rows_of(f, yd);
    double worst = 0.0;
    ROLLED for (int r = lane; r < rows[blocks]; r += stride) {
        const double size = yd[r] < 0.0 ? -yd[r] : yd[r];
        worst = size > worst ? size : worst;
    }
    worst = greatest_of_lanes(worst);
    meet_lanes();
    return (float)worst;
"""
)
def advance_newton(
    blocks: int, tree_dofs: int, length: float, block_row: wp.array[int], entries: wp.array[int],
    tree_dof: wp.array2d[int], y: wp.array2d[float], wide: wp.array2d[wp.float64], lanes: int,
) -> float:  # fmt: skip
    """Sets z <- z + length dz, F <- that of z; returns the greatest entry of Y F, a velocity [m/s]."""
    ...


_PIECES = """
    const Floats scales = elements(scale), slopes = elements(friction), apexes = elements(cohesion);
    const Floats lows = elements(lower), highs = elements(upper);
    const Ints kinds = elements(block_kind);
    // `pieces` <- rows v with v^T v = Y^T P Y of one block; returns how many
    auto pieces_of = [&](int b, auto pieces) -> int {
        const int r = rows[b], count = counts[b];
        const double gain = (double)rho * scales[r];
        const Floats y0 = row(y, r);
        if (kinds[b] != CONTACT) {
            if (point[r] < lows[r] || point[r] > highs[r]) return 0;
            const float root = (float)sqrt(gain);
            ROLLED for (int e = lane; e < count; e += stride) pieces[e] = root * y0[e];
            return 1;
        }
        const Floats y1 = row(y, r + 1), y2 = row(y, r + 2);
        const double slope = slopes[b], n = point[r] + apexes[b];
        const double t1 = point[r + 1], t2 = point[r + 2], t = sqrt(t1 * t1 + t2 * t2);
        if (slope * t <= -n) return 0;
        if (t <= slope * n) {
            const float root = (float)sqrt(gain);
            ROLLED for (int e = lane; e < count; e += stride) {
                pieces[e] = root * y0[e];
                pieces[most + e] = root * y1[e];
                pieces[2 * most + e] = root * y2[e];
            }
            return 3;
        }
        const double normal = (n + slope * t) / (1.0 + slope * slope);
        const float out = (float)sqrt(gain / (1.0 + slope * slope)), s = (float)slope;
        const float around = (float)sqrt(gain * slope * normal / t), c1 = (float)(t1 / t), c2 = (float)(t2 / t);
        ROLLED for (int e = lane; e < count; e += stride) {
            pieces[e] = out * (y0[e] + s * (c1 * y1[e] + c2 * y2[e]));
            pieces[most + e] = around * (c1 * y2[e] - c2 * y1[e]);
        }
        return 2;
    };
"""

_FACTOR = """
    // U^T U by rows: row j ends at last_column[j], and zeros within are passed over
    for (int j = 0; j < tree_dofs; ++j) {
        const Floats pivot = row(factor, j);
        const int last = last_column[j];
        // The Hessian is 1 and something positive: what rounding takes is given back
        const float root = sqrtf(pivot[j] > 0.5f ? pivot[j] : 0.5f), inverse = 1.0f / root;
        meet_lanes();
        if (lane == 0) pivot[j] = root;
        ROLLED for (int k = j + 1 + lane; k <= last; k += stride) pivot[k] *= inverse;
        meet_lanes();
        ROLLED for (int i = j + 1 + lane; i <= last; i += stride) {
            const float share = pivot[i];
            if (share == 0.0f) continue;
            const Floats mine = row(factor, i);
            if (last > last_column[i]) last_column[i] = last;
            int k = i;
#ifndef __CUDA_ARCH__
            for (; k + 8 <= last + 1; k += 8) *(lanes8*)(mine + k) -= share * *(const lanes8*)(pivot + k);
#endif
            for (; k <= last; ++k) mine[k] -= share * pivot[k];
        }
        meet_lanes();
    }
    ROLLED for (int i = lane; i < tree_dofs; i += stride) dz[i] = -f[i];
    meet_lanes();
    for (int j = 0; j < tree_dofs; ++j) {
        const Floats mine = row(factor, j);
        const double value = dz[j] / mine[j];
        meet_lanes();
        if (lane == 0) dz[j] = value;
        ROLLED for (int k = j + 1 + lane; k <= last_column[j]; k += stride) dz[k] -= mine[k] * value;
        meet_lanes();
    }
    for (int j = tree_dofs - 1; j >= 0; --j) {
        const Floats mine = row(factor, j);
        double total = lane == 0 ? dz[j] : 0.0;
        ROLLED for (int k = j + 1 + lane; k <= last_column[j]; k += stride) total -= mine[k] * dz[k];
        total = sum_of_lanes(total);
        if (lane == 0) dz[j] = total / mine[j];
        meet_lanes();
    }
"""


@wp.func_native(
    _NAMES
    + _ROWS
    + _PIECES
    + """
#ifndef __CUDA_ARCH__
    typedef float lanes8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef float lanes4 __attribute__((ext_vector_type(4), aligned(4)));
#endif
    const int room = tree_dofs * spread.shape[1];  // what these degrees of freedom have, whatever else is in the world
    const Floats pieces = flat(spread);
    const Ints last_column = elements(factor_end);
    ROLLED for (int i = lane; i < tree_dofs; i += stride) {
        for (int j = i + 1; j < tree_dofs; ++j) row(factor, i)[j] = 0.0f;
        row(factor, i)[i] = 1.0f;
        last_column[i] = i;
    }
    meet_lanes();
    for (int b = 0; b < blocks; ++b) {
        const Ints at = row(tree_dof, b);
        int last = 0;
        for (int e = 0; e < counts[b]; ++e) last = at[e] > last ? at[e] : last;
        ROLLED for (int e = lane; e < counts[b]; e += stride)
            last_column[at[e]] = last > last_column[at[e]] ? last : last_column[at[e]];
        meet_lanes();
    }
    // Contacts of one pair of bodies share their places: their rows are gathered, and multiplied together.
    int held = 0;
    for (int b = 0; b < blocks; ++b) {
        const Ints at = row(tree_dof, b);
        const int count = counts[b];
        held += pieces_of(b, pieces + held * most);
        bool together = b + 1 < blocks && counts[b + 1] == count && (held + 3) * most <= room;
        for (int e = 0; together && e < count; ++e) together = row(tree_dof, b + 1)[e] == at[e];
        if (together) continue;
        meet_lanes();
        ROLLED for (int e = lane; e < count; e += stride) {
            const Floats mine = row(factor, at[e]);
            int from = 0;
#ifndef __CUDA_ARCH__
            auto add_lanes = [&](auto sum) {
                constexpr int LANES = sizeof(sum) / sizeof(float);
                for (; from + LANES <= count; from += LANES) {
                    sum = 0.0f;
                    for (int k = 0; k < held; ++k) {
                        const float* __restrict__ v = pieces + (size_t)k * most;
                        decltype(sum) piece;  // a deduced type has lost `aligned(4)`: it must not be read through
                        __builtin_memcpy(&piece, v + from, sizeof piece);
                        sum += v[e] * piece;
                    }
                    for (int o = 0; o < LANES; ++o)
                        if (at[from + o] >= at[e]) mine[at[from + o]] += sum[o];
                }
            };
            add_lanes(lanes8());
            add_lanes(lanes4());
#endif
            for (; from < count; ++from) {
                float sum = 0.0f;
                for (int k = 0; k < held; ++k) sum += pieces[k * most + e] * pieces[k * most + from];
                if (at[from] >= at[e]) mine[at[from]] += sum;
            }
        }
        meet_lanes();
        held = 0;
    }
"""
    + _FACTOR
    + """
    rows_of(dz, yd);
    double along = 0.0;
    ROLLED for (int i = lane; i < tree_dofs; i += stride) along += f[i] * dz[i];
    along = sum_of_lanes(along);
    meet_lanes();
    return (float)along;
"""
)
def set_direction(
    blocks: int, tree_dofs: int, block_row: wp.array[int], block_kind: wp.array[int], entries: wp.array[int],
    tree_dof: wp.array2d[int], y: wp.array2d[float], friction: wp.array[float], cohesion: wp.array[float],
    lower: wp.array[float], upper: wp.array[float], scale: wp.array[float], rho: float, most: int,
    spread: wp.array2d[float], factor: wp.array2d[float], factor_end: wp.array[int], wide: wp.array2d[wp.float64],
    lanes: int,
) -> float:  # fmt: skip
    """Sets dz <- -(1 + Y^T P Y)^-1 F and Y dz; returns F . dz, which is negative. `spread` holds the rows of a pair,
    of `most` entries each.
    """
    ...


@wp.func
def can_step_by_newton(problem: ConeProblem) -> bool:
    """True if the problem has the form for it and the workspace is allocated."""
    if problem.newton == 0 or problem.loop_count > 0 or problem.rolling_count > 0:
        return False
    if problem.tree_dof_count == 0 or problem.tree_dof_count > LARGEST:
        return False
    if problem.factor.shape[0] < problem.tree_dof_count:
        return False
    if problem.wide.shape[1] < wp.max(problem.row_count, problem.tree_dof_count):
        return False
    if 3 * problem.entry_count > problem.tree_dof_count * problem.spread.shape[1]:
        return False
    for row in range(problem.row_count):
        if problem.compliance[row] != 0.0:
            return False
    return True


@wp.func
def is_chain(problem: ConeProblem) -> bool:
    """True if it is a long chain, and accelerated gradient its only other solver: a stack, an arch. The Hessian
    is a narrow band, so that a Newton step costs no more than a few gradient steps, of which a chain takes hundreds.
    """
    if problem.row_count < LONG_CHAIN or problem.wide.shape[0] > KEPT_VECTORS or not can_step_by_newton(problem):
        return False
    for block in range(problem.block_count):
        low = problem.tree_dof_count
        high = int(0)
        for e in range(problem.block_entries[block]):
            tree_dof = problem.block_tree_dof[block, e]
            low = wp.min(low, tree_dof)
            high = wp.max(high, tree_dof)
        if high - low >= problem.entry_count:
            return False
    return True


@wp.func
def search_along(problem: ConeProblem, rho: float, steepness: float) -> float:
    """Length at which the slope along dz has fallen to a third of `steepness`, with point and p there."""
    low = float(0.0)
    low_slope = float(steepness)
    high = float(0.0)
    high_slope = float(0.0)
    length = float(1.0)
    trial = int(0)
    while trial < TRIALS:
        slope = try_length(
            problem.block_count, problem.tree_dof_count, problem.block_row, problem.block_kind, problem.friction,
            problem.cohesion, problem.lower, problem.upper, problem.scale, problem.vectors, rho, length, problem.wide,
            problem.lanes,
        )  # fmt: skip
        trial += 1
        if wp.abs(slope) <= -0.3 * steepness or (trial == 1 and slope < 0.0) or trial == TRIALS:
            return length
        if slope > 0.0:
            high = length
            high_slope = slope
        else:
            low = length
            low_slope = slope
        length = low + (high - low) * wp.clamp(-low_slope / (high_slope - low_slope), 0.1, 0.9)
    return length


@wp.func
def step_proximally(problem: ConeProblem, rho: float, goal: float) -> int:
    """Sets p <- the result of one proximal step from X, to a velocity of `goal` [m/s]; returns the Newton steps."""
    begin(
        problem.block_count, problem.tree_dof_count, problem.block_row, problem.block_entries, problem.block_tree_dof,
        problem.y, problem.vectors, problem.wide, problem.lanes,
    )  # fmt: skip
    steps = int(0)
    length = float(0.0)
    try_length(
        problem.block_count, problem.tree_dof_count, problem.block_row, problem.block_kind, problem.friction,
        problem.cohesion, problem.lower, problem.upper, problem.scale, problem.vectors, rho, 0.0, problem.wide,
        problem.lanes,
    )  # fmt: skip
    while steps < INNER:
        error = advance_newton(
            problem.block_count, problem.tree_dof_count, length, problem.block_row, problem.block_entries,
            problem.block_tree_dof, problem.y, problem.wide, problem.lanes,
        )  # fmt: skip
        if steps > 0 and error < goal:
            return steps
        steepness = set_direction(
            problem.block_count, problem.tree_dof_count, problem.block_row, problem.block_kind, problem.block_entries,
            problem.block_tree_dof, problem.y, problem.friction, problem.cohesion, problem.lower, problem.upper,
            problem.scale, rho, problem.entry_count, problem.spread, problem.factor, problem.factor_end, problem.wide,
            problem.lanes,
        )  # fmt: skip
        length = search_along(problem, rho, steepness)
        steps += 1
    return steps


@wp.func
def advance_proximally(problem: ConeProblem, config: ConeConfig, rho: float, residual: float) -> SolveReport:
    """Sets X <- the result of one proximal step from X, where the residual is given; reports Newton steps made and the
    residual that is left. De Saxcé's term follows.
    """
    report = SolveReport()
    report.iterations = step_proximally(problem, rho, INNER_SHARE * wp.max(residual, config.tolerance))
    for row in range(lane_of(problem.lanes), problem.row_count, stride_of(problem.lanes)):
        problem.vectors[X, row] = float(problem.wide[2, row])
    meet(problem.lanes)
    refresh(problem, X, AX)
    report.residual = natural_residual(problem, X, AX, config.friction_law, 1)
    return report


@wp.func
def solve_proximally(problem: ConeProblem, config: ConeConfig, most: int) -> SolveReport:
    """BEST <- a better solution, from BEST, in at most about `most` Newton steps; scales are set."""
    n = problem.row_count
    report = SolveReport()
    copy(n, problem.vectors, BEST, X, problem.lanes)
    refresh(problem, X, AX)
    best = natural_residual(problem, X, AX, config.friction_law, 1)
    now = float(best)
    rho = float(FIRST_RHO)
    stalls = int(0)
    while best > config.tolerance and report.iterations < most and stalls < STALLS:
        step = advance_proximally(problem, config, rho, now)
        report.iterations += step.iterations
        now = step.residual
        stalls += 1
        if now < best:
            best = now
            stalls = 0
            copy(n, problem.vectors, X, BEST, problem.lanes)
        rho = wp.min(rho * GROWTH, LAST_RHO)
    report.residual = best
    return report
