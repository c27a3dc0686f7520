"""Vehicles of Chrono's files stand, accelerate, steer and brake as bodies on wheels do, or as the list says."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from scripts.chrono_fleet import BLOCK, PAGE, loaded, verdict
from scripts.chrono_fleet_driving import drive
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

CHRONO = Path(__file__).parents[3] / "shared/reference/chrono/vehicles"
FLEET: Final = (
    "MAN_Kat1/vehicle/MAN_10t_Vehicle_8WD.json", "MAN_Kat1/vehicle/MAN_5t_Vehicle_4WD.json", "Polaris/Polaris.json",
    "audi/json/audi.json", "gclass/vehicle/G500_Vehicle.json", "generic/vehicle/Vehicle_SolidAxles.json",
    "hmmwv/vehicle/HMMWV_Vehicle_replica.json", "truck/json/truck.json", "articulated_chassis/ACV_Vehicle.json",
    "generic/vehicle/Vehicle_HendricksonPRIMAXX.json", "mtv/vehicle/MTV_Vehicle_WalkingBeam.json",
)  # fmt: skip
"""One of each new template and number of axles."""
GRAVITY: Final = 9.81
LISTED: Final = BLOCK.search(PAGE.read_text(encoding="utf-8"))
VERDICTS: Final = {
    cells[1].strip(): cells[4].strip()
    for cells in (line.split("|") for line in (LISTED[0].splitlines()[3:-1] if LISTED else ()))
    if cells[2].strip() == "yes"
}
"""Of the list, by the file as it stands there."""
FILES: Final = tuple(name.strip("`") for name in VERDICTS)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHRONO.exists(), reason="the files of the other simulator are not here"),
]


def standing(name: str) -> tuple[Any, Vehicle, Simulation]:
    """A vehicle with its brakes on."""
    builder = ModelBuilder()
    parts = add_vehicle(builder, loaded(CHRONO, CHRONO / name, driven=True))
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    simulation = Simulation(model, 1.0e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
    rows = vehicle.input.numpy()
    rows[:, 2] = 1.0
    vehicle.input.assign(rows)
    return builder, vehicle, simulation


@pytest.mark.parametrize("name", FLEET)
def test_wheels_bear_what_it_weighs(name):
    """The wheels' forces balance the weight and its moments about x and y, however the springs share it."""
    builder, vehicle, simulation = standing(name)
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


@pytest.mark.parametrize("name", FILES)
def test_it_drives_as_the_list_says(name):
    """Every file that loads stands, accelerates, steers and brakes within the laws, or is listed with a fault."""
    found = drive(loaded(CHRONO, CHRONO / name, driven=True))
    assert VERDICTS[f"`{name}`"] == verdict(found)
