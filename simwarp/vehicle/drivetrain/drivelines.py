"""Driveline templates: shafts, differentials and bevel gears as shafts and couplings of the builder.

Speeds are positive in forward drive. A shaft's speed is seen from the chassis, so that the couplings' reactions act on
it. Shafts that a rigid gear ties are one coordinate: a differential's box adds ratio² x inertia to the shaft before it.
"""

from __future__ import annotations

import dataclasses

from simwarp.core.types import Drive, PositionDrive, VelocityMotor
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.spec.vehicle_spec import (
    DifferentialDrive,
    Driveline,
    MultiAxleDriveline,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
    SpecError,
)
from simwarp.vehicle.suspensions import Side

SLIP_SHARE = 2.0e-3
"""Inertia of the coordinate that measures a clutch's slip, over the smaller of the two that it ties: too little to be
felt, enough for float32 to keep what is left of torque / inertia.
"""


@dataclasses.dataclass(frozen=True)
class Lock:
    """A clutch across a differential: the coordinate of its slip, whose dry friction is the clutch's torque."""

    slip: int
    held: float
    """Torque of the open clutch, of a limited-slip differential [N·m]."""
    locking: float
    """Torque added when it closes [N·m]."""


@dataclasses.dataclass(frozen=True)
class DrivelineParts:
    """Parts of a driveline that the transmission acts on: a shaft, or directly the axles of a simple driveline.

    `split` lists (left turn, right turn, share of the torque x gear ratio, gear ratio, largest bias).
    """

    shaft: int = -1
    locks: tuple[Lock, ...] = ()
    split: tuple[tuple[int, int, float, float, float], ...] = ()
    inertia: float = 0.0
    """Of the shaft alone, whose acceleration takes torque from what is behind it [kg·m²]."""
    shaft_reaction: float = 0.0
    """Torque on the chassis about x per torque behind the shaft."""
    wheel_reaction: float = 1.0
    """Share of the torque of `split` that acts back on the chassis."""
    motors: tuple[int, ...] = ()
    """Shafts of the motors of a differential drive: left, right."""

    @property
    def speed(self) -> list[tuple[int, float]]:
        """(shaft or turn, coefficient): the sum is the speed at which the driveline takes the transmission's torque."""
        if self.shaft >= 0:
            return [(self.shaft, 1.0)]
        return [(turn, 0.5 * share / ratio) for left, right, share, ratio, _ in self.split for turn in (left, right)]


def add_driveline(
    builder: ModelBuilder, prefix: str, spec: Driveline | None, sides: list[tuple[Side, Side]]
) -> DrivelineParts:
    """Shafts and couplings between the transmission and the axles (left, right)."""
    match spec:
        case None:
            return DrivelineParts()
        case ShaftsDriveline2WD():
            return _two_wheels(builder, prefix, spec, sides)
        case ShaftsDriveline4WD():
            return _four_wheels(builder, prefix, spec, sides)
        case SimpleDriveline():
            front, rear = (sides[axle] for axle in spec.axles)
            share = spec.front_torque_fraction
            axles = (
                (front[0].turn, front[1].turn, share, spec.front_gear_ratio, spec.front_max_bias),
                (rear[0].turn, rear[1].turn, 1.0 - share, spec.rear_gear_ratio, spec.rear_max_bias),
            )
            driven = tuple(axle for axle in axles if axle[2] > 0.0)
            return DrivelineParts(split=driven, wheel_reaction=spec.reaction)
        case MultiAxleDriveline():
            share = 1.0 / len(spec.axles)
            pairs = [sides[axle] for axle in spec.axles]
            driven = tuple((left.turn, right.turn, share, spec.gear_ratio, spec.max_bias) for left, right in pairs)
            return DrivelineParts(split=driven, wheel_reaction=spec.reaction)
        case DifferentialDrive():
            return _motor_per_side(builder, prefix, spec, sides)
    raise SpecError(f"driveline: template '{spec.template}' is not known")


def add_clutch(builder: ModelBuilder, name: str, ends: tuple[int, int], inertia: float, torque: float) -> int:
    """The slip between two shafts or turns, with dry friction up to a torque [N·m]; `inertia`: the smaller of the two
    [kg·m²]. Returns the coordinate of the slip.
    """
    slip = builder.add_shaft(name, inertia=SLIP_SHARE * inertia, friction=torque)
    builder.add_coupling(name, [(ends[0], 1.0), (ends[1], -1.0), (slip, -1.0)])
    return slip


def _add_lock(
    builder: ModelBuilder, name: str, ends: tuple[int, int], inertia: float, held: float, locking: float
) -> tuple[Lock, ...]:
    """A clutch across a differential; none where it would hold nothing."""
    if held + locking == 0.0:
        return ()
    return (Lock(add_clutch(builder, name, ends, inertia, held + locking), held, locking),)


