"""Islands: what stands apart from the others in a world moves as it does alone, bit by bit, and obeys the laws."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import Material
from simwarp.scenes.contact import stack
from simwarp.simulation.step_sizes import step_layouts, step_sizes
from tests.reference.contact_step import ContactReference
from tests.reference.yards import PARTS, content, yard

DT = 2e-3
SOLVES: dict[str, dict[str, Any]] = {
    "apgd": {}, "apgd-rows": {"dense_rows": 0}, "newton": {"tolerance": 1e-7}, "convex": {"friction_law": "convex"},
    "psor": {"solver": "psor"}, "psor-rows": {"solver": "psor", "dense_rows": 0}, "spg": {"solver": "spg"},
    "padmm": {"solver": "padmm"}, "padmm-mixed": {"solver": "padmm", "dense_rows": 15},
    "interior_point": {"solver": "interior_point", "max_iterations": 25},
    "fallback": {"fallback": True, "max_iterations": 5},
}  # fmt: skip


def simulation(parts: Sequence[str], *, worlds: int = 2, ordered: bool = True, **options: Any) -> sw.Simulation:
    """A yard whose second world moves differently; with the options that a model would choose by what it contains."""
    solver = sw.SolverOptions(**{"refinement": 0, "position_projection": 1, "fallback": False} | options)
    sim = sw.Simulation(yard(parts, ordered=ordered).finalize(worlds, "cpu"), DT, solver=solver, joint_reactions=True)
    v = sim.state.body_v.numpy()
    v[1:] += 0.1
    sim.state.body_v.assign(v)
    sim.measure()
    return sim


def assert_same(alone: sw.Simulation, together: sw.Simulation, part: str) -> None:
    among = content(part, together)
    for name, values in content(part, alone).items():
        assert values.tobytes() == among[name].tobytes(), (part, name)


@pytest.mark.sweep
@pytest.mark.parametrize("options", SOLVES.values(), ids=SOLVES)
def test_what_stands_apart_equals_itself_alone(options: dict[str, Any]) -> None:
    """A box that slides, boxes that topple and crash, a linkage, drives: among all the others, and alone."""
    together = simulation(PARTS, **options)
    alone = {part: simulation([part], **options) for part in PARTS}
    blocks = np.zeros(2, int)
    for _ in range(10):
        together.advance(50)
        for part, sim in alone.items():
            sim.advance(50)
            assert_same(sim, together, part)
        reports = [sim.diagnostics for sim in alone.values()]
        for name in ("iterations", "cone_residual"):
            each = np.array([getattr(report, name).numpy() for report in reports])
            np.testing.assert_array_equal(getattr(together.diagnostics, name).numpy(), each.max(axis=0))
        counted = np.sum([report.constraint_count.numpy() for report in reports], axis=0)
        np.testing.assert_array_equal(together.diagnostics.constraint_count.numpy(), counted)
        blocks = np.maximum(blocks, counted)
    assert blocks.min() >= 20


def test_the_order_of_joints_changes_nothing() -> None:
    """Rows of limits stand before those of contacts, whoever they belong to."""
    together = simulation(PARTS, ordered=False)
    together.advance(200)
    for part in PARTS:
        alone = simulation([part], ordered=False)
        alone.advance(200)
        assert_same(alone, together, part)


def test_islands_join_and_part_again() -> None:
    """Two boxes collide, part, and stop: alone, joined and alone again, like in a world without a third."""

    def boxes(third: bool) -> sw.Simulation:
        builder = sw.ModelBuilder()
        builder.add_shape_plane(material=Material(friction=0.2, restitution=0.6))
        for index, (x, v) in enumerate([(0.0, 1.5), (0.6, 0.0), (30.0, 0.3)][: 3 if third else 2]):
            builder.add_solid(
                f"b{index}", "box", (0.1, 0.1, 0.1), mass=1.0 + index, pose=sw.pose((x, 0.0, 0.1)),
                velocity=(v, 0.0, 0.0), material=Material(friction=0.2, restitution=0.6),
            )  # fmt: skip
        return sw.Simulation(builder.finalize(1, "cpu"), DT)

    pair, three = boxes(False), boxes(True)
    gaps = []
    for _ in range(300):
        pair.step()
        three.step()
        x = pair.state.body_x.numpy()
        assert x.tobytes() == three.state.body_x.numpy()[:, :2].tobytes()
        gaps.append(x[0, 1, 0] - x[0, 0, 0] - 0.2)
    nearest = int(np.argmin(gaps))
    assert 50 < nearest < 290
    assert gaps[0] > 0.3 < gaps[-1] + 0.25
    assert gaps[nearest] < 2e-3 < gaps[-1]


def test_momentum_of_crashes_side_by_side() -> None:
    """Pairs of bodies that meet head-on in the air: each keeps its momentum."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    rng = np.random.default_rng(4)
    masses = rng.uniform(1.0, 5.0, (4, 2))
    for pair in range(4):
        for side in range(2):
            builder.add_solid(
                f"b{pair}_{side}", "box", (0.2, 0.15, 0.1), mass=masses[pair, side],
                pose=sw.pose((0.5 * side, 5.0 * pair + 0.05 * side, 0.02 * side)),
                velocity=((1.0 + pair) * (1 - 2 * side), 0.1, 0.0), material=Material(friction=0.5, restitution=0.3),
            )  # fmt: skip
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT)

    def momenta() -> tuple[np.ndarray, np.ndarray]:
        v = sim.state.body_v.numpy()[0].astype(float).reshape(4, 2, 3)
        return (masses[..., None] * v).sum(axis=1), v

    before, start = momenta()
    sim.advance(150)
    after, end = momenta()
    assert np.abs(end - start).max(axis=(1, 2)).min() > 0.5  # all of them met
    # float32 speeds of 5 m/s, rounded at each of the few steps in contact
    np.testing.assert_allclose(after, before, atol=1e-5 * np.abs(masses).max() * 5.0)


