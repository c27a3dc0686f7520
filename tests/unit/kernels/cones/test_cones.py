"""Cone projections and the solvers' kernels on single problems: rolling friction, cohesion, boxes, matrix-free."""

# mypy: disable-error-code="index,assignment,attr-defined,arg-type"

import numpy as np
import pytest

from simwarp.core.types import ConeSolver, FrictionLaw
from simwarp.kernels.cones.problem import AX, OWN
from tests.reference import cones as reference
from tests.unit.kernels.cones.single_problem import MULTIPLY, PROJECT, RESIDUAL, SOLVE, Single, rows_with_factor


def mixed_blocks(rng, count):
    """Boxes, contacts and rolling contacts in turn, with slopes that include zero."""
    blocks, row = [], 0
    for i in range(count):
        kind = ("rolling", "box", "contact")[i % 3]
        slopes = tuple(rng.choice([0.0, 0.3, 1.0], 3) * rng.uniform(0.5, 1.5, 3))
        cohesion = float(rng.choice([0.0, 0.5])) if kind != "box" else 0.0
        bounds = [(0.0, np.inf), (-0.2, 0.3), (-np.inf, np.inf), (-np.inf, 0.1)][i % 4]
        blocks.append(
            reference.Block(kind, row, slopes[: {"box": 0, "contact": 1, "rolling": 3}[kind]], cohesion, bounds)
        )
        row = blocks[-1].rows.stop
    return blocks, row


@pytest.mark.parametrize("seed", range(3))
def test_projection_satisfies_moreau(seed):
    rng = np.random.default_rng(seed)
    blocks, rows = mixed_blocks(rng, 600)
    p = (rng.normal(size=rows) * 10.0 ** rng.uniform(-2, 2, rows)).astype(np.float32).astype(float)
    p[rng.random(rows) < 0.1] = 0.0
    q, _ = project_rows(blocks, p)
    for b in blocks:
        a, x = p[b.rows], q[b.rows]
        size = 1.0 + np.abs(a).max()
        np.testing.assert_allclose(x, reference.project(b, a), atol=2e-6 * size)
        if b.kind != "box":
            apex = np.zeros(len(a))
            apex[0] = -b.cohesion
            # x in the cone, x - a in its dual, and the two orthogonal.
            np.testing.assert_allclose(reference.project(b, x), x, atol=2e-6 * size)
            dual = reference.Block(b.kind, 0, b.slopes)
            np.testing.assert_allclose(reference.project(dual, -(x - a)), 0.0, atol=4e-6 * size)
            assert abs((x - apex) @ (x - a)) <= 1e-5 * size**2


def project_rows(blocks, p):
    """Projection by the kernel; S is of no use there and stays small."""
    return Single(np.zeros((1, 1)), np.zeros(len(p)), blocks).run(PROJECT, p)


def test_projection_in_the_order_that_is_safe_without_friction():
    block = [reference.Block("contact", 0, (0.0,))]
    for p, q in [((1, 2, 3), (1, 0, 0)), ((-1, 2, 3), (0, 0, 0)), ((0, 0, 0), (0, 0, 0)), ((0, 1, 0), (0, 0, 0))]:
        np.testing.assert_array_equal(project_rows(block, np.array(p, float))[0], q)


def test_tiny_and_huge_impulses_project_without_overflow():
    block = [reference.Block("contact", 0, (0.5,))]
    for size in (1e-30, 1e-15, 1e15):
        q, _ = project_rows(block, size * np.array([0.1, 1.0, 0.0]))
        assert np.isfinite(q).all()
        if size > 1e-20:
            np.testing.assert_allclose(q / size, reference.project(block[0], np.array([0.1, 1.0, 0.0])), rtol=1e-5)


@pytest.mark.parametrize("name", reference.NAMES)
def test_residual_vanishes_at_the_stored_solutions(name):
    p = reference.load(name)
    assert reference.residual(p.n, p.r, p.blocks, p.gamma, exact=False) <= 1e-11
    if p.bilateral == 0:
        single = Single(p.n, p.r, p.blocks)
        _, results = single.run(RESIDUAL, p.gamma, law=FrictionLaw.CONVEX)
        assert results[0] <= 2.0 * 6e-8 * (np.abs(p.n) @ np.abs(p.gamma)).max() + 1e-7
        off = p.gamma + 1e-2
        _, results = single.run(RESIDUAL, off)
        np.testing.assert_allclose(results[0], reference.residual(p.n, p.r, p.blocks, off, exact=True), rtol=1e-3)


