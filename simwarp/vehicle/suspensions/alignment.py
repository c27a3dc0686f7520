"""Adjustments of a suspension on its bench: tie rods for toe, the spindle's seat for camber, springs for the height."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

import numpy as np

from simwarp.core.rotation import rotate
from simwarp.vehicle.spec.parts import Array, ForceLine, SpecError, Vec3
from simwarp.vehicle.spec.vehicle_spec import (
    DoubleWishbone,
    DoubleWishboneReduced,
    MacPhersonStrut,
    MultiLink,
    SingleWishbone,
    SolidAxle,
    Suspension,
)
from simwarp.vehicle.suspensions.kingpins import kingpin_axis

SteeredSuspension = DoubleWishbone | DoubleWishboneReduced | SingleWishbone | MacPhersonStrut | MultiLink | SolidAxle

ON_UPRIGHT: Final[dict[type, tuple[str, ...]]] = {
    DoubleWishbone: ("tierod_upright",), DoubleWishboneReduced: ("tierod_upright",),
    SingleWishbone: ("tierod_upright",), MacPhersonStrut: ("tierod_upright", "strut_upright"),
    MultiLink: ("tierod_upright",), SolidAxle: ("tierod_knuckle", "draglink_knuckle"),
}  # fmt: skip
"""Points that turn about the kingpin with the upright."""
TURNING: Final[dict[type, tuple[str, ...]]] = {
    DoubleWishbone: ("spindle", "upright"), DoubleWishboneReduced: ("spindle", "upright"),
    SingleWishbone: ("spindle", "upright"), MacPhersonStrut: ("spindle", "upright", "strut"),
    MultiLink: ("spindle", "upright"), SolidAxle: ("spindle", "knuckle"),
}  # fmt: skip
"""Parts whose centres of mass do."""
SPRUNG_UPRIGHTS: Final = (DoubleWishboneReduced, MacPhersonStrut)
"""Suspensions whose springs stand on the upright."""


def has_tierod(suspension: Suspension) -> bool:
    """Whether the length of a tie rod sets the toe of both wheels; rigid axles, trailing arms and beams have none."""
    if isinstance(suspension, SolidAxle):
        return suspension.draglink_chassis is not None
    return type(suspension) in ON_UPRIGHT


def tierod_length(suspension: Suspension) -> float | None:
    """Of the rod between its two balls, as built [m]; of a beam axle that between its knuckles. None: there is none."""
    if not has_tierod(suspension):
        return None
    if isinstance(suspension, SolidAxle):
        return 2.0 * abs(suspension.tierod_knuckle[1])
    steered: Any = suspension
    return math.dist(steered.tierod_chassis, steered.tierod_upright)


def with_tierod_turned(suspension: Suspension, angle: float) -> Suspension:
    """The suspension with tie rods of another length: its uprights stand turned about their kingpins, as built.

    Balls at the ends of the kingpin stay; outer balls of tie rods, spindles and what else the upright holds go round
    them.

    Args:
        suspension: with a tie rod.
        angle: by which the wheels' fronts turn inwards [rad].

    Raises:
        SpecError: the toe that this makes is beyond what a description may hold.
    """
    point, axis = _kingpin(suspension)
    turn = np.array([*(-math.sin(0.5 * angle) * axis), math.cos(0.5 * angle)])

    def around(place: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (float(value) for value in point + rotate(turn, np.subtract(place, point)))
        return x, y, z

    part: Any = suspension
    changes: dict[str, Any] = {
        name: around(getattr(part, name)) for name in ON_UPRIGHT[type(part)] if getattr(part, name) is not None
    }
    for name in TURNING[type(part)]:
        body = getattr(part, name)
        changes[name] = dataclasses.replace(body, com=around(body.com))
    if isinstance(part, SPRUNG_UPRIGHTS):
        changes["springs"] = tuple(dataclasses.replace(line, arm_point=around(line.arm_point)) for line in part.springs)
    x, y, z = (float(value) for value in rotate(turn, _wheel_axis(part.toe, part.camber)))
    toe, camber = math.atan2(x, y), -math.asin(min(max(z, -1.0), 1.0))
    return dataclasses.replace(part, **changes, toe=toe, camber=camber)


def with_camber_changed(suspension: Suspension, angle: float) -> Suspension:
    """The suspension with its spindles seated otherwise in their uprights: the wheels' tops lean outwards by `angle`
    more [rad], as built.

    Raises:
        SpecError: the camber that this makes is beyond what a description may hold.
    """
    part: Any = suspension
    changed: Suspension = dataclasses.replace(part, camber=part.camber + angle)
    return changed


def elastic(line: ForceLine) -> bool:
    """Whether a line is a spring, whose free length sets a height."""
    return line.stiffness > 0.0 or line.spring_curve is not None


def free_length(line: ForceLine) -> float | None:
    """Of a spring [m]; None of a line that is none."""
    if not elastic(line):
        return None
    return math.dist(line.chassis_point, line.arm_point) if line.rest_length is None else line.rest_length


def with_free_lengths(suspension: Suspension, changes: Array) -> Suspension:
    """The suspension with longer springs.

    Args:
        suspension: with springs.
        changes: (k,) by which each of its lines grows [m]; without effect on those that are no springs.

    Raises:
        SpecError: a spring would have no length.
    """
    part: Any = suspension
    springs = []
    for line, change in zip(part.springs, changes, strict=True):
        length = free_length(line)
        if length is not None:
            if not length + change > 0.0:
                raise SpecError(
                    f"springs: must keep a length, got a spring of {length:.4g} m shortened by {-change:.4g} m; "
                    "take a softer spring"
                )
            line = dataclasses.replace(line, rest_length=length + float(change))
        springs.append(line)
    return dataclasses.replace(part, springs=tuple(springs))


def _wheel_axis(toe: float, camber: float) -> Array:
    """Axis of a left wheel, outwards, with toe and camber as a description has them."""
    return np.array([math.sin(toe) * math.cos(camber), math.cos(toe) * math.cos(camber), -math.sin(camber)])


def _kingpin(suspension: Suspension) -> tuple[Array, Array]:
    """A point of the line about which the left upright steers, as built, and its direction upwards."""

    def as_built(vector: Vec3) -> Array:
        return np.array([vector], float)

    point, axis = kingpin_axis(suspension, as_built, as_built, as_built, 1)
    if np.isnan(axis).any():
        raise SpecError(f"toe: must be left out of the template '{suspension.template}', which has no tie rod")
    return point[0], axis[0]
