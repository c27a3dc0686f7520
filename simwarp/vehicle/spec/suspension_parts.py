"""Descriptions of suspensions, one dataclass per template, and of anti-roll bars."""

from __future__ import annotations

import dataclasses
from typing import ClassVar, Literal, TypeAlias

from simwarp.vehicle.spec.parts import (
    Bushing,
    ForceLine,
    RigidPart,
    Spec,
    Vec3,
    check_apart,
    check_direction,
    check_triangle,
    refuse,
)

TIEROD = ("tierod_chassis", "tierod_upright")


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoubleWishbone(Spec):
    """Two A-arms between chassis and upright, tie rod to the steering link or the chassis."""

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["double-wishbone"] = "double-wishbone"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    camber: float = 0.0
    """[rad], as built."""
    toe: float = 0.0
    spindle: RigidPart
    upright: RigidPart
    upper_arm: RigidPart
    lower_arm: RigidPart
    upper_arm_front: Vec3
    upper_arm_back: Vec3
    upper_arm_upright: Vec3
    lower_arm_front: Vec3
    lower_arm_back: Vec3
    lower_arm_upright: Vec3
    tierod_chassis: Vec3
    tierod_upright: Vec3
    springs: tuple[ForceLine, ...]
    """Between chassis and lower arm."""
    axle_inertia: float
    upper_arm_bushing: Bushing | None = None
    lower_arm_bushing: Bushing | None = None

    def check(self) -> None:
        """Arms are triangles, and nothing has no length."""
        check_triangle(self, "upper_arm_front", "upper_arm_back", "upper_arm_upright")
        check_triangle(self, "lower_arm_front", "lower_arm_back", "lower_arm_upright")
        check_apart(self, TIEROD, ("upper_arm_upright", "lower_arm_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoubleWishboneReduced(Spec):
    """The same with massless arms: every arm is two rods."""

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["double-wishbone-reduced"] = "double-wishbone-reduced"
    camber: float = 0.0
    toe: float = 0.0
    spindle: RigidPart
    upright: RigidPart
    upper_arm_front: Vec3
    upper_arm_back: Vec3
    upper_arm_upright: Vec3
    lower_arm_front: Vec3
    lower_arm_back: Vec3
    lower_arm_upright: Vec3
    tierod_chassis: Vec3
    tierod_upright: Vec3
    springs: tuple[ForceLine, ...]
    """Between chassis and upright."""
    axle_inertia: float

    def check(self) -> None:
        """Arms are triangles, and nothing has no length."""
        check_triangle(self, "upper_arm_front", "upper_arm_back", "upper_arm_upright")
        check_triangle(self, "lower_arm_front", "lower_arm_back", "lower_arm_upright")
        check_apart(self, TIEROD, ("upper_arm_upright", "lower_arm_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class SingleWishbone(Spec):
    """One arm that turns about a line of the chassis; the upright turns on it about the kingpin.

    Axes "arm" of the arm's inertia: y from the chassis to the upright, x level.
    """

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["single-wishbone"] = "single-wishbone"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    camber: float = 0.0
    toe: float = 0.0
    spindle: RigidPart
    upright: RigidPart
    arm: RigidPart
    arm_chassis: Vec3
    arm_axis: Vec3 = (1.0, 0.0, 0.0)
    arm_upright: Vec3
    kingpin_axis: Vec3 = (0.0, 0.0, 1.0)
    tierod_chassis: Vec3
    tierod_upright: Vec3
    springs: tuple[ForceLine, ...]
    """Between chassis and arm."""
    axle_inertia: float

    def check(self) -> None:
        """Axes have a direction, arm and tie rod a length."""
        check_direction(self, "arm_axis", "kingpin_axis")
        check_apart(self, TIEROD, ("arm_chassis", "arm_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class MacPhersonStrut(Spec):
    """A lower arm, and a strut that slides in the upright and is pinned to the chassis."""

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["macpherson-strut"] = "macpherson-strut"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    camber: float = 0.0
    toe: float = 0.0
    spindle: RigidPart
    upright: RigidPart
    strut: RigidPart
    lower_arm: RigidPart
    lower_arm_front: Vec3
    lower_arm_back: Vec3
    lower_arm_upright: Vec3
    strut_chassis: Vec3
    strut_upright: Vec3
    tierod_chassis: Vec3
    tierod_upright: Vec3
    springs: tuple[ForceLine, ...]
    """Between chassis and upright."""
    axle_inertia: float

    def check(self) -> None:
        """The arm is a triangle; strut and tie rod have a length."""
        check_triangle(self, "lower_arm_front", "lower_arm_back", "lower_arm_upright")
        check_apart(self, TIEROD, ("strut_chassis", "strut_upright"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class MultiLink(Spec):
    """Upper arm, lateral link, trailing link and tie rod.

    Axes "arm" of the links' inertias: z from the upright to the chassis; y normal to the plane with the trailing link's
    end at the upright (of the lateral link) or with the spring's lower end (of the trailing link).
    """

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["multi-link"] = "multi-link"
    inertia_axes: Literal["arm", "vehicle"] = "arm"
    camber: float = 0.0
    toe: float = 0.0
    spindle: RigidPart
    upright: RigidPart
    upper_arm: RigidPart
    lateral: RigidPart
    trailing_link: RigidPart
    upper_arm_front: Vec3
    upper_arm_back: Vec3
    upper_arm_upright: Vec3
    lateral_chassis: Vec3
    lateral_upright: Vec3
    trailing_link_chassis: Vec3
    trailing_link_upright: Vec3
    tierod_chassis: Vec3
    tierod_upright: Vec3
    springs: tuple[ForceLine, ...]
    """Between chassis and trailing link."""
    axle_inertia: float

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

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["solid-axle"] = "solid-axle"
    camber: float = 0.0
    toe: float = 0.0
    spindle: RigidPart
    knuckle: RigidPart
    axle_tube: RigidPart
    upper_link: RigidPart
    lower_link: RigidPart
    knuckle_lower: Vec3
    knuckle_upper: Vec3
    upper_link_chassis: Vec3
    upper_link_axle: Vec3
    lower_link_chassis: Vec3
    lower_link_axle: Vec3
    tierod_knuckle: Vec3
    draglink_chassis: Vec3 | None = None
    draglink_knuckle: Vec3 | None = None
    springs: tuple[ForceLine, ...]
    """Between chassis and axle tube."""
    axle_inertia: float

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
    """Spindles that turn in the chassis itself."""

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["rigid-suspension"] = "rigid-suspension"
    camber: float = 0.0
    toe: float = 0.0
    spindle: RigidPart
    axle_inertia: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class PinnedAxle(Spec):
    """A rigid axle that rolls about one longitudinal pin, `pin`; `axle_tube` and `pin` are not mirrored."""

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["pinned-axle"] = "pinned-axle"
    spindle: RigidPart
    axle_tube: RigidPart
    pin: Vec3
    axle_inertia: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrailingArm(Spec):
    """An arm behind its pivot on the chassis carries the spindle."""

    POSITIVE: ClassVar = frozenset({"axle_inertia"})

    template: Literal["trailing-arm"] = "trailing-arm"
    camber: float = 0.0
    toe: float = 0.0
    spindle: RigidPart
    arm: RigidPart
    pivot: Vec3
    pivot_axis: Vec3 = (0.0, 1.0, 0.0)
    springs: tuple[ForceLine, ...]
    axle_inertia: float

    def check(self) -> None:
        """The pivot has a direction."""
        check_direction(self, "pivot_axis")


Suspension: TypeAlias = (
    DoubleWishbone
    | DoubleWishboneReduced
    | SingleWishbone
    | MacPhersonStrut
    | MultiLink
    | SolidAxle
    | RigidSuspension
    | PinnedAxle
    | TrailingArm
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class AntirollBar(Spec):
    """Two arms joined by a torsion spring, each linked to its side of the axle: `arm_length` out from the middle and
    `arm_width` forward, then a massless link of `droplink_height` upwards (down where negative). Inertia in axes of the
    vehicle about the arm's centre, half its length from the middle.
    """

    POSITIVE: ClassVar = frozenset({"arm_mass", "arm_inertia", "arm_length", "arm_width", "stiffness"})
    NOT_NEGATIVE: ClassVar = frozenset({"damping"})

    location: Vec3
    """Of the bar's middle in the vehicle's frame [m]."""
    arm_mass: float
    arm_inertia: Vec3
    arm_length: float
    arm_width: float
    droplink_height: float
    stiffness: float
    """Of the torsion spring [N·m/rad]."""
    damping: float = 0.0