def test_products_dense_and_matrix_free():
    rng = np.random.default_rng(12)
    for count in (1, 2, 4, 7, 11):
        blocks, rows = mixed_blocks(rng, count)
        n, entries = rows_with_factor(rng, blocks, rows)
        gamma = rng.normal(size=rows)
        for single in (Single(n, np.zeros(rows), blocks), Single(n, np.zeros(rows), blocks, entries)):
            _, results = single.run(MULTIPLY, gamma)
            vectors = single.problem.vectors.numpy()
            size = (np.abs(n) @ np.abs(gamma)).max()
            np.testing.assert_allclose(vectors[int(AX)], n @ gamma, atol=1e-5 * size)
            np.testing.assert_allclose(vectors[int(OWN)], n @ gamma, atol=1e-5 * size)
            np.testing.assert_allclose(results[0], gamma @ n @ gamma, atol=1e-5 * size * rows)


@pytest.mark.quick("0-0", "1-1", "1-2", "1-3", "1-4")
@pytest.mark.parametrize("solver", list(ConeSolver))
@pytest.mark.parametrize("law", list(FrictionLaw))
def test_mixed_blocks_dense_and_matrix_free_against_the_reference(solver, law):
    rng = np.random.default_rng(13)
    for count in (2, 5):
        blocks, rows = mixed_blocks(rng, count)
        n, entries = rows_with_factor(rng, blocks, rows)
        r = rng.normal(size=rows)
        exact = law == FrictionLaw.EXACT
        expected = n @ reference.solve(n, r, blocks, exact)
        for single in (Single(n, r, blocks), Single(n, r, blocks, entries)):
            gamma, results = single.run(SOLVE, np.zeros(rows), law=law, solver=solver)
            assert reference.residual(n, r, blocks, gamma, exact) <= 5e-5
            assert results[0] <= 5e-5
            if not exact:
                np.testing.assert_allclose(n @ gamma, expected, atol=2e-3)


@pytest.mark.parametrize("law", list(FrictionLaw))
def test_interior_point_with_boxes_cohesion_and_bounds_of_all_kinds(law):
    rng = np.random.default_rng(14)
    for trial in range(6):
        bounds = [(0.0, np.inf), (-0.2, 0.3), (-np.inf, np.inf), (-np.inf, 0.1), (0.25, 0.25)]
        blocks = [reference.Block("box", i, bounds=b) for i, b in enumerate(bounds)]
        blocks += [
            reference.Block("contact", 5 + 3 * i, (mu,), c) for i, (mu, c) in enumerate([(0.7, 0.2), (0.0, 0.1)])
        ]
        n, _ = rows_with_factor(rng, blocks, 11, loops=0)
        r = rng.normal(size=11)
        single = Single(n, r, blocks)
        for solver in (ConeSolver.INTERIOR_POINT, ConeSolver.APGD):
            steps = 25 if solver == ConeSolver.INTERIOR_POINT else 20000
            gamma, _ = single.run(SOLVE, np.zeros(11), law=law, solver=solver, iterations=steps)
            assert gamma[4] == pytest.approx(0.25)
            found = reference.residual(n, r, blocks, gamma, law == FrictionLaw.EXACT)
            assert found <= 3e-5, (trial, solver)


@pytest.mark.parametrize("solver", list(ConeSolver))
def test_exact_law_keeps_a_rolling_contact_from_lifting(solver):
    # A ball that slides, rolls and spins at once: all three frictions saturate, and u_n is zero.
    blocks = [reference.Block("rolling", 0, (0.3, 0.1, 0.05))]
    n, r = np.diag([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]), np.array([-0.2, 1.0, 0.5, 1.0, -1.0, 2.0])
    single = Single(n, r, blocks)
    gamma, _ = single.run(SOLVE, np.zeros(6), solver=solver)
    u = n @ gamma + r
    assert abs(u[0]) <= 1e-5
    np.testing.assert_allclose(np.linalg.norm(gamma[1:3]), 0.3 * gamma[0], rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(gamma[3:5]), 0.1 * gamma[0], rtol=1e-4)
    np.testing.assert_allclose(abs(gamma[5]), 0.05 * gamma[0], rtol=1e-4)


@pytest.mark.parametrize("solver", list(ConeSolver))
def test_nan_comes_back_as_nan_and_ends(solver):
    blocks = [reference.Block("contact", 0, (0.5,)), reference.Block("contact", 3, (0.5,))]
    r = np.array([-1.0, np.nan, 0.0, -1.0, 0.0, 0.0])
    _, results = Single(np.eye(6), r, blocks).run(SOLVE, np.zeros(6), solver=solver)
    assert not np.isfinite(results[0])


def test_scratch_of_another_problem_has_no_effect():
    p = reference.load("incline_slip")
    single = Single(p.n, p.r, p.blocks)
    for solver in ConeSolver:
        first, _ = single.run(SOLVE, np.zeros(12), solver=solver)
        single.run(SOLVE, np.full(12, np.nan), solver=ConeSolver.INTERIOR_POINT)
        again, _ = single.run(SOLVE, np.zeros(12), solver=solver)
        np.testing.assert_array_equal(first, again)
