"""The factor of a mesh's matrix against a dense solve in float64."""

import numpy as np
import pytest
import warp as wp

from simwarp.kernels.meshes.block_factor import (
    BLOCK,
    BlockTables,
    assemble,
    assemble_double,
    factor,
    factor_double,
    substitute_backward,
    substitute_backward_double,
    substitute_forward,
    substitute_forward_double,
)
from simwarp.meshes.block_structure import analyse, element_blocks
from simwarp.meshes.lattices import box_of_hexahedra, box_of_tetrahedra, rectangle_of_triangles
from simwarp.meshes.triangle_elements import with_neighbours

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

MESHES = {
    "tetrahedra": box_of_tetrahedra((4, 4, 4), (1.0, 1.0, 1.0))[1],
    "hexahedra": box_of_hexahedra((3, 2, 4), (1.0, 1.0, 1.0))[1],
    "triangles": with_neighbours(rectangle_of_triangles((7, 5), (1.0, 1.0))[1]),
}


@wp.kernel
def solve(
    n: int, count: int, t: BlockTables, parts: wp.array[wp.mat33], masses: wp.array[float], least: float,
    blocks: wp.array[float], x: wp.array[float], raised: wp.array(dtype=int),  # type: ignore[valid-type]
):  # fmt: skip
    assemble(n, count, t.term_start, t.term, parts, masses, blocks, 1)
    raised[0] = factor(n, n, t.column_start, t.target_start, t.target, least, blocks, 1)
    substitute_forward(n, n, t.column_start, t.block_row, blocks, x, 1)
    substitute_backward(n, n, t.column_start, t.block_row, blocks, x, 1)


@wp.kernel
def solve_double(
    n: int, count: int, t: BlockTables, parts: wp.array[wp.mat33], masses: wp.array[float], least: float,
    blocks: wp.array[wp.float64], x: wp.array[wp.float64], raised: wp.array(dtype=int),  # type: ignore[valid-type]
):  # fmt: skip
    assemble_double(n, count, t.term_start, t.term, parts, masses, blocks, 1)
    raised[0] = factor_double(n, n, t.column_start, t.target_start, t.target, least, blocks, 1)
    substitute_forward_double(n, n, t.column_start, t.block_row, blocks, x, 1)
    substitute_backward_double(n, n, t.column_start, t.block_row, blocks, x, 1)


def tables_of(structure):
    tables = BlockTables()
    for field in ("order", "column_start", "block_row", "target_start", "target", "term_start", "term"):
        setattr(tables, field, wp.array(getattr(structure, field), dtype=int, device="cpu"))
    return tables


def problem(elements, count, rng):
    """Random positive element matrices in the order of the kernels, and the dense sum of them and of masses."""
    parts: list = []
    total = np.zeros((count, 3, count, 3))
    for nodes in elements:
        k = len(nodes)
        factor = rng.standard_normal((3 * k, 3 * k))
        matrix = (factor @ factor.T).astype(np.float32).astype(float).reshape(k, 3, k, 3)
        parts.extend(matrix[a, :, b] for a, b in element_blocks(k))
        there = [a for a in range(k) if nodes[a] >= 0]
        for a in there:
            for b in there:
                total[nodes[a], :, nodes[b]] += matrix[a, :, b]
    masses = rng.uniform(0.5, 2.0, count).astype(np.float32)
    for node in range(count):
        total[node, :, node] += masses[node] * np.eye(3)
    return np.array(parts), masses, total.reshape(3 * count, 3 * count)


