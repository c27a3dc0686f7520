"""Descriptions of tracks: shoes, sprockets, idlers, road wheels on arms, one dataclass per template.

Units are SI. Points are those of the LEFT track: x forward, y left, z up from where the part is placed; the right one
mirrors y. Inertias are about the centre of mass: of arms in axes of the arm (x from its hinge's side to the wheel's,
y along the hinge), of all others in axes of the vehicle.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Final, Literal, TypeAlias

from simwarp.core.constraints import Ge, Inertia, MinLen, NotNegative, Point, Positive, Tagged
from simwarp.vehicle.spec.parts import ZERO, ForceLine, RigidPart, Spec, SpecError, check_apart, refuse
from simwarp.vehicle.spec.vehicle_parts import Brake

FEWEST_TEETH: Final = 3
"""Of a sprocket."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackWheel(Spec):
    """A road wheel or idler: one disc, or two with a gap for the shoes' guides. y is the axis of rotation."""

    mass: Positive
    inertia: Inertia
    radius: Positive
    width: Positive
    """Over all [m]."""
    gap: NotNegative = 0.0
    """Between two discs [m]; 0: there is one."""
    friction: NotNegative

    def check(self) -> None:
        """The gap leaves two discs."""
        if not self.gap < self.width:
            raise refuse("gap", f"less than the width of {self.width} m", self.gap)

    @property
    def disc_offset(self) -> float:
        """Of the middle of a disc from that of the wheel [m]; 0 of a single one."""
        return 0.25 * (self.width + self.gap) if self.gap > 0.0 else 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShoePad(Spec):
    """A box of a shoe, in the shoe's frame."""

    center: Point
    size: tuple[Positive, Positive, Positive]
    """Whole lengths along x, y, z [m]."""

    @property
    def bottom(self) -> float:
        """Z of its lower side [m]."""
        return self.center[2] - 0.5 * self.size[2]

    @property
    def top(self) -> float:
        """Z of its upper side [m]."""
        return self.center[2] + 0.5 * self.size[2]


def pad_around(pads: Sequence[ShoePad]) -> ShoePad:
    """The box around some pads of a shoe."""
    corners = [
        tuple(place + sign * 0.5 * length for place, length in zip(pad.center, pad.size, strict=True))
        for pad in pads for sign in (-1.0, 1.0)
    ]  # fmt: skip
    low, high = ([bound(values) for values in zip(*corners, strict=True)] for bound in (min, max))
    x, y, z = (0.5 * (a + b) for a, b in zip(low, high, strict=True))
    length, width, height = (b - a for a, b in zip(low, high, strict=True))
    return ShoePad(center=(x, y, z), size=(length, width, height))


