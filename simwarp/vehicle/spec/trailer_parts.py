"""Trailers of a vehicle, the hitches that hold them, and the units of the train that they make with it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np

from simwarp.core.constraints import MinLen, NotNegative, Point, Positive
from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.parts import ZERO, Spec, SpecError, Vec3, refuse
from simwarp.vehicle.spec.suspension_parts import SolidAxle
from simwarp.vehicle.spec.tabulated_suspension import TabulatedSuspension
from simwarp.vehicle.spec.vehicle_parts import Axle, Chassis


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hitch(Spec):
    """What holds a trailer: a ball, or a fifth wheel that leaves yaw and pitch free and carries roll.

    The plate of a fifth wheel pitches about y of the towing unit; the kingpin turns in it about z of the trailer. Both
    points are one as built, and the axes of both units parallel.
    """

    kind: Literal["ball", "fifth-wheel"]
    towing_point: Point
    """In the frame of reference of the towing unit [m]."""
    trailer_point: Point
    """In that of the trailer [m]."""
    yaw_friction: NotNegative = 0.0
    """Dry friction against yaw, as of a greased plate or a stabiliser [N·m]."""
    yaw_damping: NotNegative = 0.0
    """Viscous damping of yaw [N·m·s/rad]."""
    yaw_limit: Positive | None = None
    """Greatest turn to either side [rad]; None: as far as it goes."""
    pitch_limit: Positive | None = None
    """Greatest pitch either way [rad]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trailer(Spec):
    """A towed unit: a chassis on axles, which nothing drives or steers, behind the vehicle or the trailer before it.

    `chassis` and the places of `axles` are in the trailer's own frame of reference (X forward, Y left, Z up).
    """

    name: str
    hitch: Hitch
    chassis: Chassis
    axles: Annotated[tuple[Axle, ...], MinLen(1)]

    def check(self) -> None:
        """Its axles are such as nothing steers."""
        for index, axle in enumerate(self.axles):
            key = f"axles[{index}]"
            if axle.steering is not None:
                raise refuse(f"{key}.steering", "left out of a trailer, which has no steerings", axle.steering)
            if isinstance(axle.suspension, TabulatedSuspension):
                raise SpecError(f"{key}.suspension: must have linkages on a trailer, got tables; describe them")
            steered = isinstance(axle.suspension, BeamAxle) and axle.suspension.is_steered
            if steered or (isinstance(axle.suspension, SolidAxle) and axle.suspension.draglink_chassis is not None):
                rule = "left out of a trailer, which has no steering to hold it"
                raise SpecError(f"{key}.suspension.draglink_chassis: must be {rule}; leave it out")
        behind = self.hitch.trailer_point[0] - min(axle.location[0] for axle in self.axles)
        if behind <= 0.0:
            rule = "ahead of the rearmost axle, or the trailer turns round"
            raise refuse("hitch.trailer_point", rule, self.hitch.trailer_point, "x points forwards")


class Unit(NamedTuple):
    """The towing vehicle or one of its trailers."""

    key: str
    """What its keys begin with in a file: nothing, or such as "trailers[0].". """
    chassis: Chassis
    axles: tuple[Axle, ...]
    """In its own frame of reference."""
    origin: Vec3
    """Of its frame of reference in the vehicle's, as built [m]."""
    hitch: Hitch | None
    """None of the towing vehicle."""


def units_of(chassis: Chassis, axles: tuple[Axle, ...], trailers: Sequence[Trailer]) -> tuple[Unit, ...]:
    """The towing vehicle, then its trailers, each held by the one before."""
    units = [Unit("", chassis, axles, ZERO, None)]
    for index, trailer in enumerate(trailers):
        hitch = trailer.hitch
        x, y, z = np.add(units[-1].origin, np.subtract(hitch.towing_point, hitch.trailer_point)).tolist()
        units.append(Unit(f"trailers[{index}].", trailer.chassis, trailer.axles, (x, y, z), hitch))
    return tuple(units)


def moved_axle(axle: Axle, by: Vec3) -> Axle:
    """An axle elsewhere, with its anti-roll bar."""
    x, y, z = np.add(axle.location, by).tolist()
    bar = axle.antiroll_bar
    if bar is not None:
        bar_x, bar_y, bar_z = np.add(bar.location, by).tolist()
        bar = dataclasses.replace(bar, location=(bar_x, bar_y, bar_z))
    return dataclasses.replace(axle, location=(x, y, z), antiroll_bar=bar)
