"""Device half of the factor of a mesh's stiffness matrix: A = L D Lᵀ by dense panels, and its substitutions.

A supernode's panel is stored column by column. The last rows of the panels, and all of the update matrices, are walked
eight at a time on a CPU. Where a pivot falls below a share of its diagonal it is replaced by that share.
"""

from typing import Any

import warp as wp

from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})

PIVOT_FLOOR = wp.constant(1e-6)

_SUPERNODE = """
        const Ints super = row(supernodes, s);
        const int first = 3 * super[0], blocks = super[1], width = 3 * blocks, below = 3 * super[2];
        const int pitch = super[5];
        const Numbers p = elements(panels) + super[3];
"""

_FACTOR = (
    """
    const Ints entry = elements(block_start), place = elements(block_panel), rows = elements(row_start);
    const Ints inner = elements(child_start), inners = elements(child), target = elements(place_in_parent);
    const Numbers value = elements(values), inverses = elements(inverse_pivots);
    const Numbers weight = elements(work), pivots = weight + 3 * widest;
    for (int s = 0; s < supernode_count; ++s) {"""
    + _SUPERNODE
    + """
        const int up = super[6];
        const Numbers u = elements(updates) + super[4];
        for (int k = 0; k < width * pitch; ++k)
            p[k] = 0;
        for (int k = 0; k < below * up; ++k)
            u[k] = 0;
        for (int e = entry[s]; e < entry[s + 1]; ++e) {
            const Numbers to = p + place[e], from = value + 9 * e;
            for (int c = 0; c < 3; ++c)
                for (int r = 0; r < 3; ++r)
                    to[c * pitch + r] = from[3 * c + r];
        }
        for (int c = 0; c < width; ++c)
            inverses[first + c] = p[c * pitch + c];
        for (int q = inner[s]; q < inner[s + 1]; ++q) {
            const Ints other = row(supernodes, inners[q]);
            const int count = other[2], step = other[6];
            const Numbers from = elements(updates) + other[4];
            const Ints to = target + rows[inners[q]];
            for (int j = 0; j < count; ++j) {
                const bool mine = to[j] < blocks;
                const int stride = mine ? pitch : up;
                const Numbers column = mine ? p + 3 * to[j] * pitch : u + (3 * (to[j] - blocks) * up - width);
                for (int i = j; i < count; ++i)
                    for (int c = 0; c < 3; ++c)
                        for (int r = 0; r < 3; ++r)
                            column[c * stride + 3 * to[i] + r] += from[(3 * j + c) * step + 3 * i + r];
            }
        }
        for (int c = 0; c < width; ++c) {
            const Numbers own = p + c * pitch;
            for (int k = 0; k < c; ++k)
                weight[k] = p[k * pitch + c] * pivots[k];
#ifndef __CUDA_ARCH__
            for (int r = c & ~7; r < pitch; r += 16) {
                const bool both = r + 8 < pitch;
                lanes8 low = *(const lanes8*)(own + r), high = *(const lanes8*)(own + r + (both ? 8 : 0));
                for (int k = 0; k < c; ++k) {
                    const real* __restrict__ other = p + k * pitch + r;
                    low -= *(const lanes8*)other * weight[k];
                    high -= *(const lanes8*)(other + (both ? 8 : 0)) * weight[k];
                }
                *(lanes8*)(own + r) = low;
                if (both)
                    *(lanes8*)(own + r + 8) = high;
            }
#else
            for (int r = c; r < width + below; ++r) {
                real total = own[r];
                for (int k = 0; k < c; ++k)
                    total -= p[k * pitch + r] * weight[k];
                own[r] = total;
            }
#endif
            const real least = (real)floor_share * inverses[first + c];
            const real pivot = own[c] > least ? own[c] : least;
            const real inverse = (real)1 / pivot;
            pivots[c] = pivot;
            inverses[first + c] = inverse;
            for (int r = c + 1; r < width + below; ++r)
                own[r] *= inverse;
        }
        for (int c = 0; c < below; c += 3) {
            const Numbers own = u + c * up, low_rows = p + width;
            for (int k = 0; k < width; ++k)
                for (int j = 0; j < 3; ++j)
                    weight[3 * k + j] = low_rows[k * pitch + c + j] * pivots[k];
#ifndef __CUDA_ARCH__
            int r = c & ~7;
            for (; r + 16 <= up; r += 16) {
                lanes8 a0 = 0, a1 = 0, b0 = 0, b1 = 0, c0 = 0, c1 = 0;
                for (int k = 0; k < width; ++k) {
                    const real* __restrict__ other = low_rows + k * pitch + r;
                    const lanes8 x = *(const lanes8*)other, y = *(const lanes8*)(other + 8);
                    const real f = weight[3 * k], g = weight[3 * k + 1], h = weight[3 * k + 2];
                    a0 += x * f; a1 += y * f;
                    b0 += x * g; b1 += y * g;
                    c0 += x * h; c1 += y * h;
                }
                *(lanes8*)(own + r) -= a0; *(lanes8*)(own + r + 8) -= a1;
                *(lanes8*)(own + up + r) -= b0; *(lanes8*)(own + up + r + 8) -= b1;
                *(lanes8*)(own + 2 * up + r) -= c0; *(lanes8*)(own + 2 * up + r + 8) -= c1;
            }
            if (r < up) {
                lanes8 a0 = 0, b0 = 0, c0 = 0;
                for (int k = 0; k < width; ++k) {
                    const lanes8 x = *(const lanes8*)(low_rows + k * pitch + r);
                    a0 += x * weight[3 * k]; b0 += x * weight[3 * k + 1]; c0 += x * weight[3 * k + 2];
                }
                *(lanes8*)(own + r) -= a0; *(lanes8*)(own + up + r) -= b0; *(lanes8*)(own + 2 * up + r) -= c0;
            }
#else
            for (int r = c; r < below; ++r) {
                real a0 = 0, b0 = 0, c0 = 0;
                for (int k = 0; k < width; ++k) {
                    const real x = low_rows[k * pitch + r];
                    a0 += x * weight[3 * k]; b0 += x * weight[3 * k + 1]; c0 += x * weight[3 * k + 2];
                }
                own[r] -= a0; own[up + r] -= b0; own[2 * up + r] -= c0;
            }
#endif
        }
    }
"""
)