def solved(structure, parts, masses, right, *, double, least=1e-6):
    """The solution by kernels, and how many pivots were raised."""
    n = structure.node_count
    real = wp.float64 if double else float
    vector = np.zeros((n, 4))
    vector[:, :3] = right.reshape(n, 3)[structure.order]
    x: wp.array = wp.array(vector.reshape(-1), dtype=real, device="cpu")
    blocks = wp.zeros(BLOCK * structure.block_count, dtype=real, device="cpu")
    raised = wp.zeros(1, dtype=int, device="cpu")
    wp.launch(
        solve_double if double else solve, 1, device="cpu",
        inputs=[
            n, structure.block_count, tables_of(structure), wp.array(parts, dtype=wp.mat33, device="cpu"),
            wp.array(masses[structure.order], dtype=float, device="cpu"), least, blocks, x, raised,
        ],
    )  # fmt: skip
    found = np.zeros((n, 3))
    found[structure.order] = x.numpy().reshape(n, 4)[:, :3]
    return found.reshape(-1), int(raised.numpy()[0])


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("kind", sorted(MESHES))
def test_a_solve_is_that_of_the_dense_matrix(kind, double):
    elements = MESHES[kind]
    count = int(elements.max()) + 1
    rng = np.random.default_rng(3)
    structure = analyse(count, elements.tolist())
    parts, masses, dense = problem(elements.tolist(), count, rng)
    right = rng.standard_normal(3 * count)
    found, raised = solved(structure, parts, masses, right, double=double)
    exact = np.linalg.solve(dense, right)
    # Condition numbers are of the order 100: rounding of one precision or the other, and no more
    assert np.abs(found - exact).max() < (1e-13 if double else 1e-5) * np.abs(exact).max()
    assert raised == 0


@pytest.mark.parametrize("seed", range(8))
def test_random_elements_of_any_nodes(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 40))
    elements = [
        rng.choice(count, size=min(count, int(k)), replace=False).tolist() for k in rng.choice([2, 4, 6, 8], 30)
    ]
    for element in elements:
        element[0] = -1 if rng.random() < 0.3 else element[0]
    structure = analyse(count, elements, last=[0, 1])
    assert structure.order[-2:].tolist() == [0, 1]
    assert sorted(structure.order.tolist()) == list(range(count))
    parts, masses, dense = problem(elements, count, rng)
    right = rng.standard_normal(3 * count)
    found, _ = solved(structure, parts, masses, right, double=True)
    exact = np.linalg.solve(dense, right)
    assert np.abs(found - exact).max() < 1e-11 * np.abs(exact).max()


def test_the_factor_is_as_sparse_as_minimum_degree_makes_it():
    # A banded elimination of this lattice has 2.5 times as many operations
    structure = analyse(125, box_of_tetrahedra((4, 4, 4), (1.0, 1.0, 1.0))[1].tolist())
    assert structure.multiplications < 3.2e5
    assert structure.depth < 50
    assert structure.block_count < 1500


def test_a_parent_is_the_first_row_and_every_target_is_in_its_row_and_column():
    structure = analyse(60, box_of_hexahedra((2, 3, 4), (1.0, 1.0, 1.0))[1].tolist())
    columns = [
        structure.block_row[a:b] for a, b in zip(structure.column_start, structure.column_start[1:], strict=False)
    ]
    column_of = np.repeat(np.arange(60), np.diff(structure.column_start))
    for column, rows in enumerate(columns):
        assert structure.parent[column] == (rows[0] if len(rows) else -1)
        assert (rows[1:] > rows[:-1]).all()
        targets = iter(structure.target[structure.target_start[column] : structure.target_start[column + 1]])
        for k, other in enumerate(rows):
            for row in rows[k:]:
                block = next(targets)
                place = (block, block) if block < 60 else (structure.block_row[block - 60], column_of[block - 60])
                assert place == (row, other)


def test_a_pivot_that_rounding_ate_is_raised():
    # Two nodes tied 1e9 times as stiffly as they are heavy: their difference has no digits left
    stiff = 1e9 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    parts = np.array([stiff[a, b] * np.ones((3, 3)) for a, b in element_blocks(2)])
    structure = analyse(2, [[0, 1]])
    found, raised = solved(structure, parts, np.full(2, 1e-3), np.ones(6), double=False)
    assert raised > 0
    assert np.isfinite(found).all()


def test_what_is_no_number_stays_none():
    structure = analyse(2, [[0, 1]])
    found, _ = solved(structure, np.full((3, 3, 3), np.nan), np.ones(2), np.ones(6), double=False)
    assert np.isnan(found).all()
