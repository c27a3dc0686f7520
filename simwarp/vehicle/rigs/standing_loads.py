"""Mass, centre of mass and wheel loads of a vehicle that stands as it is built, and the shares of its brakes."""

from __future__ import annotations

import dataclasses
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
    """A vehicle on level ground, in its frame of reference; A axles.

    Attributes:
        mass: of the whole vehicle [kg].
        com: (3,) centre of mass as built [m].
        axle_x: (A,) of the wheels' centres [m].
        center_z: (A,) of the wheels' centres [m].
        track: (A,) between the wheels' centres [m].
        wheel_load: (A,) of each wheel of the axle [N].
        loaded_radius: (A,) of its tires under that load [m].
        brake_share: (A,) share of the axle of the brakes' force; zeros without brakes.
    """

    mass: float
    com: Array
    axle_x: Array
    center_z: Array
    track: Array
    wheel_load: Array
    loaded_radius: Array
    brake_share: Array

    @property
    def wheelbase(self) -> float:
        """From the first to the last axle [m]."""
        return float(self.axle_x[0] - self.axle_x[-1])

    @property
    def com_height(self) -> float:
        """Of the centre of mass above the ground, on which first and last axle stand [m]."""
        levels = (self.center_z - self.loaded_radius)[[-1, 0]]
        return float(self.com[2] - np.interp(self.com[0], self.axle_x[[-1, 0]], levels))


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
    bodies = builder.bodies[parts.bodies.start : parts.bodies.stop]
    masses = np.array([body.mass for body in bodies])
    com = masses @ np.array([body.pose.position for body in bodies]) / masses.sum()
    centers = np.array([builder.bodies[side.spindle].pose.position for side in parts.sides]).reshape(-1, 2, 3)
    x = centers[:, :, 0].mean(axis=1)
    weight = GRAVITY * float(masses.sum())
    away = x - x.mean()
    spread = float(away @ away)
    tilt = 0.0 if spread == 0.0 else (float(com[0]) - float(x.mean())) / spread
    loads = 0.5 * weight * (1.0 / len(x) + tilt * away)
    radii = np.array(
        [
            axle.tire.radius - float(static_deflection(axle.tire, load, device=device))
            if axle.tire.template in MODELS and load > 0.0
            else axle.tire.radius
            for axle, load in zip(spec.axles, loads, strict=True)
        ]
    )
    brakes = np.array([0.0 if axle.brake is None else axle.brake.max_torque / axle.tire.radius for axle in spec.axles])
    share = brakes / brakes.sum() if brakes.sum() > 0.0 else brakes
    track = centers[:, 0, 1] - centers[:, 1, 1]
    return StandingLoads(
        float(masses.sum()), np.asarray(com, np.float64), x, centers[:, :, 2].mean(axis=1), track, loads, radii, share
    )
