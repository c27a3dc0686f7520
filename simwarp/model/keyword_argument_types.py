"""Keyword options that several methods of a builder share: types for editors, constraints for the schema."""

from __future__ import annotations

from typing import Annotated, Any, Final, TypedDict

from simwarp.core.types import (
    Drive,
    Material,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    VelocityMotor,
)
from simwarp.model.rules import (
    DriveLimit,
    GroupBits,
    MapField,
    Margin,
    MotorLimit,
    Name,
    Passive,
    PoseField,
    Range,
    Signed,
    TableField,
    one_of,
)


class DofOptions(TypedDict, total=False):
    """Fields of `Dof`, with its defaults."""

    limit: Range | None
    armature: Passive
    stiffness: Passive
    rest: Signed
    damping: Passive
    preload: Signed
    friction: Passive
    spring_table: TableField | None
    damper_table: TableField | None
    damper_map: MapField | None
    drive: Annotated[Drive, one_of(PositionDrive, VelocityMotor, PrescribedPosition, PrescribedSpeed)] | None


class PositionDriveFields(TypedDict, total=False):
    """Fields of `PositionDrive`."""

    stiffness: Passive
    damping: Passive
    effort_limit: DriveLimit


class VelocityMotorFields(TypedDict, total=False):
    """Fields of `VelocityMotor`."""

    effort_limit: MotorLimit


class MotionFields(TypedDict, total=False):
    """Fields of `PrescribedPosition` and `PrescribedSpeed`."""

    table: TableField | None


DRIVES: Final[dict[type, Any]] = {
    PositionDrive: PositionDriveFields,
    VelocityMotor: VelocityMotorFields,
    PrescribedPosition: MotionFields,
    PrescribedSpeed: MotionFields,
}


class SurfaceOptions(TypedDict, total=False):
    """Keyword options of a collision shape, but for its name and pose.

    Attributes:
        material: of the surface; `Material()` when None.
        margin: thickness that is added to the surface on all sides [m]; 0 by default.
        group: groups that the shape belongs to, as bits of a whole number below 2^31; 1 by default.
        mask: groups that it meets, in the same bits; all by default.
    """

    material: Annotated[Material, one_of(Material)] | None
    margin: Margin
    group: GroupBits
    mask: GroupBits


class ShapeOptions(SurfaceOptions, total=False):
    """Keyword options of every `add_shape_...`.

    Attributes:
        name: of its own among the shapes; by default the kind and a number, "box3".
        pose: position [m] and orientation of the shape's frame: relative to the body's centre of mass, in the body's
            axes; in world axes on WORLD. Without it they coincide.
        material: of the surface; `Material()` when None.
        margin: thickness that is added to the surface on all sides [m]; 0 by default.
        group: groups that the shape belongs to, as bits of a whole number below 2^31; 1 by default.
        mask: groups that it meets, in the same bits; all by default.
    """

    name: Name
    pose: PoseField
