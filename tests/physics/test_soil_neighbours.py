"""Several vehicles on the soil of one world: out of touch each equals itself alone, and their order does not matter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.model.builder import ModelBuilder
from simwarp.soil import soil_under
from simwarp.vehicle.construction import add_chassis_box, add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicles, per_world
from simwarp.vehicle.vehicle_convoy import HMMWV_BOX
from tests.physics.sample_vehicles import shipped

STARTS = {
    # crosses the ruts of "first" behind it
    "first": ((0.0, 0.0), 0.0, 5.0),
    "across": ((1.0, -12.0), 0.5 * math.pi, 6.0),
    "far": ((-40.0, 13.0), 0.3, 3.0),
}
"""(x, y) [m], heading [rad] and speed [m/s]."""
STEPS = 1300
STATE = ("body_x", "body_rot", "body_v", "body_omega")
PUSH = ScriptSpec(throttle=((0.0, 0.8),))


class Field:
    """Vehicles of these names on mid soil, numbered in their order."""

    def __init__(self, names: tuple[str, ...], *, pages: int = 256, worlds: int = 2) -> None:
        self.names = names
        spec = with_options(shipped("hmmwv-reduced"), tire="soil-rigid")
        builder, self.parts = ModelBuilder(), []
        for name in names:
            (x, y), heading, speed = STARTS[name]
            turn = (0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading))
            place = sw.pose((x, y, spec.start_height), turn)
            self.parts.append(add_vehicle(builder, spec, at=place, prefix=f"{name}_", speed=speed))
        for each in self.parts:
            add_chassis_box(builder, each, half=HMMWV_BOX[0], position=HMMWV_BOX[1])
        model: Any = builder.finalize(worlds, "cpu", per_world=per_world())
        self.vehicles = Vehicles(self.parts, model)
        self.soil = soil_under(self.vehicles, "mid", spacing=0.1, pages=pages)
        driver = ScriptedDriver(self.vehicles, PUSH)
        self.sim = sw.Simulation(
            model, 2.0e-3, elements=[driver, self.vehicles, self.soil], solver=VEHICLE_SOLVER
        )  # fmt: skip

    def told(self, name: str) -> dict[str, np.ndarray]:
        """Everything that there is of one vehicle."""
        number = self.names.index(name)
        bodies = list(self.parts[number].bodies)
        found = {key: getattr(self.sim.state, key).numpy()[:, bodies] for key in STATE}
        vehicle = self.vehicles[number]
        found |= {key: getattr(vehicle.tires, key).numpy() for key in ("load", "slip_ratio", "deflection", "force_w")}
        found["gear"] = vehicle.gear.numpy()
        return found


@pytest.fixture(scope="module")
def crossed() -> Field:
    field = Field(("first", "across"))
    field.sim.step(STEPS)
    return field


def difference(a: Field, b: Field, name: str) -> list[str]:
    """What differs of one vehicle, in any bit."""
    one, other = a.told(name), b.told(name)
    return [key for key in one if one[key].tobytes() != other[key].tobytes()]


def test_the_second_crosses_the_ruts_of_the_first(crossed):
    """Otherwise the tests below tell nothing."""
    alone = Field(("across",))
    alone.sim.step(STEPS)
    assert "body_x" in difference(alone, crossed, "across")
    assert difference(alone, crossed, "across") != []
    assert float(crossed.vehicles.tires.deflection.numpy().min()) > 0.02


def test_order_does_not_matter(crossed):
    turned = Field(("across", "first"))
    turned.sim.step(STEPS)
    for name in ("first", "across"):
        assert difference(crossed, turned, name) == []


def test_order_does_not_matter_to_recycled_pages():
    one, other = (Field(names, pages=64) for names in (("first", "across"), ("across", "first")))
    for field in (one, other):
        field.sim.step(STEPS)
        assert (field.soil.recycled.numpy() > 0).all()
    for name in ("first", "across"):
        assert difference(one, other, name) == []


def test_a_vehicle_out_of_touch_equals_itself_alone(crossed):
    three = Field(("far", "first", "across"))
    three.sim.step(STEPS)
    alone = Field(("far",))
    alone.sim.step(STEPS)
    assert difference(alone, three, "far") == []
    for name in ("first", "across"):
        assert difference(crossed, three, name) == []
