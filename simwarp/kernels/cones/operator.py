"""Operations on a problem shared by all solvers: products with S, block scales, the residual, De Saxcé's shift.

The residual of a block is that of the natural map, g |gamma - Pi(gamma - u / g)| with g the mean diagonal of the block:
a velocity [m/s or rad/s]. Blocks that nothing moves (zero diagonal) keep the projection of zero and have no residual.
"""

import warp as wp

from simwarp.core.types import BlockKind, FrictionLaw
from simwarp.kernels.cones.problem import EXACT, R_EFF, ROLLING, WEIGHT, ConeProblem
from simwarp.kernels.cones.projection import NEAREST_IN_CONE, joint_projection_normal, shortened, slopes_of
from simwarp.kernels.cones.sparse_rows import add_rows, subtract_loops, sum_rows
from simwarp.kernels.cones.vectors import clear
from simwarp.kernels.core.lanes import LANES, greatest_over_lanes, lane_of, meet, stride_of, sum_over_lanes
from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})


@wp.func_native(
    VIEWS
    + LANES
    + """
    const Floats x = row(vectors, source), out = row(vectors, target);
    int i = lane;
    float dot = 0.0f;
#ifndef __CUDA_ARCH__
    const int pitch = s.strides[0] / sizeof(float);
    const float* __restrict__ m = s.data;
    typedef float lanes8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef float lanes4 __attribute__((ext_vector_type(4), aligned(4)));
    for (; i + 16 <= n; i += 16) {
        lanes8 a = 0.0f, b = 0.0f;
        const float* col = m + i;
        for (int j = 0; j < n; ++j, col += pitch) {
            const lanes8 xj = x[j];
            a += *(const lanes8*)col * xj;
            b += *(const lanes8*)(col + 8) * xj;
        }
        *(lanes8*)(out + i) = a;
        *(lanes8*)(out + i + 8) = b;
    }
    for (; i + 8 <= n; i += 8) {
        lanes8 a = 0.0f, b = 0.0f;
        const float* col = m + i;
        int j = 0;
        for (; j + 2 <= n; j += 2, col += 2 * pitch) {
            a += *(const lanes8*)col * x[j];
            b += *(const lanes8*)(col + pitch) * x[j + 1];
        }
        if (j < n) a += *(const lanes8*)col * x[j];
        *(lanes8*)(out + i) = a + b;
    }
    for (; i + 4 <= n; i += 4) {
        lanes4 a = 0.0f, b = 0.0f;
        const float* col = m + i;
        int j = 0;
        for (; j + 2 <= n; j += 2, col += 2 * pitch) {
            a += *(const lanes4*)col * x[j];
            b += *(const lanes4*)(col + pitch) * x[j + 1];
        }
        if (j < n) a += *(const lanes4*)col * x[j];
        *(lanes4*)(out + i) = a + b;
    }
#endif
    ROLLED for (; i < n; i += stride) {
        float a = 0.0f;
        for (int j = 0; j < n; ++j) a += row(s, j)[i] * x[j];
        out[i] = a;
    }
    ROLLED for (int k = lane; k < n; k += stride) dot += x[k] * out[k];
    dot = sum_of_lanes(dot);
    meet_lanes();
    return dot;
"""
)
def multiply_dense(
    n: int, s: wp.array2d[float], vectors: wp.array2d[float], source: int, target: int, lanes: int
) -> float:
    """vectors[target] <- s vectors[source] for a symmetric s: columns are walked as rows. Returns their product."""
    ...


@wp.func_native(
    VIEWS
    + LANES
    + """
    const Floats x = row(vectors, source), out = row(vectors, target);
    int i = lane;
#ifndef __CUDA_ARCH__
    const int pitch = s.strides[0] / sizeof(float);
    const float* __restrict__ m = s.data;
    typedef float lanes4 __attribute__((ext_vector_type(4), aligned(4)));
    typedef double wide4 __attribute__((ext_vector_type(4), aligned(8)));
    for (; i + 4 <= n; i += 4) {
        wide4 a = 0.0;
        const float* col = m + i;
        for (int j = 0; j < n; ++j, col += pitch)
            a += __builtin_convertvector(*(const lanes4*)col, wide4) * (double)x[j];
        *(lanes4*)(out + i) = __builtin_convertvector(a, lanes4);
    }
#endif
    ROLLED for (; i < n; i += stride) {
        double a = 0.0;
        for (int j = 0; j < n; ++j) a += (double)row(s, j)[i] * x[j];
        out[i] = (float)a;
    }
    meet_lanes();
"""
)
def multiply_dense_wide(n: int, s: wp.array2d[float], vectors: wp.array2d[float], source: int, target: int, lanes: int):
    """As `multiply_dense`, summed in double precision: impulses of 100 N·s cancel to velocities of 1e-5 m/s."""
    ...