_FORWARD = (
    """
    const Ints rows = elements(row_start), nodes = elements(row_node);
    const Numbers v = elements(x), local = elements(work);
    for (int s = 0; s < supernode_count; ++s) {"""
    + _SUPERNODE
    + """
        const Ints node = nodes + rows[s];
        for (int k = 0; k < width; ++k)
            local[k] = v[first + k];
        for (int k = width; k < pitch; ++k)
            local[k] = 0;
        for (int c = 0; c < width; ++c) {
            const Numbers own = p + c * pitch;
            const real value = local[c];
            for (int k = c + 1; k < width + below; ++k)
                local[k] -= own[k] * value;
        }
        for (int k = 0; k < width; ++k)
            v[first + k] = local[k];
        for (int i = 0; i < below / 3; ++i)
            for (int j = 0; j < 3; ++j)
                v[3 * node[i] + j] += local[width + 3 * i + j];
    }
"""
)

_BACKWARD = (
    """
    const Ints rows = elements(row_start), nodes = elements(row_node);
    const Numbers v = elements(x), local = elements(work), inverses = elements(inverse_pivots);
    for (int s = supernode_count - 1; s >= 0; --s) {"""
    + _SUPERNODE
    + """
        const Ints node = nodes + rows[s];
        for (int i = 0; i < below / 3; ++i)
            for (int j = 0; j < 3; ++j)
                local[width + 3 * i + j] = v[3 * node[i] + j];
        for (int k = width + below; k < pitch; ++k)
            local[k] = 0;
        for (int c = width - 1; c >= 0; --c) {
            const Numbers own = p + c * pitch;
            real total = 0;
            int k = c + 1;
#ifndef __CUDA_ARCH__
            lanes8 parts = 0;
            for (; k + 8 <= pitch; k += 8)
                parts += *(const lanes8*)(own + k) * *(const lanes8*)(local + k);
            total = ((parts[0] + parts[4]) + (parts[1] + parts[5])) + ((parts[2] + parts[6]) + (parts[3] + parts[7]));
#endif
            for (; k < width + below; ++k)
                total += own[k] * local[k];
            local[c] = v[first + c] * inverses[first + c] - total;
            v[first + c] = local[c];
        }
    }
"""
)


