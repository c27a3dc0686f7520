"""Dense linear algebra of the bilateral rows: N = Y Y^T + C, its Cholesky factor with guarded pivots, its solves.

Rows of different groups have nothing in common (`simwarp/model/row_groups.py`): N is formed, factorised and kept group
by group, each as a square of its own.

Written natively, since the loops of a kernel index arrays element by element: here rows are contiguous, padded to whole
blocks of `BLOCK` numbers, and compile to vector code (measured on 30 rows: 14 us for assembly and factor before, 3 us
now). What lies right of a row's diagonal inside its last block is scratch.
"""

import warp as wp

from simwarp.kernels.core.native_views import VIEWS
from simwarp.kernels.core.tables import Topology, Work

wp.set_module_options({"enable_backward": False})

BLOCK = 8


def padded(count: int) -> int:
    """The next multiple of `BLOCK`."""
    return (count + BLOCK - 1) // BLOCK * BLOCK


_LANES = (
    VIEWS
    + """
#ifndef __CUDA_ARCH__
    typedef float lanes8 __attribute__((ext_vector_type(8), aligned(4)));
#endif
"""
)


@wp.func_native(
    _LANES
    + """
    const int pitch = (count + 7) / 8 * 8;
    const Ints entries = elements(path) + first, dofs = elements(column);
    const Floats a = elements(n) + start, t = elements(y_t);
    const Floats soft = elements(compliance) + first, scales = elements(scale) + first;
    for (int k = 0; k < columns * pitch; ++k)
        t[k] = 0.0f;
    for (int r = 0; r < count; ++r)
        for (int e = entries[r]; e < entries[r + 1]; ++e)
            t[dofs[e] * pitch + r] = row(y, first + r)[dofs[e]];
    for (int r = 0; r < count; ++r) {
        const Floats own = a + r * pitch, mine = row(y, first + r);
#ifndef __CUDA_ARCH__
        int k = 0;
        for (; k + 8 <= r; k += 16) {
            lanes8 low = 0.0f, high = 0.0f;
            for (int e = entries[r]; e < entries[r + 1]; ++e) {
                const int dof = dofs[e];
                const float* __restrict__ other = t + dof * pitch + k;
                low += *(const lanes8*)other * mine[dof];
                high += *(const lanes8*)(other + 8) * mine[dof];
            }
            *(lanes8*)(own + k) = low;
            *(lanes8*)(own + k + 8) = high;
        }
        if (k <= r) {
            lanes8 low = 0.0f;
            for (int e = entries[r]; e < entries[r + 1]; ++e) {
                const int dof = dofs[e];
                low += *(const lanes8*)(t + dof * pitch + k) * mine[dof];
            }
            *(lanes8*)(own + k) = low;
        }
#else
        for (int k = 0; k <= r; ++k) {
            float total = 0.0f;
            for (int e = entries[r]; e < entries[r + 1]; ++e)
                total += t[dofs[e] * pitch + k] * mine[dofs[e]];
            own[k] = total;
        }
#endif
        own[r] += soft[r];
        if (own[r] > scales[r])
            scales[r] = own[r];
    }
"""
)
def assemble(
    first: int, count: int, start: int, columns: int, path: wp.array[int], column: wp.array[int], y: wp.array2d[float],
    compliance: wp.array[float], y_t: wp.array[float], n: wp.array[float], scale: wp.array[float],
):  # fmt: skip
    """N <- lower triangle of Y Y^T + C of the `count` rows from `first` on, at place `start`; `scale` grows to its
    diagonal at least. `y_t` keeps the columns of Y.
    """
    ...


@wp.func_native(
    _LANES
    + """
    const int pitch = (count + 7) / 8 * 8;
    const Floats a = elements(n) + start, t = elements(work);
    const Floats scales = elements(scale) + first, inverses = elements(inverse_pivot) + first;
    for (int k = 0; k < pitch; ++k)
        t[k] = 0.0f;
    for (int c = 0; c < count; ++c) {
        const float pivot = a[c * pitch + c];
        const float inverse = pivot > tolerance * scales[c] ? 1.0f / sqrtf(pivot) : 0.0f;
        inverses[c] = inverse;
        t[c] = 0.0f;
        for (int r = c + 1; r < count; ++r) {
            const float f = a[r * pitch + c] * inverse;
            a[r * pitch + c] = f;
            t[r] = f;
        }
        for (int r = c + 1; r < count; ++r) {
            const float f = t[r];
            if (f == 0.0f)
                continue;
            const Floats own = a + r * pitch;
#ifndef __CUDA_ARCH__
            for (int k = (c + 1) & ~7; k <= r; k += 8)
                *(lanes8*)(own + k) -= *(const lanes8*)(t + k) * f;
#else
            for (int k = c + 1; k <= r; ++k)
                own[k] -= f * t[k];
#endif
        }
    }
"""
)
def factor(
    first: int, count: int, start: int, tolerance: float, scale: wp.array[float], n: wp.array[float],
    inverse_pivot: wp.array[float], work: wp.array[float],
):  # fmt: skip
    """N <- its Cholesky factor, column by column to the right; inverse pivots of redundant rows are zero."""
    ...


