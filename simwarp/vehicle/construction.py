"""From the description of a vehicle to the bodies, joints, shafts and couplings of a ModelBuilder."""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Iterable
from typing import Final, Protocol, Unpack

import numpy as np

from simwarp.core.object_repr import Readable, plural
from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import Pose, Vec3, finite_vector, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.keyword_argument_types import SurfaceOptions
from simwarp.vehicle.drivetrain.drivelines import DrivelineParts, add_driveline
from simwarp.vehicle.drivetrain.transmissions import TransmissionParts, add_transmission
from simwarp.vehicle.hitches import add_hitch
from simwarp.vehicle.initial_velocity import Rolling, roll_bodies, roll_driveline, start_of, wheel_rate
from simwarp.vehicle.reduced.reduced_construction import add_reduced_bodies, drive_row, reduced_driveline
from simwarp.vehicle.spec.parts import merged
from simwarp.vehicle.spec.vehicle_parts import Chassis
from simwarp.vehicle.spec.vehicle_spec import SpecError, Unit, VehicleSpec
from simwarp.vehicle.suspensions import Side, add_antiroll_bar, add_axle
from simwarp.vehicle.suspensions.corner import Array, Frame
from simwarp.vehicle.suspensions.steerings import SteeringParts, add_steering
from simwarp.vehicle.tires.parameter_vector import MODELS

TRAILER_BOX: Final = "_trailer"
"""Behind the name of a vehicle's box in contacts, before the trailer's number: that trailer's box."""


@dataclasses.dataclass(frozen=True)
class UnitParts:
    """The towing vehicle or one of its trailers in the builder."""

    chassis: int
    reference: Array
    """(3,) origin of its frame of reference from the chassis' centre of mass, body axes [m]."""
    axles: range
    """Numbers of its axles among `VehicleSpec.all_axles`."""
    hitch: int = -1
    """The joint that holds it to the unit before; -1 of the towing vehicle."""
    bodies: tuple[int, ...] = ()
    """All of it, the chassis first."""


@dataclasses.dataclass(frozen=True, repr=False)
class VehicleParts(Readable):
    """Indices, in the builder, of what a vehicle is made of."""

    spec: VehicleSpec
    chassis: int
    reference: Array
    """(3,) origin of the vehicle's frame of reference from the chassis' centre of mass, body axes [m]."""
    sides: tuple[Side, ...]
    """Wheels: front left, front right, then those of the axles behind."""
    steerings: tuple[SteeringParts, ...]
    driveline: DrivelineParts
    gears: TransmissionParts
    start: Rolling
    """Speed, gear and shaft speeds at the start."""
    bodies: range
    """All that `add_vehicle` made."""
    prefix: str = ""
    """Of the names of its bodies and joints, and of what is added to it without a name of its own."""
    units: tuple[UnitParts, ...] = ()
    """The towing vehicle, then its trailers."""

    def unit_of(self, axle: int) -> UnitParts:
        """The unit that an axle, numbered through, belongs to."""
        return next(unit for unit in self.units if axle in unit.axles)

    @property
    def has_wheel_bodies(self) -> bool:
        """Whether the wheels are bodies of their own; of a reduced vehicle they may be none."""
        return all(side.spindle != self.chassis for side in self.sides)

    def _readable_title(self) -> str:
        wheels = plural(len(self.sides), "wheel")
        return f" of '{self.spec.name}': chassis is body {self.chassis}, {wheels}"


