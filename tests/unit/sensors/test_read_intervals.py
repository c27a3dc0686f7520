"""Sensors launched only where they are due leave the same bits behind as sensors launched in every sub-step."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.sensors.clock import LONGEST_INTERVAL, due_substeps
from simwarp.sensors.interface import Mount, Schedule, ScheduleSteps
from simwarp.sensors.presets import KINDS, load_config, make_sensor
from simwarp.sensors.ranging.beams import beam_grid
from simwarp.sensors.scene import Visuals
from simwarp.simulation.read_interval import ReadInterval
from simwarp.simulation.world_launches import WorldShares
from tests.reference.sensors.sensor_clock import frames, read
from tests.unit.sensors.sensor_probe import Probe, ball
from tests.unit.sensors.test_sensor_clock import READS, SCHEDULES as CLOCKS
from tests.unit.sensors.test_sensor_mistakes import EXAMPLES, ON_JOINTS

WORLDS = 4
DT = 0.002
SUBSTEPS, EVERY = 2, 6
INTERVAL = SUBSTEPS * EVERY
SCHEDULES = {  # period, window, lag [sub-steps]
    "at reads": (12, 0, 0),
    "whole": (12, 12, 0),
    "between": (12, 3, 5),
    "two intervals": (24, 4, 0),
    "odd": (7, 2, 10),
    "long": (31, 0, 13),
    "often": (4, 1, 3),
}
EVERY_SUBSTEP = ("imu", "encoder")
"""These remember the sub-step before."""


def schedule_of(name: str) -> Schedule:
    period, window, lag = SCHEDULES[name]
    return Schedule(rate=1.0 / (period * DT), window=window * DT, lag=lag * DT)


def sensors_of(sort: str, scene: Any) -> list[Any]:
    """A sensor of each schedule, with all the noise of the shipped one."""
    config = load_config(EXAMPLES[sort])
    small: dict[str, Any] = {
        "camera": {"width": 5, "height": 4, "outputs": ("rgb", "depth")},
        "lidar": {"beams": beam_grid(6, 2), "noise": load_config("generic-lidar").noise},
        "radar": {"rays": beam_grid(6, 2)},
        "encoder": {"reading": "speed"},
    }
    place: Any = "axle" if sort in ON_JOINTS else Mount("wheel", sw.pose((0.0, 0.0, 0.4)))
    changes = small.get(sort, {})
    return [
        make_sensor(
            dataclasses.replace(config, schedule=schedule_of(name), **changes), scene, place,
            name=name.replace(" ", "_"), seed=5,
        )
        for name in SCHEDULES
    ]  # fmt: skip


def simulation(sort: str, everywhere: bool, threads: int = 1) -> sw.Simulation:
    """Wheels that turn at different speeds over a floor; `everywhere`: sensors are launched in every sub-step."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="floor")
    wheel = builder.add_solid("wheel", "sphere", 0.3, mass=1.0, pose=sw.pose((0.0, 0.0, 0.299)))
    builder.add_joint_revolute("axle", sw.WORLD, wheel, axis=(0.0, 1.0, 0.0))
    visuals = Visuals(builder)
    visuals.add_box(sw.WORLD, half=(0.3, 0.5, 0.8), pose=sw.pose((3.0, 0.0, 0.5)))
    scene = visuals.finalize(builder.finalize(WORLDS, "cpu"))
    sim = sw.Simulation(
        scene.model, DT * SUBSTEPS, substeps=SUBSTEPS, sensors=sensors_of(sort, scene), read_every=EVERY,
        joint_reactions=True, threads=threads,
    )  # fmt: skip
    if everywhere:
        sim.read_interval.whole = lambda substeps: 0  # type: ignore[method-assign]
    return sim


def bits(sim: sw.Simulation) -> dict[str, bytes]:
    """Everything that sensors hold, and the state."""
    found = {name: array.numpy().tobytes() for name, array in sim.snapshot().arrays().items()}
    for sensor in sim.sensors:
        for name, array in {**sensor.memory, "data": sensor.data, "valid": sensor.valid}.items():
            found[f"{sensor.name} {name}"] = array.numpy().tobytes()
    return found


def spoil(sim: sw.Simulation) -> None:
    """One world breaks down."""
    velocity = sim.state.joint_qd.numpy()
    velocity[2] = np.nan
    sim.state.joint_qd.assign(velocity)
    velocity = sim.state.body_omega.numpy()
    velocity[2] = np.nan
    sim.state.body_omega.assign(velocity)


def in_step(sim: sw.Simulation) -> bool:
    return sim.read_interval.at_start


def by_parts(sim: sw.Simulation, parts: list[int]) -> None:
    for steps in parts:
        sim.advance(steps)


ODD = np.arange(WORLDS) % 2 == 1