@wp.func_native(
    VIEWS
    + """
    const int pitch = (count + 7) / 8 * 8;
    const Floats a = elements(n) + start, inverse = elements(inverse_pivot) + first, v = elements(x) + first;
    for (int r = 0; r < count; ++r) {
        const Floats own = a + r * pitch;
        float part[8] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
        int k = 0;
        for (; k + 8 <= r; k += 8)
            for (int j = 0; j < 8; ++j)
                part[j] += own[k + j] * v[k + j];
        float total = v[r] - ((part[0] + part[4]) + (part[1] + part[5])) - ((part[2] + part[6]) + (part[3] + part[7]));
        for (; k < r; ++k)
            total -= own[k] * v[k];
        v[r] = total * inverse[r];
    }
"""
)
def forward(first: int, count: int, start: int, n: wp.array[float], inverse_pivot: wp.array[float], x: wp.array[float]):
    """X <- L^-1 x of one group's rows."""
    ...


@wp.func_native(
    VIEWS
    + """
    const int pitch = (count + 7) / 8 * 8;
    const Floats a = elements(n) + start, inverse = elements(inverse_pivot) + first, v = elements(x) + first;
    for (int r = count - 1; r >= 0; --r) {
        const Floats own = a + r * pitch;
        const float value = v[r] * inverse[r];
        v[r] = value;
        int k = 0;
        for (; k + 8 <= r; k += 8)
            for (int j = 0; j < 8; ++j)
                v[k + j] -= own[k + j] * value;
        for (; k < r; ++k)
            v[k] -= own[k] * value;
    }
"""
)
def backward(
    first: int, count: int, start: int, n: wp.array[float], inverse_pivot: wp.array[float], x: wp.array[float]
):
    """X <- L^-T x of one group's rows."""
    ...


@wp.func
def factor_rows(topology: Topology, pivot_tolerance: float, work: Work):
    """N <- Cholesky factor of Y Y^T + C, group by group; a row whose pivot falls below the tolerance times its scale
    is set aside: it takes no impulse (inverse pivot zero).
    """
    for group in range(topology.group_count):
        first = topology.group_row[group]
        count = topology.group_row[group + 1] - first
        start = topology.group_factor[group]
        assemble(
            first, count, start, topology.group_columns[group], topology.row_path, topology.path_column, work.y,
            work.row_compliance, work.y_t, work.n, work.row_scale,
        )  # fmt: skip
        factor(first, count, start, pivot_tolerance, work.row_scale, work.n, work.inv_pivot, work.row_t)


@wp.func
def solve_group_forward(group: int, topology: Topology, work: Work):
    """row_r <- L^-1 row_r of one group, zero where a pivot was set aside."""
    first = topology.group_row[group]
    count = topology.group_row[group + 1] - first
    forward(first, count, topology.group_factor[group], work.n, work.inv_pivot, work.row_r)


@wp.func
def solve_group_backward(group: int, topology: Topology, work: Work):
    """row_r <- L^-T row_r of one group."""
    first = topology.group_row[group]
    count = topology.group_row[group + 1] - first
    backward(first, count, topology.group_factor[group], work.n, work.inv_pivot, work.row_r)


@wp.func
def solve_group(group: int, topology: Topology, work: Work):
    """row_r <- (N + C)^-1 row_r of one group by the guarded factor."""
    solve_group_forward(group, topology, work)
    solve_group_backward(group, topology, work)


@wp.func
def solve_rows(topology: Topology, work: Work):
    """row_r <- (N + C)^-1 row_r of all groups."""
    for group in range(topology.group_count):
        solve_group(group, topology, work)