@wp.func_native(
    VIEWS
    + """
    const Doubles x = row(wide, source), out = row(wide, target);
    for (int i = 0; i < n; ++i) out[i] = 0.0;
    for (int j = 0; j < n; ++j) {
        const Floats mine = row(s, j);
        const double xj = x[j];
#pragma clang loop vectorize_width(4) interleave_count(2)
        for (int i = 0; i < n; ++i) out[i] += (double)mine[i] * xj;
    }
"""
)
def multiply_wide(n: int, s: wp.array2d[float], wide: wp.array2d[wp.float64], source: int, target: int):
    """wide[target] <- s wide[source] for a symmetric s."""
    ...


@wp.func
def multiply_free(problem: ConeProblem, source: int, target: int) -> float:
    """vectors[target] <- (Y Y^T - W W^T + compliance) vectors[source]. Returns their product.

    `tree_dof_sum` and `loop_sum` keep Y^T and W^T of the source.
    """
    x = problem.vectors[source]
    ax = problem.vectors[target]
    clear(problem.tree_dof_count, problem.tree_dof_sum, problem.lanes)
    add_rows(
        problem.block_count, problem.block_row, problem.block_entries, problem.block_tree_dof, problem.y, x,
        problem.tree_dof_sum, problem.lanes,
    )  # fmt: skip
    dot = sum_rows(
        problem.block_count, problem.block_row, problem.block_entries, problem.block_tree_dof, problem.y,
        problem.compliance, problem.tree_dof_sum, x, ax, problem.lanes,
    )  # fmt: skip
    if problem.loop_count > 0:
        dot -= subtract_loops(
            problem.block_count, problem.loop_count, problem.block_row, problem.block_loops, problem.w, x,
            problem.loop_sum, ax, problem.lanes,
        )  # fmt: skip
    return dot


@wp.func
def add_row(problem: ConeProblem, block: int, row: int, value: float):
    """tree_dof_sum, loop_sum <- with `value` more in one row: Y^T gamma and W^T gamma kept up to date."""
    for e in range(problem.block_entries[block]):
        problem.tree_dof_sum[problem.block_tree_dof[block, e]] += problem.y[row, e] * value
    if problem.loop_count > 0:
        near = problem.block_loops[block, 1]
        for k in range(near):
            problem.loop_sum[problem.block_loops[block, 0] + k] += problem.w[row, k] * value
        for k in range(problem.block_loops[block, 3]):
            problem.loop_sum[problem.block_loops[block, 2] + k] += problem.w[row, near + k] * value


@wp.func
def row_sum(problem: ConeProblem, block: int, row: int) -> float:
    """(Y Y^T - W W^T) gamma of one row, from tree_dof_sum and loop_sum."""
    total = float(0.0)
    for e in range(problem.block_entries[block]):
        total += problem.y[row, e] * problem.tree_dof_sum[problem.block_tree_dof[block, e]]
    if problem.loop_count > 0:
        near = problem.block_loops[block, 1]
        for k in range(near):
            total -= problem.w[row, k] * problem.loop_sum[problem.block_loops[block, 0] + k]
        for k in range(problem.block_loops[block, 3]):
            total -= problem.w[row, near + k] * problem.loop_sum[problem.block_loops[block, 2] + k]
    return total


@wp.func
def multiply(problem: ConeProblem, source: int, target: int) -> float:
    """vectors[target] <- S vectors[source]; source and target differ. Returns the product of the two."""
    if problem.dense == 1:
        return multiply_dense(problem.row_count, problem.s, problem.vectors, source, target, problem.lanes)
    return multiply_free(problem, source, target)


@wp.func
def refresh(problem: ConeProblem, source: int, target: int):
    """As `multiply`, without the rounding of long sums where S is dense."""
    if problem.dense == 1:
        multiply_dense_wide(problem.row_count, problem.s, problem.vectors, source, target, problem.lanes)
    else:
        multiply_free(problem, source, target)


