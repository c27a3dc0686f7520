"""What a step costs the host: one recorded launch per sub-step, two with contacts; no allocation, no copy, no read."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.launch_loop import LaunchLoop
from tests.reference.mechanisms import random_mechanism

MODELS: dict[str, Callable[[], ModelBuilder]] = {
    "pendulum": scenes.pendulum, "four_bar": scenes.four_bar,
    "everything": lambda: random_mechanism(0, bounds=True, couplings=True),
}  # fmt: skip


class Counter:
    """Counts calls of functions while it is active."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls: dict[str, int] = {}
        self._monkeypatch = monkeypatch

    def watch(self, owner: object, name: str) -> None:
        label = f"{getattr(owner, '__name__', owner)}.{name}"
        original = getattr(owner, name)
        self.calls[label] = 0

        def counted(*args: object, **kwargs: object) -> object:
            self.calls[label] += 1
            return original(*args, **kwargs)

        self._monkeypatch.setattr(owner, name, counted)


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("reactions", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_a_step_allocates_launches_and_reads_nothing(name, substeps, reactions, monkeypatch):
    model = MODELS[name]().finalize(4, "cpu")
    sim = sw.Simulation(model, 1e-3, substeps=substeps, joint_reactions=reactions, joint_accelerations=reactions)
    sim.step()
    counter = Counter(monkeypatch)
    for function in ("launch", "zeros", "empty", "full", "clone", "copy", "synchronize", "synchronize_device"):
        counter.watch(wp, function)
    for method in ("__init__", "numpy", "list", "assign", "fill_", "zero_", "__getitem__"):
        counter.watch(wp.array, method)
    counter.watch(type(sim.model.device.default_allocator), "allocate")
    counter.watch(wp.Launch, "launch")
    counter.watch(wp, "capture_launch")
    turns: list[int] = []
    loop = LaunchLoop.run

    def run(self: LaunchLoop, times: int) -> None:
        turns.append(times)
        loop(self, times)

    monkeypatch.setattr(LaunchLoop, "run", run)
    before_launches = sim.shares.launches
    before = sim.time.ptr
    for _ in range(5):
        sim.step()
    monkeypatch.undo()
    assert {label: count for label, count in counter.calls.items() if count} == {}
    assert turns == [substeps] * 5  # native code makes all launches of a step
    assert sim.shares.launches - before_launches == 5 * substeps * len(sim.physics_commands)
    assert sim.time.ptr == before
    np.testing.assert_allclose(sim.time.numpy(), 6e-3, rtol=1e-6)  # and they did step


def test_the_hooks_do_count(monkeypatch):
    """The same hooks see what other calls do, or the test above could not fail."""
    model = scenes.pendulum().finalize(2, "cpu")
    counter = Counter(monkeypatch)
    for function in ("launch", "zeros", "copy"):
        counter.watch(wp, function)
    for method in ("__init__", "numpy"):
        counter.watch(wp.array, method)
    counter.watch(type(model.device.default_allocator), "allocate")
    sim = sw.Simulation(model, 1e-3)
    sim.reset([True, False])
    sim.snapshot()
    sim.state.joint_q.numpy()
    monkeypatch.undo()
    assert all(count > 0 for count in counter.calls.values()), counter.calls


def test_python_memory_does_not_grow():
    sim = sw.Simulation(scenes.pendulum().finalize(2, "cpu"), 1e-3)
    for _ in range(20):
        sim.step()
    gc.collect()
    tracemalloc.start()
    start = tracemalloc.get_traced_memory()[0]
    for _ in range(1000):
        sim.step()
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - start
    tracemalloc.stop()
    assert grown < 2000, f"{grown} bytes over 1000 steps"


def test_a_recorded_step_sees_what_is_written_later():
    """The command holds the arrays, not their values: controls, parameters and resets reach it."""
    sim = sw.Simulation(scenes.pendulum().finalize(2, "cpu"), 1e-3)
    sim.model.gravity.assign([(0.0, 0.0, 0.0)])
    sim.control.joint_force[0, 0] = 2.0
    sim.step()
    # 1 kg on a 1 m arm
    np.testing.assert_allclose(sim.state.joint_qd.numpy()[:, 0], (2e-3, 0.0), rtol=1e-5)


def test_arrays_keep_their_place():
    sim = sw.Simulation(scenes.four_bar().finalize(3, "cpu"), 1e-3)
    pointers = {name: getattr(sim.state, name).ptr for name in sim.state.NAMES}
    saved = sim.snapshot()
    sim.step()
    sim.set_joint_state(None, sim.state.joint_q.numpy(), None)
    sim.reset()
    sim.restore(saved)
    assert pointers == {name: getattr(sim.state, name).ptr for name in sim.state.NAMES}


@pytest.mark.parametrize(("keyword", "value", "message"), [
    ("dt", 0.0, "dt must be > 0 s, got 0.0"), ("dt", -1.0, "dt must be"), ("dt", float("nan"), "dt must be"),
    ("dt", float("inf"), "dt must be"), ("dt", "fast", "dt must be"),
    ("substeps", 0, "substeps must be at least 1, got 0"), ("substeps", 1.5, "substeps must be"),
])  # fmt: skip
def test_unusable_arguments(keyword, value, message):
    model = scenes.pendulum().finalize(1, "cpu")
    arguments = {"dt": 0.01} | {keyword: value}
    with pytest.raises(sw.ModelError, match=message):
        sw.Simulation(model, **arguments)
