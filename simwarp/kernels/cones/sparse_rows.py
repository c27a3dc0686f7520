"""Native loops over the rows of the cone problem, kept as a few entries each: y[row, e] at block_tree_dof[block, e].

All rows of a block have their entries at the same tree degrees of freedom, so that a contact's three rows share each
place that they read or write. Written natively, since the loops of a kernel index arrays element by element; on a GPU
the same text is plain C++.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

GROUP = 4
"""Rows side by side in `spread`: the three of a contact, and one more to fill a vector register."""

_LANES = """
#ifndef __CUDA_ARCH__
    typedef float lanes4 __attribute__((ext_vector_type(4), aligned(4)));
#endif
"""


@wp.func_native(
    _LANES
    + """
    const int width = y.strides[0] / (int)sizeof(float);
    const int places = tree_dof.strides[0] / (int)sizeof(int);
    const float* __restrict__ v = x.data;
    float* __restrict__ t = sums.data;
    for (int b = 0; b < blocks; ++b) {
        const int* __restrict__ at = tree_dof.data + (size_t)b * places;
        const int count = entries.data[b], end = block_row.data[b + 1];
        for (int r = block_row.data[b]; r < end;) {
            const float* __restrict__ y0 = y.data + (size_t)r * width;
            if (r + 3 > end) {
                for (int e = 0; e < count; ++e) t[at[e]] += y0[e] * v[r];
                r += 1;
                continue;
            }
            const float* __restrict__ y1 = y0 + width;
            const float* __restrict__ y2 = y1 + width;
            const float x0 = v[r], x1 = v[r + 1], x2 = v[r + 2];
            r += 3;
            if (x0 == 0.0f && x1 == 0.0f && x2 == 0.0f) continue;
            int e = 0;
#ifndef __CUDA_ARCH__
            for (; e + 4 <= count; e += 4) {
                const lanes4 a = *(const lanes4*)(y0 + e) * x0 + *(const lanes4*)(y1 + e) * x1
                    + *(const lanes4*)(y2 + e) * x2;
                for (int i = 0; i < 4; ++i) t[at[e + i]] += a[i];
            }
#endif
            for (; e < count; ++e) t[at[e]] += y0[e] * x0 + y1[e] * x1 + y2[e] * x2;
        }
    }
"""
)
def add_rows(
    blocks: int, block_row: wp.array[int], entries: wp.array[int], tree_dof: wp.array2d[int], y: wp.array2d[float],
    x: wp.array[float], sums: wp.array[float],
):  # fmt: skip
    """Adds Y^T x to `sums`. An x of zeros, as of an open contact, costs next to nothing."""
    ...


@wp.func_native(
    _LANES
    + """
    const int width = y.strides[0] / (int)sizeof(float);
    const int places = tree_dof.strides[0] / (int)sizeof(int);
    const float* __restrict__ t = sums.data;
    const float* __restrict__ v = x.data;
    float* __restrict__ out = ax.data;
    float dot = 0.0f;
    for (int b = 0; b < blocks; ++b) {
        const int* __restrict__ at = tree_dof.data + (size_t)b * places;
        const int count = entries.data[b], end = block_row.data[b + 1];
        for (int r = block_row.data[b]; r < end;) {
            const float* __restrict__ y0 = y.data + (size_t)r * width;
            float a0 = 0.0f, a1 = 0.0f, a2 = 0.0f;
            if (r + 3 > end) {
                for (int e = 0; e < count; ++e) a0 += y0[e] * t[at[e]];
                out[r] = compliance.data[r] * v[r] + a0;
                dot += out[r] * v[r];
                r += 1;
                continue;
            }
            const float* __restrict__ y1 = y0 + width;
            const float* __restrict__ y2 = y1 + width;
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
            out[r] = compliance.data[r] * v[r] + a0;
            out[r + 1] = compliance.data[r + 1] * v[r + 1] + a1;
            out[r + 2] = compliance.data[r + 2] * v[r + 2] + a2;
            dot += out[r] * v[r] + out[r + 1] * v[r + 1] + out[r + 2] * v[r + 2];
            r += 3;
        }
    }
    return dot;