@wp.func
def set_scales(problem: ConeProblem):
    """WEIGHT <- greatest diagonal of the row's block, scale <- its inverse (0 where nothing moves), R_EFF <- r."""
    lane = lane_of(problem.lanes)
    stride = stride_of(problem.lanes)
    top = float(0.0)
    for row in range(lane, problem.row_count, stride):
        top = wp.max(top, problem.diagonal[row])
        problem.vectors[R_EFF, row] = problem.r[row]
    least = 1.0e-12 * greatest_over_lanes(problem.lanes, top)
    for block in range(lane, problem.block_count, stride):
        first = problem.block_row[block]
        last = problem.block_row[block + 1]
        weight = float(0.0)
        for row in range(first, last):
            weight = wp.max(weight, problem.diagonal[row])
        step = float(0.0)
        if weight > least:
            step = 1.0 / weight
        else:
            weight = float(0.0)
        for row in range(first, last):
            problem.vectors[WEIGHT, row] = weight
            problem.scale[row] = step
    meet(problem.lanes)


@wp.func
def start_from_gamma(problem: ConeProblem, target: int):
    """vectors[target] <- the warm start, zero in blocks that nothing moves."""
    for row in range(lane_of(problem.lanes), problem.row_count, stride_of(problem.lanes)):
        start = float(0.0)
        if problem.scale[row] > 0.0:
            start = problem.gamma[row]
        problem.vectors[target, row] = start
    meet(problem.lanes)


SLIDING = """
    auto sliding = [](float t1, float t2, float bound) {
        return t1 * t1 + t2 * t2 < 0.99f * bound * bound ? 0.0f : 1.0f;
    };
"""


@wp.func_native(SLIDING + "return sliding(t1, t2, bound);")
def sliding(t1: float, t2: float, bound: float) -> float:
    """1 where a tangential impulse is at its bound, else 0: what sticks has no sliding speed in the end, and that of
    the iterates is noise, which De Saxcé's term would carry into the normal rows (ten times the iterations of a stack).
    """
    ...


@wp.func_native(
    f"""
    constexpr int BOX = {int(BlockKind.BOX)}, CONTACT = {int(BlockKind.CONTACT)};
    constexpr int EXACT = {int(FrictionLaw.EXACT)};
"""
    + VIEWS
    + LANES
    + NEAREST_IN_CONE
    + SLIDING
    + """
    const Floats x = row(vectors, source), ax = row(vectors, product), r_eff = row(vectors, 3), free = elements(r);
    const Floats slopes = elements(friction), apexes = elements(cohesion), diagonals = elements(diagonal);
    const Floats scales = elements(scale), lows = elements(lower), highs = elements(upper);
    const Ints rows = elements(block_row), kinds = elements(block_kind);
    float worst = 0.0f, poison = 0.0f;
    ROLLED for (int b = lane; b < blocks; b += stride) {
        const int at = rows[b], kind = kinds[b];
        if (!(scales[at] > 0.0f)) continue;
        float square;
        if (kind == CONTACT) {
            const float slope = slopes[b], apex = apexes[b];
            float un = ax[at] + free[at];
            const float u1 = ax[at + 1] + free[at + 1], u2 = ax[at + 2] + free[at + 2];
            if (friction_law == EXACT) {
                const float term = slope * sqrtf(u1 * u1 + u2 * u2);
                un += term;
                if (shift == 1)
                    r_eff[at] = free[at] + sliding(x[at + 1], x[at + 2], slope * (x[at] + apex)) * term;
            }
            const float mean = (diagonals[at] + diagonals[at + 1] + diagonals[at + 2]) * (1.0f / 3.0f);
            const float inverse = 1.0f / mean;
            float q[3];
            nearest_in_cone(
                x[at] - un * inverse, x[at + 1] - u1 * inverse, x[at + 2] - u2 * inverse, slope, apex, q);
            const float d0 = x[at] - q[0], d1 = x[at + 1] - q[1], d2 = x[at + 2] - q[2];
            square = mean * mean * (d0 * d0 + d1 * d1 + d2 * d2);
        } else if (kind == BOX) {
            const float moved = x[at] - (ax[at] + free[at]) / diagonals[at];
            const float gap = diagonals[at] * (x[at] - wp::clamp(moved, lows[at], highs[at]));
            square = gap * gap;
        } else {
            continue;
        }
        worst = square > worst ? square : worst;
        poison += 0.0f * square;
    }
    worst = greatest_of_lanes(worst);
    poison = sum_of_lanes(poison);
    meet_lanes();
    return worst + poison;
"""
)
def native_residual(
    blocks: int, block_row: wp.array[int], block_kind: wp.array[int], friction: wp.array[float],
    cohesion: wp.array[float], lower: wp.array[float], upper: wp.array[float], r: wp.array[float],
    diagonal: wp.array[float], scale: wp.array[float], vectors: wp.array2d[float], source: int, product: int,
    friction_law: int, shift: int, lanes: int,
) -> float:  # fmt: skip
    """Greatest squared residual of the BOX and CONTACT blocks, see `natural_residual`; NaN if one is not finite."""
    ...


