"""From the description of a tracked vehicle to a ModelBuilder: chassis, two tracks, driveline and gears."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from simwarp.core.object_repr import Readable
from simwarp.core.rotation import rotate
from simwarp.core.types import WORLD, Pose, pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.drivetrain.transmissions import TransmissionParts, add_transmission
from simwarp.vehicle.initial_velocity import Rolling, start_of
from simwarp.vehicle.spec.belt_parts import BeltTrack
from simwarp.vehicle.spec.parts import Array, SpecError, merged
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.suspensions.corner import Frame
from simwarp.vehicle.tracks.belt_construction import BeltTrackParts, add_belt_track, chassis_parts
from simwarp.vehicle.tracks.shoe_construction import (
    ShoeTrackParts,
    SprocketContact,
    add_shoe_track,
    check_shoe_track,
)
from simwarp.vehicle.tracks.track_drivelines import TrackDrivelineParts, add_track_driveline

EXCHANGE_TIME: Final = 1.0e-4
"""Of the slip between gears and sprockets [s]: a tenth of that of wheels, since torques are ten times theirs. 4500 N·m
slip by 0.9 rad/s on 0.5 kg·m²."""


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class TrackedVehicleParts(Readable):
    """Indices, in the builder, of what a tracked vehicle is made of."""

    spec: TrackedVehicleSpec
    chassis: int
    reference: Array
    """(3,) origin of the vehicle's frame of reference from the chassis' centre of mass, body axes [m]."""
    left: ShoeTrackParts | BeltTrackParts
    right: ShoeTrackParts | BeltTrackParts
    driveline: TrackDrivelineParts
    gears: TransmissionParts
    start: Rolling
    """Gear and speeds of the shafts at the start."""
    bodies: range
    """All that `add_tracked_vehicle` made."""
    prefix: str = ""
    """Of the names of its bodies and joints."""

    @property
    def chains(self) -> tuple[ShoeTrackParts, ...]:
        """Left and right track shoe by shoe; none of a vehicle on belts."""
        return tuple(side for side in (self.left, self.right) if isinstance(side, ShoeTrackParts))

    @property
    def belts(self) -> tuple[BeltTrackParts, ...]:
        """Left and right track by belt; none of a vehicle shoe by shoe."""
        return tuple(side for side in (self.left, self.right) if isinstance(side, BeltTrackParts))

    def _readable_title(self) -> str:
        return f" of '{self.spec.name}': chassis is body {self.chassis}, {len(self.bodies)} bodies"


def add_tracked_vehicle(
    builder: ModelBuilder, spec: TrackedVehicleSpec, *, sprocket: SprocketContact = SprocketContact.TEETH,
    at: Pose | None = None, prefix: str = "", wheel_compliance: float = 0.0, ground_compliance: float = 0.0,
    hull_fixed: bool = False,
) -> TrackedVehicleParts:  # fmt: skip
    """Adds a tracked vehicle that stands, its chains as laid: tensioners tighten them in the first tenths of a second.

    Shoes meet shapes of the default group, 1; belts meet the ground of their `TrackedVehicle`, and no shapes. That
    element drives, steers and brakes either.

    Args:
        sprocket: how sprockets meet shoes.
        at: pose of its frame of reference in the world; `spec.start_height` above the origin when None.
        prefix: of the names of its bodies and joints.
        wheel_compliance: of each contact between a shoe and a road wheel or idler [m/N].
        ground_compliance: of each contact between a shoe and the ground [m/N].
        hull_fixed: builds the chassis of a vehicle with chains into the world.

    Raises:
        SpecError: a chain or belt does not go around, or another vehicle has this prefix.
    """
    tracks = (("left", spec.left, 1.0), ("right", spec.right, -1.0))
    components = list(spec.chassis.components)
    for name, track, side in tracks:
        try:
            if isinstance(track, BeltTrack):
                components += chassis_parts(track, spec.track_offset, side)
            else:
                check_shoe_track(track, sprocket)
        except SpecError as error:
            raise SpecError(f"{name}.{error}") from None
    if any(body.name in (f"{prefix}chassis", f"{prefix}left.arm0") for body in builder.bodies):
        raise SpecError(f"prefix: must be one that no other vehicle has, got {prefix!r} again; number them")
    if hull_fixed and spec.on_belts:
        raise SpecError(
            "hull_fixed: must be False for belts, whose forces act on the chassis; use chains, or let it go"
        )
    first_body = len(builder.bodies)
    origin = pose((0.0, 0.0, spec.start_height)) if at is None else at
    mass, com, inertia = merged(components)
    chassis = WORLD
    if not hull_fixed:
        center = pose(origin.position + rotate(origin.rotation, com), origin.rotation)
        chassis = builder.add_body(f"{prefix}chassis", mass=mass, inertia=inertia, pose=center)
    sides: list[ShoeTrackParts | BeltTrackParts] = []
    for name, track, side in tracks:
        middle = origin.position + rotate(origin.rotation, np.array([0.0, side * spec.track_offset, 0.0]))
        frame = Frame(builder, f"{prefix}{name}", pose(middle, origin.rotation), side)
        if isinstance(track, BeltTrack):
            sides.append(add_belt_track(frame, track, chassis))
        else:
            sides.append(
                add_shoe_track(
                    frame, track, chassis, sprocket=sprocket, wheel_compliance=wheel_compliance,
                    ground_compliance=ground_compliance,
                )
            )  # fmt: skip
    left, right = sides
    driveline = add_track_driveline(builder, prefix, spec.driveline, (left.sprocket, right.sprocket))
    start = start_of(spec.transmission, 0.0, 0.0, None)
    gears = add_transmission(builder, prefix, spec.transmission, driveline.line, start, exchange_time=EXCHANGE_TIME)
    return TrackedVehicleParts(
        spec=spec, chassis=chassis, reference=-com, left=left, right=right, driveline=driveline, gears=gears,
        start=start, bodies=range(first_body, len(builder.bodies)), prefix=prefix,
    )  # fmt: skip
