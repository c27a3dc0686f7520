"""Worlds with contacts are independent, repeatable, and say when they run out of contact slots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import simwarp as sw
import simwarp.model.model
from simwarp.core.types import Material
from simwarp.scenes.contact import ant, stack
from simwarp.simulation.state import Contacts, State

Arrays = dict[str, np.ndarray]


def scene() -> sw.ModelBuilder:
    """Tumbling boxes and balls that meet each other, and a hinged arm that hits the ground."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    rng = np.random.default_rng(1)
    for index in range(4):
        kind, size = ("box", (0.1, 0.12, 0.14)) if index % 2 else ("sphere", 0.12)
        at = sw.pose((0.05 * index, 0.03 * index, 0.13 + 0.26 * index), (0.1 * index, 0.05, 0.0, 1.0))
        material = Material(friction=0.5, restitution=0.3)
        builder.add_solid(f"b{index}", kind, size, mass=1.0, pose=at, omega=rng.normal(size=3), material=material)
    body = builder.add_body("arm", mass=1.0, inertia=(0.01, 0.1, 0.1), pose=sw.pose((2.0, 0.0, 0.2)))
    builder.add_shape_capsule(body, radius=0.1, half_length=0.2, name="arm", pose=sw.pose((0.3, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", sw.WORLD, body, axis=(0.0, 1.0, 0.0), anchor=(1.5, 0.0, 0.2), friction=0.1)
    return builder


def simulation(worlds: int = 6, builder: Callable[[], sw.ModelBuilder] = scene, **options: Any) -> sw.Simulation:
    return sw.Simulation(builder().finalize(worlds, "cpu", **options), 2e-3)


def stir(sim: sw.Simulation, worlds: range | None = None) -> None:
    """Gives every world velocities of its own: those of world w do not depend on how many there are."""
    v = sim.state.body_v.numpy()
    for row, world in enumerate(worlds or range(len(v))):
        v[row] += 0.3 * np.random.default_rng(world).normal(size=v[row].shape).astype(np.float32)
    sim.state.body_v.assign(v)
    sim.measure()


def everything(sim: sw.Simulation) -> Arrays:
    """State, and contacts as far as they are in use (slots behind the count hold old values)."""
    arrays = {name: getattr(sim.state, name).numpy().copy() for name in State.NAMES}
    count = sim.contacts.contact_count.numpy()
    for name in Contacts.NAMES:
        values = getattr(sim.contacts, name).numpy().copy()
        if values.ndim >= 2 and name.startswith("contact_"):
            for world in range(len(values)):
                values[world, count[world] :] = 0
        arrays[name] = values
    return arrays


def steps(sim: sw.Simulation, count: int) -> Arrays:
    for _ in range(count):
        sim.step()
    return everything(sim)


def assert_equal(one: Arrays, two: Arrays, worlds: list[int] | slice = slice(None)) -> None:
    for name, values in one.items():
        same = np.array_equal(values[worlds], two[name][worlds], equal_nan=True)
        assert same, f"{name} differs"


def test_two_runs_are_identical() -> None:
    runs = []
    for _ in range(2):
        sim = simulation()
        stir(sim)
        runs.append(steps(sim, 60))
    assert_equal(runs[0], runs[1])
    assert runs[0]["contact_count"].min() > 0


@pytest.mark.parametrize("how", ["moved", "nan", "disabled", "turned"])
def test_a_disturbed_world_leaves_the_others_alone(how: str) -> None:
    results = []
    for disturbed in (False, True):
        sim = simulation(per_world=["shape_enabled"])
        stir(sim)
        steps(sim, 20)
        if disturbed and how == "disabled":
            enabled = sim.model.shape_enabled.numpy()
            enabled[3, 1:3] = 0
            sim.model.shape_enabled.assign(enabled)
        elif disturbed:
            name = {"moved": "body_x", "nan": "body_v", "turned": "body_omega"}[how]
            array = getattr(sim.state, name)
            values = array.numpy()
            values[3] = np.nan if how == "nan" else values[3] + 0.05
            array.assign(values)
        results.append(steps(sim, 40))
    assert_equal(results[0], results[1], [0, 1, 2, 4, 5])
    assert not np.array_equal(results[0]["body_x"][3], results[1]["body_x"][3], equal_nan=True)
    if how == "nan":
        assert results[1]["world_status"][3] != 0
        assert any(line.startswith("world 3:") and "NON_FINITE" in line for line in sim.problems())


def test_worlds_do_not_depend_on_their_number() -> None:
    wide = simulation(17)
    stir(wide)
    expected = steps(wide, 40)
    for worlds in (range(1), range(2), range(5, 7)):
        few = simulation(len(worlds))
        stir(few, worlds)
        found = steps(few, 40)
        for name, values in found.items():
            assert np.array_equal(values, expected[name][list(worlds)]), name


def test_snapshot_restores_bitwise() -> None:
    sim = simulation()
    stir(sim)
    steps(sim, 25)
    kept, before = sim.snapshot(), everything(sim)
    first = steps(sim, 25)
    sim.restore(kept)
    assert_equal(everything(sim), before)
    assert_equal(steps(sim, 25), first)


def test_reset_forgets_contacts_and_repeats() -> None:
    sim = simulation()
    first = steps(sim, 30)
    mask = np.array([True, False, True, False, False, True])
    sim.reset(mask)
    count = sim.contacts.contact_count.numpy()
    assert (count[mask] == 0).all()
    assert np.array_equal(count[~mask], first["contact_count"][~mask])
    again = steps(sim, 30)
    assert_equal(again, first, [0, 2, 5])


def test_ant_repeats_bitwise_after_a_reset() -> None:
    sim = simulation(3, ant)
    first = steps(sim, 80)
    sim.reset()
    assert_equal(steps(sim, 80), first)
    assert first["contact_count"].min() > 0


def test_shape_size_per_world() -> None:
    sim = simulation(3, lambda: stack(count=1), per_world=["shape_size"])
    size = sim.model.shape_size.numpy()
    size[:, 1, 2] = [0.25, 0.2, 0.1]
    sim.model.shape_size.assign(size)
    steps(sim, 400)
    # rests on half of its height, within the envelope of float32 gaps and the last of its fall
    assert np.allclose(sim.state.body_x.numpy()[:, 0, 2], [0.25, 0.2, 0.1], atol=1e-5)


def test_shape_friction_per_world() -> None:
    sim = simulation(3, lambda: stack(count=1, friction=0.8), per_world=["shape_friction"])
    friction = np.repeat(np.array([[0.1], [0.4], [0.8]], np.float32), 2, axis=1)
    sim.model.shape_friction.assign(friction)
    sim.control.body_force.assign(np.tile(np.array([5.0, 0.0, 0.0], np.float32), (3, 1, 1)))
    steps(sim, 100)
    # 1 kg: a = 5 - mu g, or it sticks; impulses to the solver's 1e-5 m/s in each of 100 steps
    expected = [0.2 * (5.0 - 0.1 * 9.81), 0.2 * (5.0 - 0.4 * 9.81), 0.0]
    assert np.allclose(sim.state.body_v.numpy()[:, 0, 0], expected, atol=1e-3)


def test_shape_restitution_per_world() -> None:
    def ball() -> sw.ModelBuilder:
        builder = sw.ModelBuilder()
        builder.add_shape_plane()
        builder.add_solid("ball", "sphere", 0.25, mass=1.0, pose=sw.pose((0.0, 0.0, 0.25)), velocity=(0.0, 0.0, -1.0))
        return builder

    sim = simulation(3, ball, per_world=["shape_restitution"])
    sim.model.shape_restitution.assign(np.repeat(np.array([[0.0], [0.5], [1.0]], np.float32), 2, axis=1))
    steps(sim, 1)
    assert np.allclose(sim.state.body_v.numpy()[:, 0, 2], [0.0, 0.5, 1.0], atol=1e-4)


def test_overflow_keeps_the_deepest_and_flags_its_world() -> None:
    """Four balls at depths 1 to 4 mm, two slots; in world 1 all but one are high up."""

    def balls() -> sw.ModelBuilder:
        builder = sw.ModelBuilder()
        builder.add_shape_plane()
        for index, depth in enumerate((2e-3, 4e-3, 1e-3, 3e-3)):
            at = sw.pose((index, 0.0, 0.25 - depth))
            builder.add_solid(f"b{index}", "sphere", 0.25, mass=1.0, pose=at)
        return builder

    sim = simulation(3, balls, contact_capacity=2)
    x = sim.state.body_x.numpy()
    x[1, 1:, 2] += 1.0
    sim.state.body_x.assign(x)
    sim.measure()
    steps(sim, 1)
    assert sim.contacts.contact_overflow.numpy().tolist() == [2, 0, 2]
    assert sim.contacts.contact_count.numpy().tolist() == [2, 1, 2]
    # float32 of 4 mm
    assert np.allclose(np.sort(sim.contacts.contact_gap.numpy()[0]), [-4e-3, -3e-3], atol=1e-7)
    lines = [line for line in sim.problems() if "contact_capacity" in line]
    assert [line.split(":")[0] for line in lines] == ["world 0", "world 2"]
    assert all("contact_capacity=4" in line for line in lines)


def test_enough_slots_are_no_problem() -> None:
    sim = simulation()
    steps(sim, 60)
    assert not any("contact_capacity" in line for line in sim.problems())
    assert not sim.contacts.contact_overflow.numpy().any()


def many() -> sw.ModelBuilder:
    """All kinds of shapes in one heap, some of a group of their own, some of one body."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    builder.add_shape_box(sw.WORLD, half=(0.5, 0.5, 0.05), pose=sw.pose((0.3, 0.3, 0.05)), name="step")
    rng = np.random.default_rng(4)
    kinds = ["sphere", "box", "capsule", "cylinder", "ellipsoid", "cone"]
    for index in range(18):
        at = np.array([0.3 * (index % 3), 0.3 * (index // 3 % 3), 0.2 + 0.3 * (index // 9)])
        q = rng.normal(size=4)
        kind = kinds[index % 6]
        sizes: dict[str, Any] = {"sphere": 0.15, "box": (0.15, 0.1, 0.12), "ellipsoid": (0.15, 0.1, 0.12)}
        size = sizes.get(kind, (0.1, 0.1))
        mask = 0x7FFFFFFF if index % 5 else 1
        builder.add_solid(f"b{index}", kind, size, mass=1.0, pose=sw.pose(at, q), mask=mask, group=1 + (index % 7 == 0))
    builder.exclude_collision(0, 1)
    return builder


def test_grid_finds_what_the_list_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = simulation(2, many)
    monkeypatch.setattr(simwarp.model.model, "LISTED_PAIRS", 0)
    grid = simulation(2, many)
    assert listed.model.topology.grid_buckets == 0
    assert grid.model.topology.grid_buckets > 0
    for step in range(40):
        if step % 10 == 0:
            stir(listed)
        grid.restore(listed.snapshot())
        one, two = steps(listed, 1), steps(grid, 1)
        for world in range(2):
            found = [contact_set(arrays, world) for arrays in (one, two)]
            assert found[0] == found[1]
            assert len(found[0]) > 5


def contact_set(arrays: Arrays, world: int) -> set[tuple[int, int, int, float]]:
    count = int(arrays["contact_count"][world])
    names = ("contact_shape0", "contact_shape1", "contact_feature", "contact_gap")
    return set(zip(*(arrays[name][world, :count].tolist() for name in names), strict=True))