def _add_axle_lock(
    builder: ModelBuilder, name: str, sides: tuple[Side, Side], held: float, locking: float
) -> tuple[Lock, ...]:
    """A clutch between the wheels of an axle."""
    inertia = min(float(builder.bodies[side.spindle].inertia[1, 1]) for side in sides)
    return _add_lock(builder, name, _turns(sides), inertia, held, locking)


def add_differential(builder: ModelBuilder, name: str, shaft: int, ratio: float, turns: tuple[int, int]) -> None:
    """Bevel gear and differential: the mean speed of two turns, left and right, is ratio x the shaft's."""
    left, right = turns
    builder.add_coupling(name, [(left, 0.5), (right, 0.5), (shaft, -ratio)])


def _turns(sides: tuple[Side, Side]) -> tuple[int, int]:
    """Of an axle's wheels."""
    return sides[0].turn, sides[1].turn


def _two_wheels(
    builder: ModelBuilder, prefix: str, spec: ShaftsDriveline2WD, sides: list[tuple[Side, Side]]
) -> DrivelineParts:
    inertia = spec.driveshaft_inertia + spec.box_inertia * spec.gear_ratio**2
    shaft = builder.add_shaft(f"{prefix}driveline.shaft", inertia=inertia)
    driven = sides[spec.axle]
    add_differential(builder, f"{prefix}driveline.differential", shaft, spec.gear_ratio, _turns(driven))
    locking = spec.locking_limit if spec.lockable else 0.0
    locks = _add_axle_lock(builder, f"{prefix}driveline.lock", driven, spec.slip_torque, locking)
    return DrivelineParts(shaft, locks, inertia=spec.driveshaft_inertia, shaft_reaction=spec.reaction)


def _four_wheels(
    builder: ModelBuilder, prefix: str, spec: ShaftsDriveline4WD, sides: list[tuple[Side, Side]]
) -> DrivelineParts:
    front_inertia = spec.front_shaft_inertia + spec.front_box_inertia * spec.front_gear_ratio**2
    rear_inertia = spec.rear_shaft_inertia + spec.rear_box_inertia * spec.rear_gear_ratio**2
    shaft = builder.add_shaft(f"{prefix}driveline.shaft", inertia=spec.driveshaft_inertia)
    front = builder.add_shaft(f"{prefix}driveline.front_shaft", inertia=front_inertia)
    rear = builder.add_shaft(f"{prefix}driveline.rear_shaft", inertia=rear_inertia)
    builder.add_coupling(f"{prefix}driveline.center", [(front, 0.5), (rear, 0.5), (shaft, -1.0)])
    first, last = (sides[axle] for axle in spec.axles)
    add_differential(builder, f"{prefix}driveline.front_differential", front, spec.front_gear_ratio, _turns(first))
    add_differential(builder, f"{prefix}driveline.rear_differential", rear, spec.rear_gear_ratio, _turns(last))
    axle = spec.axle_locking_limit if spec.lockable else 0.0
    center = spec.central_locking_limit if spec.lockable else 0.0
    shafts = min(front_inertia, rear_inertia)
    locks = (
        *_add_lock(builder, f"{prefix}driveline.center_lock", (front, rear), shafts, spec.central_slip_torque, center),
        *_add_axle_lock(builder, f"{prefix}driveline.front_lock", first, spec.axle_slip_torque, axle),
        *_add_axle_lock(builder, f"{prefix}driveline.rear_lock", last, spec.axle_slip_torque, axle),
    )
    return DrivelineParts(shaft, locks, inertia=spec.driveshaft_inertia, shaft_reaction=spec.reaction)


def _motor_per_side(
    builder: ModelBuilder, prefix: str, spec: DifferentialDrive, sides: list[tuple[Side, Side]]
) -> DrivelineParts:
    """A motor's shaft on each side, geared to all wheels there.

    The voltage, bounded, gives at most the stall torque either way, and a damper takes of it what a turning motor
    loses: the straight line from stall torque to no-load speed. Both are implicit, however stiff they are.
    """
    drive: Drive = VelocityMotor(effort_limit=spec.stall_torque)
    if spec.gain is not None:
        drive = PositionDrive(stiffness=0.0, damping=spec.gain, effort_limit=spec.stall_torque)
    motors = []
    for index, name in enumerate(("left", "right")):
        label = f"{prefix}driveline.{name}"
        motor = builder.add_shaft(
            f"{label}_motor", inertia=spec.motor_inertia, damping=spec.stall_torque / spec.no_load_speed, drive=drive
        )
        for number, axle in enumerate(sides):
            builder.add_coupling(f"{label}_gear{number}", [(axle[index].turn, 1.0), (motor, -spec.gear_ratio)])
        motors.append(motor)
    return DrivelineParts(motors=tuple(motors))