@dataclasses.dataclass(frozen=True, kw_only=True)
class SinglePinShoe(Spec):
    """A shoe with one pin to the next one. Its frame: origin midway between its pins, x along the track, z inwards."""

    template: Literal["track-single-pin"] = "track-single-pin"
    mass: Positive
    inertia: Inertia
    pitch: Positive
    """Distance of its two pins [m]."""
    height: Positive
    ground_pad: ShoePad
    """What meets the ground."""
    wheel_pad: ShoePad
    """What meets road wheels and idler."""
    guide: Point
    """Where the guide between the discs of wheels meets them [m]."""
    guide_width: Positive = 0.01
    """Of the guide there [m]."""
    side_pads: tuple[ShoePad, ...] = ()
    """What else sinks into soft ground."""
    friction: NotNegative
    roller_radius: Positive
    """Of the two cylinders, about y, that meet the sprocket [m]."""
    roller_front: float
    """x of the front one [m]."""
    roller_rear: float
    """x of the rear one [m]."""

    def check(self) -> None:
        """Shoes that do not reach into each other, and rollers in order."""
        check_pads(self.pitch, self.ground_pad, self.wheel_pad)
        if not self.roller_rear < self.roller_front:
            raise refuse("roller_rear", f"behind roller_front {self.roller_front} m", self.roller_rear)

    @property
    def lengths(self) -> tuple[float, ...]:
        """Of the links of one shoe [m]."""
        return (self.pitch,)

    @property
    def links(self) -> tuple[tuple[str, RigidPart], ...]:
        """Name and body of each."""
        return (("shoe", RigidPart(mass=self.mass, inertia=self.inertia)),)

    @property
    def rollers(self) -> tuple[float, tuple[float, float]]:
        """Radius of what meets the sprocket, and its places along the last link [m]."""
        return self.roller_radius, (self.roller_front, self.roller_rear)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoublePinShoe(Spec):
    """A shoe with two pins; a connector joins it to the next one. Frames as of a shoe with one."""

    template: Literal["track-double-pin"] = "track-double-pin"
    mass: Positive
    inertia: Inertia
    length: Positive
    """Distance of its two pins [m]."""
    width: Positive
    height: Positive
    ground_pad: ShoePad
    wheel_pad: ShoePad
    guide: Point
    side_pads: tuple[ShoePad, ...] = ()
    guide_width: Positive = 0.01
    friction: NotNegative
    connector: RigidPart
    connector_length: Positive
    """Distance of the pins that a connector joins [m]."""
    connector_radius: Positive
    """Of its ends, which meet the sprocket [m]."""
    connector_width: Positive
    joined: bool = True
    """The two connectors of a joint, one on either side of the shoes, are one body."""

    def check(self) -> None:
        """Shoes that do not reach into each other."""
        check_pads(self.pitch, self.ground_pad, self.wheel_pad)

    @property
    def pitch(self) -> float:
        """From a shoe to the next [m]."""
        return self.length + self.connector_length

    @property
    def lengths(self) -> tuple[float, ...]:
        """Of the links of one shoe, itself and its connectors as one body [m]."""
        return self.length, self.connector_length

    @property
    def links(self) -> tuple[tuple[str, RigidPart], ...]:
        """Name and body of each. Two connectors lie at the shoe's sides."""
        one, (x, y, z) = self.connector, self.connector.inertia
        aside = one.mass * (0.5 * self.width) ** 2
        both = RigidPart(mass=2.0 * one.mass, inertia=(2.0 * (x + aside), 2.0 * y, 2.0 * (z + aside)))
        return ("shoe", RigidPart(mass=self.mass, inertia=self.inertia)), ("connector", both)

    @property
    def rollers(self) -> tuple[float, tuple[float, float]]:
        """Radius of what meets the sprocket, and its places along the last link [m]."""
        return self.connector_radius, (0.5 * self.connector_length, -0.5 * self.connector_length)


Shoe: TypeAlias = Annotated[SinglePinShoe | DoublePinShoe, Tagged("template")]


def check_pads(pitch: float, ground_pad: ShoePad, wheel_pad: ShoePad) -> None:
    """Pads that leave a gap to those of the next shoe."""
    for name, pad in (("ground_pad", ground_pad), ("wheel_pad", wheel_pad)):
        if pad.size[0] >= pitch:
            rule = f"shorter than the pitch of {pitch:g} m: shoes would overlap"
            raise refuse(f"{name}.size", rule, pad.size[0], "shorten it, or give more pitch")