def add_vehicle(
    builder: ModelBuilder, spec: VehicleSpec, *, at: Pose | None = None, prefix: str = "", speed: float = 0.0,
    gear: int | None = None, wheel_bodies: bool = True,
) -> VehicleParts:  # fmt: skip
    """Adds a vehicle that stands, or rolls straight on.

    Args:
        at: pose of its frame of reference in the world; `spec.start_height` above the origin when None.
        prefix: of the names of its bodies and joints; vehicles of one builder need different ones.
        speed: forwards [m/s]. Wheels roll on their unloaded radius; driveline, transmission and engine turn with them.
        gear: -1 reverse, 0 neutral, 1 and up forward; None: the one that an automatic takes at that speed, of a
            manual one the lowest in which the engine does not race.
        wheel_bodies: False leaves out the bodies of a reduced vehicle's wheels, which pictures and sensors see and
            nothing else needs; the vehicle moves the same.

    Raises:
        SpecError: parts do not fit together, there is no such gear, or a vehicle has that prefix already.
    """
    if any(body.name == f"{prefix}chassis" for body in builder.bodies):
        raise SpecError(
            f"prefix: must be one that no other vehicle has, got {prefix!r} again; number them, such as 'v1_'"
        )
    if isinstance(speed, bool) or not isinstance(speed, numbers.Real) or not math.isfinite(speed):
        raise SpecError(f"speed: must be a finite number, got {speed!r}")
    first_body = len(builder.bodies)
    origin = pose((0.0, 0.0, spec.start_height)) if at is None else at
    if spec.is_reduced:
        return _add_reduced(builder, spec, origin, prefix, speed, gear, wheel_bodies)
    chassis, reference = _add_chassis(builder, f"{prefix}chassis", spec.chassis, origin)

    def place(name: str, location: object, side: float = 1.0, turn: object = (0.0, 0.0, 0.0, 1.0)) -> Frame:
        position = origin.position + rotate(origin.rotation, np.asarray(location, float))
        rotation = quat_multiply(origin.rotation, np.asarray(turn, float))
        return Frame(builder, f"{prefix}{name}", pose(position, rotation), side)

    steerings = tuple(
        add_steering(place(f"steering{index}", mount.location, turn=mount.rotation), mount.steering, chassis)
        for index, mount in enumerate(spec.steerings)
    )
    units = _add_trailers(builder, prefix, spec, UnitParts(chassis, reference, range(len(spec.axles))), origin)
    pairs: list[tuple[Side, Side]] = []
    made = [[unit.chassis] for unit in units]
    made[0] = [body for body in range(first_body, len(builder.bodies)) if body not in {each[0] for each in made[1:]}]
    for index, axle in enumerate(spec.all_axles):
        number = next(number for number, unit in enumerate(units) if index in unit.axles)
        held, start_body = units[number].chassis, len(builder.bodies)
        link = held if axle.steering is None else steerings[axle.steering].link
        left, right = add_axle(place(f"axle{index}", axle.location), index, axle, held, link)
        if axle.antiroll_bar is not None:
            middle = place(f"axle{index}.antiroll_bar", axle.antiroll_bar.location)
            add_antiroll_bar(middle, axle.antiroll_bar, held, left.bar, right.bar)
        pairs.append((left, right))
        made[number] += range(start_body, len(builder.bodies))
    units = tuple(dataclasses.replace(unit, bodies=tuple(own)) for unit, own in zip(units, made, strict=True))
    first_coupling = len(builder.couplings)
    driveline = add_driveline(builder, prefix, spec.driveline, pairs[: len(spec.axles)])
    sides = tuple(side for pair in pairs for side in pair)
    forward = rotate(origin.rotation, np.array([1.0, 0.0, 0.0]))
    roll_bodies(builder, range(first_body, len(builder.bodies)), sides, spec, speed, forward)
    couplings = range(first_coupling, len(builder.couplings))
    drive_speed = roll_driveline(builder, driveline, couplings, sides, spec, speed)
    start = start_of(spec.transmission, speed, drive_speed, gear)
    gears = add_transmission(builder, prefix, spec.transmission, driveline, start)
    bodies = range(first_body, len(builder.bodies))
    return VehicleParts(spec, chassis, reference, sides, steerings, driveline, gears, start, bodies, prefix, units)


def _add_chassis(builder: ModelBuilder, name: str, chassis: Chassis, origin: Pose) -> tuple[int, Array]:
    """The body of a unit at a pose of its frame of reference, and that frame's origin from its centre of mass."""
    mass, com, inertia = merged(chassis.components)
    center = pose(origin.position + rotate(origin.rotation, com), origin.rotation)
    return builder.add_body(name, mass=mass, inertia=inertia, pose=center), -com


def _add_trailers(
    builder: ModelBuilder, prefix: str, spec: VehicleSpec, towing: UnitParts, origin: Pose
) -> tuple[UnitParts, ...]:
    """The chassis of all trailers on their hitches; all units, the towing vehicle first."""
    units = [towing]
    for number, unit in enumerate(spec.units[1:]):
        assert unit.hitch is not None  # of the towing vehicle alone
        name = f"{prefix}trailer{number}"
        place = pose(origin.position + rotate(origin.rotation, np.array(unit.origin)), origin.rotation)
        chassis, reference = _add_chassis(builder, f"{name}.chassis", unit.chassis, place)
        hitch = add_hitch(builder, f"{name}.hitch", unit.hitch, units[-1].chassis, chassis, place)
        first = units[-1].axles.stop
        units.append(UnitParts(chassis, reference, range(first, first + len(unit.axles)), hitch))
    return tuple(units)


