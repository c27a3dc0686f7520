"""Drivelines of tracked vehicles: from the transmission to two sprockets, and what steering does to them.

The left sprocket is the inner one of a turn to the left. A simple driveline takes torque from the inner sprocket, up to
all of it (in gyration mode twice that, so that it is driven backwards); a braked differential brakes it.
"""

from __future__ import annotations

import dataclasses

from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.drivetrain.drivelines import DrivelineParts, add_differential
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.track_parts import BrakedDifferential, SimpleTrackDriveline, TrackDriveline


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackDrivelineParts:
    """A driveline in the builder, and how steering acts."""

    line: DrivelineParts
    steers_by_torque: bool = False
    """Steering takes torque from the inner sprocket."""
    steers_by_brake: bool = False
    """Steering adds to the braking of the inner sprocket."""
    torque_sign: float = 1.0
    """Of the torque that the gears' coupling brings to the sprockets: -1 of a shaft that turns backwards (`legacy`)."""


def add_track_driveline(
    builder: ModelBuilder, prefix: str, spec: TrackDriveline | None, sprockets: tuple[int, int]
) -> TrackDrivelineParts:  # fmt: skip
    """Shafts and couplings between the transmission and the sprockets' coordinates, left and right."""
    match spec:
        case None:
            return TrackDrivelineParts(line=DrivelineParts())
        case SimpleTrackDriveline():
            sign = -1.0 if spec.legacy else 1.0
            line = DrivelineParts(split=((*sprockets, 1.0, sign, spec.differential_bias),))
            return TrackDrivelineParts(line=line, steers_by_torque=True, torque_sign=sign)
        case BrakedDifferential():
            inertia = spec.driveshaft_inertia + spec.box_inertia * spec.bevel_ratio**2
            shaft = builder.add_shaft(f"{prefix}driveline.shaft", inertia=inertia)
            add_differential(builder, f"{prefix}driveline.differential", shaft, spec.bevel_ratio, sprockets)
            line = DrivelineParts(shaft, inertia=spec.driveshaft_inertia)
            return TrackDrivelineParts(line=line, steers_by_brake=True)
    raise SpecError(f"driveline: template '{spec.template}' is not known")
