"""Vehicles of Chrono's files stand, stop, steer and accelerate as bodies on wheels do."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from scripts.chrono_fleet import loaded
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.suspensions.kinematics import travel_table
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

CHRONO = Path(__file__).parents[3] / "shared/reference/chrono/vehicles"
FLEET: Final = (
    "MAN_Kat1/vehicle/MAN_10t_Vehicle_8WD.json", "MAN_Kat1/vehicle/MAN_5t_Vehicle_4WD.json", "Polaris/Polaris.json",
    "audi/json/audi.json", "gclass/vehicle/G500_Vehicle.json", "generic/vehicle/Vehicle_SolidAxles.json",
    "hmmwv/vehicle/HMMWV_Vehicle_replica.json", "truck/json/truck.json",
)  # fmt: skip
"""One of each new template and number of axles."""
SPEED: Final = 12.0
GRAVITY: Final = 9.81
GRIP: Final = 1.15
"""More than any of their tires' largest friction: 1.0 of Fiala's here, a tenth over 0.8 to 1.0 of TMeasy's curves."""
ROLL_STEER: Final = np.radians(0.5)
"""Of a first axle that steers into the turn by its links, at 50 mm of travel up and down: that of the trucks'."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHRONO.exists(), reason="the files of the other simulator are not here"),
]


def start(name: str, speed: float, inputs: list[tuple[float, float, float]]) -> tuple[Any, Vehicle, Simulation]:
    """A world for each steering, throttle and brake."""
    builder = ModelBuilder()
    parts = add_vehicle(builder, loaded(CHRONO, CHRONO / name, driven=True), speed=speed)
    model = builder.finalize(len(inputs), "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    simulation = Simulation(model, 1.0e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
    rows = vehicle.input.numpy()
    rows[:, :3] = inputs
    vehicle.input.assign(rows)
    return builder, vehicle, simulation


@pytest.mark.parametrize("name", FLEET)
def test_wheels_bear_what_it_weighs(name):
    """The wheels' forces balance the weight and its moments about x and y, however the springs share it."""
    builder, vehicle, simulation = start(name, 0.0, [(0.0, 0.0, 1.0)])
    simulation.step(5000)
    masses = np.array([body.mass for body in builder.bodies])
    places = np.asarray(simulation.state.body_x.numpy()[0], np.float64)
    weight, com = masses.sum() * GRAVITY, masses @ places / masses.sum()
    loads = np.asarray(vehicle.tires.load.numpy()[0], np.float64)
    wheels = places[[side.spindle for side in vehicle.parts.sides]]
    assert (loads > 0.0).all()
    # what is left of the bounce after five seconds: a thousandth of the weight, and its moment about a metre
    assert loads.sum() == pytest.approx(weight, rel=1e-3)
    np.testing.assert_allclose(loads @ wheels[:, :2] / weight, com[:2], atol=1e-3)
    # all parts but drag links, bell cranks and track bars lie symmetrically
    left, right = loads[0::2], loads[1::2]
    assert (np.abs(left - right) < 0.01 * (left + right)).all()


@pytest.mark.parametrize("name", FLEET)
def test_it_stops_no_sooner_than_friction_allows(name):
    """Rolling for a second, then full brakes: at least v² / 2 µ g, and a stop all the same."""
    _, vehicle, simulation = start(name, SPEED, [(0.0, 0.0, 0.0)])
    simulation.step(1000)
    speed = float(vehicle.velocity_b.numpy()[0, 0])
    begin = simulation.state.body_x.numpy()[0, vehicle.parts.chassis].copy()
    rows = vehicle.input.numpy()
    rows[:, 2] = 1.0
    vehicle.input.assign(rows)
    simulation.step(6000)
    way = float(np.linalg.norm((simulation.state.body_x.numpy()[0, vehicle.parts.chassis] - begin)[:2]))
    assert abs(float(vehicle.velocity_b.numpy()[0, 0])) < 0.05
    assert speed**2 / (2.0 * GRIP * GRAVITY) <= way <= speed**2 / (2.0 * 0.25 * GRAVITY)


def oversteers(name: str, loads: np.ndarray) -> bool:
    """Whether a description has a reason to: more weight behind, or a first axle that steers into the turn by roll."""
    spec = loaded(CHRONO, CHRONO / name)
    rolled = travel_table(spec, 0, [-0.05], right=[0.05])  # to the right, as in a turn to the left
    return bool(loads[:2].sum() < loads[-2:].sum() or rolled.steer.mean() > ROLL_STEER)


@pytest.mark.parametrize("name", FLEET)
def test_it_steers_where_the_wheel_turns_and_understeers(name):
    """Left for positive steering and right for negative; the curve widens with speed unless there is a reason."""
    curves = []
    for speed in (3.0, SPEED):
        _, vehicle, simulation = start(name, speed, [(0.15, 0.0, 0.0), (-0.15, 0.0, 0.0)])
        simulation.step(2000)
        curves.append(vehicle.omega_b.numpy()[:, 2] / vehicle.velocity_b.numpy()[:, 0])
    slow, fast = curves
    for curve in curves:
        assert curve[0] > 0.0 > curve[1]
    ratio = (fast[0] - fast[1]) / (slow[0] - slow[1])
    assert 0.5 < ratio < (1.15 if oversteers(name, vehicle.tires.load.numpy().mean(axis=0)) else 1.0)


@pytest.mark.parametrize("name", FLEET)
def test_full_throttle_accelerates_within_grip(name):
    _, vehicle, simulation = start(name, 3.0, [(0.0, 1.0, 0.0)])
    simulation.step(2000)
    gained = float(vehicle.velocity_b.numpy()[0, 0]) - 3.0
    assert 0.5 < gained < GRIP * GRAVITY * 2.0