@pytest.mark.parametrize("dense_rows", [128, 0])
@pytest.mark.parametrize(("apart", "seed"), [(0.1995, 1), (0.1994, 4)])  # where the reference itself converges
def test_several_islands_against_the_reference(dense_rows: int, apart: float, seed: int) -> None:
    """Balls that roll, slide and press on each other in heaps: all of a world are one problem for the reference.

    Rows take their overlaps of up to 0.8 mm away: a fiftieth of the depenetration velocity in a step is 1 mm.
    """
    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=Material(friction=0.5))
    rng = np.random.default_rng(seed)
    for heap in range(4):
        for index in range(1 + heap % 3):
            builder.add_solid(
                f"ball{heap}_{index}", "sphere", 0.1, mass=1.0 + 0.3 * index, material=Material(friction=0.5),
                pose=sw.pose((3.0 * heap + apart * index, 0.01 * index, 0.0995)), velocity=0.3 * rng.normal(size=3),
                omega=rng.normal(size=3),
            )  # fmt: skip
    options = sw.SolverOptions(tolerance=1e-7, max_iterations=2000, dense_rows=dense_rows, contact_margin=0.1)
    options = dataclasses.replace(options, max_depenetration_velocity=50.0)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3, solver=options)
    reference = ContactReference(builder, 1e-3, envelope=0.1, max_depenetration_velocity=50.0)
    for _ in range(5):
        sim.step()
        reference.step()
        assert reference.solve_residual < 2e-7
    assert sim.diagnostics.constraint_count.numpy()[0] == 10
    # gaps are formed in float32 and corrected within a step (test_contact_step.py)
    allowed = 3.0 * (0.5 * 0.2 * float(np.finfo(np.float32).eps) / 1e-3 + 1e-5)
    assert np.abs(sim.state.body_v.numpy()[0] - reference.v).max() < allowed
    assert np.abs(sim.state.body_omega.numpy()[0] - reference.omega).max() < allowed / 0.1


def test_the_number_of_worlds_and_their_neighbours_change_nothing() -> None:
    few, many = simulation(PARTS, worlds=2), simulation(PARTS, worlds=17)
    v = many.state.body_v.numpy()
    v[3] += 0.5
    many.state.body_v.assign(v)
    few.advance(100)
    many.advance(100)
    x, expected = many.state.body_x.numpy(), few.state.body_x.numpy()
    assert x[0].tobytes() == expected[0].tobytes()
    assert all(x[world].tobytes() == expected[1].tobytes() for world in range(1, 17) if world != 3)
    assert x[3].tobytes() != expected[1].tobytes()


def test_snapshot_and_masked_reset() -> None:
    sim = simulation(PARTS)
    sim.advance(60)
    snapshot = sim.snapshot()
    sim.advance(60)
    after = {part: content(part, sim) for part in PARTS}
    sim.restore(snapshot)
    sim.advance(60)
    for part in PARTS:
        for name, values in content(part, sim).items():
            assert values.tobytes() == after[part][name].tobytes(), (part, name)


def test_islands_within_the_dense_limit_are_dense_though_the_world_is_not() -> None:
    """PADMM works on the dense matrix alone: four stacks of 48 rows in a world with a limit of 60."""

    def stacks(count: int, solver: str) -> sw.Simulation:
        builder = sw.ModelBuilder()
        builder.add_shape_plane(material=Material(friction=0.5))
        for place in range(count):
            for level in range(4):
                builder.add_solid(
                    f"b{place}_{level}", "box", (0.2, 0.2, 0.2), mass=1.0, material=Material(friction=0.5),
                    pose=sw.pose((2.0 * place, 0.0, 0.2 + 0.4 * level)),
                )  # fmt: skip
        solver_options = sw.SolverOptions(solver=solver, dense_rows=60, tolerance=1e-6)
        sim = sw.Simulation(builder.finalize(1, "cpu"), 5e-3, solver=solver_options)
        sim.advance(3)
        return sim

    one, four = stacks(1, "padmm"), stacks(4, "padmm")
    assert four.diagnostics.constraint_count.numpy()[0] == 64
    assert four.diagnostics.iterations.numpy()[0] == one.diagnostics.iterations.numpy()[0]
    assert four.state.body_v.numpy()[0, :4].tobytes() == one.state.body_v.numpy()[0].tobytes()
    descent = stacks(1, "apgd")  # what stands in without a dense matrix
    assert descent.state.body_v.numpy().tobytes() != one.state.body_v.numpy().tobytes()


def test_scratch_grows_by_the_number_of_units() -> None:
    def room(count: int) -> int:
        model = stack(count=count).finalize(1, "cpu")
        layouts = step_layouts(model, step_sizes(model, 0, False), 1)
        newton = 4 * step_sizes(model, 0, False).factor_rows ** 2
        return sum(4 * int(np.prod(layout.shape)) for layout in layouts.values()) - newton

    for count in (10, 40):
        assert room(count) <= 1.2 * count / 5 * room(5)
