"""Whether the parts of an axle reach each other: hardpoints around their wheel, an anti-roll bar and its drop links.

A point that is far off, in another frame or with a digit too many, assembles all the same: links are as long as they
are drawn. What it makes breaks down where it moves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.parts import Array, RigidPart, SpecError, Vec3
from simwarp.vehicle.spec.plausibility import lengths
from simwarp.vehicle.spec.suspension_parts import (
    AntirollBar,
    DoubleWishbone,
    DoubleWishboneReduced,
    MacPhersonStrut,
    MultiLink,
    SingleWishbone,
    SolidAxle,
    Suspension,
    ThreeLink,
    TrailingArm,
)
from simwarp.vehicle.spec.vehicle_parts import Axle

AROUND_WHEEL: Final = 4.0
"""Farthest hardpoint from its wheel's centre, in radii of the tire: the longest trailing arms, those of desert racers,
have three. The track is allowed where it is more: steering and tubes of beam axles reach to the other wheel."""
ANYWHERE: Final = frozenset({"pivot", "ball"})
"""Points without that bound: an arm of tens of metres stands for a wheel that is led straight up, and a push pipe is as
long as the vehicle allows."""
BESIDE_ARM: Final = 1.0
"""Farthest foot of a drop link from the part that holds it, in radii of the tire: brackets are shorter than a wheel."""
FOLLOWED: Final = 0.17
"""Travel of the wheel up and down from the state as built through which drop links have to reach, in radii of the tire:
what the bench of a suspension goes through."""
STATES: Final = 11
"""Travels there."""
LONGER: Final = 150
"""Lengths of a drop link that are tried for the message, up to a radius of the tire more: steps of 5 % at most."""

HELD_BY: Final[dict[type, tuple[str, ...]]] = {
    DoubleWishbone: ("lower_arm_front", "lower_arm_back", "lower_arm_upright"),
    DoubleWishboneReduced: ("upper_arm_upright", "lower_arm_upright", "tierod_upright", "spindle"),
    SingleWishbone: ("arm_chassis", "arm_upright"),
    MacPhersonStrut: ("lower_arm_front", "lower_arm_back", "lower_arm_upright"),
    MultiLink: ("trailing_link_chassis", "trailing_link_upright"),
    SolidAxle: ("axle_tube", "upper_link_axle", "lower_link_axle", "knuckle_upper", "knuckle_lower"),
    TrailingArm: ("pivot", "spindle"),
    ThreeLink: ("arm_chassis", "upper_rod_arm", "lower_rod_arm", "spindle"),
    BeamAxle: ("axle_tube", "spindle"),
}  # fmt: skip
"""Points of the part that holds the foot of a drop link, or other parts whose centres of mass lie on it."""


def check_reach(axles: Sequence[Axle], key: str = "") -> None:
    """All axles of a vehicle or of a trailer, whose keys begin with `key`.

    Raises:
        SpecError: a point that is too far off, with the distance that is allowed; a drop link that is too short.
    """
    for index, axle in enumerate(axles):
        _check_hardpoints(f"{key}axles[{index}]", axle)
        if axle.antiroll_bar is not None and type(axle.suspension) in HELD_BY:
            _check_bar(f"{key}axles[{index}].antiroll_bar", axle, axle.antiroll_bar)


def _around(axle: Axle) -> float:
    """How far a point of an axle may be from its wheel's centre [m]."""
    return max(AROUND_WHEEL * axle.tire.radius, 2.0 * abs(axle.suspension.spindle.com[1]))


def _check_hardpoints(key: str, axle: Axle) -> None:
    center, reach = axle.suspension.spindle.com, _around(axle)
    for where, _, value in lengths(axle.suspension, f"{key}.suspension"):
        bounded = where.rpartition(".")[2] not in ANYWHERE
        if bounded and isinstance(value, tuple) and math.dist(value, center) > reach:
            raise SpecError(
                f"{where}: must be within {reach:.4g} m of the wheel's centre {center} (4 tire radii, or the track), "
                f"got {value}, {math.dist(value, center):.4g} m off; give metres in the frame of the axle, left side"
            )


