"""From the description of a track to bodies, joints and shapes of a ModelBuilder, shoe by shoe.

A chain is a tree of hinges that starts at the shoe half way around, so that paths through it are short, and one point
that stays on a line closes it: two rows, where a hinge would have three more that its neighbours keep already.

Contacts are few. A shoe meets wheels with two balls, a quarter of the pitch before and behind its middle and one on
each disc, and the ground with two others at opposite corners of its pad; the next shoe takes the other corners. So a
wheel rolls over points half a pitch apart. Wheels are capsules, of which a chain sees the cylinder alone.

Two balls more are a shoe's rollers in the middle of the track, which meet the sprocket's profile alone: two gear discs
are one. A fifth is its guide, which meets the grooves between the discs of wheels and beside the sprocket.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Final, TypedDict

import numpy as np

from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import Material, ModelError, pose
from simwarp.geometry.sprocket_profiles import SprocketProfile, checked_profile
from simwarp.vehicle.spec.parts import Array, RigidPart, SpecError, Vec3, refuse
from simwarp.vehicle.spec.track_parts import (
    RoadWheelMount,
    ShoeTrack,
    SinglePinShoe,
    SinglePinSprocket,
    SlidingIdler,
    TrackWheel,
)
from simwarp.vehicle.suspensions.corner import Frame
from simwarp.vehicle.tracks.laying import LaidChain, TrackCourse, lay_chain

SLACK: Final = 0.9
"""Share of a shoe's height by which a chain of shoes with one pin is laid off idler and road wheels; with two, whose
folds are sharper, it lies on them."""
QUARTER_TURN: Final = (math.sin(0.25 * math.pi), 0.0, 0.0, math.cos(0.25 * math.pi))
"""Turns a shape's axis from z to -y."""
DEFAULT_GROUP: Final = 1
"""Of shapes that name none: what shoes roll on."""
GROUP_BITS: Final = 31
GAP_DOWN: Final = (-0.5, 0.5, 0.5, 0.5)
"""Turns a shape's axis from z to y, and its x axis, on which a sprocket has its first gap, straight down."""


class SprocketContact(enum.Enum):
    """How a sprocket meets the shoes."""

    DRUM = "drum"
    """A smooth cylinder at the depth at which rollers lie in its gaps: it drives by friction alone."""
    TEETH = "teeth"
    """Its profile, which the rollers of the shoes lie in; one of its gaps points straight down at the start."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShoeTrackParts:
    """Indices, in the builder, of what a track is made of."""

    sprocket: int
    """Joint; its coordinate is positive in forward drive [rad]."""
    tensioner: int
    """Joint of the idler's slide; its coordinate is positive forwards [m]."""
    idler: int
    """Body."""
    arms: tuple[int, ...]
    """Joints, from front to rear; coordinates are positive with the wheel up [rad]."""
    road_wheels: tuple[int, ...]
    """Bodies."""
    shoes: tuple[int, ...]
    """Bodies, from below the sprocket over its far side."""
    pins: tuple[int, ...]
    """Joints: pin k lies between shoes k - 1 and k."""


def course_of(track: ShoeTrack) -> TrackCourse:
    """What the chain of a track is laid around, from the track's origin."""
    first, last = track.road_wheels[0], track.road_wheels[-1]
    (sx, _, sz), (ix, _, iz) = track.sprocket_location, track.idler_location
    shoe = track.shoe
    top = shoe.wheel_pad.top
    away = SLACK * shoe.height if isinstance(shoe, SinglePinShoe) else top
    return TrackCourse(
        sprocket=(sx, sz), sprocket_radius=track.sprocket.assembly_radius,
        idler=(ix, iz), idler_radius=track.idler.wheel.radius + away,
        wheel_front=(first.location[0], first.location[2]), wheel_rear=(last.location[0], last.location[2]),
        wheel_radius=last.suspension.wheel.radius + away,
    )  # fmt: skip


