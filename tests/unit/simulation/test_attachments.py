"""Base classes of force elements and sensors: hooks that do nothing, mistyped hooks, one Simulation for each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.sensors import Field, FrameSensor, Imu, Mount, Schedule
from tests.unit.sensors.sensor_probe import Probe, ball

Made = Callable[[sw.Model], sw.Simulation]


def refused(make: Callable[[], Any]) -> str:
    with pytest.raises(sw.ModelError) as caught:
        make()
    assert "\n" not in str(caught.value)
    return str(caught.value)


class Nothing(sw.ForceElement):
    """Overrides no hook."""


class Blind(sw.Sensor):
    """Has what a sensor must have, and overrides no hook."""

    name = "blind"

    def __init__(self, model: sw.Model) -> None:
        self._data = wp.zeros((model.world_count, 1), dtype=float, device=model.device)
        self._time = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
        self._valid = wp.full(model.world_count, True, dtype=wp.bool, device=model.device)

    data = property(lambda self: self._data)
    timestamp = property(lambda self: self._time)
    valid = property(lambda self: self._valid)


def test_hooks_do_nothing_by_default():
    model = scenes.pendulum().finalize(2, "cpu")
    bare = sw.Simulation(model, 1e-3)
    with_both = sw.Simulation(model, 1e-3, elements=[Nothing()], sensors=[Blind(model)])
    assert len(with_both.physics_commands) == len(bare.physics_commands)
    assert with_both.sensor_commands == [[]]
    for simulation in (bare, with_both):
        simulation.step(5)
        simulation.reset(np.array([True, False]))
        simulation.restore(simulation.snapshot())
    assert with_both.problems() == []
    assert (with_both.state.joint_q.numpy() == bare.state.joint_q.numpy()).all()


@pytest.mark.parametrize(
    ("base", "name", "hook"),
    [
        (sw.ForceElement, "record_afer", "record_after"), (sw.ForceElement, "recrod", "record"),
        (sw.ForceElement, "recordReset", "record_reset"), (sw.ForceElement, "record_output", "record_outputs"),
        (sw.ForceElement, "world_problem", "world_problems"), (sw.ForceElement, "implict", "implicit"),
        (sw.ForceElement, "asigned_bodies", "assigned_bodies"), (sw.ForceElement, "memroy", "memory"),
        (sw.Sensor, "begni", "begin"), (sw.Sensor, "chekc", "check"), (sw.Sensor, "checks", "check"),
        (sw.Sensor, "record_intervals", "record_interval"),
    ],
)  # fmt: skip
def test_a_mistyped_hook_is_one_line(base: type, name: str, hook: str) -> None:
    found = refused(lambda: type("Mine", (base,), {name: lambda self: ()}))
    rule = f"class Mine: '{name}' must not be mistaken for '{hook}' of {base.__name__}"
    assert found == f"{rule}; write it so, or give it another name"


@pytest.mark.parametrize(
    "name",
    [
        "record_rate",
        "memories",
        "names",
        "measured",
        "height",
        "restart",
        "record_mask",
        "before",
        "beginning",
        "dates",
    ],
)
def test_names_of_ones_own_are_fine(name: str) -> None:
    for base in (sw.ForceElement, sw.Sensor):
        assert issubclass(type("Mine", (base,), {name: lambda self: ()}), base)


def test_a_name_near_a_hook_that_is_overridden_is_ones_own() -> None:
    type("Mine", (sw.ForceElement,), {"record": lambda self, simulation, dt: (), "records": lambda self: ()})
    type("Own", (FrameSensor,), {"checks": lambda self: ()})


def test_what_looks_like_an_element_or_a_sensor_is_refused():
    class Looks:
        name = "looks"
        memory: Any = None

        def record(self, simulation: Any, dt: float) -> Any:
            return ()

        def begin(self, simulation: Any, mask: Any) -> None: ...

    model = scenes.pendulum().finalize(1, "cpu")
    wrong: Any = Looks()
    found = refused(lambda: sw.Simulation(model, 1e-3, elements=[wrong]))
    assert found.startswith("Simulation: elements must be force elements, got ")
    assert found.endswith("or derive a class of your own from simwarp.ForceElement")
    found = refused(lambda: sw.Simulation(model, 1e-3, sensors=[wrong]))
    assert found.startswith("Simulation: sensors must be sensors, got ")
    assert found.endswith("or derive a class of your own from simwarp.Sensor")
    nameless = Blind(model)
    nameless.name = ""
    found = refused(lambda: sw.Simulation(model, 1e-3, sensors=[nameless]))
    assert found == "Simulation: a sensor must have a name, got a Blind without; set .name"


def test_a_sensor_without_data_cannot_be_made():
    class Empty(sw.Sensor):
        name = "empty"

    with pytest.raises(TypeError, match="data"):
        Empty()  # type: ignore[abstract]


class Counter(sw.ForceElement):
    """A force element with a state, whose recording may fail."""

    def __init__(self, model: sw.Model, *, fails: bool = False) -> None:
        self.count = wp.zeros(model.world_count, dtype=int, device=model.device)
        self.fails = fails

    @property
    def memory(self) -> dict[str, wp.array]:
        return {"count": self.count}

    def record(self, simulation: sw.StepContext, dt: float) -> tuple[Any, ...]:
        if self.fails:
            raise RuntimeError("out of memory")
        return ()


def test_an_element_belongs_to_one_simulation():
    model = scenes.pendulum().finalize(2, "cpu")
    element = Counter(model)
    simulation = sw.Simulation(model, 1e-3, elements=[element])
    words = "force element Counter: is part of a Simulation already; make one for each"
    assert refused(lambda: sw.Simulation(model, 1e-3, elements=[element])) == words
    del simulation  # its state is in the element's memory: it is not as built
    assert refused(lambda: sw.Simulation(model, 1e-3, elements=[element])) == words


def test_what_could_not_be_built_frees_its_parts():
    model = ball(2)
    good, bad = Counter(model), Counter(model, fails=True)
    imu, probe = Imu(model, Mount("ball")), Probe(model, Schedule(rate=100.0))
    with pytest.raises(RuntimeError, match="out of memory"):
        sw.Simulation(model, 0.01, elements=[good, bad], sensors=[imu, probe])
    bad.fails = False
    simulation = sw.Simulation(model, 0.01, elements=[good, bad], sensors=[imu, probe])
    simulation.step(3)
    assert imu.timestamp.numpy() == pytest.approx([0.03, 0.03], abs=1e-6)
    fresh = Counter(model)
    refused(lambda: sw.Simulation(model, 0.01, elements=[fresh, good]))
    sw.Simulation(model, 0.01, elements=[fresh])


def test_a_sensor_that_was_recorded_before_another_failed_starts_anew():
    class Late(Probe):
        fails = True

        def _sample(self, simulation: sw.StepContext) -> Any:
            if self.fails:
                raise RuntimeError("out of memory")
            return super()._sample(simulation)

    model = ball(2)
    imu, late = Imu(model, Mount("ball")), Late(model, Schedule(rate=100.0), name="late")
    with pytest.raises(RuntimeError, match="out of memory"):
        sw.Simulation(model, 0.01, sensors=[imu, late])
    late.fails = False
    simulation = sw.Simulation(model, 0.005, sensors=[imu, late], read_every=2)
    twin = Imu(model, Mount("ball"))
    other = sw.Simulation(model, 0.005, sensors=[twin], read_every=2)
    for each in (simulation, other):
        each.step(5)
    for mine, theirs in zip(imu.memory.values(), twin.memory.values(), strict=True):
        assert (mine.numpy() == theirs.numpy()).all()


def test_a_field_is_what_a_sensor_publishes():
    class Clock(FrameSensor):
        data = property(lambda self: self.frames.data["data"])

        def _sample(self, simulation: sw.StepContext) -> list[Any]:
            return []

    model = ball(1)
    clock = Clock("clock", Schedule(rate=100.0), model, {"data": Field((2,), wp.float32)})
    sw.Simulation(model, 0.01, sensors=[clock]).step(2)
    assert clock.data.shape == (1, 2)
    assert clock.timestamp.numpy()[0] == pytest.approx(0.02)
    assert repr(clock).startswith("Clock 'clock': 100 Hz, 1 world on cpu")
