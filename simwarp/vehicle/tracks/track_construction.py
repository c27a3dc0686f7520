"""From the description of a tracked vehicle to bodies, joints and shapes of a ModelBuilder, shoe by shoe.

A chain is a tree of hinges that starts at the shoe half way around, so that paths through it are short, and one point
that stays on a line closes it: two rows, where a hinge would have three more that its neighbours keep already.

Contacts are few. A shoe meets wheels with two balls, a quarter of the pitch before and behind its middle and one on
each disc, and the ground with two others at opposite corners of its pad; the next shoe takes the other corners. So a
wheel rolls over points half a pitch apart. Wheels are capsules, of which a chain sees the cylinder alone: nothing
guides it sideways but friction.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Final

import numpy as np

from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import WORLD, Material, Pose, pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.spec.parts import Array, RigidPart, SpecError, Vec3, merged, refuse
from simwarp.vehicle.spec.track_parts import (
    RoadWheelMount,
    ShoeTrack,
    SinglePinShoe,
    SinglePinSprocket,
    SlidingIdler,
    TrackedVehicleSpec,
    TrackWheel,
)
from simwarp.vehicle.suspensions.corner import Frame
from simwarp.vehicle.tracks.laying import LaidChain, TrackCourse, lay_chain

SLACK: Final = 0.9
"""Share of a shoe's height by which a chain is laid off idler and road wheels."""
QUARTER_TURN: Final = (math.sin(0.25 * math.pi), 0.0, 0.0, math.cos(0.25 * math.pi))
"""Turns a shape's axis from z to -y."""
DEFAULT_GROUP: Final = 1
"""Of shapes that name none: what shoes roll on."""
GROUP_BITS: Final = 31


class SprocketContact(enum.Enum):
    """How a sprocket meets the shoes."""

    DRUM = "drum"
    """A smooth cylinder at the depth at which rollers lie in its gaps: it drives by friction alone."""
    TEETH = "teeth"
    """Its profile; not there yet."""


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


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackedVehicleParts:
    """Indices, in the builder, of what a tracked vehicle is made of."""

    spec: TrackedVehicleSpec
    chassis: int
    reference: Array
    """(3,) origin of the vehicle's frame of reference from the chassis' centre of mass, body axes [m]."""
    left: ShoeTrackParts
    right: ShoeTrackParts
    bodies: range
    """All that `add_tracked_vehicle` made."""


def course_of(track: ShoeTrack) -> TrackCourse:
    """What the chain of a track is laid around, from the track's origin."""
    first, last = track.road_wheels[0], track.road_wheels[-1]
    (sx, _, sz), (ix, _, iz) = track.sprocket_location, track.idler_location
    away = SLACK * track.shoe.height
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
    return lay_chain(course_of(track), pitch=track.shoe.pitch, shoes=track.shoes)


def add_tracked_vehicle(
    builder: ModelBuilder, spec: TrackedVehicleSpec, *, sprocket: SprocketContact, at: Pose | None = None,
    prefix: str = "", wheel_compliance: float = 0.0, ground_compliance: float = 0.0, hull_fixed: bool = False,
) -> TrackedVehicleParts:  # fmt: skip
    """Adds a tracked vehicle that stands, its chains as laid: tensioners tighten them in the first tenths of a second.

    Shoes meet shapes of the default group, 1. Torques on sprockets are the user's (`control.joint_force`).

    Args:
        sprocket: how sprockets meet shoes; only `SprocketContact.DRUM` is there.
        at: pose of its frame of reference in the world; `spec.start_height` above the origin when None.
        prefix: of the names of its bodies and joints.
        wheel_compliance: of each contact between a shoe and a road wheel or idler [m/N].
        ground_compliance: of each contact between a shoe and the ground [m/N].
        hull_fixed: builds the chassis into the world.

    Raises:
        SpecError: a chain does not close, or the description asks for what is not there yet.
    """
    _refuse_what_lacks(spec, sprocket)
    if any(body.name.startswith(f"{prefix}left.") for body in builder.bodies):
        raise SpecError(f"prefix: must be one that no other tracked vehicle has, got {prefix!r} again; number them")
    first_body = len(builder.bodies)
    origin = pose((0.0, 0.0, spec.start_height)) if at is None else at
    mass, com, inertia = merged(spec.chassis.components)
    chassis = WORLD
    if not hull_fixed:
        center = pose(origin.position + rotate(origin.rotation, com), origin.rotation)
        chassis = builder.add_body(f"{prefix}chassis", mass=mass, inertia=inertia, pose=center)
    sides = []
    for name, track, side in (("left", spec.left, 1.0), ("right", spec.right, -1.0)):
        middle = origin.position + rotate(origin.rotation, np.array([0.0, side * spec.track_offset, 0.0]))
        frame = Frame(builder, f"{prefix}{name}", pose(middle, origin.rotation), side)
        sides.append(_Track(frame, track, chassis, wheel_compliance, ground_compliance).add())
    return TrackedVehicleParts(
        spec=spec, chassis=chassis, reference=-com, left=sides[0], right=sides[1],
        bodies=range(first_body, len(builder.bodies)),
    )  # fmt: skip