def _text(body: str, number: str) -> str:
    """Native text for one type of numbers."""
    views = {"float": "Floats", "double": "Doubles"}[number]
    lanes = f"""
    typedef {number} real;
    typedef {views} Numbers;
#ifndef __CUDA_ARCH__
    typedef real lanes8 __attribute__((ext_vector_type(8), aligned({4 if number == "float" else 8})));
#endif
"""
    return VIEWS + lanes + body


@wp.struct
class FactorTables:
    """A `FactorPlan` (mesh_factor.py) on a device."""

    supernode_count: int
    widest: int
    block_panel: wp.array[int]
    supernodes: wp.array2d[int]
    block_start: wp.array[int]
    row_start: wp.array[int]
    row: wp.array[int]
    target: wp.array[int]
    child_start: wp.array[int]
    child: wp.array[int]


# Overloads: Warp finds the first one by its name in this scope
for number, dtype in (("float", wp.float32), ("double", wp.float64)):

    @wp.func_native(_text(_FACTOR, number))
    def factor_panels(
        supernode_count: int, widest: int, floor_share: float, supernodes: wp.array2d[int],
        block_start: wp.array[int], block_panel: wp.array[int], row_start: wp.array[int],
        place_in_parent: wp.array[int], child_start: wp.array[int], child: wp.array[int],
        values: wp.array(dtype=dtype), panels: wp.array(dtype=dtype), updates: wp.array(dtype=dtype),
        inverse_pivots: wp.array(dtype=dtype), work: wp.array(dtype=dtype),
    ):  # fmt: skip
        """Panels and inverse pivots <- the factor of the matrix whose blocks, column by column, are `values`."""
        ...

    @wp.func_native(_text(_FORWARD, number))
    def solve_forward(
        supernode_count: int, supernodes: wp.array2d[int], row_start: wp.array[int], row_node: wp.array[int],
        panels: wp.array(dtype=dtype), x: wp.array(dtype=dtype), work: wp.array(dtype=dtype),
    ):  # fmt: skip
        """X <- L^-1 x."""
        ...

    @wp.func_native(_text(_BACKWARD, number))
    def solve_backward(
        supernode_count: int, supernodes: wp.array2d[int], row_start: wp.array[int], row_node: wp.array[int],
        panels: wp.array(dtype=dtype), inverse_pivots: wp.array(dtype=dtype), x: wp.array(dtype=dtype),
        work: wp.array(dtype=dtype),
    ):  # fmt: skip
        """X <- L^-T D^-1 x."""
        ...


@wp.func
def factor_mesh(
    tables: FactorTables, values: wp.array(dtype=Any), panels: wp.array(dtype=Any), updates: wp.array(dtype=Any),
    inverse_pivots: wp.array(dtype=Any), work: wp.array(dtype=Any),
):  # fmt: skip
    """Panels and inverse pivots <- the factor of one world's matrix."""
    factor_panels(
        tables.supernode_count, tables.widest, PIVOT_FLOOR, tables.supernodes, tables.block_start, tables.block_panel,
        tables.row_start, tables.target, tables.child_start, tables.child, values, panels, updates, inverse_pivots,
        work,
    )  # fmt: skip


@wp.func
def solve_mesh(
    tables: FactorTables, panels: wp.array(dtype=Any), inverse_pivots: wp.array(dtype=Any), x: wp.array(dtype=Any),
    work: wp.array(dtype=Any),
):  # fmt: skip
    """X <- A^-1 x in one world; nodes in the order of elimination."""
    solve_forward(tables.supernode_count, tables.supernodes, tables.row_start, tables.row, panels, x, work)
    solve_backward(
        tables.supernode_count, tables.supernodes, tables.row_start, tables.row, panels, inverse_pivots, x, work
    )
