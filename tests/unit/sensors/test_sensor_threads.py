"""Sensors give the same bits for any number of threads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.sensors.interface import Mount
from simwarp.sensors.presets import load_sensor
from simwarp.sensors.scene import Visuals
from simwarp.sensors.shipped import sensor_names

WORLDS = 5
LARGE = ("generic-camera", "hdl-32e", "hdl-32e-lasers", "generic-lidar")


def run(name: str, threads: int) -> dict[str, bytes]:
    """Everything that a sensor holds after some steps and a reset of two worlds, all worlds turning differently."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    box = builder.add_solid("box", "box", (0.5, 0.3, 0.1), mass=2.0, pose=sw.pose((0.0, 0.0, 1.0)))
    builder.add_joint_revolute("post", sw.WORLD, box, axis=(0.0, 0.0, 1.0))
    visuals = Visuals(builder)
    visuals.add_sphere(sw.WORLD, radius=1.0, pose=sw.pose((4.0, 0.0, 1.0)), name="lamp")
    model = builder.finalize(WORLDS, "cpu")
    scene = visuals.finalize(model)
    place: Any = "post" if "encoder" in name or name == "load-cell" else Mount("box", sw.pose((0.0, 0.0, 0.2)))
    sensor = load_sensor(name, scene, place, seed=3)
    sim = sw.Simulation(model, 0.02, sensors=[sensor], joint_reactions=True, threads=threads)
    sim.set_joint_state(None, np.linspace(0.0, 1.0, WORLDS)[:, None], np.linspace(-3.0, 3.0, WORLDS)[:, None])
    sim.advance(6)
    sim.reset(np.arange(WORLDS) % 2 == 1)
    sim.advance(6)
    arrays = {**sensor.memory, "data": sensor.data, "timestamp": sensor.timestamp, "valid": sensor.valid}
    return {key: array.numpy().tobytes() for key, array in arrays.items()}


@pytest.mark.parametrize("name", [name for name in sensor_names() if name not in LARGE])
@pytest.mark.sweep
def test_the_same_bits(name):
    alone = run(name, 1)
    for threads in (2, 3, 7):
        shared = run(name, threads)
        assert [key for key, value in shared.items() if value != alone[key]] == []