@dataclasses.dataclass(frozen=True, kw_only=True)
class GearDiscs(Spec):
    """What sprockets for shoes with one pin and with two have alike."""

    template: str
    mass: Positive
    inertia: Inertia
    axle_inertia: NotNegative = 0.0
    """Of the shaft that turns with it, about its axis [kg·m²]."""
    teeth: Annotated[int, Ge(FEWEST_TEETH)]
    separation: Positive
    """Distance of the two discs [m]."""
    backlash: NotNegative
    """Way that a shoe's guide has to either side [m]."""
    assembly_radius: Positive
    """Of the circle of pins on which the chain is laid [m]."""
    tip_radius: Positive
    arc_radius: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class SinglePinSprocket(GearDiscs):
    """Two gear discs whose gaps are circular arcs, for shoes with one pin. y is the axis of rotation."""

    template: Literal["sprocket-single-pin"] = "sprocket-single-pin"
    arc_center_radius: Positive
    """Of the circle on which the centres of the arcs lie [m]."""
    friction: NotNegative

    def check(self) -> None:
        """A profile with gaps between its tips."""
        if not 0.0 < self.roller_seat < self.tip_radius:
            rule = (
                f"above the bottom of the gaps, {self.roller_seat:.4g} m (arc_center_radius - arc_radius), "
                "and that above 0"
            )
            raise refuse("tip_radius", rule, self.tip_radius)

    @property
    def roller_seat(self) -> float:
        """Radius of the bottom of the gaps [m]."""
        return self.arc_center_radius - self.arc_radius

    @property
    def arc_centers(self) -> tuple[float, float]:
        """Radius of the circle of the arcs' centres [m], and their angle from the middle of their gap [rad]."""
        return self.arc_center_radius, 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoublePinSprocket(GearDiscs):
    """Two gear discs for shoes with two pins: each gap has two arcs, beside its middle. y is the axis of rotation."""

    template: Literal["sprocket-double-pin"] = "sprocket-double-pin"
    arc_center_height: Positive
    """Of the arcs' centres from the axis, along the line through the gap [m]."""
    arc_center_offset: Positive
    """Of the arcs' centres from that line [m]."""
    friction: NotNegative

    @property
    def arc_centers(self) -> tuple[float, float]:
        """Radius of the circle of the arcs' centres [m], and their angle from the middle of their gap [rad]."""
        height, offset = self.arc_center_height, self.arc_center_offset
        return math.hypot(height, offset), math.atan2(offset, height)


