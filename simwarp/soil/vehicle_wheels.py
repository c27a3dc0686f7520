"""The wheels of a vehicle as a soil takes them."""

from __future__ import annotations

from simwarp.core.types import ModelError
from simwarp.soil.soil import SoilWheel
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
