"""What a manoeuvre is: a driver, the ground and what lies across the way, and how long it takes."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Final

from simwarp.vehicle.driving.drawbar import DrawbarSpec
from simwarp.vehicle.driving.drivers import ScriptSpec
from simwarp.vehicle.driving.intervention import Intervention
from simwarp.vehicle.driving.lane_courses import LaneCourse
from simwarp.vehicle.driving.path_tracking import PathTrackingSpec

SETTLING: Final = 1.0
"""Time with full brakes before a manoeuvre begins [s]."""


class CrossingKind(enum.Enum):
    """What lies across the way."""

    HALF_ROUND = "half-round"
    TRENCH = "trench"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Crossing:
    """An obstacle across the way of a tracked vehicle, on level ground.

    Attributes:
        kind: of obstacle.
        size: radius of a half round, or width of a trench [m].
        ahead: of the vehicle's frame of reference at the start: middle of a half round, near edge of a trench [m].
        length: of the vehicle, from its frame of reference to its last road wheel's far side [m].
    """

    kind: CrossingKind
    size: float
    ahead: float
    length: float

    @property
    def beyond(self) -> float:
        """Its far edge, from the start [m]."""
        return self.ahead + self.size


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionPatch:
    """A rectangle of the road on which the friction is another one.

    Attributes:
        x: its first and last x [m].
        y: its first and last y [m].
        factor: of the road's friction.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    factor: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bump:
    """A bump across the road: the height of half a sine wave.

    Attributes:
        start: x of its near edge [m].
        length: along x [m].
        height: in its middle [m].
    """

    start: float
    length: float
    height: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Maneuver:
    """A script over time from the start of the simulation, or a path to follow.

    It lasts for `duration` [s] from its zero on, which is `start` [s] after the start of the simulation.
    """

    name: str
    script: ScriptSpec = dataclasses.field(default_factory=ScriptSpec)
    duration: float
    start: float = SETTLING
    follow: PathTrackingSpec | None = None
    """If given, a path tracker that drives in place of the script."""
    drawbar: DrawbarSpec | None = None
    """If given, a drawbar test in place of the script."""
    slope: float = 0.0
    """Of the ground, rise per run; the vehicle faces uphill."""
    place: tuple[float, float, float] | None = None
    """Where the vehicle's frame of reference begins [m]; None: above the origin, as high as it stands."""
    crossing: Crossing | None = None
    """What lies across the way of a tracked vehicle."""
    gyration: bool = False
    """A simple driveline of tracks turns the inner side's torque around at full steering."""
    initial_speed: float = 0.0
    """With which a vehicle on wheels begins, all its parts in motion [m/s]."""
    intervention: Intervention | None = None
    """What the test does to the driver's inputs from a moment on; on wheels."""
    course: LaneCourse | None = None
    """Lanes between cones that a vehicle on wheels must not leave."""
    patches: tuple[FrictionPatch, ...] = ()
    """Of the road below a vehicle on wheels with another friction."""
    bump: Bump | None = None
    """Across the road of a vehicle on wheels."""
    wheelbase: float = math.nan
    """Of the vehicle, from which an understeer gradient is reckoned [m]."""
    steering_angle: float = math.nan
    """Of the front wheels per steering input, by the linkage alone, straight ahead [rad]."""
    held_gear: int | None = None
    """In which an automatic transmission stays throughout; None: it shifts."""
    steering_unit: float = math.nan
    """Steering input at a lateral acceleration of 0.3 g at this speed, to which amplitudes refer."""


def after_settling(
    *points: tuple[float, float], before: float, settling: float = SETTLING
) -> tuple[tuple[float, float], ...]:
    """Points of the manoeuvre's own time, with a value until it begins."""
    moved = tuple((settling + time, value) for time, value in points)
    return ((0.0, before), (settling, before), *moved)