def story(sim: sw.Simulation) -> list[tuple[str, dict[str, bytes], bool, int]]:
    """A run of all that may happen: what was done, what is there then, whether clocks are in step, launches so far."""
    kept: list[Any] = []
    spin = np.linspace(-9.0, 9.0, WORLDS)[:, None]
    deeds: list[tuple[str, Callable[[], Any]]] = [
        ("set", lambda: sim.set_joint_state(None, np.linspace(0.0, 1.0, WORLDS)[:, None], spin)),
        ("an interval", lambda: sim.advance(EVERY)),
        ("three intervals", lambda: sim.advance(3 * EVERY)),
        ("reset of some", lambda: sim.reset(ODD)),
        ("two intervals", lambda: sim.advance(2 * EVERY)),
        ("snapshot", lambda: kept.append(sim.snapshot())),
        ("an interval by steps", lambda: by_parts(sim, EVERY * [1])),
        ("three intervals by halves", lambda: by_parts(sim, 2 * [3 * EVERY // 2])),
        ("an interval", lambda: sim.advance(EVERY)),
        ("a world breaks down", lambda: spoil(sim)),
        ("an interval and a half", lambda: sim.advance(3 * EVERY // 2)),
        ("restore", lambda: sim.restore(kept[0])),
        ("two intervals", lambda: sim.advance(2 * EVERY)),
        ("a step", lambda: sim.step()),
        ("reset of some between reads", lambda: sim.reset(ODD)),
        ("intervals out of step", lambda: sim.advance(5 * EVERY - 1)),
        ("snapshot out of step", lambda: kept.append(sim.snapshot())),
        ("set of all", lambda: sim.set_joint_state(None, None, spin)),
        ("two intervals", lambda: sim.advance(2 * EVERY)),
        ("restore out of step", lambda: sim.restore(kept[1])),
        ("intervals", lambda: sim.advance(3 * EVERY)),
        ("restore again", lambda: sim.restore(kept[0])),
        ("intervals", lambda: sim.advance(7 * EVERY)),
    ]
    found = []
    for name, deed in deeds:
        deed()
        found.append((name, bits(sim), in_step(sim), sim.shares.launches))
    return found


@pytest.mark.parametrize("sort", KINDS)
@pytest.mark.sweep
def test_the_same_bits_as_in_every_substep(sort):
    with np.errstate(invalid="ignore"):
        due, everywhere = (story(simulation(sort, choice)) for choice in (False, True))
    for (name, found, _, _), (_, wanted, _, _) in zip(due, everywhere, strict=True):
        assert [key for key, value in found.items() if value != wanted[key]] == [], name
    launches = [run[-1][3] for run in (due, everywhere)]
    if sort in EVERY_SUBSTEP:
        assert launches[0] == launches[1]
        return
    assert launches[0] < 0.85 * launches[1]
    out_of_step = [name for name, _, in_step, _ in due if not in_step]
    # between reads; and from the reset of some of the worlds there, until all begin anew or others are restored
    assert out_of_step == [
        "an interval and a half", "a step", "reset of some between reads", "intervals out of step",
        "snapshot out of step", "restore out of step", "intervals",
    ]  # fmt: skip


@pytest.mark.parametrize("sort", ["camera", "load-cell"])
def test_the_same_bits_with_threads(sort):
    alone, shared = (story(simulation(sort, False, threads)) for threads in (1, 3))
    for (name, wanted, _, _), (_, found, _, _) in zip(alone, shared, strict=True):
        assert [key for key, value in found.items() if value != wanted[key]] == [], name


def counted(sim: sw.Simulation, steps: int) -> int:
    """Launches of these steps."""
    before = sim.shares.launches
    sim.advance(steps)
    return sim.shares.launches - before


def meter(model: sw.Model, name: str) -> Any:
    """A speedometer, of one kernel and two outputs."""
    return make_sensor(
        dataclasses.replace(load_config("speedometer"), schedule=schedule_of(name)), model, Mount("ball")
    )


@pytest.mark.parametrize(
    ("name", "clock", "kernel", "copies"),
    # at a read; in every sub-step; where it collects (3), where it publishes, and at a read
    [("at reads", 1, 1, 0), ("whole", 12, 12, 0), ("between", 3 + 1 + 1, 3, 2), ("two intervals", 4 + 1, 4, 0)],
)
def test_launches_of_an_interval(name, clock, kernel, copies):
    model = ball(2)
    sim = sw.Simulation(model, DT * SUBSTEPS, substeps=SUBSTEPS, sensors=[meter(model, name)], read_every=EVERY)
    physics = len(sim.physics_commands)
    assert counted(sim, 3 * EVERY) == 3 * (INTERVAL * physics + clock + kernel + copies)
    outputs = 2 if copies else 0
    assert counted(sim, EVERY - 1) == (INTERVAL - SUBSTEPS) * (physics + 2 + outputs)  # no whole interval


@pytest.mark.parametrize(("rate", "window", "lag"), CLOCKS)
def test_due_substeps_are_those_of_the_event_list(rate, window, lag):
    period = round(1000.0 / rate)
    for substeps, every in READS:
        length = substeps * every
        due = due_substeps(ScheduleSteps(period, window, lag), length)
        assert due is not None
        intervals = 2 * math.lcm(period, length) // length + (window + lag) // length + 2
        events = frames(period, window, lag, 0, intervals * length)
        seen = {read(events, k * length).number: read(events, k * length) for k in range(1, intervals + 1)}
        seen.pop(0, None)
        collecting = {(count - 1) % length + 1 for frame in seen.values() for count in frame.substeps}
        publishing = {(frame.published - 1) % length + 1 for frame in seen.values()}
        assert due.collecting == collecting
        assert due.publishing == publishing


def test_an_interval_of_very_many_substeps_is_not_divided():
    assert due_substeps(ScheduleSteps(7, 0, 0), LONGEST_INTERVAL) is not None
    assert due_substeps(ScheduleSteps(7, 0, 0), LONGEST_INTERVAL + 1) is None
    assert due_substeps(ScheduleSteps(2**31 - 1, 2**31 - 1, 2**31 - 1), 1000) is not None


@pytest.mark.parametrize("phases", ["random", "written", "restored"])
def test_where_phases_may_differ_sensors_are_launched_everywhere(phases, tmp_path):
    """Seen by a sensor whose frames come at different sub-steps in different worlds."""
    found = []
    for everywhere in (False, True):
        model = ball(5)
        schedule = dataclasses.replace(schedule_of("at reads"), phase="random" if phases == "random" else "zero")
        config = dataclasses.replace(load_config("speedometer"), schedule=schedule)
        sensors: list[Any] = [make_sensor(config, model, Mount("ball"))]
        sim = sw.Simulation(model, DT, sensors=sensors, read_every=INTERVAL)
        if everywhere:
            sim.read_interval.whole = lambda substeps: 0  # type: ignore[method-assign]
        sim.advance(INTERVAL)
        if phases == "written":
            sensors[0].frames.phase.assign(np.arange(5, dtype=np.int32))
        if phases == "restored":
            other: Any = make_sensor(config, model, Mount("ball"))
            twin = sw.Simulation(model, DT, sensors=[other], read_every=INTERVAL)
            other.frames.phase.assign(np.arange(5, dtype=np.int32))
            path = tmp_path / "snapshot.npz"
            twin.snapshot().save(path)
            sim.restore(sw.Snapshot.load(path, sim))
        assert counted(sim, 4 * INTERVAL) == 4 * INTERVAL * (len(sim.physics_commands) + 2)
        found.append(bits(sim))
    assert found[0] == found[1]


def test_a_sensor_of_ones_own_is_launched_everywhere():
    """It may remember what it saw in other sub-steps: the probe counts them."""
    model = ball(2)
    own = Probe(model, schedule_of("at reads"))
    sim = sw.Simulation(model, DT, sensors=[own, meter(model, "at reads")], read_every=INTERVAL)
    assert counted(sim, INTERVAL) == INTERVAL * (len(sim.physics_commands) + 2) + 2
    assert own.notes.count.numpy().tolist() == [INTERVAL] * 2


class Device:
    """A device that may be capturing."""

    is_cuda = False
    is_capturing = False


@pytest.fixture
def interval() -> ReadInterval:
    made = ReadInterval(10, WorldShares(1, 1, Device()))
    made.sensors.append(None)
    return made


def test_what_is_captured_may_be_repeated_unseen(interval):
    device: Any = interval._shares.device
    device.is_capturing = True
    assert interval.whole(30) == 0
    interval.asked_before_replay = True  # who captures asks before each replay
    assert interval.whole(30) == 3
    interval.begin_some()
    device.is_capturing = False
    assert interval.at_start
    interval.advance(3)  # from now on a replay may begin clocks here
    interval.advance(7)
    assert not interval.at_start
    interval.begin_all()
    assert not interval.at_start


@pytest.mark.parametrize("deed", ["step", "begin between reads", "restore"])
def test_captured_parts_of_an_interval_are_for_good(deed, interval):
    device: Any = interval._shares.device
    if deed == "begin between reads":
        interval.advance(2)
    device.is_capturing = True
    if deed == "step":
        interval.advance(12)
    elif deed == "restore":
        interval.sensors = [make_interval()]
        interval.begin_from_clocks()
    else:
        interval.begin_some()
    device.is_capturing = False
    interval.begin_all()
    assert not interval.at_start
    assert interval.whole(20) == 0


def make_interval() -> Any:
    model = ball(1)
    return sw.Simulation(model, DT, sensors=[meter(model, "at reads")], read_every=INTERVAL).read_interval.sensors[0]


def test_a_snapshot_of_a_file_tells_where_the_clocks_are(tmp_path: Path):
    sim = simulation("gps", False)
    sim.advance(EVERY + 1)
    sim.snapshot().save(tmp_path / "between.npz")
    again = simulation("gps", False)
    again.restore(sw.Snapshot.load(tmp_path / "between.npz", again))
    assert not again.read_interval.at_start
    again.advance(EVERY - 1)
    assert again.read_interval.at_start
    sim.advance(EVERY - 1)
    assert bits(sim) == bits(again)
