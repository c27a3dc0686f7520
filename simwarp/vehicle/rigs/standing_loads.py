"""Mass, centre of mass and wheel loads of a vehicle that stands as it is built, and the shares of its brakes.

A trailer stands on its axles and on its hitch, which loads the unit that tows it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np

from simwarp.core.types import pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.rigs.tire_rig import static_deflection
from simwarp.vehicle.spec.drivetrain_parts import (
    DifferentialDrive,
    MultiAxleDriveline,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
)
from simwarp.vehicle.spec.parts import Array
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.tires.parameter_vector import MODELS

GRAVITY: Final = 9.81
"""[m/s²]."""


@dataclasses.dataclass(frozen=True)
class StandingLoads:
    """A vehicle on level ground, in its frame of reference; A axles with those of its trailers.

    Attributes:
        mass: of the vehicle without its trailers [kg].
        com: (3,) its centre of mass as built [m].
        own_axles: how many axles are its own; those of trailers follow.
        hitch_load: (trailers,) vertical force of each on the unit before it, positive downwards [N].
        axle_x: (A,) of the wheels' centres [m].
        center_z: (A,) of the wheels' centres [m].
        track: (A,) between the wheels' centres [m].
        wheel_load: (A,) of each wheel of the axle [N].
        loaded_radius: (A,) of its tires under that load [m].
        brake_share: (A,) share of the axle of the brakes' force; zeros without brakes.
    """

    mass: float
    com: Array
    own_axles: int
    hitch_load: Array
    axle_x: Array
    center_z: Array
    track: Array
    wheel_load: Array
    loaded_radius: Array
    brake_share: Array

    @property
    def wheelbase(self) -> float:
        """From the first to the last axle of the vehicle without its trailers [m]."""
        return float(self.axle_x[0] - self.axle_x[self.own_axles - 1])

    @property
    def com_height(self) -> float:
        """Of the centre of mass above the ground, on which first and last axle stand [m]."""
        ends = [self.own_axles - 1, 0]
        levels = (self.center_z - self.loaded_radius)[ends]
        return float(self.com[2] - np.interp(self.com[0], self.axle_x[ends], levels))


def driven_axles(spec: VehicleSpec) -> tuple[int, ...]:
    """Indices of the axles that the driveline drives; none of a vehicle without one."""
    match spec.driveline:
        case None:
            return ()
        case DifferentialDrive():
            return tuple(range(len(spec.axles)))
        case SimpleDriveline() as line:
            shares = (line.front_torque_fraction, 1.0 - line.front_torque_fraction)
            return tuple(axle for axle, share in zip(line.axles, shares, strict=True) if share > 0.0)
        case ShaftsDriveline2WD() as line:
            return (line.axle % len(spec.axles),)
        case ShaftsDriveline4WD() | MultiAxleDriveline() as line:
            return line.axles


def standing_loads(spec: VehicleSpec, *, device: str = "cpu") -> StandingLoads:
    """Loads by the lever rule; of more than two axles, those of a rigid chassis on equal springs.

    Args:
        spec: the vehicle.
        device: that evaluates the tires' law for their loaded radius.

    Raises:
        SpecError: parts of the vehicle do not fit together.
    """
    spec.require_linkages("the rig of its suspensions")
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, at=pose())
    centers = np.array([builder.bodies[side.spindle].pose.position for side in parts.sides]).reshape(-1, 2, 3)
    x = centers[:, :, 0].mean(axis=1)
    loads, hitches = np.zeros(len(x)), np.zeros(len(spec.trailers))
    behind, at = 0.0, 0.0  # force of the unit behind on its hitch, and where [N, m]
    for number in range(len(parts.units) - 1, -1, -1):
        unit = parts.units[number]
        mass, com = _mass_of(builder, unit.bodies)
        hitch, places = spec.units[number].hitch, x[unit.axles.start : unit.axles.stop]
        force = GRAVITY * mass + behind
        lever = (GRAVITY * mass * float(com[0]) + behind * at) / force
        if hitch is not None:
            at = spec.units[number].origin[0] + hitch.trailer_point[0]
            # two supports, the hitch and the middle of its axles, which are taken to share alike
            behind = force * (lever - float(places.mean())) / (at - float(places.mean()))
            hitches[number - 1] = behind
            loads[unit.axles.start : unit.axles.stop] = 0.5 * (force - behind) / len(places)
        else:
            loads[unit.axles.start : unit.axles.stop] = 0.5 * _shares(places, lever) * force
    radii = np.array(
        [
            axle.tire.radius - float(static_deflection(axle.tire, load, device=device))
            if axle.tire.template in MODELS and load > 0.0
            else axle.tire.radius
            for axle, load in zip(spec.all_axles, loads, strict=True)
        ]
    )
    brakes = np.array(
        [0.0 if axle.brake is None else axle.brake.max_torque / axle.tire.radius for axle in spec.all_axles]
    )
    share = brakes / brakes.sum() if brakes.sum() > 0.0 else brakes
    track = centers[:, 0, 1] - centers[:, 1, 1]
    return StandingLoads(
        mass, com, len(spec.axles), hitches, x, centers[:, :, 2].mean(axis=1), track, loads, radii, share
    )  # fmt: skip


def _mass_of(builder: ModelBuilder, bodies: Sequence[int]) -> tuple[float, Array]:
    """Mass [kg] and centre of mass (3,) [m] of some bodies as built."""
    masses = np.array([builder.bodies[body].mass for body in bodies])
    places = np.array([builder.bodies[body].pose.position for body in bodies])
    return float(masses.sum()), np.asarray(masses @ places / masses.sum(), np.float64)


def _shares(places: Array, lever: float) -> Array:
    """Shares (A,) of a force at `lever` that axles at (A,) places [m] bear: of more than two, those on equal springs
    below a rigid chassis.
    """
    away = places - places.mean()
    spread = float(away @ away)
    tilt = 0.0 if spread == 0.0 else (lever - float(places.mean())) / spread
    return np.asarray(1.0 / len(places) + tilt * away)
