"""Soil knows no left and right, and no direction of its grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.soil import Soil, SoilSpec, SoilWheel
from tests.unit.soil.soil_wheels import RADIUS, WIDTH, rolling


def thrown(soil: SoilSpec | str, mirror: float) -> np.ndarray:
    """Way (n, 7) of a wheel that rolls, slips sideways, leans, yaws; mirrored in the plane y = 0 by -1."""
    lean, yaw = 0.15 * mirror, 0.3 * mirror
    cos, sin = (lambda a: math.cos(0.5 * a)), (lambda a: math.sin(0.5 * a))
    # yaw about Z, then lean about the wheel's own X
    turn = (sin(lean) * cos(yaw), sin(lean) * sin(yaw), cos(lean) * sin(yaw), cos(lean) * cos(yaw))
    builder = sw.ModelBuilder()
    place = (0.0, 0.013 * mirror, RADIUS)
    body = builder.add_body("w", mass=300.0, inertia=(10.0, 15.0, 10.0), pose=sw.pose(place, turn))
    model = builder.finalize(1, "cpu")
    soil_element = Soil(model, [SoilWheel(body=body, radius=RADIUS, width=WIDTH)], soil)
    simulation = sw.Simulation(model, 1e-3, elements=[soil_element], threads=1)
    simulation.state.body_v.fill_(wp.vec3(1.5, 0.4 * mirror, -0.2))
    simulation.state.body_omega.fill_(wp.vec3(0.1 * mirror, 4.0, 0.3 * mirror))
    simulation.measure()
    simulation.control.body_torque.fill_(wp.vec3(0.0, 150.0, 20.0 * mirror))
    rows = []
    for _ in range(40):
        simulation.step(10)
        x, q = simulation.state.body_x.numpy()[0, 0], simulation.state.body_rot.numpy()[0, 0]
        rows.append([*x, *q])
    return np.array(rows)


@pytest.mark.parametrize("soil", ["mid", "hard"])
def test_a_mirrored_wheel_goes_a_mirrored_way(soil):
    plain, mirrored = thrown(soil, 1.0), thrown(soil, -1.0)
    # a mirror turns y, and rotations about X and Z
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    assert np.abs(plain[-1, :2] - plain[0, :2]).max() > 0.3
    assert np.abs(plain[-1, 1]) > 0.01
    np.testing.assert_allclose(mirrored * signs, plain, atol=1e-4)


@pytest.mark.parametrize("soil", ["soft", "mid"])
def test_a_track_turned_by_37_degrees_is_the_same_to_3_percent(soil):
    """Nodes lie otherwise below the wheel: 5 or 6 rows of them, each with its share."""
    runs = []
    for direction in (0.0, math.radians(37.0)):
        simulation, _ = rolling(soil=soil, torque=1200.0, direction=direction, speed=1.0)
        ahead = np.array([math.cos(direction), math.sin(direction), 0.0])
        side = np.array([-ahead[1], ahead[0], 0.0])
        rows = []
        for _ in range(150):
            simulation.step(10)
            state = simulation.state
            x = state.body_x.numpy()[0, 0]
            rows.append((x @ ahead, RADIUS - x[2], state.body_omega.numpy()[0, 0] @ side, abs(float(x @ side))))
        runs.append(np.array(rows))
    straight, turned = runs
    assert straight[-1, 0] > 1.0
    assert turned[-1, 0] == pytest.approx(straight[-1, 0], rel=0.03)
    assert turned[50:, 1].mean() == pytest.approx(straight[50:, 1].mean(), rel=0.03)
    assert turned[-1, 2] == pytest.approx(straight[-1, 2], rel=0.03)
    assert turned[:, 3].max() < 0.03 * turned[-1, 0]
