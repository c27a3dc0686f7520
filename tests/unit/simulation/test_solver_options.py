"""Every solver, law and operator in the step, on the same scenes; and options that are no options."""

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes

SOLVERS = ["apgd", "psor", "spg", "padmm", "interior_point"]
DT = 5e-3


def stepped(builder: sw.ModelBuilder, steps: int, **options: object) -> sw.Simulation:
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, solver=sw.SolverOptions(**options))  # type: ignore[arg-type]
    for _ in range(steps):
        sim.step()
    return sim


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("law", ["exact", "convex"])
def test_every_solver_moves_a_sliding_stack_alike(solver: str, law: str) -> None:
    def slides() -> sw.ModelBuilder:
        builder = scenes.stack(count=3)
        builder.gravity = np.array([4.0, 1.0, -9.0])  # beyond friction 0.5 at the ground: it slides and twists
        return builder

    reference = stepped(slides(), 10, tolerance=1e-7, max_iterations=20000, friction_law=law)
    sim = stepped(slides(), 10, solver=solver, tolerance=1e-6, max_iterations=5000, friction_law=law)
    assert sim.diagnostics.cone_residual.numpy()[0] <= 1e-5
    difference = np.abs(sim.state.body_v.numpy() - reference.state.body_v.numpy()).max()
    # velocities differ by some ten residuals per step in the slow modes of a stack
    assert difference < 1e-3


@pytest.mark.parametrize("scene", ["stack", pytest.param("wall", marks=pytest.mark.slow), "ant"])
def test_the_matrix_free_operator_gives_the_same_motion(scene: str) -> None:
    build = getattr(scenes, scene)
    dense = stepped(build(), 20, tolerance=1e-7, max_iterations=20000, dense_rows=1000)
    free = stepped(build(), 20, tolerance=1e-7, max_iterations=20000, dense_rows=0)
    assert free.diagnostics.constraint_count.numpy()[0] == dense.diagnostics.constraint_count.numpy()[0]
    # both stop at their float32 floor, 1e-6 m/s for a stack, ten times that in its slow modes
    np.testing.assert_allclose(free.state.body_v.numpy(), dense.state.body_v.numpy(), atol=5e-5)


def test_the_fallback_helps_where_masses_differ() -> None:
    few = {"tolerance": 1e-5, "max_iterations": 5}
    alone = stepped(scenes.heavy_on_light(ratio=1000.0), 1, fallback=False, **few)
    fallback = stepped(scenes.heavy_on_light(ratio=1000.0), 1, **few)
    residual = [float(sim.diagnostics.cone_residual.numpy()[0]) for sim in (alone, fallback)]
    # float32 leaves 6e-5 m/s at this mass ratio
    assert residual[1] < 1e-4 < residual[0]


def test_rows_cost_by_what_touches_not_by_capacity() -> None:
    """The solver sees active contacts only: none in the air, whatever the capacity."""
    builder = scenes.pile(height=5.0)
    sim = sw.Simulation(builder.finalize(1, "cpu", contact_capacity=5000), 1e-3)
    sim.step()
    assert sim.contacts.contact_count.numpy()[0] == 0
    assert sim.diagnostics.constraint_count.numpy()[0] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"solver": "newton"}, "solver must be one of apgd, psor, spg, padmm, interior_point, got 'newton'"),
        ({"friction_law": "coulomb"}, "friction_law must be one of exact, convex, got 'coulomb'"),
        ({"contact_model": "soft"}, "contact_model must be one of rigid, smooth, smooth_hooke, got 'soft'"),
    ],
)
def test_unknown_choices_are_named(options: dict[str, str], message: str) -> None:
    with pytest.raises(sw.ModelError, match=message):
        sw.Simulation(scenes.stack(count=1).finalize(1, "cpu"), DT, solver=sw.SolverOptions(**options))  # type: ignore[arg-type]


def test_energy_is_that_of_the_formula() -> None:
    sim = sw.Simulation(scenes.bouncing_balls().finalize(2, "cpu"), 1e-3)
    np.testing.assert_allclose(sim.measure_energy().numpy(), 24034.5, rtol=1e-7)  # 49 balls of 10 kg, 5 m high
    for _ in range(100):
        sim.step()
    # semi-implicit flight: m g² h T / 2 per ball
    np.testing.assert_allclose(24034.5 - sim.measure_energy().numpy(), 49 * 10 * 9.81**2 * 1e-3 * 0.1 / 2, rtol=1e-2)
