"""A mesh's matrix factored, A = L Lᵀ in blocks of 3 x 3, and solved with: one world, which lanes of a GPU may share.

A block lies in memory as three columns of four numbers, so that an update is a few vector instructions of a CPU. The
fourth numbers of a block on the diagonal are its diagonal before all updates, those of others are zero. After `factor`
the blocks on the diagonal hold the inverse of theirs of L. Vectors have four numbers for each column as well, in the
order of elimination. `BlockStructure` says what the tables are. Single and double precision have the same text.
"""

import warp as wp

from simwarp.kernels.core.lanes import LANES
from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})

WIDTH = 4
"""Numbers of a column of a block, and of a node's part of a vector, in memory."""
BLOCK = 3 * WIDTH
"""Numbers of a block in memory."""


@wp.struct
class BlockTables:
    """A `BlockStructure` on a device."""

    order: wp.array[int]
    column_start: wp.array[int]
    block_row: wp.array[int]
    target_start: wp.array[int]
    target: wp.array[int]
    term_start: wp.array[int]
    term: wp.array[int]
    share_start: wp.array[int]
    share: wp.array[int]


_COLUMNS = (
    VIEWS
    + LANES
    + """
#ifdef __CUDA_ARCH__
    struct Column {
        Real v[4];
        CUDA_CALLABLE Real& operator[](int i) { return v[i]; }
        CUDA_CALLABLE Real operator[](int i) const { return v[i]; }
        CUDA_CALLABLE Column operator*(Real s) const { return {v[0] * s, v[1] * s, v[2] * s, Real(0)}; }
        CUDA_CALLABLE Column operator*(Column o) const {
            return {v[0] * o.v[0], v[1] * o.v[1], v[2] * o.v[2], Real(0)};
        }
        CUDA_CALLABLE Column operator+(Column o) const {
            return {v[0] + o.v[0], v[1] + o.v[1], v[2] + o.v[2], Real(0)};
        }
        CUDA_CALLABLE void operator+=(Column o) { v[0] += o.v[0]; v[1] += o.v[1]; v[2] += o.v[2]; }
        CUDA_CALLABLE void operator-=(Column o) { v[0] -= o.v[0]; v[1] -= o.v[1]; v[2] -= o.v[2]; }
    };
#else
    typedef Real Column __attribute__((ext_vector_type(4), aligned(sizeof(Real))));
#endif
"""
)

_ASSEMBLE = """
    const Ints starts = elements(term_start), terms = elements(term);
    const float* const parts = (const float*)element_blocks.data;
    Column* const a = (Column*)blocks.data;
    ROLLED for (int block = lane; block < count; block += stride) {
        Real sum[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
        for (int k = starts[block]; k < starts[block + 1]; ++k) {
            const float* const part = parts + 9 * (size_t)(terms[k] >> 1);
            if (terms[k] & 1) {
                for (int i = 0; i < 9; ++i) sum[i] += part[i];
            } else {
                for (int i = 0; i < 9; ++i) sum[i] += part[3 * (i % 3) + i / 3];
            }
        }
        const bool on_diagonal = block < n;
        const Real m = on_diagonal ? Real(masses[block]) : Real(0);
        for (int i = 0; i < 3; ++i) sum[4 * i] += m;
        for (int i = 0; i < 3; ++i)
            a[3 * (size_t)block + i] =
                Column{sum[3 * i], sum[3 * i + 1], sum[3 * i + 2], on_diagonal ? sum[4 * i] : Real(0)};
    }
    meet_lanes();
"""

_FACTOR = """
    const Ints starts = elements(column_start), target_starts = elements(target_start), targets = elements(target);
    Column* const a = (Column*)blocks.data;
    int raised = 0;
    for (int column = 0; column < eliminated; ++column) {
        Column* const d = a + 3 * (size_t)column;
        auto pivot = [&](Real value, Real before) {
            if (value < least * before) { value = least * before; ++raised; }
            return Real(1) / (Real)sqrt(value);
        };
        const Real i00 = pivot(d[0][0], d[0][3]);
        const Real l10 = d[0][1] * i00, l20 = d[0][2] * i00;
        const Real i11 = pivot(d[1][1] - l10 * l10, d[1][3]);
        const Real l21 = (d[1][2] - l20 * l10) * i11;
        const Real i22 = pivot(d[2][2] - l20 * l20 - l21 * l21, d[2][3]);
        const Real i10 = -l10 * i00 * i11, i21 = -l21 * i11 * i22;
        const Real i20 = -(l20 * i00 + l21 * i10) * i22;
        meet_lanes();
        if (lane == 0) {
            d[0] = Column{i00, i10, i20, 0};
            d[1] = Column{0, i11, i21, 0};
            d[2] = Column{0, 0, i22, 0};
        }
        Column* const panel = a + 3 * (size_t)(n + starts[column]);
        const int rows = starts[column + 1] - starts[column];
        ROLLED for (int k = lane; k < rows; k += stride) {
            Column* const g = panel + 3 * k;
            const Column a0 = g[0], a1 = g[1], a2 = g[2];
            g[0] = a0 * i00;
            g[1] = a0 * i10 + a1 * i11;
            g[2] = a0 * i20 + a1 * i21 + a2 * i22;
        }
        meet_lanes();
        const Ints into = targets + target_starts[column];
        for (int other = 0, start = 0; other < rows; start += rows - other, ++other) {
            Column* const g = panel + 3 * other;
            const Real s00 = g[0][0], s01 = g[1][0], s02 = g[2][0];
            const Real s10 = g[0][1], s11 = g[1][1], s12 = g[2][1];
            const Real s20 = g[0][2], s21 = g[1][2], s22 = g[2][2];
            ROLLED for (int k = lane; k < rows - other; k += stride) {
                Column* const t = a + 3 * (size_t)into[start + k];
                const Column g0 = g[3 * k], g1 = g[3 * k + 1], g2 = g[3 * k + 2];
                t[0] -= g0 * s00 + g1 * s01 + g2 * s02;
                t[1] -= g0 * s10 + g1 * s11 + g2 * s12;
                t[2] -= g0 * s20 + g1 * s21 + g2 * s22;
            }
        }
        meet_lanes();
    }
    return raised;
"""