def _add_reduced(
    builder: ModelBuilder, spec: VehicleSpec, origin: Pose, prefix: str, speed: float, gear: int | None,
    wheel_bodies: bool,
) -> VehicleParts:  # fmt: skip
    """A reduced vehicle: a chassis, and the wheels as `wheel_bodies` asks for."""
    for index, axle in enumerate(spec.axles):
        if axle.tire.template not in MODELS:
            found = f"got '{axle.tire.template}' of the reduced '{spec.name}'"
            raise SpecError(f"axles[{index}].tire: must be a force law on tables, {found}; choose another tire")
    first = len(builder.bodies)
    chassis, sides, reference = add_reduced_bodies(builder, spec, origin, prefix, wheel_bodies)
    forward = rotate(origin.rotation, np.array([1.0, 0.0, 0.0]))
    bodies = range(first, len(builder.bodies))
    roll_bodies(builder, bodies, sides if wheel_bodies else (), spec, speed, forward)
    rates = np.array([wheel_rate(spec, side, speed) for side in sides])
    start = start_of(spec.transmission, speed, float(drive_row(spec) @ rates), gear)
    driveline = reduced_driveline(spec)
    units = (UnitParts(chassis, reference, range(len(spec.axles)), bodies=tuple(bodies)),)
    return VehicleParts(
        spec, chassis, reference, sides, (), driveline, TransmissionParts(), start, bodies, prefix, units
    )  # fmt: skip


class ChassisParts(Protocol):
    """A vehicle on wheels or tracks in the builder, as far as its chassis goes."""

    @property
    def chassis(self) -> int:
        """The sprung body."""

    @property
    def reference(self) -> Array:
        """(3,) origin of the vehicle's frame of reference from the chassis' centre of mass, body axes [m]."""

    @property
    def bodies(self) -> Iterable[int]:
        """All of it."""

    @property
    def prefix(self) -> str:
        """Of its names."""


def _trailers(parts: ChassisParts) -> list[tuple[UnitParts, Unit]]:
    """Trailers in the builder and as described; on tracks none are towed."""
    if not isinstance(parts, VehicleParts):
        return []
    return list(zip(parts.units[1:], parts.spec.units[1:], strict=True))


def add_chassis_box(
    builder: ModelBuilder, parts: ChassisParts, *, half: Vec3, position: Vec3 = (0.0, 0.0, 0.0),
    name: str | None = None, **options: Unpack[SurfaceOptions],
) -> int:  # fmt: skip
    """A box in contacts that stands for a vehicle: it meets other vehicles' and the world's shapes, its own never.

    Each trailer gets one too, as large as its `chassis.size`, with `_trailer0` and so on behind the name.

    Args:
        builder: that `parts` was added to.
        parts: from `add_vehicle` or `add_tracked_vehicle`.
        half: half lengths along x (ahead), y (to the left) and z [m].
        position: of its middle in the vehicle's frame of reference [m].
        name: of the shape; `chassis_box` behind the vehicle's prefix when None.
        options: `material`, `margin`, `group`, `mask` of the shape.

    Returns:
        The index of the shape.

    Raises:
        ModelError: a value is not usable, or the name is taken.
    """
    called = f"{parts.prefix}chassis_box" if name is None else name
    place = pose(parts.reference + finite_vector(called, "position", position, 3))
    shape = builder.add_shape_box(parts.chassis, half=half, pose=place, name=called, **options)
    trailers = _trailers(parts)
    for number, (unit, described) in enumerate(trailers):
        x, y, z = (0.5 * length for length in described.chassis.size)
        builder.add_shape_box(
            unit.chassis, half=(x, y, z), pose=pose(unit.reference + np.array(described.chassis.size_center)),
            name=f"{called}{TRAILER_BOX}{number}", **options,
        )  # fmt: skip
    boxed = [parts.chassis, *(unit.chassis for unit, _ in trailers)]
    for place_of, chassis in enumerate(boxed):
        for body in parts.bodies:
            if body not in boxed[: place_of + 1]:
                builder.exclude_collision(chassis, body)
    return shape


def trailer_boxes(builder: ModelBuilder, parts: ChassisParts) -> list[int]:
    """Indices of the shapes that `add_chassis_box` added for trailers; none before that."""
    pulled = {unit.chassis for unit, _ in _trailers(parts)}
    return [
        index
        for index, shape in enumerate(builder.shapes)
        if shape.body in pulled and TRAILER_BOX in (shape.name or "")
    ]
