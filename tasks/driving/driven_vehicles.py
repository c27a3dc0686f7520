"""Vehicles that a driving task may be given in place of its own, with what a task must know of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from simwarp.vehicle import VehicleParts

from ..framework.config import require
from ..framework.mixing import Mix
from .driving_config import DrivingConfig

SETTLING = 0.9
"""Time in which a vehicle comes to rest on its springs before the first episode [s]."""
SETTLING_ON_AIR = 1.6
"""The same on flexible tires, whose air damps little [s]."""
VEHICLE_ARRAYS = ("joint_friction", "coupling_coefficient")
"""Model parameters that a vehicle writes, world by world."""
OWN_MEASURES = ("vehicle_name", "full_name", "chassis_half", "chassis_place", "camera_place")
"""What a class that drives another vehicle says together."""
CHASSIS_GROUP = 1 << 20
"""Bit of the collision group of vehicles' chassis; obstacles meet nothing else. Chassis of two vehicles meet. Tracks,
which take the lowest free bits, leave it free."""

Place = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class DrivenVehicle:
    """A vehicle as driving tasks know it; the fields are class variables of `DrivingTask`.

    Attributes:
        vehicle_name: name of the vehicle that policies are trained on.
        full_name: name of the full model, driven with the field ``full``; the same where there is one model only.
        tire: name of its tires; None: those of the vehicle's description.
        chassis_half: half lengths (x, y, z) of the box that stands for the chassis in contacts [m].
        chassis_place: middle of that box in the vehicle's frame of reference [m].
        camera_place: place of the policy's camera or lidar in the vehicle's frame of reference [m].
    """

    vehicle_name: str
    full_name: str
    tire: str | None
    chassis_half: Place
    chassis_place: Place
    camera_place: Place


HMMWV: Final = DrivenVehicle("hmmwv-reduced", "hmmwv", None, (2.3, 1.05, 0.5), (0.0, 0.0, 0.2), (1.5, 0.0, 0.875))
GATOR: Final = DrivenVehicle("gator", "gator", "tmeasy", (1.35, 0.75, 0.35), (0.0, 0.0, 0.2), (0.65, 0.0, 0.75))
SEDAN: Final = DrivenVehicle("sedan", "sedan", "tmeasy", (2.2, 0.9, 0.4), (0.0, 0.0, 0.0), (1.5, 0.0, 0.875))
TRUCK: Final = DrivenVehicle("truck", "truck", "tmeasy", (3.2, 1.25, 0.9), (0.0, 0.0, 1.2), (3.25, 0.0, 1.3))
SEMITRAILER: Final = dataclasses.replace(
    TRUCK, vehicle_name="truck-semitrailer", full_name="truck-semitrailer", chassis_half=(1.2, 1.25, 1.0),
    chassis_place=(2.0, 0.0, 1.3),
)  # fmt: skip
SEDAN_TRAILER: Final = dataclasses.replace(SEDAN, vehicle_name="sedan-trailer", full_name="sedan-trailer")
_FULL: Final = {"hmmwv": HMMWV, "gator": GATOR, "sedan": SEDAN}
_REDUCED: Final = {f"{name}-14dof": known for name, known in _FULL.items()}
DRIVEN_VEHICLES: Final[Mapping[str, DrivenVehicle]] = MappingProxyType(
    _FULL
    | {each.vehicle_name: each for each in (TRUCK, SEMITRAILER, SEDAN_TRAILER)}
    | {name: dataclasses.replace(known, vehicle_name=name) for name, known in _REDUCED.items()}
)
"""Vehicles of the size of a road, by the names that the field ``vehicle`` has for them."""


def settling_time(parts: VehicleParts) -> float:
    """Return the time in which a vehicle comes to rest before the first episode [s]."""
    return SETTLING_ON_AIR if any(side.mesh is not None for side in parts.sides) else SETTLING


@dataclasses.dataclass(frozen=True)
class VehicleChoiceConfig(DrivingConfig):
    """Fields of driving tasks whose world has room for any of `DRIVEN_VEHICLES`."""

    vehicle: str | None = None
    """Vehicle that is driven: hmmwv, gator, sedan, truck, truck-semitrailer, sedan-trailer, or one of the first three
    reduced, such as hmmwv-14dof; several with commas between them, such as hmmwv,gator,sedan, share the batch, a group
    of worlds for each. None: the task's own."""

    def validate(self) -> None:
        """Check that the vehicles are known, and different ones."""
        super().validate()
        names, known = self.vehicles, list(DRIVEN_VEHICLES)
        right = len(set(names)) == len(names) and all(name in known for name in names)
        require(right, self, "vehicle", f"different ones of {', '.join(known)}, with commas between them")

    @property
    def vehicles(self) -> list[str]:
        """Return the names of the vehicles that are asked for."""
        return [] if self.vehicle is None else [name.strip() for name in self.vehicle.split(",")]

    def mixed(self) -> Mix | None:
        """Return what differs between the models: by several vehicles, or as ``mix`` says."""
        names = self.vehicles
        if len(names) < 2:
            return super().mixed()
        require(not self.mix, self, "mix", "empty where vehicle names several, which are a mix")
        return Mix("vehicle", tuple(names))

    def driven(self) -> DrivenVehicle | None:
        """Return the vehicle that is driven in place of the task's own, if one is asked for."""
        return None if self.vehicle is None else DRIVEN_VEHICLES[self.vehicle.strip()]
