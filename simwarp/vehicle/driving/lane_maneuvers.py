"""Lane changes between cones: ISO 3888-1 and ISO 3888-2."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from simwarp.vehicle.driving.driver_choices import steering_for
from simwarp.vehicle.driving.intervention import Intervention, Pedals
from simwarp.vehicle.driving.lane_courses import (
    STATION,
    LaneCourse,
    double_lane_change_course,
    driven_line,
    obstacle_avoidance_course,
)
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.path_tracking import LookAhead, PIDGains, Unicycle, wheelbase
from simwarp.vehicle.driving.paths import Path
from simwarp.vehicle.driving.reachable_speeds import held_speed
from simwarp.vehicle.driving.rolling_start import LEAD, rolling
from simwarp.vehicle.driving.vehicle_outline import Outline, outline_of
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, VehicleSpec

ISO_3888_1_SPEED: Final = 15.0
ISO_3888_2_SPEED: Final = 12.0
"""Through a course of lanes, for vehicles whose description has no other one [m/s]."""
RELEASE: Final = 2.0
"""ISO 3888-2: way of the front into the first lane after which the throttle is released [m]."""
RUN_OUT: Final = 20.0
"""Behind the last lane [m]."""
PREVIEW: Final = 0.35
"""Of the driver between cones [s], and 0.8 wheelbases at least."""
NEAREST: Final = 0.8
FULL_ANGLE: Final = 0.53
"""Angle of road wheels at full steering that the driver reckons with [rad]."""
CHARACTERISTIC_SPEED: Final = 18.0
"""At which the driver steers twice as much as at a walk on the same curve [m/s]."""
COASTING_SPEED: Final = 10.0
"""ISO 3888-2: below it the throttle is held, or the vehicle would stop between the cones [m/s]."""
ROOM: Final = 1.5
"""Of the approach: as many times the vehicle's length at least."""


def cone_driver(spec: VehicleSpec, speed: float) -> LookAhead | Unicycle:
    """Steering between cones at a speed [m/s]: to a point that is nearer than usual, by as much as the curve asks for.

    On a circle of curvature k the point at a distance d straight ahead is k d²/2 beside the path; the gain turns that
    into the angle l k (1 + (v/v_c)²) of a vehicle with wheelbase l and characteristic speed v_c.
    """
    if isinstance(spec.driveline, DifferentialDrive):
        return steering_for(spec)
    size = wheelbase(spec)
    distance = max(NEAREST * size, PREVIEW * speed)
    angle = 2.0 * size * (1.0 + (speed / CHARACTERISTIC_SPEED) ** 2) / distance**2
    return LookAhead(distance=distance, gains=PIDGains(proportional=angle / FULL_ANGLE))


def lane_speed(spec: VehicleSpec, usual: float) -> float:
    """Through a course of lanes: what the description gives, or a usual one that the vehicle holds [m/s]."""
    return spec.maneuver_defaults.speed_in_lanes or held_speed(spec, usual)


def between_cones(
    spec: VehicleSpec, course_of: Callable[[Outline, float], LaneCourse], speed: float
) -> tuple[LaneCourse, Path]:  # fmt: skip
    """The course of a vehicle, entered two seconds after the start at a speed [m/s], and the line through it.

    The line is the same at all speeds: straight up to a place before the entry, from where on it is that of least
    curvature.
    """
    outline = outline_of(spec)
    room = ROOM * outline.length + outline.front
    course = course_of(outline, max(LEAD * speed + outline.front, room))
    still = course_of(outline, 0.0)
    line = driven_line(still, -room, still.end + RUN_OUT + outline.length).points + np.array([course.start, 0.0])
    ahead = [] if line[0, 0] <= STATION else [(0.0, 0.0)]
    return course, Path(np.array([*ahead, *line]))


def iso_3888_1(spec: VehicleSpec, *, speed: float | None = None, duration: float | None = None) -> Maneuver:
    """The double lane change of ISO 3888-1 between its cones, at a speed [m/s] that the driver holds.

    It begins in motion and enters the first lane two seconds later; the line is that of least curvature.
    """
    target = lane_speed(spec, ISO_3888_1_SPEED) if speed is None else speed
    course, line = between_cones(spec, double_lane_change_course, target)
    total = (course.end + course.outline.length) / target * 1.1 - LEAD + 0.5 if duration is None else duration
    return rolling(
        spec, "iso-3888-1", speed=target, duration=total, path=line, steering=cone_driver(spec, target), course=course
    )  # fmt: skip


def iso_3888_2(spec: VehicleSpec, *, speed: float | None = None, duration: float | None = None) -> Maneuver:
    """The obstacle avoidance of ISO 3888-2 between its cones; 2 m into the first lane the throttle is released.

    It begins in motion and enters the first lane two seconds later, at a speed [m/s]; the line is that of least
    curvature. Below 10 m/s the throttle is held: the vehicle would stop between the cones.
    """
    target = lane_speed(spec, ISO_3888_2_SPEED) if speed is None else speed
    course, line = between_cones(spec, obstacle_avoidance_course, target)
    # engine and tires slow it down by a third or so
    total = (course.end + course.outline.length) / target * 1.6 - LEAD + 1.0 if duration is None else duration
    release = Intervention(beyond=course.start + RELEASE - course.outline.front, pedals=Pedals.RELEASED)
    return rolling(
        spec, "iso-3888-2", speed=target, duration=total, path=line, steering=cone_driver(spec, target), course=course,
        intervention=release if target >= COASTING_SPEED else None,
    )  # fmt: skip
