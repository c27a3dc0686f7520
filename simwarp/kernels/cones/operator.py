"""Operations on a problem shared by all solvers: products with S, block scales, the residual, De Saxcé's shift.

The residual of a block is that of the natural map, g |gamma - Pi(gamma - u / g)| with g the mean diagonal of the block:
a velocity [m/s or rad/s]. Blocks that nothing moves (zero diagonal) keep the projection of zero and have no residual.
"""

import warp as wp

from simwarp.kernels.cones.problem import (
    BOX,
    CONTACT,
    EXACT,
    R_EFF,
    WEIGHT,
    ConeProblem,
)
from simwarp.kernels.cones.projection import joint_projection_normal, project_contact, shortened, slopes_of

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
    const int pitch = s.strides[0] / sizeof(float);
    const float* __restrict__ m = s.data;
    const float* __restrict__ x = vectors.data + source * (vectors.strides[0] / sizeof(float));
    float* __restrict__ out = vectors.data + target * (vectors.strides[0] / sizeof(float));
    int i = 0;
    float dot = 0.0f;
#ifndef __CUDA_ARCH__
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
    for (; i < n; ++i) {
        float a = 0.0f;
        for (int j = 0; j < n; ++j) a += m[j * pitch + i] * x[j];
        out[i] = a;
    }
    for (int k = 0; k < n; ++k) dot += x[k] * out[k];
    return dot;
""")
def multiply_dense(n: int, s: wp.array2d[float], vectors: wp.array2d[float], source: int, target: int) -> float:
    """vectors[target] <- s vectors[source] for a symmetric s: columns are walked as rows. Returns their product."""
    ...


@wp.func_native("""
    const int pitch = s.strides[0] / sizeof(float);
    const float* __restrict__ m = s.data;
    const float* __restrict__ x = vectors.data + source * (vectors.strides[0] / sizeof(float));
    float* __restrict__ out = vectors.data + target * (vectors.strides[0] / sizeof(float));
    int i = 0;
#ifndef __CUDA_ARCH__
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
    for (; i < n; ++i) {
        double a = 0.0;
        for (int j = 0; j < n; ++j) a += (double)m[j * pitch + i] * x[j];
        out[i] = (float)a;
    }
""")
def multiply_dense_wide(n: int, s: wp.array2d[float], vectors: wp.array2d[float], source: int, target: int):
    """As `multiply_dense`, summed in double precision: impulses of 100 N·s cancel to velocities of 1e-5 m/s."""
    ...


@wp.func_native("""
    const int pitch = s.strides[0] / sizeof(float);
    const float* __restrict__ m = s.data;
    const double* __restrict__ x = wide.data + source * (wide.strides[0] / sizeof(double));
    double* __restrict__ out = wide.data + target * (wide.strides[0] / sizeof(double));
    for (int i = 0; i < n; ++i) out[i] = 0.0;
    for (int j = 0; j < n; ++j) {
        const float* __restrict__ row = m + j * pitch;
        const double xj = x[j];
#pragma clang loop vectorize_width(4) interleave_count(2)
        for (int i = 0; i < n; ++i) out[i] += (double)row[i] * xj;
    }
""")
def multiply_wide(n: int, s: wp.array2d[float], wide: wp.array2d[wp.float64], source: int, target: int):
    """wide[target] <- s wide[source] for a symmetric s."""
    ...


@wp.func
def multiply_free(problem: ConeProblem, source: int, target: int) -> float:
    """vectors[target] <- (Y Y^T - W W^T + compliance) vectors[source]. Returns their product."""
    for tree_dof in range(problem.tree_dof_count):
        problem.tree_dof_sum[tree_dof] = 0.0
    for k in range(problem.loop_count):
        problem.loop_sum[k] = 0.0
    for block in range(problem.block_count):
        for row in range(problem.block_row[block], problem.block_row[block + 1]):
            add_row(problem, block, row, problem.vectors[source, row])
    dot = float(0.0)
    for block in range(problem.block_count):
        for row in range(problem.block_row[block], problem.block_row[block + 1]):
            value = problem.vectors[source, row]
            total = problem.compliance[row] * value + row_sum(problem, block, row)
            problem.vectors[target, row] = total
            dot += total * value
    return dot


@wp.func
def add_row(problem: ConeProblem, block: int, row: int, value: float):
    """tree_dof_sum, loop_sum <- with `value` more in one row: Y^T gamma and W^T gamma kept up to date."""
    for e in range(problem.block_entries[block]):
        problem.tree_dof_sum[problem.block_tree_dof[block, e]] += problem.y[row, e] * value
    for k in range(problem.loop_count):
        problem.loop_sum[k] += problem.w[row, k] * value


@wp.func
def row_sum(problem: ConeProblem, block: int, row: int) -> float:
    """(Y Y^T - W W^T) gamma of one row, from tree_dof_sum and loop_sum."""
    total = float(0.0)
    for e in range(problem.block_entries[block]):
        total += problem.y[row, e] * problem.tree_dof_sum[problem.block_tree_dof[block, e]]
    for k in range(problem.loop_count):
        total -= problem.w[row, k] * problem.loop_sum[k]
    return total


@wp.func
def multiply(problem: ConeProblem, source: int, target: int) -> float:
    """vectors[target] <- S vectors[source]; source and target differ. Returns the product of the two."""
    if problem.dense == 1:
        return multiply_dense(problem.row_count, problem.s, problem.vectors, source, target)
    return multiply_free(problem, source, target)


@wp.func
def refresh(problem: ConeProblem, source: int, target: int):
    """As `multiply`, without the rounding of long sums where S is dense."""
    if problem.dense == 1:
        multiply_dense_wide(problem.row_count, problem.s, problem.vectors, source, target)
    else:
        multiply_free(problem, source, target)


@wp.func
def set_scales(problem: ConeProblem):
    """WEIGHT <- greatest diagonal of the row's block, scale <- its inverse (0 where nothing moves), R_EFF <- r."""
    top = float(0.0)
    for row in range(problem.row_count):
        top = wp.max(top, problem.diagonal[row])
        problem.vectors[R_EFF, row] = problem.r[row]
    least = 1.0e-12 * top
    for block in range(problem.block_count):
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


