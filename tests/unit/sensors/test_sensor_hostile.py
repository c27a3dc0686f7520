"""Hostile values for every field of every sensor's configuration: one clear line, or a sensor that measures."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core import memory
from simwarp.core.types import ModelError
from simwarp.sensors.cameras.camera import CameraConfig
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.presets import KINDS, make_sensor
from simwarp.sensors.ranging.beams import beam_grid
from simwarp.sensors.scene import Scene, Visuals

NAN, INF = float("nan"), float("inf")
HOSTILE: list[Any] = [
    None, "", "abc", b"1", NAN, INF, -INF, -1, 0, 1, 3, 1e39, 1e308, 1e-60, 1e30, 10**6, 10**9, 2**31, 2**40, 10**400,
    10**5000, True, 1j, [], [1], (1, 2, 3), (0.0, 0.0, 0.0), (NAN, 0, 0), {}, object(), (10**9, 10**9), [["x"]], "a\nb",
    "\ud800", np.array([1.0, 2.0]), np.full((3, 3), NAN), Schedule(rate=1e-30), Schedule(rate=10.0, lag=1e30),
]  # fmt: skip
SCHEDULE = Schedule(rate=10.0)
BASES: dict[str, Any] = {name: kind.config() for name, kind in KINDS.items() if name not in ("lidar", "radar")} | {
    "camera": CameraConfig(width=4, height=3),
    "lidar": KINDS["lidar"].config(schedule=SCHEDULE, beams=beam_grid(4, 2)),
    "radar": KINDS["radar"].config(schedule=SCHEDULE, rays=beam_grid(4, 2)),
}  # fmt: skip
PLACES = {"encoder": "hinge", "load-cell": "hinge"}


@pytest.fixture(scope="module")
def scene() -> Scene:
    builder = sw.ModelBuilder()
    box = builder.add_solid("box", "box", 0.1, mass=1.0, pose=sw.pose((3, 0, 0)))
    arm = builder.add_body("arm", mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_revolute("hinge", box, arm, axis=(0, 0, 1))
    builder.add_shape_plane()
    return Visuals(builder).finalize(builder.finalize(2, "cpu"))


def told(error: ModelError) -> str:
    message = str(error)
    return "" if message.isprintable() and len(message) < 500 else f"message: {message[:200]!r}"


def tried(scene: Scene, name: str, field: str, value: Any) -> str:
    """What is wrong with how a configuration takes a value; empty if nothing is."""
    try:
        config = dataclasses.replace(BASES[name], **{field: value})
        place = PLACES.get(name, Mount("box"))
        sensor = make_sensor(config, scene if KINDS[name].sees else scene.model, place)
        sw.Simulation(scene.model, 0.01, sensors=[sensor], joint_reactions=True).step()
    except ModelError as error:
        return told(error)
    return ""


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.sweep
def test_hostile_values(scene, name):
    wrong = []
    for field in dataclasses.fields(BASES[name]):
        for index, value in enumerate(HOSTILE):
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    found = tried(scene, name, field.name, value)
                except Exception as error:  # noqa: BLE001 - what it is belongs to the complaint
                    found = f"{type(error).__name__}: {str(error)[:120]}"
            if found:
                wrong.append(f"{field.name} = value {index}: {found}")
    assert wrong == []


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(Schedule)])
def test_hostile_schedules(scene, field):
    wrong = []
    for value in HOSTILE:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                schedule = dataclasses.replace(SCHEDULE, **{field: value})
                imu = Imu(scene.model, Mount("box"), ImuConfig(schedule=schedule))
                sw.Simulation(scene.model, 0.01, sensors=[imu]).step()
            except ModelError as error:
                wrong.append(told(error))
    assert set(wrong) <= {""}


def test_what_does_not_fit_into_memory(scene, monkeypatch):
    """Frames of all worlds, and those that wait for their lag."""
    late = ImuConfig(schedule=Schedule(rate=100.0, lag=1000.0))
    imu = Imu(scene.model, Mount("box"), late)
    monkeypatch.setattr(memory, "free_memory", lambda device: 10**5)
    with pytest.raises(
        ModelError, match=r"sensor 'imu': 100001 frames in waiting .* need .* are free; shorten the lag"
    ):
        sw.Simulation(scene.model, 0.01, sensors=[imu])
    config = CameraConfig(width=1000, height=1000)
    with pytest.raises(ModelError, match=r"sensor 'camera': the frames of 2 worlds need .* are free; take fewer"):
        make_sensor(config, scene, Mount("box"))