def lay_track(track: ShoeTrack) -> LaidChain:
    """The chain of a track as it is built.

    Raises:
        SpecError: it does not close.
    """
    return lay_chain(course_of(track), lengths=track.shoe.lengths, shoes=track.shoes)


def check_shoe_track(track: ShoeTrack, sprocket: SprocketContact) -> None:
    """Checks that a chain closes, and that its rollers fit the sprocket.

    Raises:
        SpecError: they do not.
    """
    if not isinstance(sprocket, SprocketContact):
        raise refuse("sprocket", "a SprocketContact", sprocket, "write SprocketContact.TEETH")
    lay_track(track)
    if sprocket is SprocketContact.DRUM:
        drum_radius(track)
        return
    (roller, _), profile = track.shoe.rollers, track.sprocket
    (centers, offset), tip = profile.arc_centers, profile.tip_radius
    try:
        checked_profile("sprocket", SprocketProfile(profile.teeth, centers / tip, profile.arc_radius / tip, offset))
    except ModelError as error:
        raise SpecError(str(error)) from None
    if not roller < profile.arc_radius:
        raise refuse("shoe.roller_radius", f"less than the sprocket's arc_radius {profile.arc_radius:g} m", roller)


def add_shoe_track(
    frame: Frame, spec: ShoeTrack, chassis: int, *, sprocket: SprocketContact = SprocketContact.TEETH,
    wheel_compliance: float = 0.0, ground_compliance: float = 0.0,
) -> ShoeTrackParts:  # fmt: skip
    """Adds a track, shoe by shoe, to a chassis.

    Args:
        frame: of the track: its builder, the prefix of its names, its origin in the world, its side.
        spec: described as a left one, and checked (`check_shoe_track`).
        chassis: body.
        sprocket: how it meets shoes.
        wheel_compliance: of each contact between a shoe and a road wheel or idler [m/N].
        ground_compliance: of each contact between a shoe and the ground [m/N].
    """
    return _Track(frame, spec, chassis, sprocket, wheel_compliance, ground_compliance).add()


class _Bits(TypedDict):
    """Collision bits of a shape."""

    group: int
    mask: int


@dataclasses.dataclass(frozen=True)
class _Groups:
    """Who meets whom in a track: tops of shoes its wheels, rollers its sprocket, guides the grooves; and nobody else.

    Three bits are enough: shapes meet if the group of each is the mask of the other, and each of the three pairs of
    bits has one kind of shape either way.
    """

    first: int
    second: int
    third: int

    @property
    def wheels(self) -> _Bits:
        return _Bits(group=self.first, mask=self.second)

    @property
    def tops(self) -> _Bits:
        return _Bits(group=self.second, mask=self.first)

    @property
    def pads(self) -> _Bits:
        return _Bits(group=self.second, mask=DEFAULT_GROUP)

    @property
    def sprocket(self) -> _Bits:
        return _Bits(group=self.first, mask=self.third)

    @property
    def rollers(self) -> _Bits:
        return _Bits(group=self.third, mask=self.first)

    @property
    def grooves(self) -> _Bits:
        return _Bits(group=self.second, mask=self.third)

    @property
    def guides(self) -> _Bits:
        return _Bits(group=self.third, mask=self.second)


