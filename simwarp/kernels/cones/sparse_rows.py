"""Native loops over the rows of the cone problem, kept as a few entries each: y[row, e] at block_tree_dof[block, e].

All rows of a block have their entries at the same tree degrees of freedom, so that a contact's three rows share each
place that they read or write. Written natively, since the loops of a kernel index arrays element by element; on a GPU
the same text is plain C++.
"""

import warp as wp

from simwarp.kernels.core.lanes import LANES
from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})

GROUP = 4
"""Rows side by side in `spread`: the three of a contact, and one more to fill a vector register."""

_ROWS = (
    VIEWS
    + LANES
    + """
#ifndef __CUDA_ARCH__
    typedef float lanes4 __attribute__((ext_vector_type(4), aligned(4)));
#endif
"""
)


@wp.func_native(
    _ROWS
    + """
    const Floats v = elements(x), t = elements(sums);
    const Ints rows = elements(block_row), counts = elements(entries);
    for (int b = 0; b < blocks; ++b) {
        const Ints at = row(tree_dof, b);
        const int count = counts[b], end = rows[b + 1];
        for (int r = rows[b]; r < end;) {
            const Floats y0 = row(y, r);
            if (r + 3 > end) {
                ROLLED for (int e = lane; e < count; e += stride) t[at[e]] += y0[e] * v[r];
                r += 1;
                continue;
            }
            const Floats y1 = row(y, r + 1), y2 = row(y, r + 2);
            const float x0 = v[r], x1 = v[r + 1], x2 = v[r + 2];
            r += 3;
            if (x0 == 0.0f && x1 == 0.0f && x2 == 0.0f) continue;
            int e = lane;
#ifndef __CUDA_ARCH__
            for (; e + 4 <= count; e += 4) {
                const lanes4 a = *(const lanes4*)(y0 + e) * x0 + *(const lanes4*)(y1 + e) * x1
                    + *(const lanes4*)(y2 + e) * x2;
                for (int i = 0; i < 4; ++i) t[at[e + i]] += a[i];
            }
#endif
            ROLLED for (; e < count; e += stride) t[at[e]] += y0[e] * x0 + y1[e] * x1 + y2[e] * x2;
        }
        meet_lanes();  // the next block has other degrees of freedom in these places
    }
"""
)
def add_rows(
    blocks: int, block_row: wp.array[int], entries: wp.array[int], tree_dof: wp.array2d[int], y: wp.array2d[float],
    x: wp.array[float], sums: wp.array[float], lanes: int,
):  # fmt: skip
    """Adds Y^T x to `sums`. An x of zeros, as of an open contact, costs next to nothing."""
    ...


@wp.func_native(
    _ROWS
    + """
    const Floats t = elements(sums), v = elements(x), out = elements(ax), soft = elements(compliance);
    const Ints rows = elements(block_row), counts = elements(entries);
    float dot = 0.0f;
    ROLLED for (int b = lane; b < blocks; b += stride) {
        const Ints at = row(tree_dof, b);
        const int count = counts[b], end = rows[b + 1];
        for (int r = rows[b]; r < end;) {
            const Floats y0 = row(y, r);
            float a0 = 0.0f, a1 = 0.0f, a2 = 0.0f;
            if (r + 3 > end) {
                for (int e = 0; e < count; ++e) a0 += y0[e] * t[at[e]];
                out[r] = soft[r] * v[r] + a0;
                dot += out[r] * v[r];
                r += 1;
                continue;
            }
            const Floats y1 = row(y, r + 1), y2 = row(y, r + 2);
            int e = 0;
#ifndef __CUDA_ARCH__
            lanes4 s0 = 0.0f, s1 = 0.0f, s2 = 0.0f;
            for (; e + 4 <= count; e += 4) {
                const lanes4 g = {t[at[e]], t[at[e + 1]], t[at[e + 2]], t[at[e + 3]]};
                s0 += *(const lanes4*)(y0 + e) * g;
                s1 += *(const lanes4*)(y1 + e) * g;
                s2 += *(const lanes4*)(y2 + e) * g;
            }
            a0 = (s0[0] + s0[1]) + (s0[2] + s0[3]);
            a1 = (s1[0] + s1[1]) + (s1[2] + s1[3]);
            a2 = (s2[0] + s2[1]) + (s2[2] + s2[3]);
#endif
            for (; e < count; ++e) {
                const float g = t[at[e]];
                a0 += y0[e] * g;
                a1 += y1[e] * g;
                a2 += y2[e] * g;
            }
            out[r] = soft[r] * v[r] + a0;
            out[r + 1] = soft[r + 1] * v[r + 1] + a1;
            out[r + 2] = soft[r + 2] * v[r + 2] + a2;
            dot += out[r] * v[r] + out[r + 1] * v[r + 1] + out[r + 2] * v[r + 2];
            r += 3;
        }
    }
    dot = sum_of_lanes(dot);
    meet_lanes();
    return dot;
"""
)
def sum_rows(
    blocks: int, block_row: wp.array[int], entries: wp.array[int], tree_dof: wp.array2d[int], y: wp.array2d[float],
    compliance: wp.array[float], sums: wp.array[float], x: wp.array[float], ax: wp.array[float], lanes: int,
) -> float:  # fmt: skip
    """Sets ax = Y sums + diag(compliance) x; returns x . ax."""
    ...