def _check_bar(key: str, axle: Axle, bar: AntirollBar) -> None:
    """The bar is near its axle, its links end at the part that holds them, and they reach as the wheel travels."""
    radius, center = axle.tire.radius, np.array(axle.suspension.spindle.com)
    middle = np.subtract(bar.location, axle.location)
    foot = middle + np.array((bar.arm_width, bar.arm_length, bar.droplink_height))
    part = [np.array(point) for point in _holding_points(axle.suspension)]
    off = min(_distance(foot, a, b) for a, b in itertools.combinations(part, 2))
    if off > BESIDE_ARM * radius:
        raise SpecError(
            f"{key}: its drop link must end within {BESIDE_ARM * radius:.4g} m of the arm that holds it (a tire's "
            f"radius), got {off:.4g} m at location + (arm_width, arm_length, droplink_height), {_text(foot)} in the "
            "axle's frame; change these"
        )
    if math.dist(middle, center) > _around(axle):
        rule = f"within {_around(axle):.4g} m of the wheel's centre (4 tire radii, or the track)"
        far = math.dist(middle, center)
        raise SpecError(
            f"{key}.location: must be {rule}, got {bar.location}, {far:.4g} m off; give the vehicle's frame"
        )
    _check_droplink(f"{key}.droplink_height", axle, bar, middle)


def _check_droplink(key: str, axle: Axle, bar: AntirollBar, middle: Array) -> None:
    reach = FOLLOWED * axle.tire.radius
    if _follows(axle.suspension, bar, middle, bar.droplink_height, reach):
        return
    sign = math.copysign(1.0, bar.droplink_height)
    least = max(abs(bar.droplink_height), 1e-3 * axle.tire.radius)
    tried = np.geomspace(least, least + axle.tire.radius, LONGER)
    longer = next((each for each in tried if _follows(axle.suspension, bar, middle, sign * each, reach)), None)
    rule = f"long enough for the bar's end to follow the wheel through {reach:.3g} m up and down"
    if longer is None:
        remedy = "no length is enough there: make arm_width longer or move location"
    else:  # a bit more than the least, for it is printed with three digits
        remedy = f"{sign * 1.02 * longer:.3g} is enough"
    raise SpecError(f"{key}: must be {rule}, got {bar.droplink_height:g}; {remedy}")


def _follows(suspension: Suspension, bar: AntirollBar, middle: Array, drop: float, reach: float) -> bool:
    """Whether a drop link keeps its length between its foot, which the suspension moves, and the bar's end, which goes
    round the bar's axis.
    """
    moved = _motion(suspension)
    foot = middle + np.array((bar.arm_width, bar.arm_length, drop))
    feet = np.array([moved(foot, travel) for travel in np.linspace(-reach, reach, STATES)]) - middle
    from_axis, aside = np.hypot(feet[:, 0], feet[:, 2]), feet[:, 1] - bar.arm_length
    nearest = np.hypot(from_axis - bar.arm_width, aside)
    farthest = np.hypot(from_axis + bar.arm_width, aside)
    return bool((nearest <= abs(drop) + 1e-9).all() and (farthest >= abs(drop) - 1e-9).all())


def _motion(suspension: Suspension) -> Callable[[Array, float], Array]:
    """Where a travel of the wheel [m] moves a point of the part that holds a bar: about its hinge, by the angle that
    lifts the ball or the wheel which it carries by the travel; straight up where it has none.
    """
    match suspension:
        case DoubleWishbone() | MacPhersonStrut():
            back, tip = suspension.lower_arm_back, suspension.lower_arm_upright
            axis: Vec3 | Array = np.subtract(suspension.lower_arm_front, back)
        case SingleWishbone():
            back, tip, axis = suspension.arm_chassis, suspension.spindle.com, suspension.arm_axis
        case TrailingArm():
            back, tip, axis = suspension.pivot, suspension.spindle.com, suspension.pivot_axis
        case ThreeLink():  # both rods lie across, so that the arm swings about its ball nearly as about y
            back, tip, axis = suspension.arm_chassis, suspension.spindle.com, (0.0, 1.0, 0.0)
        case _:
            return lambda point, travel: np.asarray(point + np.array((0.0, 0.0, travel)))
    unit = np.array(axis) / np.linalg.norm(axis)
    lever = float(np.cross(unit, np.subtract(tip, back))[2])
    if lever == 0.0:
        return lambda point, _: point

    def about_hinge(point: Array, travel: float) -> Array:
        angle, arm = travel / lever, point - back
        turned = arm * math.cos(angle) + np.cross(unit, arm) * math.sin(angle)
        return np.asarray(back + turned + unit * (unit @ arm) * (1.0 - math.cos(angle)))

    return about_hinge


def _holding_points(suspension: Suspension) -> list[Vec3]:
    values = [getattr(suspension, name) for name in HELD_BY[type(suspension)]]
    points = [value.com if isinstance(value, RigidPart) else value for value in values]
    if not isinstance(suspension, MacPhersonStrut):  # its springs stand on the upright, the bar holds the arm
        points += [line.arm_point for line in getattr(suspension, "springs", ())]
    return points


def _distance(point: Array, start: Array, end: Array) -> float:
    """From a point to a segment [m]."""
    along = end - start
    share = float(np.clip((point - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0))
    return float(np.linalg.norm(point - start - share * along))


def _text(point: Array) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point.tolist()) + ")"
