"""Descriptions of suspensions, one dataclass per template, and of anti-roll bars."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Literal, TypeAlias

from simwarp.core.constraints import Direction, Inertia, NotNegative, Point, Positive, Tagged
from simwarp.vehicle.spec.beam_axle_parts import BeamAxle, Lean
from simwarp.vehicle.spec.parts import (
    Bushing,
    ForceLine,
    RigidPart,
    Spec,
    check_apart,
    check_triangle,
    refuse,
)
from simwarp.vehicle.spec.tabulated_suspension import TabulatedSuspension

TIEROD = ("tierod_chassis", "tierod_upright")


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteeredCorner(Spec):
    """Shared by suspensions of one wheel each, whose upright a tie rod holds or steers."""

    template: str
    camber: Lean = 0.0
    """[rad], as built."""
    toe: Lean = 0.0
    spindle: RigidPart
    upright: RigidPart
    tierod_chassis: Point
    tierod_upright: Point
    axle_inertia: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoubleWishbone(SteeredCorner):
    """Two A-arms between chassis and upright, tie rod to the steering link or the chassis."""

    template: Literal["double-wishbone"] = "double-wishbone"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    upper_arm: RigidPart
    lower_arm: RigidPart
    upper_arm_front: Point
    upper_arm_back: Point
    upper_arm_upright: Point
    lower_arm_front: Point
    lower_arm_back: Point
    lower_arm_upright: Point
    springs: tuple[ForceLine, ...]
    """Between chassis and lower arm."""
    upper_arm_bushing: Bushing | None = None
    lower_arm_bushing: Bushing | None = None

    def check(self) -> None:
        """Arms are triangles, and nothing has no length."""
        check_triangle(self, "upper_arm_front", "upper_arm_back", "upper_arm_upright")
        check_triangle(self, "lower_arm_front", "lower_arm_back", "lower_arm_upright")
        check_apart(self, TIEROD, ("upper_arm_upright", "lower_arm_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoubleWishboneReduced(SteeredCorner):
    """The same with massless arms: every arm is two rods."""

    template: Literal["double-wishbone-reduced"] = "double-wishbone-reduced"
    upper_arm_front: Point
    upper_arm_back: Point
    upper_arm_upright: Point
    lower_arm_front: Point
    lower_arm_back: Point
    lower_arm_upright: Point
    springs: tuple[ForceLine, ...]
    """Between chassis and upright."""

    def check(self) -> None:
        """Arms are triangles, and nothing has no length."""
        check_triangle(self, "upper_arm_front", "upper_arm_back", "upper_arm_upright")
        check_triangle(self, "lower_arm_front", "lower_arm_back", "lower_arm_upright")
        check_apart(self, TIEROD, ("upper_arm_upright", "lower_arm_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class SingleWishbone(SteeredCorner):
    """One arm that turns about a line of the chassis; the upright turns on it about the kingpin.

    Axes "arm" of the arm's inertia: y from the chassis to the upright, x level.
    """

    template: Literal["single-wishbone"] = "single-wishbone"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    arm: RigidPart
    arm_chassis: Point
    arm_axis: Direction = (1.0, 0.0, 0.0)
    arm_upright: Point
    kingpin_axis: Direction = (0.0, 0.0, 1.0)
    springs: tuple[ForceLine, ...]
    """Between chassis and arm."""

    def check(self) -> None:
        """Arm and tie rod have a length."""
        check_apart(self, TIEROD, ("arm_chassis", "arm_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class MacPhersonStrut(SteeredCorner):
    """A lower arm, and a strut that slides in the upright and is pinned to the chassis."""

    template: Literal["macpherson-strut"] = "macpherson-strut"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    strut: RigidPart
    lower_arm: RigidPart
    lower_arm_front: Point
    lower_arm_back: Point
    lower_arm_upright: Point
    strut_chassis: Point
    strut_upright: Point
    springs: tuple[ForceLine, ...]
    """Between chassis and upright."""

    def check(self) -> None:
        """The arm is a triangle; strut and tie rod have a length."""
        check_triangle(self, "lower_arm_front", "lower_arm_back", "lower_arm_upright")
        check_apart(self, TIEROD, ("strut_chassis", "strut_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class MultiLink(SteeredCorner):
    """Upper arm, lateral link, trailing link and tie rod.

    Axes "arm" of the links' inertias: z from the upright to the chassis; y normal to the plane with the trailing link's
    end at the upright (of the lateral link) or with the spring's lower end (of the trailing link).
    """

    template: Literal["multi-link"] = "multi-link"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    upper_arm: RigidPart
    lateral: RigidPart
    trailing_link: RigidPart
    upper_arm_front: Point
    upper_arm_back: Point
    upper_arm_upright: Point
    lateral_chassis: Point
    lateral_upright: Point
    trailing_link_chassis: Point
    trailing_link_upright: Point
    springs: tuple[ForceLine, ...]
    """Between chassis and trailing link."""

    def check(self) -> None:
        """The arm is a triangle; links have a length and, with inertias of their own axes, a plane."""
        check_triangle(self, "upper_arm_front", "upper_arm_back", "upper_arm_upright")
        check_apart(self, TIEROD, ("lateral_chassis", "lateral_upright"))
        check_apart(self, ("trailing_link_chassis", "trailing_link_upright"))
        if self.inertia_axes == "arm":
            check_triangle(self, "lateral_chassis", "lateral_upright", "trailing_link_upright")
            if not self.springs:
                raise refuse("springs", "one or more, for the first gives the trailing link's axes", self.springs)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SolidAxle(Spec):
    """A beam axle on two longitudinal links per side, with knuckles that a drag link and a tie rod steer.

    Without a drag link the knuckles are fixed to the tube. Inertias of the links: z along the link, y normal to the
    plane with the other link's end. The tie rod connects both knuckles.
    """

    template: Literal["solid-axle"] = "solid-axle"
    camber: Lean = 0.0
    toe: Lean = 0.0
    spindle: RigidPart
    knuckle: RigidPart
    axle_tube: RigidPart
    upper_link: RigidPart
    lower_link: RigidPart
    knuckle_lower: Point
    knuckle_upper: Point
    upper_link_chassis: Point
    upper_link_axle: Point
    lower_link_chassis: Point
    lower_link_axle: Point
    tierod_knuckle: Point
    draglink_chassis: Point | None = None
    draglink_knuckle: Point | None = None
    springs: tuple[ForceLine, ...]
    """Between chassis and axle tube."""
    axle_inertia: Positive

    def check(self) -> None:
        """Links have a length and a plane, knuckles an axis; a drag link has two ends."""
        check_triangle(self, "upper_link_chassis", "upper_link_axle", "lower_link_axle")
        check_triangle(self, "lower_link_chassis", "lower_link_axle", "upper_link_axle")
        check_apart(self, ("knuckle_upper", "knuckle_lower"))
        if (self.draglink_chassis is None) != (self.draglink_knuckle is None):
            raise refuse("draglink_knuckle", "given together with draglink_chassis", self.draglink_knuckle)
        if self.draglink_chassis is not None:
            check_apart(self, ("draglink_chassis", "draglink_knuckle"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class RigidSuspension(Spec):
    """Spindles that turn in the chassis itself, or in the arm of the steering that the axle names."""

    template: Literal["rigid-suspension"] = "rigid-suspension"
    camber: Lean = 0.0
    toe: Lean = 0.0
    spindle: RigidPart
    axle_inertia: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class PinnedAxle(Spec):
    """A rigid axle that rolls about one longitudinal pin, `pin`; `axle_tube` and `pin` are not mirrored."""

    template: Literal["pinned-axle"] = "pinned-axle"
    spindle: RigidPart
    axle_tube: RigidPart
    pin: Point
    axle_inertia: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrailingArm(Spec):
    """An arm behind its pivot on the chassis carries the spindle."""

    template: Literal["trailing-arm"] = "trailing-arm"
    camber: Lean = 0.0
    toe: Lean = 0.0
    spindle: RigidPart
    arm: RigidPart
    pivot: Point
    pivot_axis: Direction = (0.0, 1.0, 0.0)
    springs: tuple[ForceLine, ...]
    axle_inertia: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThreeLink(Spec):
    """A trailing arm on a ball carries the spindle; two massless rods from it to the chassis lead it."""

    template: Literal["three-link"] = "three-link"
    camber: Lean = 0.0
    toe: Lean = 0.0
    spindle: RigidPart
    arm: RigidPart
    arm_chassis: Point
    upper_rod_chassis: Point
    upper_rod_arm: Point
    lower_rod_chassis: Point
    lower_rod_arm: Point
    springs: tuple[ForceLine, ...]
    """Between chassis and arm."""
    axle_inertia: Positive

    def check(self) -> None:
        """Rods have a length, and with the ball they span the arm."""
        check_apart(self, ("upper_rod_chassis", "upper_rod_arm"), ("lower_rod_chassis", "lower_rod_arm"))
        check_triangle(self, "arm_chassis", "upper_rod_arm", "lower_rod_arm")


Suspension: TypeAlias = Annotated[
    DoubleWishbone
    | DoubleWishboneReduced
    | SingleWishbone
    | MacPhersonStrut
    | MultiLink
    | SolidAxle
    | RigidSuspension
    | PinnedAxle
    | TrailingArm
    | ThreeLink
    | BeamAxle
    | TabulatedSuspension,
    Tagged("template"),
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class AntirollBar(Spec):
    """Two arms joined by a torsion spring, each linked to its side of the axle: `arm_length` out from the middle and
    `arm_width` forward, then a massless link of `droplink_height` upwards (down where negative). Inertia in axes of the
    vehicle about the arm's centre, half its length from the middle.
    """

    location: Point
    """Of the bar's middle in the vehicle's frame [m]."""
    arm_mass: Positive
    arm_inertia: Inertia
    arm_length: Positive
    arm_width: Positive
    droplink_height: float
    stiffness: Positive
    """Of the torsion spring [N·m/rad]."""
    damping: NotNegative = 0.0
