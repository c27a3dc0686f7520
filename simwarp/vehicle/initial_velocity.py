"""A start at speed: bodies, wheels, shafts and gear of a vehicle that rolls straight on, all consistent."""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Sequence

import numpy as np

from simwarp.core.rotation import rotate
from simwarp.core.types import JointType
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.drivetrain.drivelines import DrivelineParts
from simwarp.vehicle.spec.vehicle_spec import (
    AutomaticMap,
    AutomaticShafts,
    ManualShafts,
    SpecError,
    Transmission,
    VehicleSpec,
)
from simwarp.vehicle.suspensions import Side
from simwarp.vehicle.suspensions.corner import Array

MANUAL_UPSHIFT = 300.0
"""Engine speed up to which a manual gearbox starts in a gear, some 2900 rpm [rad/s]."""


@dataclasses.dataclass(frozen=True)
class Rolling:
    """Initial speeds of a rolling vehicle and its powertrain."""

    speed: float
    """Forwards [m/s]."""
    gear: int
    """-1 reverse, 0 neutral, 1 and up forward."""
    drive_speed: float
    """Of the drive shaft [rad/s]."""
    motor_speed: float
    """Of the engine, and of the shaft between converter or clutch and gears [rad/s]; 0 in neutral."""


def roll_bodies(
    builder: ModelBuilder, bodies: range, sides: Sequence[Side], spec: VehicleSpec, speed: float, forward: Array
) -> None:
    """Every body moves on at `speed` along `forward`; wheels turn as their unloaded radius asks for."""
    velocity = speed * forward
    for index in bodies:
        builder.bodies[index] = dataclasses.replace(builder.bodies[index], velocity=velocity)
    for side in sides:
        body = builder.bodies[side.spindle]
        axis = rotate(body.pose.rotation, np.array([0.0, 1.0, 0.0]))
        omega = wheel_rate(spec, side, speed) * axis
        builder.bodies[side.spindle] = dataclasses.replace(body, omega=omega)
        if side.mesh is not None:
            for index in (side.mesh.bodies[node] for node in side.mesh.nodes):
                node = builder.bodies[index]
                around = np.cross(omega, node.pose.position - body.pose.position)
                builder.bodies[index] = dataclasses.replace(node, velocity=velocity + around)


def wheel_rate(spec: VehicleSpec, side: Side, speed: float) -> float:
    """Of a wheel that rolls on its unloaded radius [rad/s]."""
    return speed / spec.all_axles[side.axle].tire.radius


def roll_driveline(
    builder: ModelBuilder, driveline: DrivelineParts, couplings: range, sides: Sequence[Side], spec: VehicleSpec,
    speed: float,
) -> float:  # fmt: skip
    """Turns the shafts of a driveline with the wheels; returns the speed of the drive shaft [rad/s]."""
    turns = {side.turn: wheel_rate(spec, side, speed) for side in sides}
    if driveline.shaft < 0 and not driveline.motors:
        return sum(value * turns[turn] for turn, value in driveline.speed)
    joint_of = {builder.dof_start(joint): joint for joint in range(len(builder.joints))}
    terms = [[(joint_of[dof], value) for dof, value in builder.couplings[row].terms] for row in couplings]
    shafts = sorted({joint for row in terms for joint, _ in row if builder.joints[joint].type == JointType.SHAFT})
    matrix, known = np.zeros((len(terms), len(shafts))), np.zeros(len(terms))
    for row, entries in enumerate(terms):
        for joint, value in entries:
            if joint in turns:
                known[row] -= value * turns[joint]
            else:
                matrix[row, shafts.index(joint)] = value
    rates = dict(zip(shafts, np.linalg.lstsq(matrix, known)[0].tolist(), strict=True))
    for joint, rate in rates.items():
        turn_shaft(builder, joint, rate)
    return float(rates.get(driveline.shaft, 0.0))


def turn_shaft(builder: ModelBuilder, joint: int, rate: float) -> None:
    """A shaft starts at a speed [rad/s]."""
    builder.joints[joint] = dataclasses.replace(builder.joints[joint], initial_qd=rate)


def start_of(gears: Transmission | None, speed: float, drive_speed: float, gear: int | None) -> Rolling:
    """The gear of a vehicle at a speed, and its engine's speed in it.

    Args:
        gears: the transmission.
        speed: of the vehicle [m/s].
        drive_speed: of the drive shaft [rad/s].
        gear: the one that the driver wants; None: the one that an automatic takes, of a manual one the lowest in which
            the engine turns below `MANUAL_UPSHIFT`.

    Raises:
        SpecError: there is no such gear.
    """
    count = len(getattr(gears, "forward_ratios", (1.0,)))
    if gear is not None and not (isinstance(gear, numbers.Integral) and -1 <= gear <= count):
        raise SpecError(f"gear: must be a whole number from -1 (reverse) to {count}, got {gear!r}")
    chosen = _automatic_gear(gears, speed, drive_speed) if gear is None else gear
    ratio = gear_ratio(gears, chosen)
    return Rolling(speed, chosen, drive_speed, 0.0 if ratio == 0.0 else drive_speed / ratio)


def gear_ratio(gears: Transmission | None, gear: int) -> float:
    """Speed of the drive shaft per speed of the shaft before the gears; 0 in neutral and without fixed gears."""
    if gear == 0 or not isinstance(gears, (AutomaticMap, AutomaticShafts, ManualShafts)):
        return 0.0
    return gears.reverse_ratio if gear < 0 else gears.forward_ratios[gear - 1]


def _automatic_gear(gears: Transmission | None, speed: float, drive_speed: float) -> int:
    if speed < 0.0:
        return -1
    gear = 1
    match gears:
        case AutomaticMap():
            upshift = tuple(up for _, up in gears.shift_points)
        case AutomaticShafts():
            upshift = (gears.upshift_speed,) * len(gears.forward_ratios)
        case ManualShafts():
            upshift = (MANUAL_UPSHIFT,) * len(gears.forward_ratios)
        case _:
            return gear
    while gear < len(upshift) and abs(drive_speed / gears.forward_ratios[gear - 1]) > upshift[gear - 1]:
        gear += 1
    return gear
