"""W W^T where a block sees the loop rows of no group, of one or of two, against the whole W with its zeros."""

# mypy: disable-error-code="index,assignment,attr-defined,arg-type"

import numpy as np
import pytest
import warp as wp

from simwarp.core.types import ConeSolver, FrictionLaw
from simwarp.kernels.cones.problem import AX
from simwarp.kernels.cones.sparse_rows import finish_gram, subtract_loops
from tests.reference import cones as reference
from tests.unit.kernels.cones.single_problem import MULTIPLY, SOLVE, Single, rows_with_factor

wp.set_module_options({"enable_backward": False})

STARTS = [0, 5, 5, 12, 14]  # of four groups; the second has no rows
SEEN = [(), (0,), (2,), (3,), (0, 2), (0, 3), (2, 3), (2,)]


@wp.kernel(enable_backward=False)
def take_loops(
    # inputs
    blocks: int,
    loops: int,
    block_row: wp.array[int],
    block_loops: wp.array2d[int],
    w: wp.array2d[float],
    compliance: wp.array[float],
    x: wp.array[float],
    # in and out
    sums: wp.array[float],
    ax: wp.array[float],
    s: wp.array2d[float],
    # outputs
    lost: wp.array[float],
):
    """Both functions, once each."""
    lost[0] = subtract_loops(blocks, loops, block_row, block_loops, w, x, sums, ax, 1)
    finish_gram(blocks, block_row, block_loops, w, compliance, s, 1)


def blocks_with_loops(rng):
    """Blocks of one, three and six rows, W as kernels keep it, what each block sees, and W with all its columns."""
    blocks, row = [], 0
    for index in range(len(SEEN)):
        kind = ("contact", "box", "rolling")[index % 3]
        slopes = (0.5, 0.1, 0.1)[: {"box": 0, "contact": 1, "rolling": 3}[kind]]
        blocks.append(reference.Block(kind, row, slopes, 0.0, (0.0, np.inf)))
        row = blocks[-1].rows.stop
    packed, whole = np.full((row, 12), np.nan), np.zeros((row, STARTS[-1]))
    table = np.zeros((len(SEEN), 4), np.int32)
    for block, (groups, seen) in enumerate(zip(SEEN, table, strict=True)):
        column, rows = 0, blocks[block].rows
        for place, group in enumerate(groups):
            first, end = STARTS[group], STARTS[group + 1]
            seen[2 * place : 2 * place + 2] = first, end - first
            whole[rows, first:end] = 0.3 * rng.normal(size=(rows.stop - rows.start, end - first))
            packed[rows, column : column + end - first] = whole[rows, first:end]
            column += end - first
    return blocks, packed.astype(np.float32), table, whole.astype(np.float32).astype(float)


@pytest.mark.parametrize("seed", range(3))
def test_products_and_the_dense_matrix(seed):
    rng = np.random.default_rng(seed)
    blocks, packed, table, whole = blocks_with_loops(rng)
    rows = len(whole)
    x, ax = rng.normal(size=(2, rows)).astype(np.float32)
    x[::5] = 0.0
    half = rng.normal(size=(rows, rows)).astype(np.float32)
    s, compliance = half + half.T, rng.uniform(0.0, 1.0, rows).astype(np.float32)
    sums = np.full(STARTS[-1], np.nan, np.float32)
    given = [sums, ax, s, np.zeros(1, np.float32)]
    out: list[wp.array] = [wp.array(each, dtype=float, device="cpu") for each in given]
    starts = np.array([*(block.row for block in blocks), rows], np.int32)
    inputs: list[wp.array] = [wp.array(starts, dtype=int, device="cpu"), wp.array(table, dtype=int, device="cpu")]
    floats: list[wp.array] = [wp.array(each, dtype=float, device="cpu") for each in (packed, compliance, x)]
    wp.launch(take_loops, dim=1, inputs=[len(blocks), STARTS[-1], *inputs, *floats, *out], device="cpu")
    found = [each.numpy() for each in out]
    exact = whole @ (whole.T @ x)
    np.testing.assert_allclose(found[0], whole.T @ x, atol=2e-6)
    np.testing.assert_allclose(found[1], ax - exact, atol=5e-6)
    np.testing.assert_allclose(found[2], s - whole @ whole.T + np.diag(compliance), atol=5e-6)
    np.testing.assert_array_equal(found[2], found[2].T)
    assert found[3][0] == pytest.approx(exact @ x, abs=2e-5)


@pytest.mark.parametrize("solver", list(ConeSolver))
def test_solvers_without_the_dense_matrix(solver):
    rng = np.random.default_rng(5)
    blocks, packed, table, whole = blocks_with_loops(rng)
    rows = len(whole)
    n, (y, slots, _, _) = rows_with_factor(rng, blocks, rows, loops=0)
    compliance = np.full(rows, 3.0 + np.linalg.norm(whole, 2) ** 2)
    full = np.zeros((rows, slots.max() + 1))
    for block, slot in zip(blocks, slots, strict=True):
        full[block.rows, slot] = y[block.rows]
    n = full @ full.T - whole @ whole.T + np.diag(compliance)
    r = rng.normal(size=rows)
    single = Single(n, r, blocks, (y, slots, packed, compliance), table)
    gamma = rng.normal(size=rows)
    _, results = single.run(MULTIPLY, gamma)
    np.testing.assert_allclose(single.problem.vectors.numpy()[int(AX)], n @ gamma, atol=1e-4)
    gamma, results = single.run(SOLVE, np.zeros(rows), law=FrictionLaw.EXACT, solver=solver)
    assert reference.residual(n, r, blocks, gamma, True) <= 5e-5
    assert results[0] <= 5e-5
