"""Copies of worlds: what is taken, what is refused in one line, and that every array that may differ is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp.core.arrays import WritableArray
from simwarp.model.builder import ModelBuilder
from simwarp.sensors.interface import Mount
from simwarp.sensors.motion.imu import Imu
from tests.physics.test_world_copies import CASES, WORLDS

DT = 5e-3


def boxes(names: tuple[str, ...] = ("a", "b")) -> ModelBuilder:
    builder = ModelBuilder()
    for index, name in enumerate(names):
        builder.add_body(name, mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.6 * index, 0, 0.12)))
        builder.add_shape_box(index, half=(0.1, 0.1, 0.1))
    builder.add_shape_plane(name="ground")
    return builder


def moving(worlds: int = 5) -> sw.Simulation:
    model = boxes().finalize(worlds, "cpu", per_world=("body_mass",))
    sim = sw.Simulation(model, DT, sensors=[Imu(model, Mount("a"))])
    sim.control.body_force[:, 0] = np.arange(3.0 * worlds).reshape(worlds, 3)
    model.body_mass[:, 1] = np.linspace(1.0, 2.0, worlds)
    sim.step(8)
    return sim


def content(sim: sw.Simulation) -> dict[str, np.ndarray]:
    return {name: array.numpy().copy() for name, array in sim.snapshot().arrays().items()}


WAYS: dict[str, Any] = {
    "indices": [0, 3], "numpy": np.array([0, 3]), "a tuple with the source": (0, 3, 2),
    "mask": [True, False, False, True, False], "numpy's mask": np.array([True, False, True, True, False]),
    "torch's mask": torch.tensor([True, False, False, True, False]),
    "Warp's mask": wp.array([True, False, False, True, False], dtype=wp.bool, device="cpu"),
}  # fmt: skip


@pytest.mark.parametrize("targets", WAYS.values(), ids=WAYS)
def test_targets_are_indices_or_a_mask(targets):
    sim = moving()
    before = content(sim)
    sim.copy_worlds(2, targets)
    for name, values in content(sim).items():
        if values.shape[0] == 5:
            wanted = before[name][[2, 1, 2, 2, 4]]
            assert values.tobytes() == wanted.tobytes(), name
    assert sim.model.body_mass.numpy()[[0, 3], 1].tolist() == [1.5, 1.5]


def test_all_worlds_without_targets_and_none_of_an_empty_list():
    sim = moving()
    before = content(sim)
    sim.copy_worlds(1, [])
    assert all(before[name].tobytes() == values.tobytes() for name, values in content(sim).items())
    sim.copy_worlds(1)
    place = content(sim)["state.body_x"]
    assert (place == before["state.body_x"][1]).all()


def test_each_target_may_have_a_source_of_its_own():
    sim = moving()
    before = content(sim)["state.body_x"]
    sim.copy_worlds([1, 4], [0, 2])
    assert content(sim)["state.body_x"].tobytes() == before[[1, 1, 4, 3, 4]].tobytes()


def test_parameters_may_stay():
    sim = moving()
    before = sim.model.body_mass.numpy().copy()
    sim.copy_worlds(0, parameters=False)
    assert (sim.model.body_mass.numpy() == before).all()


def test_what_all_worlds_share_stays_shared():
    real, imagined = moving(), sw.Simulation(boxes().finalize(2, "cpu"), DT)
    real = sw.Simulation(boxes().finalize(3, "cpu", per_world=("body_mass",)), DT)
    real.model.body_mass[:, 0] = [1.0, 2.0, 3.0]
    imagined.copy_worlds(2, of=real)
    assert imagined.model.body_mass.numpy().tolist() == [[1.0, 1.0]]


def test_a_launch_recorded_once_copies_whatever_the_mask_says():
    """The mask is read on the device when the copy runs, as in a captured graph."""
    sim = moving()
    sim.copy_worlds(0, [])
    mask = wp.zeros(5, dtype=wp.bool, device="cpu")
    with wp.ScopedCapture(device="cpu") as capture:
        sim.copy_worlds(4, mask)
    before = content(sim)["state.body_x"]
    mask.assign([False, True, False, False, False])
    wp.capture_launch(capture.graph)
    assert content(sim)["state.body_x"].tobytes() == before[[0, 4, 2, 3, 4]].tobytes()


def no_simulation(value: Any) -> Any:
    """Something else than an argument should be."""
    return value


WRONG: dict[str, tuple[Callable[[sw.Simulation], object], str]] = {
    "no such source": (lambda sim: sim.copy_worlds(5), "source must be an integer >= 0 and <= 4, got 5"),
    "negative": (lambda sim: sim.copy_worlds(-1), "source must be an integer >= 0, got -1"),
    "no such target": (lambda sim: sim.copy_worlds(0, [1, 7]), "each of targets must be an integer >= 0 and <= 4"),
    "twice": (lambda sim: sim.copy_worlds(0, [1, 2, 1]), "targets must be different worlds, got 1 twice"),
    "source overwritten": (lambda sim: sim.copy_worlds([0, 1], [1, 2]), "got world 1 as source and as target"),
    "swap": (lambda sim: sim.copy_worlds([0, 1], [1, 0]), "a source must stay as it is"),
    "too few": (lambda sim: sim.copy_worlds([0, 1], [2, 3, 4]), "one for each of 3 targets, got 2"),
    "fractions": (lambda sim: sim.copy_worlds(0, [0.5]), "targets must be indices of worlds, got [0.5]"),
    "words": (lambda sim: sim.copy_worlds(0, "all"), "targets must be indices of worlds, got 'all'"),
    "short mask": (lambda sim: sim.copy_worlds(0, [True]), "targets must have shape (5,) (worlds), got (1,)"),
    "tensor of ints": (lambda sim: sim.copy_worlds(0, torch.tensor([1])), "targets must be of bool"),
    "of no simulation": (lambda sim: sim.copy_worlds(0, of=no_simulation(3)), "of must be a Simulation, got 3"),
    "parameters": (
        lambda sim: sim.copy_worlds(0, parameters=no_simulation(1)),
        "parameters must be True or False, got 1",
    ),
    "other bodies": (
        lambda sim: sim.copy_worlds(0, of=sw.Simulation(boxes(("a", "c")).finalize(2, "cpu"), DT)),
        "of must be of a Simulation with the same model, force elements and sensors, but they differ (bodies: here 'b'",
    ),
    "no such snapshot": (lambda sim: sim.snapshot(world=5), "snapshot: world must be an integer >= 0 and <= 4, got 5"),
    "no such worlds": (lambda sim: sim.restore(sim.snapshot(world=1), [9]), "restore: each of worlds must be"),
    "worlds twice": (lambda sim: sim.restore(sim.snapshot(world=1), [0, 0]), "worlds must be different worlds"),
}


@pytest.mark.parametrize(("call", "told"), WRONG.values(), ids=WRONG)
def test_bad_input_is_refused_in_one_line_and_changes_nothing(call, told):
    sim = moving()
    before = content(sim)
    with pytest.raises(sw.ModelError) as caught:
        call(sim)
    assert told in str(caught.value)
    assert str(caught.value).isprintable()
    assert all(before[name].tobytes() == values.tobytes() for name, values in content(sim).items())


# ---- snapshots of one world ------------------------------------------------------------------------------------------


def test_a_snapshot_of_one_world_is_that_of_a_simulation_of_one(tmp_path):
    many, alone = moving(), moving(1)
    many.snapshot(world=3).save(tmp_path / "one.npz")
    alone.restore(sw.Snapshot.load(tmp_path / "one.npz", alone))
    assert content(alone)["state.body_x"].tobytes() == content(many)["state.body_x"][3:4].tobytes()
    many.restore(alone.snapshot(), [0, 1])
    assert content(many)["state.body_x"][0].tobytes() == content(alone)["state.body_x"][0].tobytes()


def test_some_worlds_of_a_snapshot_of_all():
    sim = moving()
    kept = sim.snapshot()
    before = content(sim)
    sim.step(3)
    later = content(sim)
    sim.restore(kept, [1, 2])
    found = content(sim)
    for name, values in found.items():
        if values.shape[0] == 5:
            assert values[[1, 2]].tobytes() == before[name][[1, 2]].tobytes(), name
            assert values[[0, 3, 4]].tobytes() == later[name][[0, 3, 4]].tobytes(), name


# ---- every array that may differ by world is known -------------------------------------------------------------------


def arrays_in(thing: Any, seen: set[int], path: str) -> Iterator[tuple[str, Any]]:
    """Writable arrays that are public attributes of an object or of what it holds, with where they are."""
    if id(thing) in seen:
        return
    seen.add(id(thing))
    if isinstance(thing, WritableArray):
        yield path, thing
    elif isinstance(thing, dict):
        for name, part in thing.items():
            yield from arrays_in(part, seen, f"{path}[{name!r}]")
    elif hasattr(thing, "_ctype") or type(thing).__module__.startswith("simwarp."):
        for name, part in vars(thing).items() if hasattr(thing, "__dict__") else ():
            if not name.startswith("_"):
                yield from arrays_in(part, seen, f"{path}.{name}")


REPORTS = {
    "load", "slip_ratio", "slip_angle", "camber", "deflection", "force", "torque", "force_w", "torque_w", "state",
    "sinkage", "touched", "tension", "speed", "traction", "resistance", "point_force", "point_arm",
}  # fmt: skip
"""Of tires, soil and belts, which are written anew in every sub-step; so are the events of a clock, `tick`. The `state`
of tires is in the vehicle's memory, but of those that make no forces, which remember nothing."""


@pytest.mark.parametrize("case", CASES)
def test_every_array_that_users_may_write_is_copied(case):
    sim, _ = CASES[case]()
    parts: tuple[Any, ...] = (*sim.elements, *sim.sensors)
    copied = [array for part in parts for each in (part.memory, part.world_parameters) for array in each.values()]
    spans = [(each.ptr, each.ptr + each.size * wp.types.type_size_in_bytes(each.dtype)) for each in copied if each.size]
    seen = {id(sim), id(sim.model), id(sim.state), id(sim.control), id(sim.contacts)}
    for part in parts:
        for path, array in arrays_in(part, seen, type(part).__name__):
            if not array.size or array.shape[0] != WORLDS or any(first <= array.ptr < end for first, end in spans):
                continue  # a view begins where its array does, or behind
            assert path.rpartition(".")[2] in REPORTS or ".frames.tick." in path or ".reports." in path, path