"""
)
def sum_rows(
    blocks: int, block_row: wp.array[int], entries: wp.array[int], tree_dof: wp.array2d[int], y: wp.array2d[float],
    compliance: wp.array[float], sums: wp.array[float], x: wp.array[float], ax: wp.array[float],
) -> float:  # fmt: skip
    """Sets ax = Y sums + diag(compliance) x; returns x . ax."""
    ...


_DOT = """
    auto dot = [](const float* __restrict__ a, const float* __restrict__ b, int n) {
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


@wp.func_native(
    _DOT
    + """
    const int width = w.strides[0] / (int)sizeof(float);
    const float* __restrict__ v = x.data;
    float* __restrict__ out = ax.data;
    for (int k = 0; k < loops; ++k) sums.data[k] = 0.0f;
    for (int b = 0; b < blocks; ++b) {
        const int* __restrict__ seen = block_loops.data + (size_t)b * 4;
        const int near = seen[1], far = seen[3];
        float* __restrict__ l = sums.data + seen[0];
        float* m = sums.data + seen[2];
        if (near == 0) continue;
        for (int r = block_row.data[b]; r < block_row.data[b + 1]; ++r) {
            const float* __restrict__ row = w.data + (size_t)r * width;
            const float f = v[r];
            if (f == 0.0f) continue;
#pragma clang loop vectorize_width(4) interleave_count(2)
            for (int k = 0; k < near; ++k) l[k] += row[k] * f;
#ifdef __CUDA_ARCH__
#pragma unroll 1
#endif
            for (int k = 0; k < far; ++k) m[k] += row[near + k] * f;
        }
    }
    float change = 0.0f;
    for (int b = 0; b < blocks; ++b) {
        const int* __restrict__ seen = block_loops.data + (size_t)b * 4;
        const int near = seen[1], far = seen[3];
        if (near == 0) continue;
        for (int r = block_row.data[b]; r < block_row.data[b + 1]; ++r) {
            const float* __restrict__ row = w.data + (size_t)r * width;
            float total = dot(row, sums.data + seen[0], near);
            if (far > 0) total += dot(row + near, sums.data + seen[2], far);
            out[r] -= total;
            change += total * v[r];
        }
    }
    return change;
"""
)
def subtract_loops(
    blocks: int, loops: int, block_row: wp.array[int], block_loops: wp.array2d[int], w: wp.array2d[float],
    x: wp.array[float], sums: wp.array[float], ax: wp.array[float],
) -> float:  # fmt: skip
    """Takes W W^T x from ax, with W^T x left in `sums`; returns what x . ax loses."""
    ...


@wp.func_native(
    _LANES
    + """
    const int width = y.strides[0] / (int)sizeof(float);
    const int places = tree_dof.strides[0] / (int)sizeof(int);
    const int pitch = s.strides[0] / (int)sizeof(float);
    const float* __restrict__ values = y.data;
    float* __restrict__ t = spread.data;
    float* __restrict__ out = s.data;
    for (int k = 0; k < 4 * tree_dofs; ++k) t[k] = 0.0f;
    for (int b = 0; b < blocks; ++b) {
        const int* __restrict__ mine = tree_dof.data + (size_t)b * places;
        const int own = entries.data[b], end = block_row.data[b + 1];
        for (int r = block_row.data[b]; r < end; r += 3) {
            const int group = end - r < 3 ? end - r : 3;
            for (int e = 0; e < own; ++e)
                for (int i = 0; i < group; ++i) t[4 * mine[e] + i] = values[(size_t)(r + i) * width + e];
            for (int other = 0; other <= b; ++other) {
                const int* __restrict__ at = tree_dof.data + (size_t)other * places;
                const int count = entries.data[other], last = block_row.data[other + 1];
                for (int c = block_row.data[other]; c < last; ++c) {
                    const float* __restrict__ row = values + (size_t)c * width;
#ifndef __CUDA_ARCH__
                    lanes4 even = 0.0f, odd = 0.0f;
                    int e = 0;
                    for (; e + 2 <= count; e += 2) {
                        even += *(const lanes4*)(t + 4 * at[e]) * row[e];
                        odd += *(const lanes4*)(t + 4 * at[e + 1]) * row[e + 1];
                    }
                    if (e < count) even += *(const lanes4*)(t + 4 * at[e]) * row[e];
                    const lanes4 total = even + odd;
#else
                    float total[3] = {0.0f, 0.0f, 0.0f};
                    for (int e = 0; e < count; ++e)
                        for (int i = 0; i < 3; ++i) total[i] += t[4 * at[e] + i] * row[e];
#endif
                    for (int i = 0; i < group; ++i) {
                        out[(size_t)(r + i) * pitch + c] = total[i];
                        out[(size_t)c * pitch + r + i] = total[i];
                    }
                }
            }
            for (int e = 0; e < own; ++e)
                for (int i = 0; i < group; ++i) t[4 * mine[e] + i] = 0.0f;
        }
    }
"""
)
def form_gram(
    blocks: int, tree_dofs: int, block_row: wp.array[int], entries: wp.array[int], tree_dof: wp.array2d[int],
    y: wp.array2d[float], spread: wp.array2d[float], s: wp.array2d[float],
):  # fmt: skip
    """Sets S = Y Y^T, exactly symmetric. `spread` holds up to three rows of one block, spread over the tree."""
    ...


@wp.func_native(
    _DOT
    + """
    const int width = w.strides[0] / (int)sizeof(float);
    const int pitch = s.strides[0] / (int)sizeof(float);
    float* __restrict__ out = s.data;
    for (int b = 0; b < blocks; ++b) {
        const int* __restrict__ mine = block_loops.data + (size_t)b * 4;
        for (int other = 0; other <= b && mine[1] > 0; ++other) {
            const int* __restrict__ seen = block_loops.data + (size_t)other * 4;
            int from[2], to[2], length[2], shared = 0;  // columns of the loop rows that both see
            for (int i = 0; i < 4; i += 2)
                for (int j = 0; j < 4; j += 2)
                    if (mine[i + 1] > 0 && seen[j + 1] > 0 && mine[i] == seen[j]) {
                        from[shared] = i == 0 ? 0 : mine[1];
                        to[shared] = j == 0 ? 0 : seen[1];
                        length[shared++] = mine[i + 1];
                    }
            if (shared == 0) continue;
            for (int r = block_row.data[b]; r < block_row.data[b + 1]; ++r) {
                const float* __restrict__ a = w.data + (size_t)r * width;
                for (int c = block_row.data[other]; c < block_row.data[other + 1] && c <= r; ++c) {
                    const float* __restrict__ at = w.data + (size_t)c * width;
                    float total = dot(a + from[0], at + to[0], length[0]);
                    if (shared > 1) total += dot(a + from[1], at + to[1], length[1]);
                    total = out[(size_t)r * pitch + c] - total;
                    out[(size_t)r * pitch + c] = total;
                    out[(size_t)c * pitch + r] = total;
                }
            }
        }
    }
    for (int r = 0; r < block_row.data[blocks]; ++r) out[(size_t)r * pitch + r] += compliance.data[r];
"""
)
def finish_gram(
    blocks: int, block_row: wp.array[int], block_loops: wp.array2d[int], w: wp.array2d[float],
    compliance: wp.array[float], s: wp.array2d[float],
):  # fmt: skip
    """Takes W W^T from S and adds diag(compliance)."""
    ...