@dataclasses.dataclass(frozen=True)
class _Track:
    """One track during assembly."""

    frame: Frame
    spec: ShoeTrack
    chassis: int
    sprocket: SprocketContact
    wheel_compliance: float
    ground_compliance: float

    def add(self) -> ShoeTrackParts:
        """All bodies, joints and shapes."""
        groups = self._free_groups()
        sprocket = self._add_sprocket(groups)
        tensioner, idler = self._add_idler(self.spec.idler, groups)
        arms, road_wheels = [], []
        for index, mount in enumerate(self.spec.road_wheels):
            arm, wheel = self._add_road_wheel(index, mount, groups)
            arms.append(arm)
            road_wheels.append(wheel)
        for index, roller in enumerate(self.spec.rollers):
            frame = self._place(roller.location)
            body = self._add_wheel(frame, f"roller{index}", roller.wheel, groups)
            frame.builder.add_joint_revolute(f"{frame.name}.roller{index}", self.chassis, body, axis=self._turning())
        shoes, pins = self._add_chain(groups)
        return ShoeTrackParts(
            sprocket=sprocket, tensioner=tensioner, idler=idler, arms=tuple(arms), road_wheels=tuple(road_wheels),
            shoes=shoes, pins=pins,
        )  # fmt: skip

    def _free_groups(self) -> _Groups:
        """Bits that no shape has: other tracks pass through this one."""
        taken = DEFAULT_GROUP
        for shape in self.frame.builder.shapes:
            taken |= shape.group
        free = [1 << bit for bit in range(GROUP_BITS) if not taken >> bit & 1]
        if len(free) < 3:
            raise SpecError(
                f"{self.frame.name}: must find three free collision groups, got {len(free)}; use fewer tracks"
            )
        return _Groups(*free[:3])

    def _place(self, location: Vec3) -> Frame:
        """The frame of a part."""
        return dataclasses.replace(self.frame, origin=pose(self.frame.at(location), self.frame.origin.rotation))

    def _turning(self) -> Array:
        """Axis of arms, wheels and pins: positive turns roll forwards on both sides."""
        return rotate(self.frame.origin.rotation, np.array([0.0, 1.0, 0.0]))

    def _add_drum(self, body: int, radius: float, half_length: float, material: Material, bits: _Bits) -> None:
        name = self.frame.builder.bodies[body].name
        self.frame.builder.add_shape_capsule(
            body, radius=radius, half_length=half_length, pose=pose((0.0, 0.0, 0.0), QUARTER_TURN), material=material,
            name=name, **bits,
        )  # fmt: skip

    def _add_groove(self, body: int, radius: float, half_width: float, groups: _Groups) -> None:
        name = f"{self.frame.builder.bodies[body].name}.groove"
        self.frame.builder.add_shape_groove(
            body, radius=radius, half_width=half_width, pose=pose((0.0, 0.0, 0.0), QUARTER_TURN),
            material=Material(friction=0.0), name=name, **groups.grooves,
        )  # fmt: skip

    def _add_wheel(self, frame: Frame, name: str, wheel: TrackWheel, groups: _Groups) -> int:
        body = frame.add_body(name, RigidPart(mass=wheel.mass, inertia=wheel.inertia))
        material = Material(friction=wheel.friction, compliance=self.wheel_compliance)
        self._add_drum(body, wheel.radius, 0.5 * wheel.width, material, groups.wheels)
        if wheel.gap > 0.0:
            self._add_groove(body, wheel.radius, 0.5 * wheel.gap, groups)
        return body

    def _add_sprocket(self, groups: _Groups) -> int:
        sprocket, shoe = self.spec.sprocket, self.spec.shoe
        frame = self._place(self.spec.sprocket_location)
        body = frame.add_body("sprocket", RigidPart(mass=sprocket.mass, inertia=sprocket.inertia))
        material = Material(friction=sprocket.friction)
        if self.sprocket is SprocketContact.DRUM:
            self._add_drum(body, drum_radius(self.spec), 0.5 * shoe.wheel_pad.size[1], material, groups.wheels)
        else:
            centers, offset = sprocket.arc_centers
            frame.builder.add_shape_sprocket(
                body, arc_center_radius=centers, arc_radius=sprocket.arc_radius, arc_offset=offset,
                tip_radius=sprocket.tip_radius, teeth=sprocket.teeth, half_width=0.5 * sprocket.separation,
                pose=pose((0.0, 0.0, 0.0), GAP_DOWN), material=material, name=f"{frame.name}.sprocket",
                **groups.sprocket,
            )  # fmt: skip
        room = sprocket.backlash + 0.5 * shoe.guide_width
        self._add_groove(body, sprocket.tip_radius, room, groups)
        brake = 0.0 if self.spec.brake is None else self.spec.brake.max_torque
        return frame.builder.add_joint_revolute(
            f"{frame.name}.sprocket", self.chassis, body, axis=self._turning(), armature=sprocket.axle_inertia,
            friction=brake,
        )  # fmt: skip

    def _add_idler(self, idler: SlidingIdler, groups: _Groups) -> tuple[int, int]:
        frame, builder = self._place(self.spec.idler_location), self.frame.builder
        carrier = frame.add_body("carrier", idler.carrier)
        along = frame.along((math.cos(idler.slide_angle), 0.0, math.sin(idler.slide_angle)))
        tensioner = idler.tensioner
        slide = builder.add_joint_prismatic(
            f"{frame.name}.tensioner", self.chassis, carrier, axis=along, anchor=frame.at(idler.slide),
            stiffness=tensioner.stiffness, damping=tensioner.damping, preload=idler.tightening * tensioner.force,
        )  # fmt: skip
        wheel = self._add_wheel(frame, "idler", idler.wheel, groups)
        builder.add_joint_revolute(f"{frame.name}.idler", carrier, wheel, axis=self._turning())
        return slide, wheel

    def _add_road_wheel(self, index: int, mount: RoadWheelMount, groups: _Groups) -> tuple[int, int]:
        frame, builder, suspension = self._place(mount.location), self.frame.builder, mount.suspension
        arm = frame.add_body(f"arm{index}", suspension.arm, trailing_arm_axes(suspension.hinge, suspension.wheel_joint))
        trailing = math.copysign(1.0, suspension.hinge[0] - suspension.wheel_joint[0])
        joint = builder.add_joint_revolute(
            f"{frame.name}.arm{index}", self.chassis, arm, axis=trailing * self._turning(),
            anchor=frame.at(suspension.hinge), stiffness=suspension.stiffness, damping=suspension.damping,
            rest=suspension.free_angle, preload=suspension.preload,
        )  # fmt: skip
        wheel = self._add_wheel(frame, f"wheel{index}", suspension.wheel, groups)
        builder.add_joint_revolute(f"{frame.name}.wheel{index}", arm, wheel, axis=self._turning())
        if suspension.shock is not None:
            frame.add_line(f"shock{index}", self.chassis, arm, suspension.shock)
        return joint, wheel

    def _add_chain(self, groups: _Groups) -> tuple[tuple[int, ...], tuple[int, ...]]:
        builder, name = self.frame.builder, self.frame.name
        laid = lay_track(self.spec)
        parts = self.spec.shoe.links
        count = len(laid.angles)
        links = [0] * count
        # Of bodies of one mass, the first one added is the root of their tree.
        for k in sorted(range(count), key=lambda k: abs(k - count // 2)):
            x, z = laid.centres[k].tolist()
            half = -0.5 * float(laid.angles[k])
            turn = quat_multiply(self.frame.origin.rotation, np.array([0.0, math.sin(half), 0.0, math.cos(half)]))
            kind, part = parts[k % len(parts)]
            links[k] = builder.add_body(
                f"{name}.{kind}{k // len(parts)}", mass=part.mass, inertia=part.inertia,
                pose=pose(self.frame.at((x, 0.0, z)), turn), strict=False,
            )  # fmt: skip
        shoes = links[:: len(parts)]
        for k, body in enumerate(shoes):
            self._add_shoe_shapes(f"{name}.shoe{k}", body, 1.0 if k % 2 == 0 else -1.0, groups)
        if self.sprocket is SprocketContact.TEETH:
            for k, body in enumerate(links[len(parts) - 1 :: len(parts)]):
                self._add_rollers(f"{name}.{parts[-1][0]}{k}", body, groups)
        axis, pins = self._turning(), []
        for k in range(count):
            x, z = laid.pins[k].tolist()
            pin, anchor = f"{name}.pin{k}", self.frame.at((x, 0.0, z))
            if k == 0:  # closes the chain, without a spring
                pins.append(builder.add_joint_point_on_line(pin, links[k - 1], links[k], anchor=anchor, axis=axis))
                continue
            fold = math.remainder(float(laid.angles[k] - laid.angles[k - 1]), 2.0 * math.pi)
            pins.append(
                builder.add_joint_revolute(
                    pin, links[k - 1], links[k], anchor=anchor, axis=axis, stiffness=self.spec.pin_stiffness,
                    damping=self.spec.pin_damping, rest=fold,
                )
            )  # fmt: skip
        return tuple(shoes), tuple(pins)

    def _add_rollers(self, name: str, body: int, groups: _Groups) -> None:
        """Balls that meet the sprocket: on a shoe with one pin, or at both ends of a connector."""
        shoe = self.spec.shoe
        radius, places = shoe.rollers
        for k, x in enumerate(places):
            self.frame.builder.add_shape_sphere(
                body, radius=radius, pose=pose((x, 0.0, 0.0)), material=Material(friction=shoe.friction),
                name=f"{name}.roller{k}", **groups.rollers,
            )  # fmt: skip

    def _add_shoe_shapes(self, name: str, body: int, across: float, groups: _Groups) -> None:
        shoe, builder = self.spec.shoe, self.frame.builder
        top = shoe.wheel_pad.top
        bottom = shoe.ground_pad.bottom
        radius = 0.5 * (top - bottom)
        offset = self.spec.road_wheels[0].suspension.wheel.disc_offset or 0.25 * shoe.wheel_pad.size[1]
        to_ground = Material(friction=shoe.friction, compliance=self.ground_compliance)
        length, width, _ = shoe.ground_pad.size
        for k, sign in enumerate((1.0, -1.0)):
            builder.add_shape_sphere(
                body, radius=radius, pose=pose((0.25 * sign * shoe.pitch, sign * across * offset, top - radius)),
                material=Material(friction=shoe.friction), name=f"{name}.top{k}", **groups.tops,
            )  # fmt: skip
            builder.add_shape_sphere(
                body, radius=radius, pose=pose((0.5 * sign * length, 0.5 * sign * across * width, bottom + radius)),
                material=to_ground, name=f"{name}.pad{k}", **groups.pads,
            )  # fmt: skip
        builder.add_shape_sphere(
            body, radius=0.5 * shoe.guide_width, pose=pose(shoe.guide), material=Material(friction=0.0),
            name=f"{name}.guide", **groups.guides,
        )  # fmt: skip


def drum_radius(track: ShoeTrack) -> float:
    """Radius of the drum on which shoes lie as deep as with their rollers at the bottom of the sprocket's gaps [m].

    Raises:
        SpecError: the shoes' rollers are beyond that, or the drum has no radius.
    """
    shoe, sprocket = track.shoe, track.sprocket
    if not isinstance(shoe, SinglePinShoe) or not isinstance(sprocket, SinglePinSprocket):
        raise SpecError(f"shoe: '{shoe.template}' has no drum; use SprocketContact.TEETH")
    half = 0.5 * (shoe.roller_front - shoe.roller_rear)
    seat = sprocket.roller_seat + shoe.roller_radius
    top = shoe.wheel_pad.top
    radius = math.sqrt(max(seat * seat - half * half, 0.0)) - top
    if radius <= 0.0:
        raise refuse("sprocket.arc_center_radius", f"large enough for rollers {2 * half:.4g} m apart", seat)
    return radius


def trailing_arm_axes(hinge: Vec3, wheel_joint: Vec3) -> Array:
    """Axes (columns) of an arm: x from the wheel's end to the hinge, y along the hinge."""
    along = np.subtract(hinge, wheel_joint)
    along[1] = 0.0
    x = along / np.linalg.norm(along)
    y = np.array([0.0, 1.0, 0.0])
    return np.stack([x, y, np.cross(x, y)], axis=1)
