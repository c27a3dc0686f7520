"""Dense linear algebra of the bilateral rows: N = Y Y^T + C, its Cholesky factor with guarded pivots, its solves.

Written natively, since the loops of a kernel index arrays element by element: here rows are contiguous, padded to whole
blocks of `BLOCK` numbers, and compile to vector code (measured on 30 rows: 14 us for assembly and factor before, 3 us
now). What lies right of a row's diagonal inside its last block is scratch.
"""

import warp as wp

from simwarp.kernels.core.tables import Topology, Work

wp.set_module_options({"enable_backward": False})

BLOCK = 8


def padded(count: int) -> int:
    """The next multiple of `BLOCK`."""
    return (count + BLOCK - 1) // BLOCK * BLOCK


_LANES = """
#ifndef __CUDA_ARCH__
    typedef float lanes8 __attribute__((ext_vector_type(8), aligned(4)));
#endif
"""


@wp.func_native(
    _LANES
    + """
    const int pitch = n.strides[0] / (int)sizeof(float);
    const int tree_dofs_pitch = y.strides[0] / (int)sizeof(float);
    float* __restrict__ a = n.data;
    float* __restrict__ t = y_t.data;
    for (int k = 0; k < tree_dofs * pitch; ++k)
        t[k] = 0.0f;
    for (int r = 0; r < count; ++r)
        for (int e = path.data[r]; e < path.data[r + 1]; ++e)
            t[tree_dof.data[e] * pitch + r] = y.data[r * tree_dofs_pitch + tree_dof.data[e]];
    for (int r = 0; r < count; ++r) {
        float* __restrict__ row = a + r * pitch;
        const float* __restrict__ mine = y.data + r * tree_dofs_pitch;
#ifndef __CUDA_ARCH__
        int k = 0;
        for (; k + 8 <= r; k += 16) {
            lanes8 low = 0.0f, high = 0.0f;
            for (int e = path.data[r]; e < path.data[r + 1]; ++e) {
                const int dof = tree_dof.data[e];
                const float* __restrict__ other = t + dof * pitch + k;
                low += *(const lanes8*)other * mine[dof];
                high += *(const lanes8*)(other + 8) * mine[dof];
            }
            *(lanes8*)(row + k) = low;
            *(lanes8*)(row + k + 8) = high;
        }
        if (k <= r) {
            lanes8 low = 0.0f;
            for (int e = path.data[r]; e < path.data[r + 1]; ++e) {
                const int dof = tree_dof.data[e];
                low += *(const lanes8*)(t + dof * pitch + k) * mine[dof];
            }
            *(lanes8*)(row + k) = low;
        }
#else
        for (int k = 0; k <= r; ++k) {
            float total = 0.0f;
            for (int e = path.data[r]; e < path.data[r + 1]; ++e)
                total += t[tree_dof.data[e] * pitch + k] * mine[tree_dof.data[e]];
            row[k] = total;
        }
#endif
        row[r] += compliance.data[r];
        if (row[r] > scale.data[r])
            scale.data[r] = row[r];
    }
"""
)
def assemble(
    count: int, tree_dofs: int, path: wp.array[int], tree_dof: wp.array[int], y: wp.array2d[float],
    compliance: wp.array[float], y_t: wp.array2d[float], n: wp.array2d[float], scale: wp.array[float],
):  # fmt: skip
    """N <- lower triangle of Y Y^T + C; `scale` grows to its diagonal at least. `y_t` keeps the columns of Y."""
    ...


@wp.func_native(
    _LANES
    + """
    const int pitch = n.strides[0] / (int)sizeof(float);
    float* __restrict__ a = n.data;
    float* __restrict__ t = work.data;
    for (int k = 0; k < pitch; ++k)
        t[k] = 0.0f;
    for (int c = 0; c < count; ++c) {
        const float pivot = a[c * pitch + c];
        const float inverse = pivot > tolerance * scale.data[c] ? 1.0f / sqrtf(pivot) : 0.0f;
        inverse_pivot.data[c] = inverse;
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
            float* __restrict__ row = a + r * pitch;
#ifndef __CUDA_ARCH__
            for (int k = (c + 1) & ~7; k <= r; k += 8)
                *(lanes8*)(row + k) -= *(const lanes8*)(t + k) * f;
#else
            for (int k = c + 1; k <= r; ++k)
                row[k] -= f * t[k];
#endif
        }
    }
"""
)
def factor(
    count: int, tolerance: float, scale: wp.array[float], n: wp.array2d[float], inverse_pivot: wp.array[float],
    work: wp.array[float],
):  # fmt: skip
    """N <- its Cholesky factor, column by column to the right; inverse pivots of redundant rows are zero."""
    ...


@wp.func_native("""
    const int pitch = n.strides[0] / (int)sizeof(float);
    float* __restrict__ v = x.data;
    for (int r = 0; r < count; ++r) {
        const float* __restrict__ row = n.data + r * pitch;
        float part[8] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
        int k = 0;
        for (; k + 8 <= r; k += 8)
            for (int j = 0; j < 8; ++j)
                part[j] += row[k + j] * v[k + j];
        float total = v[r] - ((part[0] + part[4]) + (part[1] + part[5])) - ((part[2] + part[6]) + (part[3] + part[7]));
        for (; k < r; ++k)
            total -= row[k] * v[k];
        v[r] = total * inverse_pivot.data[r];
    }
""")
def forward(count: int, n: wp.array2d[float], inverse_pivot: wp.array[float], x: wp.array[float]):
    """X <- L^-1 x."""
    ...


@wp.func_native("""
    const int pitch = n.strides[0] / (int)sizeof(float);
    float* __restrict__ v = x.data;
    for (int r = count - 1; r >= 0; --r) {
        const float* __restrict__ row = n.data + r * pitch;
        const float value = v[r] * inverse_pivot.data[r];
        v[r] = value;
        int k = 0;
        for (; k + 8 <= r; k += 8)
            for (int j = 0; j < 8; ++j)
                v[k + j] -= row[k + j] * value;
        for (; k < r; ++k)
            v[k] -= row[k] * value;
    }
""")
def backward(count: int, n: wp.array2d[float], inverse_pivot: wp.array[float], x: wp.array[float]):
    """X <- L^-T x."""
    ...


@wp.func
def factor_rows(topology: Topology, pivot_tolerance: float, work: Work):
    """N <- Cholesky factor of Y Y^T + C; a row whose pivot falls below the tolerance times its scale is set aside: it
    takes no impulse (inverse pivot zero).
    """
    count = topology.row_count
    assemble(
        count, topology.tree_dof_count, topology.row_path, topology.path_tree_dof, work.y, work.row_compliance,
        work.y_t, work.n, work.row_scale,
    )  # fmt: skip
    factor(count, pivot_tolerance, work.row_scale, work.n, work.inv_pivot, work.row_t)


@wp.func
def solve_rows_forward(topology: Topology, work: Work):
    """row_r <- L^-1 row_r, zero where a pivot was set aside."""
    forward(topology.row_count, work.n, work.inv_pivot, work.row_r)


@wp.func
def solve_rows_backward(topology: Topology, work: Work):
    """row_r <- L^-T row_r."""
    backward(topology.row_count, work.n, work.inv_pivot, work.row_r)


@wp.func
def solve_rows(topology: Topology, work: Work):
    """row_r <- (N + C)^-1 row_r by the guarded factor."""
    solve_rows_forward(topology, work)
    solve_rows_backward(topology, work)