@wp.func
def start_from_gamma(problem: ConeProblem, target: int):
    """vectors[target] <- the warm start, zero in blocks that nothing moves."""
    for row in range(problem.row_count):
        start = float(0.0)
        if problem.scale[row] > 0.0:
            start = problem.gamma[row]
        problem.vectors[target, row] = start


@wp.func
def sliding(t1: float, t2: float, bound: float) -> float:
    """1 where a tangential impulse is at its bound, else 0: what sticks has no sliding speed in the end, and that of
    the iterates is noise, which De Saxcé's term would carry into the normal rows (ten times the iterations of a stack).
    """
    return wp.where(t1 * t1 + t2 * t2 < 0.99 * bound * bound, 0.0, 1.0)


@wp.func
def contact_residual(
    problem: ConeProblem, block: int, row: int, x: int, ax: int, friction_law: int, shift: int
) -> float:
    """Squared residual of a CONTACT block; with `shift`, De Saxcé's term at these velocities goes to R_EFF."""
    un = problem.vectors[ax, row] + problem.r[row]
    u1 = problem.vectors[ax, row + 1] + problem.r[row + 1]
    u2 = problem.vectors[ax, row + 2] + problem.r[row + 2]
    friction = problem.friction[block]
    if friction_law == EXACT:
        term = friction * wp.sqrt(u1 * u1 + u2 * u2)
        un += term
        if shift == 1:
            slide = sliding(
                problem.vectors[x, row + 1], problem.vectors[x, row + 2],
                friction * (problem.vectors[x, row] + problem.cohesion[block]),
            )  # fmt: skip
            problem.vectors[R_EFF, row] = problem.r[row] + slide * term
    mean = (problem.diagonal[row] + problem.diagonal[row + 1] + problem.diagonal[row + 2]) * (1.0 / 3.0)
    gamma = wp.vec3(problem.vectors[x, row], problem.vectors[x, row + 1], problem.vectors[x, row + 2])
    inverse = 1.0 / mean
    moved = wp.vec3(gamma[0] - un * inverse, gamma[1] - u1 * inverse, gamma[2] - u2 * inverse)
    gap = gamma - project_contact(moved, friction, problem.cohesion[block])
    return mean * mean * wp.dot(gap, gap)


@wp.func
def rolling_residual(
    problem: ConeProblem, block: int, row: int, x: int, ax: int, friction_law: int, shift: int
) -> float:
    """Squared residual of a ROLLING block, as `contact_residual`."""
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
    worst = float(0.0)
    poison = float(0.0)
    for block in range(problem.block_count):
        row = problem.block_row[block]
        kind = problem.block_kind[block]
        if problem.scale[row] > 0.0:
            square = float(0.0)
            if kind == CONTACT:
                square = contact_residual(problem, block, row, x, ax, friction_law, shift)
            elif kind == BOX:
                diagonal = problem.diagonal[row]
                gamma = problem.vectors[x, row]
                moved = gamma - (problem.vectors[ax, row] + problem.r[row]) / diagonal
                gap = diagonal * (gamma - wp.clamp(moved, problem.lower[row], problem.upper[row]))
                square = gap * gap
            else:
                square = rolling_residual(problem, block, row, x, ax, friction_law, shift)
            worst = wp.max(worst, square)
            # A NaN or infinity stays, whatever max() does with it.
            poison += 0.0 * square
    return wp.sqrt(worst) + poison