@wp.func
def rolling_residual(
    problem: ConeProblem, block: int, row: int, x: int, ax: int, friction_law: int, shift: int
) -> float:
    """Squared residual of a ROLLING block, as the native ones."""
    slopes = slopes_of(problem, block)
    cohesion = problem.cohesion[block]
    u0 = problem.vectors[ax, row] + problem.r[row]
    u1 = problem.vectors[ax, row + 1] + problem.r[row + 1]
    u2 = problem.vectors[ax, row + 2] + problem.r[row + 2]
    u3 = problem.vectors[ax, row + 3] + problem.r[row + 3]
    u4 = problem.vectors[ax, row + 4] + problem.r[row + 4]
    u5 = problem.vectors[ax, row + 5] + problem.r[row + 5]
    if friction_law == EXACT:
        slip = slopes[0] * wp.sqrt(u1 * u1 + u2 * u2)
        roll = slopes[1] * wp.sqrt(u3 * u3 + u4 * u4)
        spin = slopes[2] * wp.abs(u5)
        u0 += slip + roll + spin
        if shift == 1:
            n = problem.vectors[x, row] + cohesion
            slip *= sliding(problem.vectors[x, row + 1], problem.vectors[x, row + 2], slopes[0] * n)
            roll *= sliding(problem.vectors[x, row + 3], problem.vectors[x, row + 4], slopes[1] * n)
            spin *= sliding(problem.vectors[x, row + 5], 0.0, slopes[2] * n)
            problem.vectors[R_EFF, row] = problem.r[row] + slip + roll + spin
    mean = float(0.0)
    for i in range(6):
        mean += problem.diagonal[row + i] / 6.0
    g1 = problem.vectors[x, row + 1]
    g2 = problem.vectors[x, row + 2]
    g3 = problem.vectors[x, row + 3]
    g4 = problem.vectors[x, row + 4]
    g5 = problem.vectors[x, row + 5]
    m1 = g1 - u1 / mean
    m2 = g2 - u2 / mean
    m3 = g3 - u3 / mean
    m4 = g4 - u4 / mean
    m5 = g5 - u5 / mean
    start = problem.vectors[x, row] + cohesion
    lengths = wp.vec3(wp.sqrt(m1 * m1 + m2 * m2), wp.sqrt(m3 * m3 + m4 * m4), wp.abs(m5))
    normal = wp.max(joint_projection_normal(start - u0 / mean, lengths, slopes), 0.0)
    f1 = shortened(lengths[0], slopes[0] * normal)
    f2 = shortened(lengths[1], slopes[1] * normal)
    f3 = shortened(lengths[2], slopes[2] * normal)
    total = (start - normal) * (start - normal)
    total += (g1 - f1 * m1) * (g1 - f1 * m1) + (g2 - f1 * m2) * (g2 - f1 * m2)
    total += (g3 - f2 * m3) * (g3 - f2 * m3) + (g4 - f2 * m4) * (g4 - f2 * m4)
    total += (g5 - f3 * m5) * (g5 - f3 * m5)
    return mean * mean * total


@wp.func
def natural_residual(problem: ConeProblem, x: int, ax: int, friction_law: int, shift: int) -> float:
    """Greatest residual over the blocks at gamma = vectors[x], S gamma = vectors[ax] [m/s or rad/s].

    With `shift` = 1 and the exact law, R_EFF gets De Saxcé's term at these velocities.
    """
    worst = native_residual(
        problem.block_count, problem.block_row, problem.block_kind, problem.friction, problem.cohesion, problem.lower,
        problem.upper, problem.r, problem.diagonal, problem.scale, problem.vectors, x, ax, friction_law, shift,
        problem.lanes,
    )  # fmt: skip
    poison = 0.0 * worst
    if problem.rolling_count > 0:
        for block in range(lane_of(problem.lanes), problem.block_count, stride_of(problem.lanes)):
            row = problem.block_row[block]
            if problem.block_kind[block] == ROLLING and problem.scale[row] > 0.0:
                square = rolling_residual(problem, block, row, x, ax, friction_law, shift)
                worst = wp.max(worst, square)
                # A NaN or infinity stays, whatever max() does with it.
                poison += 0.0 * square
        worst = greatest_over_lanes(problem.lanes, worst)
        poison = sum_over_lanes(problem.lanes, poison)
        meet(problem.lanes)
    return wp.sqrt(worst) + poison
