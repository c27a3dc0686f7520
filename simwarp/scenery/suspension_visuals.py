"""Links, uprights and springs of a vehicle as its description has them, for pictures of a vehicle as built."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import frame_from_axis
from simwarp.core.types import Vec3, pose
from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.parts import ForceLine
from simwarp.vehicle.spec.vehicle_spec import (
    Axle,
    DoubleWishbone,
    DoubleWishboneReduced,
    MacPhersonStrut,
    MultiLink,
    PinnedAxle,
    RigidSuspension,
    SingleWishbone,
    SolidAxle,
    ThreeLink,
    TrailingArm,
)

if TYPE_CHECKING:
    from simwarp.sensors.scene import Visuals
    from simwarp.vehicle.construction import VehicleParts

Array = npt.NDArray[np.float64]
HUB: Final = "spindle"
"""In place of a point's name: the centre of the wheel."""
THICK: Final = 0.035
"""Radius of a link, as a share of the tire's."""


class BarKind(enum.Enum):
    """What a line of a suspension is: its colour and its thickness over that of a link."""

    LINK = ((0.10, 0.12, 0.14), 1.0)
    UPRIGHT = ((0.32, 0.34, 0.37), 1.5)
    SPRING = ((0.70, 0.52, 0.08), 2.2)

    @property
    def color(self) -> Vec3:
        """Linear."""
        return self.value[0]

    @property
    def thickness(self) -> float:
        """Ratio to a link's."""
        return self.value[1]


@dataclasses.dataclass(frozen=True)
class Bar:
    """A straight part between two points, which are (3,) in the vehicle's frame of reference [m]."""

    start: Array
    end: Array
    kind: BarKind


TIEROD: Final = (("tierod_chassis", "tierod_upright"),)
LOWER_ARM: Final = (("lower_arm_front", "lower_arm_upright"), ("lower_arm_back", "lower_arm_upright"))
UPPER_ARM: Final = (("upper_arm_front", "upper_arm_upright"), ("upper_arm_back", "upper_arm_upright"))
LINKS: Final[dict[type, tuple[tuple[str, str], ...]]] = {
    DoubleWishbone: (*UPPER_ARM, *LOWER_ARM, *TIEROD), DoubleWishboneReduced: (*UPPER_ARM, *LOWER_ARM, *TIEROD),
    SingleWishbone: (("arm_chassis", "arm_upright"), *TIEROD),
    MacPhersonStrut: (*LOWER_ARM, *TIEROD, ("strut_chassis", "strut_upright")),
    MultiLink: (
        *UPPER_ARM, *TIEROD, ("lateral_chassis", "lateral_upright"), ("trailing_link_chassis", "trailing_link_upright"),
    ),
    SolidAxle: (
        ("upper_link_chassis", "upper_link_axle"), ("lower_link_chassis", "lower_link_axle"),
        ("draglink_chassis", "draglink_knuckle"),
    ),
    TrailingArm: (("pivot", HUB),), BeamAxle: (),
    ThreeLink: (
        ("arm_chassis", HUB), ("upper_rod_chassis", "upper_rod_arm"), ("lower_rod_chassis", "lower_rod_arm"),
    ),
}  # fmt: skip
"""Ends of the links of one side, by the names of their points; those that a description leaves out are not there.
Of a beam axle, whose links are no fields of its own, `_beam_bars` knows them."""
UPRIGHTS: Final[dict[type, tuple[str, ...]]] = {
    DoubleWishbone: ("upper_arm_upright", "lower_arm_upright", "tierod_upright"),
    DoubleWishboneReduced: ("upper_arm_upright", "lower_arm_upright", "tierod_upright"),
    SingleWishbone: ("arm_upright", "tierod_upright"),
    MacPhersonStrut: ("lower_arm_upright", "strut_upright", "tierod_upright"),
    MultiLink: ("upper_arm_upright", "lateral_upright", "trailing_link_upright", "tierod_upright"),
    SolidAxle: ("knuckle_upper", "knuckle_lower"),
    BeamAxle: ("knuckle_upper", "knuckle_lower"),
}
"""Points that an upright joins with the centre of its wheel."""
BEAMS: Final = (SolidAxle, BeamAxle, PinnedAxle, RigidSuspension)
"""Suspensions whose wheels a beam joins."""


