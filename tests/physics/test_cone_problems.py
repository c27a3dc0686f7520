"""`solve_cone_problems` against stored solutions, a float64 reference, and problems of unusual kinds."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

from simwarp.simulation.cone_problems import solve_cone_problems
from tests.reference.cones import NAMES, load, random_problem, residual, solve, standard_blocks

SOLVERS = ["apgd", "psor", "spg", "padmm", "interior_point"]

# Heavy on light: what the others reach in their iterations [m/s], by law. Elsewhere they reach 3e-5.
HEAVY = {
    "convex": {"psor": 3e-2, "spg": 3e-3, "padmm": 3e-4},
    "exact": {"psor": 3e-2, "spg": 6e-2, "padmm": 2e-2, "apgd": 3e-4, "interior_point": 3e-4},
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("solver", ["apgd", "interior_point"])
def test_references_from_n_alone(name, solver):
    p = load(name)
    done = solve_cone_problems(p.n, p.r, p.mu, **p.counts, solver=solver, friction_law="convex")
    limit = 3e-4 if name == "massratio1000" else 3e-5
    assert done.residual <= limit
    assert residual(p.n, p.r, p.blocks, done.impulse.astype(float), exact=False) <= limit
    assert np.abs(p.velocity_of(done.impulse) - p.velocity).max() <= 1e-3
    assert done.velocity is None


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("solver", ["apgd", "interior_point"])
def test_references_with_the_mechanics(name, solver):
    p = load(name)
    done = solve_cone_problems(p.n, p.r, p.mu, **p.counts, **p.mechanics, solver=solver, friction_law="convex")
    limit = 3e-4 if name == "massratio1000" else 3e-5
    assert residual(p.n, p.r, p.blocks, done.impulse.astype(float), exact=False) <= limit
    assert np.abs(done.velocity - p.velocity).max() <= 1e-4
    assert np.abs(p.velocity_of(done.impulse) - p.velocity).max() <= 1e-3
    if p.bilateral:
        joints = p.jacobian.T[: p.bilateral] @ done.velocity.astype(float)
        wanted = (p.r - p.jacobian.T @ p.free_velocity)[: p.bilateral]
        assert np.abs(joints + wanted).max() <= 5e-6


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("solver", ["psor", "spg", "padmm"])
def test_references_by_the_other_solvers(name, solver):
    p = load(name)
    done = solve_cone_problems(p.n, p.r, p.mu, **p.counts, solver=solver, friction_law="convex")
    limit = HEAVY["convex"][solver] if name == "massratio1000" else 3e-5
    assert residual(p.n, p.r, p.blocks, done.impulse.astype(float), exact=False) <= limit


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("solver", SOLVERS)
def test_exact_law_on_the_references(name, solver):
    p = load(name)
    done = solve_cone_problems(p.n, p.r, p.mu, **p.counts, solver=solver, friction_law="exact")
    limit = HEAVY["exact"][solver] if name == "massratio1000" else 3e-5
    assert residual(p.n, p.r, p.blocks, done.impulse.astype(float), exact=True) <= limit


@pytest.mark.parametrize("solver", SOLVERS)
def test_exact_law_slides_and_the_convex_one_dilates(solver):
    # A unit mass at 1 m/s on a plane with friction 0.5, pressed at 0.1 m/s: 0.05 N·s of friction cannot stop it.
    n, r = np.eye(3), np.array([-0.1, 1.0, 0.0])
    exact = solve_cone_problems(n, r, [0.5], solver=solver, friction_law="exact")
    convex = solve_cone_problems(n, r, [0.5], solver=solver, friction_law="convex")
    np.testing.assert_allclose(exact.impulse, [0.1, -0.05, 0.0], atol=2e-6)
    # The relaxed cone projects -r: n' = (0.1 + 0.5) / 1.25.
    np.testing.assert_allclose(convex.impulse, [0.48, -0.24, 0.0], atol=2e-6)


@pytest.mark.quick("exact-apgd", "exact-padmm", "convex-interior_point", "convex-psor")
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("law", ["exact", "convex"])
def test_random_problems_against_the_reference(solver, law):
    rng = np.random.default_rng(3)
    for _ in range(4):
        n, r, mu, _ = random_problem(rng, contacts=3, limits=2, spread=0.5)
        blocks = standard_blocks(0, 2, mu)
        reference = solve(n, r, blocks, law == "exact")
        assert residual(n, r, blocks, reference, law == "exact") <= 1e-9
        done = solve_cone_problems(n, r, mu, limit_count=2, solver=solver, friction_law=law)
        assert residual(n, r, blocks, done.impulse.astype(float), law == "exact") <= 5e-5
        if law == "convex":
            np.testing.assert_allclose(n @ done.impulse, n @ reference, atol=1e-3 * max(1.0, np.abs(n).max() * 1e-2))


@pytest.mark.parametrize("law", ["exact", "convex"])
@pytest.mark.parametrize("solver", ["apgd", "interior_point"])
def test_masses_from_grams_to_tonnes(solver, law):
    rng = np.random.default_rng(4)
    worst = 0.0
    for _ in range(20):
        n, r, mu, _ = random_problem(rng, contacts=6, limits=2, spread=3.0)
        done = solve_cone_problems(n, r, mu, limit_count=2, solver=solver, friction_law=law)
        found = residual(n, r, standard_blocks(0, 2, mu), done.impulse.astype(float), law == "exact")
        floor = 6e-8 * float((np.abs(n) @ np.abs(done.impulse)).max())
        worst = max(worst, found / (1e-4 + 10.0 * floor))
    assert worst <= 1.0


def test_only_bilateral_rows_even_if_redundant():
    rng = np.random.default_rng(5)
    n, r, mu, mechanics = random_problem(rng, contacts=0, bilateral=6)
    twice = [*range(6), 2, 4]
    d = mechanics["jacobian"][:, twice]
    n, r = n[np.ix_(twice, twice)], r[twice]
    done = solve_cone_problems(n, r, mu, bilateral_count=8)
    assert np.abs(n @ done.impulse + r).max() <= 2e-5
    done = solve_cone_problems(n, r, mu, bilateral_count=8, **{**mechanics, "jacobian": d})
    assert np.abs(d.T @ done.velocity).max() <= 1e-6


@pytest.mark.parametrize("solver", SOLVERS)
def test_only_limits(solver):
    n = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    r = np.array([-1.0, 0.5, 0.2])
    done = solve_cone_problems(n, r, [], limit_count=3, solver=solver)
    u = n @ done.impulse + r
    assert (done.impulse >= 0.0).all()
    assert (u >= -1e-5).all()
    assert abs(done.impulse @ u) <= 1e-5


def test_one_limit_is_solved_in_closed_form():
    done = solve_cone_problems(np.array([[[2.0]]] * 2), np.array([[-3.0], [1.0]]), np.zeros((2, 0)), limit_count=1)
    np.testing.assert_array_equal(done.impulse, [[1.5], [0.0]])
    np.testing.assert_array_equal(done.iterations, [0, 0])


@pytest.mark.parametrize("solver", SOLVERS)
def test_without_friction_there_are_no_tangential_impulses(solver):
    rng = np.random.default_rng(6)
    n, r, mu, _ = random_problem(rng, contacts=4)
    done = solve_cone_problems(n, r, 0.0 * mu, solver=solver)
    gamma = done.impulse.reshape(-1, 3)
    np.testing.assert_array_equal(gamma[:, 1:], 0.0)
    u = (n @ done.impulse + r)[::3]
    assert (u >= -5e-5).all()
    assert abs(gamma[:, 0] @ u) <= 5e-5


@pytest.mark.parametrize("solver", SOLVERS)
def test_redundant_contacts_and_rows_that_nothing_moves(solver):
    rng = np.random.default_rng(7)
    n, r, mu, _ = random_problem(rng, contacts=2)
    rows = [*range(6), 0, 1, 2]
    n, r, mu = n[np.ix_(rows, rows)], r[rows], mu[[0, 1, 0]]
    still = np.zeros((12, 12))
    still[:9, :9] = n
    n, r, mu = still, np.concatenate([r, [-0.1, 0.2, 0.0]]), np.append(mu, 0.5)
    done = solve_cone_problems(n, r, mu, solver=solver, friction_law="convex")
    np.testing.assert_array_equal(done.impulse[9:], 0.0)
    assert residual(n, r, standard_blocks(0, 0, mu), done.impulse.astype(float), exact=False) <= 5e-5


def test_nothing_that_moves_at_all():
    done = solve_cone_problems(np.zeros((4, 4)), -np.ones(4), [0.3], limit_count=1)
    np.testing.assert_array_equal(done.impulse, 0.0)


def test_mixed_rows_with_joints_agree_with_and_without_the_mechanics():
    rng = np.random.default_rng(8)
    n, r, mu, mechanics = random_problem(rng, contacts=3, limits=2, bilateral=5, spread=0.5)
    alone = solve_cone_problems(n, r, mu, bilateral_count=5, limit_count=2, friction_law="exact")
    full = solve_cone_problems(None, None, mu, bilateral_count=5, limit_count=2, **mechanics, friction_law="exact")
    diagonal = {**mechanics, "inverse_mass": np.diag(mechanics["inverse_mass"])}
    short = solve_cone_problems(n, r, mu, bilateral_count=5, limit_count=2, **diagonal, friction_law="exact")
    blocks = standard_blocks(5, 2, mu)
    for done in (alone, full, short):
        assert residual(n, r, blocks, done.impulse.astype(float), exact=True) <= 5e-5
        v = mechanics["free_velocity"] + mechanics["inverse_mass"] @ mechanics["jacobian"] @ done.impulse
        np.testing.assert_allclose(mechanics["jacobian"].T[:5] @ v, 0.0, atol=5e-5)
    np.testing.assert_allclose(full.velocity, v, atol=1e-4)


def test_compliance_on_the_diagonal_counts_with_the_mechanics_too():
    rng = np.random.default_rng(9)
    n, r, mu, mechanics = random_problem(rng, contacts=2, limits=1, bilateral=3, spread=0.3)
    soft = n + np.diag([0.5, 0.0, 0.2, 0.3, *[0.1] * 6])
    done = solve_cone_problems(soft, r, mu, bilateral_count=3, limit_count=1, **mechanics, friction_law="exact")
    assert np.abs((soft @ done.impulse + r)[:3]).max() <= 2e-5
    assert residual(soft, r, standard_blocks(3, 1, mu), done.impulse.astype(float), exact=True) <= 2e-5


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_problem_does_not_feel_its_neighbours(solver):
    rng = np.random.default_rng(10)
    problems: list[Any] = [random_problem(rng, contacts=3, limits=1, bilateral=2) for _ in range(5)]
    n, r, mu = (np.stack([p[k] for p in problems]) for k in range(3))
    mechanics: dict[str, Any] = {key: np.stack([p[3][key] for p in problems]) for key in problems[0][3]}
    # A neighbour that overflows float32 turns into NaN in the scratch.
    n[2], r[2] = 1e30 * n[2], 1e30 * r[2]
    mechanics["jacobian"][2] *= 1e15
    counts: dict[str, Any] = {"bilateral_count": 2, "limit_count": 1}
    none: dict[str, Any] = {}
    for extra in (none, mechanics):
        together = solve_cone_problems(n, r, mu, **counts, **extra, solver=solver)
        again = solve_cone_problems(n, r, mu, **counts, **extra, solver=solver)
        np.testing.assert_array_equal(together.impulse, again.impulse)
        for i in (0, 1, 3, 4):
            own = {key: value[i] for key, value in extra.items()}
            alone = solve_cone_problems(n[i], r[i], mu[i], **counts, **own, solver=solver)
            assert np.isfinite(alone.impulse).all()
            np.testing.assert_array_equal(together.impulse[i], alone.impulse)
            assert together.iterations[i] == alone.iterations
            assert together.residual[i] == alone.residual
            if extra:
                np.testing.assert_array_equal(together.velocity[i], alone.velocity)


@pytest.mark.parametrize("solver", ["apgd", "psor", "spg", "padmm"])
def test_a_warm_start_saves_iterations(solver):
    p = load("incline_stick")
    cold = solve_cone_problems(p.n, p.r, p.mu, solver=solver, tolerance=2e-4)
    moved = p.r + 1e-4 * np.random.default_rng(11).normal(size=p.r.shape)
    warm = solve_cone_problems(p.n, moved, p.mu, solver=solver, tolerance=2e-4, warm_start=cold.impulse)
    same = solve_cone_problems(p.n, p.r, p.mu, solver=solver, tolerance=2e-4, warm_start=cold.impulse)
    assert same.iterations == 0
    assert 0 < warm.iterations <= 0.7 * cold.iterations


def test_results_come_in_the_kind_of_array_that_was_given():
    p = load("incline_slip")
    expected = solve_cone_problems(p.n, p.r, p.mu)
    assert isinstance(expected.impulse, np.ndarray)
    assert expected.impulse.dtype == np.float32
    tensors = [torch.tensor(a) for a in (p.n, p.r, p.mu)]
    done = solve_cone_problems(*tensors)
    assert isinstance(done.impulse, torch.Tensor)
    np.testing.assert_array_equal(done.impulse.numpy(), expected.impulse)
    arrays: list[Any] = [wp.array(a[None], dtype=wp.float64, device="cpu") for a in (p.n, p.r, p.mu)]
    done = solve_cone_problems(*arrays)
    assert isinstance(done.impulse, wp.array)
    np.testing.assert_array_equal(done.impulse.numpy()[0], expected.impulse)


def test_every_solver_takes_problems_of_any_size():
    """From none to many rows, all of one kind: no array is shorter than what the solvers write."""
    random = np.random.default_rng(0)
    for solver in ("apgd", "psor", "spg", "padmm", "interior_point"):
        for bilateral, limits, contacts in ((0, 1, 0), (1, 0, 0), (0, 0, 1), (3, 2, 5), (0, 0, 17), (0, 33, 0)):
            rows = bilateral + limits + 3 * contacts
            factor = random.normal(size=(rows, rows))
            n, r = factor @ factor.T + np.eye(rows), random.normal(size=rows)
            done = solve_cone_problems(
                n, r, np.full(contacts, 0.5), bilateral_count=bilateral, limit_count=limits, solver=solver
            )
            assert done.residual < 1e-3, (solver, rows)


def test_empty_problems():
    done = solve_cone_problems(np.zeros((0, 0)), np.zeros(0), np.zeros(0))
    assert done.impulse.shape == (0,)
    done = solve_cone_problems(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 1)))
    assert done.impulse.shape == (0, 3)
    free = np.array([1.0, 2.0])
    done = solve_cone_problems(None, None, [], jacobian=np.zeros((2, 0)), inverse_mass=np.eye(2), free_velocity=free)
    np.testing.assert_array_equal(done.velocity, free)


GOOD: dict[str, Any] = {"N": np.eye(4), "r": np.zeros(4), "mu": [0.5], "limit_count": 1}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"N": np.eye(3)}, r"N must have shape \(4, 4\), got \(3, 3\)"),
        ({"N": np.eye(4)[None]}, r"N must have 2 axes.*without a batch axis"),
        ({"r": np.zeros((1, 1, 4))}, "r must have 1 or 2 axes"),
        ({"r": np.array([0.0, np.nan, 0.0, 0.0])}, "r must be finite, got nan"),
        ({"N": "matrix"}, "N must be an array of numbers, got 'matrix'"),
        ({"N": None}, "N must be an array when the mechanics are not given"),
        ({"N": np.triu(np.ones((4, 4)))}, r"N must be symmetric.*pass 0.5 \(N \+ N\^T\)"),
        ({"N": -np.eye(4)}, "N must be positive semidefinite, got -1"),
        ({"mu": [-0.1]}, r"mu must be >= 0, got -0.1; pass 0"),
        ({"mu": [0.5, 0.5]}, "mu must have one entry per contact.*got 4 rows"),
        ({"mu": np.zeros((2, 1))}, r"mu must have shape \(1, contacts\), got \(2, 1\)"),
        ({"limit_count": -1}, "limit_count must be zero or positive, got -1"),
        ({"solver": "apdg"}, "solver must be one of apgd, psor, spg, padmm, interior_point, got 'apdg'; did you mean"),
        ({"friction_law": "coulomb"}, "friction_law must be one of exact, convex, got 'coulomb'"),
        ({"tolerance": -1.0}, "tolerance must be zero or positive, got -1.0"),
        ({"max_iterations": 0}, "max_iterations must be at least 1, got 0"),
        ({"warm_start": np.zeros(3)}, r"warm_start must have shape \(4,\), got \(3,\)"),
        ({"jacobian": np.zeros((6, 4))}, "must be given together, got none for inverse_mass"),
        ({"N": 1e39 * np.eye(4)}, r"N must be finite and at most 3.4e38, got 1e\+39"),
        ({"r": [0.0, 0.0, 0.0, 10**400]}, "r must be an array of numbers, got"),
        ({"mu": [None]}, "mu must be an array of numbers, got"),
        ({"mu": "half"}, "mu must be an array of numbers, got 'half'"),
        ({"max_iterations": 2**33}, "max_iterations must be at most 10000000, got 8589934592"),
        ({"max_iterations": 1.5}, "max_iterations must be a whole number, got 1.5"),
        ({"max_iterations": "many"}, "max_iterations must be a whole number, got 'many'"),
        ({"tolerance": None}, "tolerance must be a number, got None"),
        ({"tolerance": 10**400}, "tolerance must be a"),
        ({"fallback": "no"}, "fallback must be True or False, got 'no'"),
        ({"solver": None}, "solver must be one of apgd, .* got None"),
        ({"limit_count": 2**40}, "mu must have one entry per contact"),
        ({"limit_count": 1.0}, "limit_count must be a whole number, got 1.0"),
        ({"device": "tpu"}, "device 'tpu' is not available"),
    ],
)
def test_errors_name_the_argument_the_rule_the_value_and_the_remedy(change, words):
    with pytest.raises(ValueError, match=words) as caught:
        solve_cone_problems(**{**GOOD, **change})
    assert "\n" not in str(caught.value)
