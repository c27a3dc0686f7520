"""Vehicles that run into each other: the boxes of their chassis meet in the cone solver."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import simwarp as sw
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import meeting_pairs
from simwarp.vehicle.construction import add_chassis_box, add_vehicle
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicles, per_world
from tests.physics.sample_vehicles import shipped

HALF = (2.3, 1.05, 0.5)
POSITION = (0.0, 0.0, 0.2)
DT = 1.0e-3


class Meeting:
    """HMMWVs on a road, through air without drag: boxes push them, and tires, whose impulse is counted.

    Args:
        places: (x, y) of their frames of reference [m].
        headings: 1 for +X, -1 for -X.
        speeds: forwards [m/s].
    """

    def __init__(
        self, places: list[tuple[float, float]], headings: list[int], speeds: list[float], name: str = "hmmwv-reduced"
    ) -> None:
        spec = shipped(name)
        spec = dataclasses.replace(spec, chassis=dataclasses.replace(spec.chassis, drag_coefficient=0.0))
        builder, self.parts = ModelBuilder(), []
        for number, ((x, y), heading, speed) in enumerate(zip(places, headings, speeds, strict=True)):
            turn = (0.0, 0.0, 0.0, 1.0) if heading > 0 else (0.0, 0.0, 1.0, 0.0)
            place = sw.pose((x, y, spec.start_height), turn)
            self.parts.append(add_vehicle(builder, spec, at=place, prefix=f"v{number}_", speed=speed))
        self.boxes = [add_chassis_box(builder, each, half=HALF, position=POSITION) for each in self.parts]
        self.model: Any = builder.finalize(1, "cpu", per_world=per_world())
        self.vehicles = Vehicles(self.parts, self.model)
        self.sim = sw.Simulation(self.model, DT, elements=[self.vehicles], solver=VEHICLE_SOLVER)
        self.mass = self.model.body_mass.numpy()[0].astype(float)
        self.deepest = 0.0
        self.tires = np.zeros(2)
        """Impulse of all tires so far, along the road and across it [N·s]."""

    def step(self, count: int) -> None:
        for _ in range(count):
            self.sim.step()
            self.tires += DT * self.vehicles.tires.force_w.numpy()[0].astype(float).sum(axis=0)[:2]
            self.deepest = max(self.deepest, float(self.sim.contacts.penetration.numpy().max()))

    def momentum(self, *numbers: int) -> npt.NDArray[np.float64]:
        """(2,) along the road and across it, of some vehicles or of all [N·s]."""
        momenta = self.mass[:, None] * self.sim.state.body_v.numpy()[0].astype(float)
        bodies = [body for number in numbers or range(len(self.parts)) for body in self.parts[number].bodies]
        return momenta[bodies].sum(axis=0)[:2]

    def speed(self, number: int) -> float:
        """Along the road [m/s]."""
        return self.momentum(number)[0] / self.mass[list(self.parts[number].bodies)].sum()


@pytest.mark.parametrize(
    ("name", "speeds", "aside"),
    [
        ("hmmwv-reduced", (10.0, 10.0), 0.0),
        ("hmmwv-reduced", (14.0, 6.0), 0.4),
        ("hmmwv", (10.0, 10.0), 0.7),
    ],
)
def test_head_on(name, speeds, aside):
    road = Meeting([(-3.3, 0.0), (3.3, aside)], [1, -1], list(speeds), name)
    before, each = road.momentum(), abs(road.momentum(0)[0])
    assert each > 1e4
    road.step(300)
    assert abs(road.momentum(0)[0] - each) > 0.2 * each, "they did not meet"
    # float32 velocities, rounded in 300 steps by 6e-8 each, at random: 1e-6
    assert np.abs(road.momentum() - before - road.tires).max() < 1e-5 * each
    assert road.deepest < 0.01


def test_a_push_from_behind_moves_a_chain():
    # half a metre between boxes of 4.6 m
    road = Meeting([(-5.1 * number, 0.0) for number in range(4)], [1] * 4, [0.0, 0.0, 0.0, 6.0])
    before = road.momentum()
    road.step(800)
    assert np.abs(road.momentum() - before - road.tires).max() < 1e-5 * before[0]
    speeds = [road.speed(number) for number in range(4)]
    # nothing rebounds: the one that was pushed last goes on as fast as all together or faster
    assert all(speed > 0.5 for speed in speeds), speeds
    assert speeds[0] >= speeds[3] - 0.05
    assert road.deepest < 0.01


def test_a_vehicles_own_parts_never_meet():
    spec = shipped("hmmwv")
    builder = ModelBuilder()
    parts = [
        add_vehicle(
            builder, with_options(spec, tire="rigid"), at=sw.pose((6.0 * k, 0.0, spec.start_height)), prefix=f"v{k}_"
        )
        for k in (0, 1)
    ]
    boxes = [add_chassis_box(builder, each, half=(3.0, 1.5, 0.8)) for each in parts]
    pairs = meeting_pairs(builder)
    assert tuple(boxes) in pairs
    wheels = [side.shape for each in parts for side in each.sides]
    for k in (0, 1):
        own, others = wheels[4 * k : 4 * k + 4], wheels[4 - 4 * k : 8 - 4 * k]
        assert not any(tuple(sorted((boxes[k], wheel))) in pairs for wheel in own)
        assert all(tuple(sorted((boxes[k], wheel))) in pairs for wheel in others)