def _refuse_what_lacks(spec: TrackedVehicleSpec, sprocket: SprocketContact) -> None:
    if not isinstance(sprocket, SprocketContact):
        raise refuse("sprocket", "a SprocketContact", sprocket, "write SprocketContact.DRUM")
    if sprocket is not SprocketContact.DRUM:
        raise SpecError("sprocket: 'teeth' is not there yet: contacts with a profile are missing; use 'drum'")
    if spec.driveline is not None:
        raise SpecError(
            f"driveline: '{spec.driveline.template}' is not there yet; leave it out (dataclasses.replace) and put "
            "torques on the sprockets"
        )
    for name, track in (("left", spec.left), ("right", spec.right)):
        if not isinstance(track.shoe, SinglePinShoe) or not isinstance(track.sprocket, SinglePinSprocket):
            raise SpecError(f"{name}.shoe: '{track.shoe.template}' is not there yet; use 'track-single-pin'")
        if track.brake is not None:
            raise SpecError(f"{name}.brake: is not there yet; leave it out (dataclasses.replace)")
        if track.pin_stiffness > 0.0 or track.pin_damping > 0.0:
            raise SpecError(f"{name}.pin_stiffness: springs at pins are not there yet; leave them out")
        try:
            lay_track(track)
            drum_radius(track)
        except SpecError as error:
            raise SpecError(f"{name}.{error}") from None