TrackSprocket: TypeAlias = Annotated[SinglePinSprocket | DoublePinSprocket, Tagged("template")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class TorsionArm(Spec):
    """A road wheel on a trailing arm with a torsion bar, and a shock absorber. Points from the wheel's centre.

    Torque on the arm that lifts the wheel [N·m]: preload - stiffness (angle - free_angle) - damping rate; angle 0 is as
    built, positive with the wheel up.
    """

    template: Literal["torsion-arm"] = "torsion-arm"
    arm: RigidPart
    hinge: Point
    """On the chassis [m]."""
    wheel_joint: Point = ZERO
    """On the wheel's axis, where the arm holds it [m]."""
    stiffness: NotNegative
    damping: NotNegative = 0.0
    free_angle: float = 0.0
    preload: float = 0.0
    shock: ForceLine | None = None
    wheel: TrackWheel

    def check(self) -> None:
        """An arm with a length."""
        if math.hypot(self.hinge[0], self.hinge[2]) <= 0.0:
            raise refuse("hinge", "off the wheel's axis", self.hinge)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tensioner(Spec):
    """A spring and damper that push the idler's carrier away from the sprocket.

    Force [N]: preload - stiffness (length - free_length) - damping rate, along the line between its two points.
    """

    carrier_point: Point
    chassis_point: Point
    free_length: Positive
    stiffness: NotNegative
    damping: NotNegative = 0.0
    preload: float = 0.0

    def check(self) -> None:
        """Two points, and a force that tightens the chain as built."""
        check_apart(self, ("carrier_point", "chassis_point"))
        if not self.force > 0.0:
            raise SpecError(
                f"preload: must leave a force > 0 N that tightens the chain as built, got {self.force:.4g} N; "
                "raise it, or free_length"
            )

    @property
    def force(self) -> float:
        """As built [N]."""
        return self.preload - self.stiffness * (math.dist(self.carrier_point, self.chassis_point) - self.free_length)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SlidingIdler(Spec):
    """An idler on a carrier that slides along the chassis. Points from the wheel's centre."""

    template: Literal["sliding-idler"] = "sliding-idler"
    carrier: RigidPart
    slide: Point
    """On the axis of the slide [m]."""
    slide_angle: float = 0.0
    """Of the slide above the horizontal, about -y [rad]."""
    tensioner: Tensioner
    """Along the slide."""
    wheel: TrackWheel

    def check(self) -> None:
        """A tensioner along the slide."""
        first, second = self.tensioner.carrier_point, self.tensioner.chassis_point
        if not math.isclose(abs(self._along), math.dist(first, second), rel_tol=1e-6):
            raise refuse("tensioner", f"along the slide, at {self.slide_angle:g} rad", (first, second))

    @property
    def _along(self) -> float:
        """From the tensioner's point on the carrier to that on the chassis, along the slide [m]."""
        first, second = self.tensioner.carrier_point, self.tensioner.chassis_point
        slope = self.slide_angle
        return (second[0] - first[0]) * math.cos(slope) + (second[2] - first[2]) * math.sin(slope)

    @property
    def tightening(self) -> float:
        """Sign of an effort along the slide that tightens the chain: 1 or -1."""
        return -math.copysign(1.0, self._along)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RoadWheelMount(Spec):
    """A road wheel's suspension at the place of the wheel's centre, from the track's origin."""

    location: Point
    suspension: TorsionArm


@dataclasses.dataclass(frozen=True, kw_only=True)
class SupportRoller(Spec):
    """A wheel on the chassis that carries the upper run, at the place of its centre from the track's origin."""

    location: Point
    wheel: TrackWheel


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimpleTrackDriveline(Spec):
    """Torque in two halves, of which steering takes from the inner side, up to all of it."""

    template: Literal["simple-tracks"] = "simple-tracks"
    differential_bias: Annotated[float, Ge(1.0)] = 1.0
    gyration: bool = False
    """Starts in the mode in which full steering turns the inner side's torque around (`TrackedVehicle.gyration`)."""
    legacy: bool = False
    """The transmission sees its shaft turn backwards when the vehicle drives forwards, as in Project Chrono: a
    converter never leaves stall, and no gear is shifted. For comparison with its runs."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BrakedDifferential(Spec):
    """A bevel gear and an open differential; steering brakes the inner sprocket."""

    template: Literal["braked-differential"] = "braked-differential"
    driveshaft_inertia: Positive
    box_inertia: Positive
    bevel_ratio: Positive


TrackDriveline: TypeAlias = Annotated[SimpleTrackDriveline | BrakedDifferential, Tagged("template")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackLayout(Spec):
    """One track: sprocket at its origin, idler, road wheels from front to rear, a closed chain."""

    sprocket: TrackSprocket
    sprocket_location: Point = ZERO
    idler: SlidingIdler
    idler_location: Point
    road_wheels: Annotated[tuple[RoadWheelMount, ...], MinLen(1)]
    shoe: Shoe
    shoes: Annotated[int, Ge(3)]
    rollers: tuple[SupportRoller, ...] = ()
    pin_stiffness: NotNegative = 0.0
    """Of a spring that straightens the chain at each pin [N·m/rad]."""
    pin_damping: NotNegative = 0.0
    """[N·m·s/rad]."""
    brake: Brake | None = None

    def check(self) -> None:
        """Shoes and sprocket of one kind, and shoes that go around it."""
        single = isinstance(self.shoe, SinglePinShoe)
        if single != isinstance(self.sprocket, SinglePinSprocket):
            rule = f"one for shoes of template '{self.shoe.template}'"
            raise refuse("sprocket.template", rule, self.sprocket.template)
        if not 0.5 * self.shoe.pitch < self.sprocket.assembly_radius:
            rule = f"more than half the pitch of {self.shoe.pitch:g} m"
            raise refuse("sprocket.assembly_radius", rule, self.sprocket.assembly_radius)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShoeTrack(TrackLayout):
    """One track, shoe by shoe."""

    track: Literal["shoes"] = "shoes"
