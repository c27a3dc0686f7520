"""Proximal Newton steps: each against its minimum, and what they save where accelerated gradient takes long."""

import itertools

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.core.types import FrictionLaw
from simwarp.kernels.cones.proximal_newton import NEWTON_VECTORS
from simwarp.simulation.step_sizes import step_sizes
from tests.reference import cones as reference
from tests.reference.contact_chains import solve_contacts
from tests.unit.kernels.cones.single_problem import CHAIN, SOLVE, STEP, Single

GRAVITY_STEP = 0.05  # m/s in a step of 5 ms


def stacked_boxes(count, rng, mass=lambda i: 1.0):
    """Cubes of 1 m on each other, four contacts a face, pushed sideways and turned: N, r, blocks and its entries."""
    corners = list(itertools.product((-0.5, 0.5), repeat=2))
    dofs = 6 * (count + 1)  # the first body is the ground, which has no velocity
    rows, slots, r = [], [], []
    blocks: list[reference.Block] = []
    push = np.zeros(dofs)
    push[6:] = rng.normal(size=dofs - 6) * 0.005
    push[8::6] = -GRAVITY_STEP
    for i in range(count):
        for x, across in corners:
            for axis in np.eye(3)[[2, 0, 1]]:
                row = np.zeros(dofs)
                for body, sign, z in ((i, -1.0, 0.5), (i + 1, 1.0, -0.5)):
                    weight = 0.0 if body == 0 else 1.0 / np.sqrt(mass(body))
                    row[6 * body : 6 * body + 3] = sign * axis * weight
                    # A cube's inertia is a sixth of its mass
                    row[6 * body + 3 : 6 * body + 6] = sign * np.cross([x, across, z], axis) * weight * np.sqrt(6.0)
                rows.append(row)
                r.append(row @ (push * np.repeat([np.sqrt(mass(b)) for b in range(count + 1)], 6)))
            blocks.append(reference.Block("contact", 3 * len(blocks), (0.5,)))
            slots.append(np.arange(6 * i, 6 * i + 12))
    full, places = np.array(rows), np.array(slots)
    y = np.array([values[places[k // 3]] for k, values in enumerate(full)])
    entries = (y, places, np.zeros((len(full), 0)), np.zeros(len(full)))
    return full @ full.T, np.array(r), blocks, entries


def proximal_minimum(n, r, blocks, gamma, rho):
    """The argmin of a proximal step, by accelerated projected gradient steps of fixed length in float64."""
    weight = np.array([max(n[k, k] for k in range(b.rows.start, b.rows.stop)) for b in blocks for _ in range(3)])
    hessian = n + np.diag(weight / rho)
    step = 1.0 / np.linalg.eigvalsh(hessian)[-1]
    keep = np.sqrt(step * np.linalg.eigvalsh(hessian)[0])
    x = y = gamma
    for _ in range(1000):
        moved = y - step * (n @ y + r + weight / rho * (y - gamma))
        after = np.concatenate([reference.project(b, moved[b.rows]) for b in blocks])
        y = after + (1.0 - keep) / (1.0 + keep) * (after - x)
        x = after
    return x


@pytest.mark.long("30")
@pytest.mark.parametrize("rho", [3, 30])
def test_a_proximal_step_is_its_minimum(rho):
    n, r, blocks, entries = stacked_boxes(2, np.random.default_rng(4), mass=lambda i: 1.0 + i)
    start = np.random.default_rng(5).normal(size=len(r)) * 0.02
    single = Single(n, r, blocks, entries)
    gamma, results = single.run(STEP, start, law=FrictionLaw.CONVEX, iterations=rho, tolerance=1e-7)
    expected = proximal_minimum(n, r, blocks, start.astype(np.float32).astype(float), rho)
    # Velocities to 1e-7 m/s, from rows in float32
    np.testing.assert_allclose(n @ gamma, n @ expected, atol=2e-6)
    np.testing.assert_allclose(gamma, expected, atol=2e-6 * rho)
    assert 1 <= results[0] < 12


@pytest.mark.parametrize("law", list(FrictionLaw))
def test_a_tall_stack_takes_few_iterations(law):
    """Without Newton steps, whose workspace is taken away to see that, it takes hundreds."""
    with_newton, without = [], []
    for seed, heavy in ((1, 30.0), (2, 30.0), (2, 1.0)):
        n, r, blocks, entries = stacked_boxes(
            16, np.random.default_rng(seed), lambda i, top=heavy: top if i > 15 else 1.0
        )
        before, _ = Single(n, r, blocks, entries).run(SOLVE, np.zeros(len(r)), law=law, tolerance=1e-5)
        # The next step: other velocities, the impulses of the last one
        r = r + n @ (np.random.default_rng(2).normal(size=len(r)) * 1e-3)
        single = Single(n, r, blocks, entries)
        gamma, (residual, iterations) = single.run(SOLVE, before, law=law, tolerance=1e-5)
        assert residual <= 1e-5
        # Measured in double, what the kernel says in float: 1e-6 m/s is the rounding of impulses of 0.8 N·s over 0.5 m
        assert reference.residual(n, r, blocks, gamma, exact=law is FrictionLaw.EXACT) <= 1.2e-5
        with_newton.append(iterations)
        single.problem.wide = wp.zeros((0, 0), dtype=wp.float64, device="cpu")
        without.append(single.run(SOLVE, before, law=law, tolerance=1e-5)[1][1])
    # 141 and 826 with the exact law, 145 and 837 with the convex one
    assert max(with_newton) < 60
    assert sum(without) > 4 * sum(with_newton)


@pytest.mark.parametrize("law", list(FrictionLaw))
@pytest.mark.parametrize("push", [0.0, 0.3])
def test_a_long_chain_is_solved_as_by_the_reference(law, push):
    """From zero, and from impulses near the solution; with a push along the ground that makes it slide."""
    exact = law is FrictionLaw.EXACT
    n, r, blocks, entries = stacked_boxes(6, np.random.default_rng(7))
    r[1:12:3] += push
    expected = solve_contacts(n, r, np.full(len(blocks), 0.5), exact=False)
    single = Single(n, r, blocks, entries)
    single.problem.chain = 1
    for start in (np.zeros(len(r)), 0.9 * expected):
        gamma, (residual, _) = single.run(SOLVE, start, law=law, tolerance=1e-5)
        assert residual <= 1e-5
        # Measured in double, what the kernel says in float: rows of 1 m/s and impulses of 0.3 N·s round by 1e-6 m/s
        assert reference.residual(n, r, blocks, gamma, exact=exact) <= 1.2e-5
        # Impulses of four corners are not unique, velocities are; both laws are one where nothing slides. The reference
        # itself is wrong by 1e-5 m/s where its residual is that; ten times as much for another path to the solution.
        if push == 0.0 or not exact:
            np.testing.assert_allclose(n @ gamma, n @ expected, atol=1e-4)


def is_chain(single):
    """What the step decides of a problem without room for other solvers."""
    single.problem.wide = wp.zeros((NEWTON_VECTORS, len(single.problem.r)), dtype=wp.float64, device="cpu")
    return bool(single.run(CHAIN, np.zeros(len(single.problem.r)))[1][0])


def test_a_long_chain_is_one_whose_bodies_touch_their_neighbours():
    n, r, blocks, entries = stacked_boxes(8, np.random.default_rng(1))
    assert is_chain(Single(n, r, blocks, entries))
    # 5 boxes have 60 rows: few gradient steps with a dense S are cheaper
    assert not is_chain(Single(*stacked_boxes(5, np.random.default_rng(1))))
    # A contact of the first and the last box makes the Hessian wide
    y, slots, w, compliance = entries
    ring = slots.copy()
    ring[-1] = np.concatenate([slots[0][6:], slots[-1][6:]])
    assert not is_chain(Single(n, r, blocks, (y, ring, w, compliance)))
    # Compliant rows have no Newton steps
    assert not is_chain(Single(n, r, blocks, (y, slots, w, compliance + 1e-3)))
    # Where another solver may follow, S is formed for it
    single = Single(n, r, blocks, entries)
    assert not single.run(CHAIN, np.zeros(len(r)))[1][0]


@pytest.mark.parametrize("threads", [1, 2])
def test_a_shaken_stack_moves_in_a_batch_as_it_does_alone(threads):
    """Bit by bit, and twice the same."""
    rng = np.random.default_rng(11)
    kicks = rng.normal(size=(3, 10, 3)) * 0.05

    def end_of(chosen):
        model = scenes.stack().finalize(len(chosen), "cpu")
        sim = sw.Simulation(model, 5e-3, solver=sw.SolverOptions(tolerance=1e-4), threads=threads)
        sim.state.body_v.assign((sim.state.body_v.numpy() + kicks[chosen]).astype(np.float32))
        for _ in range(30):
            sim.step()
        return [getattr(sim.state, name).numpy().copy() for name in ("body_x", "body_rot", "body_v", "body_omega")]

    together, again = end_of([0, 1, 2]), end_of([0, 1, 2])
    for values, same in zip(together, again, strict=True):
        np.testing.assert_array_equal(values, same)
    for world in range(3):
        for values, alone in zip(together, end_of([world]), strict=True):
            np.testing.assert_array_equal(values[world], alone[0])


def test_a_tree_too_large_for_newton_steps_goes_without():
    """Of 264 degrees of freedom: the ends of rows have room for 256, however large the workspace is."""
    n, r, blocks, entries = stacked_boxes(43, np.random.default_rng(1))
    single = Single(n, r, blocks, entries)
    gamma, results = single.run(SOLVE, np.zeros(len(r)), iterations=100)
    single.problem.wide = wp.zeros((0, 0), dtype=wp.float64, device="cpu")
    without, same = single.run(SOLVE, np.zeros(len(r)), iterations=100)
    np.testing.assert_array_equal(gamma, without)
    assert results.tolist() == same.tolist()


def test_a_shaken_stack_keeps_its_tolerance_in_few_iterations():
    """350 iterations per step without Newton steps."""
    sim = sw.Simulation(scenes.stack().finalize(4, "cpu"), 5e-3, solver=sw.SolverOptions(tolerance=1e-4))
    v = sim.state.body_v.numpy()
    v += np.random.default_rng(3).normal(size=v.shape).astype(v.dtype) * 0.05
    sim.state.body_v.assign(v)
    counts, residuals = [], []
    for _ in range(60):
        sim.step()
        counts.append(sim.diagnostics.iterations.numpy().copy())
        residuals.append(sim.diagnostics.cone_residual.numpy().copy())
    assert np.mean(counts) < 120
    assert np.mean(np.array(residuals) <= 1e-4) > 0.99


@pytest.mark.parametrize("capacity", [4, 20, None])
def test_the_workspace_of_a_step_holds_rows_and_tree(capacity):
    """14 free bodies have 84 degrees of freedom, 20 contacts 60 rows: the heap was overwritten."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane()
    for index in range(14):
        body = builder.add_body(f"b{index}", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((index, 0.0, 0.5)))
        builder.add_shape_sphere(body, radius=0.5)
    model = builder.finalize(2, "cpu", contact_capacity=capacity)
    sizes = step_sizes(model, 64, all_solvers=False)
    assert sizes.factor_rows == 84
    assert sizes.wide_rows >= max(84, 3 * model.contact_capacity)