@dataclasses.dataclass(frozen=True)
class _Track:
    """One track during assembly."""

    frame: Frame
    spec: ShoeTrack
    chassis: int
    wheel_compliance: float
    ground_compliance: float

    def add(self) -> ShoeTrackParts:
        """All bodies, joints and shapes."""
        wheels, tops = self._groups()
        sprocket = self._add_sprocket(wheels, tops)
        tensioner, idler = self._add_idler(self.spec.idler, wheels, tops)
        arms, road_wheels = [], []
        for index, mount in enumerate(self.spec.road_wheels):
            arm, wheel = self._add_road_wheel(index, mount, wheels, tops)
            arms.append(arm)
            road_wheels.append(wheel)
        for index, roller in enumerate(self.spec.rollers):
            frame = self._place(roller.location)
            body = self._add_wheel(frame, f"roller{index}", roller.wheel, (wheels, tops))
            frame.builder.add_joint_revolute(f"{frame.name}.roller{index}", self.chassis, body, axis=self._turning())
        shoes, pins = self._add_chain(wheels, tops)
        return ShoeTrackParts(
            sprocket=sprocket, tensioner=tensioner, idler=idler, arms=tuple(arms), road_wheels=tuple(road_wheels),
            shoes=shoes, pins=pins,
        )  # fmt: skip

    def _groups(self) -> tuple[int, int]:
        """Bits of this track's wheels and of what its shoes show them: others' wheels and shoes pass through."""
        taken = DEFAULT_GROUP
        for shape in self.frame.builder.shapes:
            taken |= shape.group
        free = [1 << bit for bit in range(GROUP_BITS) if not taken >> bit & 1]
        if len(free) < 2:
            raise SpecError(
                f"{self.frame.name}: must find two free collision groups, got {len(free)}; use fewer tracks"
            )
        return free[0], free[1]

    def _place(self, location: Vec3) -> Frame:
        """The frame of a part."""
        return dataclasses.replace(self.frame, origin=pose(self.frame.at(location), self.frame.origin.rotation))

    def _turning(self) -> Array:
        """Axis of arms, wheels and pins: positive turns roll forwards on both sides."""
        return rotate(self.frame.origin.rotation, np.array([0.0, 1.0, 0.0]))

    def _add_drum(
        self, body: int, radius: float, half_length: float, material: Material, groups: tuple[int, int]
    ) -> None:
        name = self.frame.builder.bodies[body].name
        self.frame.builder.add_shape_capsule(
            body, radius=radius, half_length=half_length, pose=pose((0.0, 0.0, 0.0), QUARTER_TURN), material=material,
            group=groups[0], mask=groups[1], name=name,
        )  # fmt: skip

    def _add_wheel(self, frame: Frame, name: str, wheel: TrackWheel, groups: tuple[int, int]) -> int:
        body = frame.add_body(name, RigidPart(mass=wheel.mass, inertia=wheel.inertia))
        material = Material(friction=wheel.friction, compliance=self.wheel_compliance)
        self._add_drum(body, wheel.radius, 0.5 * wheel.width, material, groups)
        return body

    def _add_sprocket(self, wheels: int, tops: int) -> int:
        sprocket, shoe = self.spec.sprocket, self.spec.shoe
        frame = self._place(self.spec.sprocket_location)
        body = frame.add_body("sprocket", RigidPart(mass=sprocket.mass, inertia=sprocket.inertia))
        radius = drum_radius(self.spec)
        self._add_drum(body, radius, 0.5 * shoe.wheel_pad.size[1], Material(friction=sprocket.friction), (wheels, tops))
        return frame.builder.add_joint_revolute(
            f"{frame.name}.sprocket", self.chassis, body, axis=self._turning(), armature=sprocket.axle_inertia
        )

    def _add_idler(self, idler: SlidingIdler, wheels: int, tops: int) -> tuple[int, int]:
        frame, builder = self._place(self.spec.idler_location), self.frame.builder
        carrier = frame.add_body("carrier", idler.carrier)
        along = frame.along((math.cos(idler.slide_angle), 0.0, math.sin(idler.slide_angle)))
        tensioner = idler.tensioner
        line = frame.at(tensioner.chassis_point) - frame.at(tensioner.carrier_point)
        sign = math.copysign(1.0, float(line @ along))  # moving towards the chassis' point shortens it
        slide = builder.add_joint_prismatic(
            f"{frame.name}.tensioner", self.chassis, carrier, axis=along, anchor=frame.at(idler.slide),
            stiffness=tensioner.stiffness, damping=tensioner.damping, preload=-sign * tensioner.force,
        )  # fmt: skip
        wheel = self._add_wheel(frame, "idler", idler.wheel, (wheels, tops))
        builder.add_joint_revolute(f"{frame.name}.idler", carrier, wheel, axis=self._turning())
        return slide, wheel

    def _add_road_wheel(self, index: int, mount: RoadWheelMount, wheels: int, tops: int) -> tuple[int, int]:
        frame, builder, suspension = self._place(mount.location), self.frame.builder, mount.suspension
        arm = frame.add_body(f"arm{index}", suspension.arm, trailing_arm_axes(suspension.hinge, suspension.wheel_joint))
        trailing = math.copysign(1.0, suspension.hinge[0] - suspension.wheel_joint[0])
        joint = builder.add_joint_revolute(
            f"{frame.name}.arm{index}", self.chassis, arm, axis=trailing * self._turning(),
            anchor=frame.at(suspension.hinge), stiffness=suspension.stiffness, damping=suspension.damping,
            rest=suspension.free_angle, preload=suspension.preload,
        )  # fmt: skip
        wheel = self._add_wheel(frame, f"wheel{index}", suspension.wheel, (wheels, tops))
        builder.add_joint_revolute(f"{frame.name}.wheel{index}", arm, wheel, axis=self._turning())
        if suspension.shock is not None:
            frame.add_line(f"shock{index}", self.chassis, arm, suspension.shock)
        return joint, wheel

    def _add_chain(self, wheels: int, tops: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        shoe, builder, name = self.spec.shoe, self.frame.builder, self.frame.name
        laid = lay_track(self.spec)
        count = len(laid.angles)
        shoes = [0] * count
        # Of bodies of one mass, the first one added is the root of their tree.
        for k in sorted(range(count), key=lambda k: abs(k - count // 2)):
            x, z = laid.centres[k].tolist()
            half = -0.5 * float(laid.angles[k])
            turn = quat_multiply(self.frame.origin.rotation, np.array([0.0, math.sin(half), 0.0, math.cos(half)]))
            shoes[k] = builder.add_body(
                f"{name}.shoe{k}", mass=shoe.mass, inertia=shoe.inertia, pose=pose(self.frame.at((x, 0.0, z)), turn),
                strict=False,
            )  # fmt: skip
        for k, body in enumerate(shoes):
            self._add_shoe_shapes(f"{name}.shoe{k}", body, 1.0 if k % 2 == 0 else -1.0, wheels, tops)
        axis, pins = self._turning(), []
        for k in range(count):
            x, z = laid.pins[k].tolist()
            add = builder.add_joint_revolute if k > 0 else builder.add_joint_point_on_line
            pins.append(add(f"{name}.pin{k}", shoes[k - 1], shoes[k], anchor=self.frame.at((x, 0.0, z)), axis=axis))
        return tuple(shoes), tuple(pins)

    def _add_shoe_shapes(self, name: str, body: int, across: float, wheels: int, tops: int) -> None:
        shoe, builder = self.spec.shoe, self.frame.builder
        top = shoe.wheel_pad.center[2] + 0.5 * shoe.wheel_pad.size[2]
        bottom = shoe.ground_pad.center[2] - 0.5 * shoe.ground_pad.size[2]
        radius = 0.5 * (top - bottom)
        offset = self.spec.road_wheels[0].suspension.wheel.disc_offset or 0.25 * shoe.wheel_pad.size[1]
        to_ground = Material(friction=shoe.friction, compliance=self.ground_compliance)
        length, width, _ = shoe.ground_pad.size
        for k, sign in enumerate((1.0, -1.0)):
            builder.add_shape_sphere(
                body, radius=radius, pose=pose((0.25 * sign * shoe.pitch, sign * across * offset, top - radius)),
                material=Material(friction=shoe.friction), group=tops, mask=wheels, name=f"{name}.top{k}",
            )  # fmt: skip
            builder.add_shape_sphere(
                body, radius=radius, pose=pose((0.5 * sign * length, 0.5 * sign * across * width, bottom + radius)),
                material=to_ground, group=tops, mask=DEFAULT_GROUP, name=f"{name}.pad{k}",
            )  # fmt: skip


def drum_radius(track: ShoeTrack) -> float:
    """Radius of the drum on which shoes lie as deep as with their rollers at the bottom of the sprocket's gaps [m].

    Raises:
        SpecError: the shoes' rollers are beyond that, or the drum has no radius.
    """
    shoe, sprocket = track.shoe, track.sprocket
    if not isinstance(shoe, SinglePinShoe) or not isinstance(sprocket, SinglePinSprocket):
        raise SpecError(f"shoe: '{shoe.template}' is not there yet; use 'track-single-pin'")
    half = 0.5 * (shoe.roller_front - shoe.roller_rear)
    seat = sprocket.roller_seat + shoe.roller_radius
    top = shoe.wheel_pad.center[2] + 0.5 * shoe.wheel_pad.size[2]
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