def suspension_bars(axle: Axle) -> list[Bar]:
    """Links, uprights, springs and dampers of both sides of an axle; none of a suspension that is reduced to tables."""
    found = [bar for side in (1.0, -1.0) for bar in _side_bars(axle, side)]
    suspension = axle.suspension
    own_rods = isinstance(suspension, BeamAxle) and suspension.tierod_chassis is not None
    joined = isinstance(suspension, (SolidAxle, BeamAxle)) and not own_rods
    across = "tierod_knuckle" if joined else "tierod_chassis"
    pairs = [(HUB, BarKind.UPRIGHT)] if isinstance(suspension, BEAMS) else []
    if axle.steering is not None:  # what both tie rods hang on
        pairs.append((across, BarKind.LINK))
    if isinstance(suspension, BeamAxle):
        found += _beam_bars(axle, suspension)
    for name, kind in pairs:
        ends = [_point(axle, name, side) for side in (1.0, -1.0)]
        if ends[0] is not None and ends[1] is not None:
            found.append(Bar(ends[0], ends[1], kind))
    return found


def add_suspension_visuals(visuals: Visuals, parts: VehicleParts) -> list[int]:
    """Draws all axles of a vehicle as built, held by its chassis: for a picture, for they do not move with the wheels.

    Args:
        visuals: of the builder that `parts` was added to.
        parts: from `simwarp.vehicle.construction.add_vehicle`.

    Returns:
        The instances.
    """
    instances = []
    shifts = [unit.origin for unit in parts.spec.units]
    for number, axle in enumerate(parts.spec.all_axles):
        unit = parts.unit_of(number)
        reference = unit.reference - shifts[parts.units.index(unit)]
        for index, bar in enumerate(suspension_bars(axle)):
            way = bar.end - bar.start
            length = float(np.linalg.norm(way))
            if length == 0.0:
                continue
            place = pose(reference + 0.5 * (bar.start + bar.end), frame_from_axis("link", way / length))
            instances.append(
                visuals.add_capsule(
                    unit.chassis, radius=THICK * bar.kind.thickness * axle.tire.radius, half_length=0.5 * length,
                    name=f"{parts.prefix}axle_{number}_bar_{index}", pose=place, color=bar.kind.color,
                )
            )  # fmt: skip
    return instances


def _side_bars(axle: Axle, side: float) -> list[Bar]:
    suspension: Any = axle.suspension
    found = []
    for first, second in LINKS.get(type(suspension), ()):
        ends = _point(axle, first, side), _point(axle, second, side)
        if ends[0] is not None and ends[1] is not None:
            found.append(Bar(ends[0], ends[1], BarKind.LINK))
    hub = _point(axle, HUB, side)
    for name in UPRIGHTS.get(type(suspension), ()):
        end = _point(axle, name, side)
        if end is not None and hub is not None:
            found.append(Bar(end, hub, BarKind.UPRIGHT))
    lines: tuple[ForceLine, ...] = getattr(suspension, "springs", ())
    return found + [
        Bar(_placed(axle, line.chassis_point, side), _placed(axle, line.arm_point, side), BarKind.SPRING)
        for line in lines
    ]


def _beam_bars(axle: Axle, spec: BeamAxle) -> list[Bar]:
    """What leads and steers a beam."""
    ends = [
        (rod.chassis_point, rod.axle_point, side)
        for rod in spec.rods
        for side in ((1.0, -1.0) if rod.mirrored else (1.0,))
    ]
    if spec.arm is not None:
        ends.append((spec.arm.chassis_point, spec.arm.axle_point, 1.0))
    if spec.ball is not None:
        ends.append((spec.ball, spec.axle_tube.com, 1.0))
    if spec.draglink is not None and spec.draglink_chassis is not None:
        ends.append((spec.draglink_chassis, spec.draglink, 1.0))
    if spec.tierod_chassis is not None and spec.tierod_knuckle is not None:
        ends += [(spec.tierod_chassis, spec.tierod_knuckle, side) for side in (1.0, -1.0)]
    if spec.bell_crank is not None:
        ends += [(spec.bell_crank.pivot, point, 1.0) for point in (spec.bell_crank.draglink, spec.bell_crank.tierod)]
    return [Bar(_placed(axle, start, side), _placed(axle, end, side), BarKind.LINK) for start, end, side in ends]


def _point(axle: Axle, name: str, side: float) -> Array | None:
    """A point of a suspension in the vehicle's frame; None where its description has none."""
    point = axle.suspension.spindle.com if name == HUB else getattr(axle.suspension, name, None)
    return None if point is None else _placed(axle, point, side)


def _placed(axle: Axle, point: Vec3, side: float) -> Array:
    return np.asarray(np.add(axle.location, np.multiply(point, (1.0, side, 1.0))))