_FORWARD = """
    const Ints starts = elements(column_start), rows = elements(block_row);
    Column* const a = (Column*)blocks.data;
    Column* const x = (Column*)vector.data;
    for (int column = 0; column < eliminated; ++column) {
        Column* const d = a + 3 * (size_t)column;
        const Column b = x[column];
        const Column y = d[0] * b[0] + d[1] * b[1] + d[2] * b[2];
        meet_lanes();
        if (lane == 0) x[column] = y;
        ROLLED for (int k = starts[column] + lane; k < starts[column + 1]; k += stride) {
            const Column* const g = a + 3 * (size_t)(n + k);
            x[rows[k]] -= g[0] * y[0] + g[1] * y[1] + g[2] * y[2];
        }
        meet_lanes();
    }
"""

_BACKWARD = """
    const Ints starts = elements(column_start), rows = elements(block_row);
    Column* const a = (Column*)blocks.data;
    Column* const x = (Column*)vector.data;
    for (int column = eliminated - 1; column >= 0; --column) {
        Column s0 = {0, 0, 0, 0}, s1 = {0, 0, 0, 0}, s2 = {0, 0, 0, 0};
        ROLLED for (int k = starts[column] + lane; k < starts[column + 1]; k += stride) {
            const Column* const g = a + 3 * (size_t)(n + k);
            const Column v = x[rows[k]];
            s0 += g[0] * v; s1 += g[1] * v; s2 += g[2] * v;
        }
        Column* const d = a + 3 * (size_t)column;
        const Column y = x[column];
        const Real r0 = y[0] - sum_of_lanes(s0[0] + s0[1] + s0[2]);
        const Real r1 = y[1] - sum_of_lanes(s1[0] + s1[1] + s1[2]);
        const Real r2 = y[2] - sum_of_lanes(s2[0] + s2[1] + s2[2]);
        meet_lanes();
        if (lane == 0)
            x[column] = Column{
                d[0][0] * r0 + d[0][1] * r1 + d[0][2] * r2, d[1][1] * r1 + d[1][2] * r2, d[2][2] * r2, Real(0)};
        meet_lanes();
    }
"""


def _typed(real: str, text: str) -> str:
    """The text for `float` or `double`."""
    return f"typedef {real} Real;\n{_COLUMNS}{text}"


@wp.func_native(_typed("float", _ASSEMBLE))
def assemble(
    n: int, count: int, term_start: wp.array[int], term: wp.array[int], element_blocks: wp.array[wp.mat33],
    masses: wp.array[float], blocks: wp.array[float], lanes: int,
):  # fmt: skip
    """Blocks <- sums of elements' blocks, and the masses of nodes, in the order of elimination, on the diagonal."""
    ...


@wp.func_native(_typed("float", _FACTOR))
def factor(
    eliminated: int, n: int, column_start: wp.array[int], target_start: wp.array[int], target: wp.array[int],
    least: float, blocks: wp.array[float], lanes: int,
) -> int:  # fmt: skip
    """Blocks <- their factor; returns how many pivots were raised to `least` of the diagonal before all updates.

    Of `n` columns the first ones are eliminated; the blocks of the others are then what that leaves of them.
    """
    ...


@wp.func_native(_typed("float", _FORWARD))
def substitute_forward(
    eliminated: int, n: int, column_start: wp.array[int], block_row: wp.array[int], blocks: wp.array[float],
    vector: wp.array[float], lanes: int,
):  # fmt: skip
    """Vector <- L⁻¹ vector of the columns that are eliminated; of the others what these leave."""
    ...


@wp.func_native(_typed("float", _BACKWARD))
def substitute_backward(
    eliminated: int, n: int, column_start: wp.array[int], block_row: wp.array[int], blocks: wp.array[float],
    vector: wp.array[float], lanes: int,
):  # fmt: skip
    """Vector <- L⁻ᵀ vector of the columns that are eliminated; the others are known."""
    ...


@wp.func_native(_typed("double", _ASSEMBLE))
def assemble_double(
    n: int, count: int, term_start: wp.array[int], term: wp.array[int], element_blocks: wp.array[wp.mat33],
    masses: wp.array[float], blocks: wp.array[wp.float64], lanes: int,
):  # fmt: skip
    """`assemble` in double precision."""
    ...


@wp.func_native(_typed("double", _FACTOR))
def factor_double(
    eliminated: int, n: int, column_start: wp.array[int], target_start: wp.array[int], target: wp.array[int],
    least: float, blocks: wp.array[wp.float64], lanes: int,
) -> int:  # fmt: skip
    """`factor` in double precision."""
    ...


@wp.func_native(_typed("double", _FORWARD))
def substitute_forward_double(
    eliminated: int, n: int, column_start: wp.array[int], block_row: wp.array[int], blocks: wp.array[wp.float64],
    vector: wp.array[wp.float64], lanes: int,
):  # fmt: skip
    """`substitute_forward` in double precision."""
    ...


@wp.func_native(_typed("double", _BACKWARD))
def substitute_backward_double(
    eliminated: int, n: int, column_start: wp.array[int], block_row: wp.array[int], blocks: wp.array[wp.float64],
    vector: wp.array[wp.float64], lanes: int,
):  # fmt: skip
    """`substitute_backward` in double precision."""
    ...
