"""Keyword options that several methods of a builder share, as type checkers and editors know them."""

from __future__ import annotations

from typing import TypedDict

from simwarp.core.types import DamperMap, Drive, Material, Pose, Table


class DofOptions(TypedDict, total=False):
    """Fields of `Dof`, with its defaults."""

    limit: tuple[float, float] | None
    armature: float
    stiffness: float
    rest: float
    damping: float
    preload: float
    friction: float
    spring_table: Table | None
    damper_table: Table | None
    damper_map: DamperMap | None
    drive: Drive | None


class SurfaceOptions(TypedDict, total=False):
    """Keyword options of a collision shape, but for its name and pose.

    Attributes:
        material: of the surface; `Material()` when None.
        margin: thickness that is added to the surface on all sides [m]; 0 by default.
        group: groups that the shape belongs to, as bits of a whole number below 2^31; 1 by default.
        mask: groups that it meets, in the same bits; all by default.
    """

    material: Material | None
    margin: float
    group: int
    mask: int


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

    name: str
    pose: Pose | None
