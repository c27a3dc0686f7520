"""The factor of a mesh's matrix: equality with dense float64, worlds apart, order, fill, replaced pivots."""

import numpy as np
import pytest

from simwarp.flex.mesh_factor import plan_factor
from simwarp.flex.solid_meshes import box_mesh
from tests.unit.flex.single_factor import solved


def random_mesh(random, nodes, corners):
    """Elements of random nodes: any graph, perhaps of several parts."""
    return np.array([random.choice(nodes, corners, replace=False) for _ in range(nodes // 2)])


def positive(random, elements, nodes, worlds=1, softest=1.0):
    """Random positive matrices with the blocks of a mesh."""
    matrices = np.zeros((worlds, 3 * nodes, 3 * nodes))
    matrices += softest * np.eye(3 * nodes)
    for element in elements:
        dofs = (3 * element[:, None] + np.arange(3)).ravel()
        part = random.normal(size=(worlds, len(dofs), len(dofs)))
        matrices[:, dofs[:, None], dofs] += part @ part.transpose(0, 2, 1)
    return matrices


@pytest.mark.parametrize(("dtype", "bound"), [(np.float32, 1e-4), (np.float64, 1e-11)])
@pytest.mark.parametrize("seed", range(6))
def test_random_meshes_are_solved_as_densely(dtype, bound, seed):
    random = np.random.default_rng(seed)
    nodes = int(random.integers(9, 60))
    elements = random_mesh(random, nodes, int(random.choice([2, 3, 4, 8])))
    matrices, right = positive(random, elements, nodes, worlds=3), random.normal(size=(3, 3 * nodes))
    expected = np.linalg.solve(matrices, right[:, :, None])[:, :, 0]
    found = solved(plan_factor(elements, nodes), matrices, right, dtype)
    assert np.abs(found - expected).max() < bound * np.abs(expected).max()


@pytest.mark.parametrize("tetrahedra", [False, True])
@pytest.mark.parametrize(("dtype", "bound"), [(np.float32, 1e-5), (np.float64, 1e-13)])
def test_a_lattice_is_solved_as_densely(tetrahedra, dtype, bound):
    vertices, elements = box_mesh((1.0, 1.0, 1.0), (3, 2, 4), tetrahedra=tetrahedra)
    random = np.random.default_rng(7)
    matrices, right = positive(random, elements, len(vertices)), random.normal(size=(1, 3 * len(vertices)))
    found = solved(plan_factor(elements, len(vertices)), matrices, right, dtype)
    expected = np.linalg.solve(matrices[0], right[0])
    assert np.abs(found[0] - expected).max() < bound * np.abs(expected).max()


def test_a_world_among_others_is_what_it_is_alone():
    random = np.random.default_rng(8)
    vertices, elements = box_mesh((1.0, 1.0, 1.0), (2, 2, 2))
    plan = plan_factor(elements, len(vertices))
    matrices, right = positive(random, elements, len(vertices), worlds=4), random.normal(size=(4, 3 * len(vertices)))
    together = solved(plan, matrices, right, np.float32)
    alone = solved(plan, matrices[2:3], right[2:3], np.float32)
    assert np.array_equal(together[2], alone[0])
    assert np.array_equal(solved(plan, matrices, right, np.float32, repetitions=2), together)


@pytest.mark.parametrize(("tetrahedra", "multiplications", "panels"), [(True, 400e3, 100e3), (False, 1.45e6, 200e3)])
def test_fill_is_that_of_minimum_degree(tetrahedra, multiplications, panels):
    """Column by column it is 287 k and 47 KiB, 1.17 M and 101 KiB; joined supernodes and whole panels add to it."""
    vertices, elements = box_mesh((1.0, 1.0, 1.0), (4, 4, 4), tetrahedra=tetrahedra)
    plan = plan_factor(elements, len(vertices))
    assert plan.multiplications < multiplications
    assert 4 * plan.panel_size < panels
    assert sorted(plan.order.tolist()) == list(range(len(vertices)))
    assert np.array_equal(plan.order[plan.place], np.arange(len(vertices)))
    assert np.all(plan.blocks[:, 0] >= plan.blocks[:, 1])


def test_a_pivot_without_digits_is_replaced():
    """Two nodes on one stiff spring and nothing else: the second pivot is rounding, and the result stays finite."""
    matrix = np.kron(np.array([[1.0, -1.0], [-1.0, 1.0]]), np.eye(3))[None]
    plan = plan_factor(np.array([[0, 1]]), 2)
    found = solved(plan, matrix, np.array([[1.0, 0.0, 0.0, -1.0, 0.0, 0.0]]), np.float32)
    assert np.all(np.isfinite(found))
    assert np.isclose(found[0, 0] - found[0, 3], 1.0, rtol=1e-5)