_DOT = (
    VIEWS
    + LANES
    + """
    auto dot = [](const Floats a, const Floats b, int n) {
        float part[4] = {0.0f, 0.0f, 0.0f, 0.0f};
        int k = 0;
#ifdef __CUDA_ARCH__
#pragma unroll 1
#endif
        for (; k + 4 <= n; k += 4)
            for (int j = 0; j < 4; ++j) part[j] += a[k + j] * b[k + j];
        float total = (part[0] + part[1]) + (part[2] + part[3]);
#ifdef __CUDA_ARCH__
#pragma unroll 1
#endif
        for (; k < n; ++k) total += a[k] * b[k];
        return total;
    };
"""
)


@wp.func_native(
    _DOT
    + """
    const Floats v = elements(x), out = elements(ax), t = elements(sums);
    const Ints rows = elements(block_row);
    ROLLED for (int k = lane; k < loops; k += stride) t[k] = 0.0f;
    meet_lanes();
    for (int b = 0; b < blocks; ++b) {
        const Ints seen = row(block_loops, b);
        const int near = seen[1], far = seen[3];
        const Floats l = t + seen[0];
        const auto m = elements(sums) + seen[2];
        if (near == 0) continue;
        for (int r = rows[b]; r < rows[b + 1]; ++r) {
            const Floats mine = row(w, r);
            const float f = v[r];
            if (f == 0.0f) continue;
#pragma clang loop vectorize_width(4) interleave_count(2)
            ROLLED for (int k = lane; k < near; k += stride) l[k] += mine[k] * f;
#ifdef __CUDA_ARCH__
#pragma unroll 1
#endif
            ROLLED for (int k = lane; k < far; k += stride) m[k] += mine[near + k] * f;
        }
        meet_lanes();
    }
    float change = 0.0f;
    ROLLED for (int b = lane; b < blocks; b += stride) {
        const Ints seen = row(block_loops, b);
        const int near = seen[1], far = seen[3];
        if (near == 0) continue;
        for (int r = rows[b]; r < rows[b + 1]; ++r) {
            const Floats mine = row(w, r);
            float total = dot(mine, t + seen[0], near);
            if (far > 0) total += dot(mine + near, t + seen[2], far);
            out[r] -= total;
            change += total * v[r];
        }
    }
    change = sum_of_lanes(change);
    meet_lanes();
    return change;
"""
)
def subtract_loops(
    blocks: int, loops: int, block_row: wp.array[int], block_loops: wp.array2d[int], w: wp.array2d[float],
    x: wp.array[float], sums: wp.array[float], ax: wp.array[float], lanes: int,
) -> float:  # fmt: skip
    """Takes W W^T x from ax, with W^T x left in `sums`; returns what x . ax loses."""
    ...


