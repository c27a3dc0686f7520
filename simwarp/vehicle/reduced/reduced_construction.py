"""From the description of a reduced vehicle to a chassis, and to wheels that others see."""

from __future__ import annotations

import numpy as np

from simwarp.core.rotation import rotate
from simwarp.core.types import Pose, pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.drivetrain.drivelines import DrivelineParts, Lock
from simwarp.vehicle.reduced.linkage_measurement import THIN
from simwarp.vehicle.spec.parts import Array, RigidPart, Vec3, merged
from simwarp.vehicle.spec.tabulated_suspension import TabulatedSuspension
from simwarp.vehicle.spec.vehicle_spec import (
    Axle,
    Driveline,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
    VehicleSpec,
)
from simwarp.vehicle.suspensions import Side


def tables_of(axle: Axle) -> TabulatedSuspension:
    """The suspension of an axle of a reduced vehicle."""
    assert isinstance(axle.suspension, TabulatedSuspension)  # of VehicleSpec.check
    return axle.suspension


def standing_center(axle: Axle, side: int) -> Vec3:
    """Of a wheel (0 left, 1 right) of the standing vehicle, straight ahead, in its frame of reference [m]."""
    suspension = tables_of(axle)
    table = (suspension.left, suspension.right)[side]
    middle = len(suspension.steering) // 2
    x, y = (
        float(np.interp(suspension.standing, suspension.travel, [row[middle] for row in values]))
        for values in (table.ahead, table.aside)
    )
    return x, y, table.height + suspension.standing


def chassis_parts(spec: VehicleSpec) -> tuple[RigidPart, ...]:
    """The chassis with its tires, but for what turns with the wheels."""
    tires = [
        RigidPart(
            mass=axle.tire.mass, com=standing_center(axle, side),
            inertia=(axle.tire.inertia[0], 2.0 * THIN * axle.tire.inertia[0], axle.tire.inertia[2]),
        )
        for axle in spec.axles
        for side in (0, 1)
    ]  # fmt: skip
    return (*spec.chassis.components, *tires)


def add_reduced_bodies(
    builder: ModelBuilder, spec: VehicleSpec, origin: Pose, prefix: str, wheel_bodies: bool
) -> tuple[int, tuple[Side, ...], Array]:  # fmt: skip
    """The chassis, the wheels, and the origin of the vehicle's frame of reference from the chassis' centre of mass.

    Args:
        builder: of the model.
        spec: of the vehicle.
        origin: pose of its frame of reference.
        prefix: of the names.
        wheel_bodies: wheels become bodies without effect, which pictures and sensors see; else the chassis stands for
            them.
    """
    mass, com, inertia = merged(chassis_parts(spec))
    center = pose(origin.position + rotate(origin.rotation, com), origin.rotation)
    chassis = builder.add_body(f"{prefix}chassis", mass=mass, inertia=inertia, pose=center, strict=False)
    sides = []
    for index, axle in enumerate(spec.axles):
        for column, (name, side) in enumerate((("left", 1.0), ("right", -1.0))):
            label, spindle = f"{prefix}axle{index}.{name}", chassis
            if wheel_bodies:
                place = pose(
                    origin.position + rotate(origin.rotation, np.array(standing_center(axle, column))), origin.rotation
                )
                spindle = builder.add_massless_body(f"{label}.spindle", pose=place, posed=True)
            sides.append(Side(label, index, side, chassis, spindle, -1, -1, chassis))
    return chassis, tuple(sides), -com


def drive_row(spec: VehicleSpec) -> Array:
    """(4,) speed of the drive shaft per speed of each wheel."""
    row = np.zeros(4)
    match spec.driveline:
        case ShaftsDriveline2WD() as line:
            row += axle_row(line.axle, line.gear_ratio)
        case ShaftsDriveline4WD() as line:
            front, rear = line.axles
            row += 0.5 * (axle_row(front, line.front_gear_ratio) + axle_row(rear, line.rear_gear_ratio))
        case SimpleDriveline() as line:
            share = line.front_torque_fraction
            row += share * axle_row(line.axles[0], line.front_gear_ratio)
            row += (1.0 - share) * axle_row(line.axles[1], line.rear_gear_ratio)
    return row


