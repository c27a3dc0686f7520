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
    """A shape's material, margin [m], and the groups that it belongs to and meets (31 bits)."""

    material: Material | None
    margin: float
    group: int
    mask: int


class ShapeOptions(SurfaceOptions, total=False):
    """Name of a shape, and the pose of its frame on the body or in the world."""

    name: str
    pose: Pose | None