@wp.func_native(
    _ROWS
    + """
    const Floats t = flat(spread);
    const Ints rows = elements(block_row), counts = elements(entries);
    ROLLED for (int k = lane; k < 4 * tree_dofs; k += stride) t[k] = 0.0f;
    meet_lanes();
    for (int b = 0; b < blocks; ++b) {
        const Ints mine = row(tree_dof, b);
        const int own = counts[b], end = rows[b + 1];
        for (int r = rows[b]; r < end; r += 3) {
            const int group = end - r < 3 ? end - r : 3;
            ROLLED for (int e = lane; e < own; e += stride)
                for (int i = 0; i < group; ++i) t[4 * mine[e] + i] = row(y, r + i)[e];
            meet_lanes();
            ROLLED for (int other = lane; other <= b; other += stride) {
                const Ints at = row(tree_dof, other);
                const int count = counts[other], last = rows[other + 1];
                for (int c = rows[other]; c < last; ++c) {
                    const Floats other_row = row(y, c);
#ifndef __CUDA_ARCH__
                    lanes4 even = 0.0f, odd = 0.0f;
                    int e = 0;
                    for (; e + 2 <= count; e += 2) {
                        even += *(const lanes4*)(t + 4 * at[e]) * other_row[e];
                        odd += *(const lanes4*)(t + 4 * at[e + 1]) * other_row[e + 1];
                    }
                    if (e < count) even += *(const lanes4*)(t + 4 * at[e]) * other_row[e];
                    const lanes4 total = even + odd;
#else
                    float total[3] = {0.0f, 0.0f, 0.0f};
                    for (int e = 0; e < count; ++e)
                        for (int i = 0; i < 3; ++i) total[i] += t[4 * at[e] + i] * other_row[e];
#endif
                    for (int i = 0; i < group; ++i) {
                        row(s, r + i)[c] = total[i];
                        row(s, c)[r + i] = total[i];
                    }
                }
            }
            meet_lanes();
            ROLLED for (int e = lane; e < own; e += stride)
                for (int i = 0; i < group; ++i) t[4 * mine[e] + i] = 0.0f;
            meet_lanes();
        }
    }
"""
)
def form_gram(
    blocks: int, tree_dofs: int, block_row: wp.array[int], entries: wp.array[int], tree_dof: wp.array2d[int],
    y: wp.array2d[float], spread: wp.array2d[float], s: wp.array2d[float], lanes: int,
):  # fmt: skip
    """Sets S = Y Y^T, exactly symmetric. `spread` holds up to three rows of one block, spread over the tree."""
    ...


@wp.func_native(
    _DOT
    + """
    const Ints rows = elements(block_row);
    const Floats soft = elements(compliance);
    for (int b = 0; b < blocks; ++b) {
        const Ints mine = row(block_loops, b);
        ROLLED for (int other = lane; other <= b && mine[1] > 0; other += stride) {
            const Ints seen = row(block_loops, other);
            int from[2], to[2], length[2], shared = 0;  // columns of the loop rows that both see
            for (int i = 0; i < 4; i += 2)
                for (int j = 0; j < 4; j += 2)
                    if (mine[i + 1] > 0 && seen[j + 1] > 0 && mine[i] == seen[j]) {
                        from[shared] = i == 0 ? 0 : mine[1];
                        to[shared] = j == 0 ? 0 : seen[1];
                        length[shared++] = mine[i + 1];
                    }
            if (shared == 0) continue;
            for (int r = rows[b]; r < rows[b + 1]; ++r) {
                const Floats a = row(w, r);
                for (int c = rows[other]; c < rows[other + 1] && c <= r; ++c) {
                    const Floats at = row(w, c);
                    float total = dot(a + from[0], at + to[0], length[0]);
                    if (shared > 1) total += dot(a + from[1], at + to[1], length[1]);
                    total = row(s, r)[c] - total;
                    row(s, r)[c] = total;
                    row(s, c)[r] = total;
                }
            }
        }
    }
    meet_lanes();
    ROLLED for (int r = lane; r < rows[blocks]; r += stride) row(s, r)[r] += soft[r];
    meet_lanes();
"""
)
def finish_gram(
    blocks: int, block_row: wp.array[int], block_loops: wp.array2d[int], w: wp.array2d[float],
    compliance: wp.array[float], s: wp.array2d[float], lanes: int,
):  # fmt: skip
    """Takes W W^T from S and adds diag(compliance)."""
    ...