def axle_row(axle: int, ratio: float) -> Array:
    """(4,) speed of an axle's bevel gear per speed of each wheel."""
    row = np.zeros(4)
    row[[2 * (axle % 2), 2 * (axle % 2) + 1]] = 0.5 / ratio
    return row


def shaft_inertia(line: Driveline | None) -> Array:
    """(4, 4) of all shafts behind the gears, on the wheels' speeds [kg·m²]."""
    match line:
        case ShaftsDriveline2WD():
            row = axle_row(line.axle, line.gear_ratio)
            return (line.driveshaft_inertia + line.box_inertia * line.gear_ratio**2) * np.outer(row, row)
        case ShaftsDriveline4WD():
            front, rear = axle_row(line.axles[0], line.front_gear_ratio), axle_row(line.axles[1], line.rear_gear_ratio)
            row = 0.5 * (front + rear)
            ahead = line.front_shaft_inertia + line.front_box_inertia * line.front_gear_ratio**2
            behind = line.rear_shaft_inertia + line.rear_box_inertia * line.rear_gear_ratio**2
            return np.asarray(
                line.driveshaft_inertia * np.outer(row, row)
                + ahead * np.outer(front, front)
                + behind * np.outer(rear, rear)
            )
    return np.zeros((4, 4))


def lock_rows(line: Driveline | None) -> list[tuple[Array, float, float]]:
    """Clutches of the differentials: slip (4,) per wheels' speeds, torque when open, torque added when closed [N·m]."""

    def across(axle: int) -> Array:
        row = np.zeros(4)
        row[[2 * (axle % 2), 2 * (axle % 2) + 1]] = 1.0, -1.0
        return row

    found: list[tuple[Array, float, float]] = []
    match line:
        case ShaftsDriveline2WD():
            found = [(across(line.axle), line.slip_torque, line.locking_limit if line.lockable else 0.0)]
        case ShaftsDriveline4WD():
            first, last = line.axles
            between = axle_row(first, line.front_gear_ratio) - axle_row(last, line.rear_gear_ratio)
            axle, center = (
                (line.axle_locking_limit, line.central_locking_limit) if line.lockable else (0.0, 0.0)
            )  # fmt: skip
            found = [
                (between, line.central_slip_torque, center), (across(first), line.axle_slip_torque, axle),
                (across(last), line.axle_slip_torque, axle),
            ]  # fmt: skip
    return [entry for entry in found if entry[1] + entry[2] > 0.0]


def reduced_driveline(spec: VehicleSpec) -> DrivelineParts:
    """The driveline as numbers: it has no shafts in the model."""
    locks = tuple(Lock(-1, held, locking) for _, held, locking in lock_rows(spec.driveline))
    match spec.driveline:
        case SimpleDriveline() as line:
            share = line.front_torque_fraction
            axles = (
                (-1, -1, share, line.front_gear_ratio, line.front_max_bias),
                (-1, -1, 1.0 - share, line.rear_gear_ratio, line.rear_max_bias),
            )
            return DrivelineParts(split=tuple(each for each in axles if each[2] > 0.0), wheel_reaction=line.reaction)
        case ShaftsDriveline2WD() | ShaftsDriveline4WD() as line:
            return DrivelineParts(locks=locks, inertia=line.driveshaft_inertia, shaft_reaction=line.reaction)
    return DrivelineParts()


def driven_wheels(spec: VehicleSpec) -> list[list[int]]:
    """Left and right wheel of each driven axle of a simple driveline."""
    line = spec.driveline
    if not isinstance(line, SimpleDriveline):
        return []
    shares = (line.front_torque_fraction, 1.0 - line.front_torque_fraction)
    return [[2 * axle, 2 * axle + 1] for axle, share in zip(line.axles, shares, strict=True) if share > 0.0]
