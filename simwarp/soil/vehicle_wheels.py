"""Soil under vehicles: their wheels as a soil takes them, and what it tells their tires."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from simwarp.core.types import ModelError
from simwarp.soil.soil import Soil
from simwarp.soil.soil_parameters import SoilSpec
from simwarp.soil.soil_shapes import SoilShape, SoilWheel
from simwarp.vehicle.tires.soil_tires import TEMPLATE, SoilTires, soil_rigid_parameters
from simwarp.vehicle.vehicle import Vehicle


def wheels_of(vehicle: Vehicle) -> list[SoilWheel]:
    """Wheels of a vehicle on `soil-rigid` tires, in the order of its reports.

    Raises:
        ModelError: its tires make forces of their own.
    """
    spec = vehicle.parts.spec
    if not isinstance(vehicle.tires, SoilTires):
        found = ", ".join(dict.fromkeys(axle.tire.template for axle in spec.axles))
        raise ModelError(
            f"soil: tires of vehicle '{spec.name}' must be {TEMPLATE}, got {found}, which do not deform it; "
            f"with_options(spec, tire='{TEMPLATE}')"
        )
    tires = [spec.axles[side.axle].tire for side in vehicle.parts.sides]
    return [
        SoilWheel(
            body=side.spindle, radius=tire.radius, width=tire.width, crown=soil_rigid_parameters(tire).crown
        )
        for side, tire in zip(vehicle.parts.sides, tires, strict=True)
    ]  # fmt: skip


def soil_under(
    vehicles: Vehicle | Sequence[Vehicle], soil: SoilSpec | str | Sequence[SoilSpec | str] = "mid", *,
    shapes: Sequence[SoilShape] = (), **options: Any,
) -> Soil:  # fmt: skip
    """Soil under the wheels of vehicles of one model; their `tires` tell its loads, slips and sinkages.

    Args:
        vehicles: on `soil-rigid` tires.
        soil: a `SoilSpec` or the name of a preset, or several for `soil_map`.
        shapes: what sinks in beside the wheels, after which they come: bellies, rocks.
        options: further arguments of `Soil`.

    Raises:
        ModelError: the tires of one make forces of their own, or a value breaks its rule.
    """
    below = [vehicles] if isinstance(vehicles, Vehicle) else list(vehicles)
    wheels = [wheels_of(vehicle) for vehicle in below]
    made = Soil(below[0].model, [*(wheel for each in wheels for wheel in each), *shapes], soil, **options)
    first = 0
    for vehicle, each in zip(below, wheels, strict=True):
        assert isinstance(vehicle.tires, SoilTires)
        vehicle.tires.show(made, first)
        first += len(each)
    return made
