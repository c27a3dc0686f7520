"""Definition of the joint types as data: degrees of freedom and rows of each.

This table is the single place that defines an element. The host orders it into tables (dynamics/topology.py),
the kernels evaluate the row kinds (kernels/dynamics/bilateral_rows.py), and conventions.md prints it for users.
"""

from __future__ import annotations

import dataclasses
from typing import Final

from simwarp.core.types import JointType, RowKind

X, Y, Z = 0, 1, 2


@dataclasses.dataclass(frozen=True)
class Row:
    """One scalar row: kind, axis of frame 0, axis of frame 1."""

    kind: RowKind
    axis0: int = 0
    axis1: int = 0


def _points(*axes: int) -> tuple[Row, ...]:
    return tuple(Row(RowKind.POINT_AXIS0, axis) for axis in axes)


def _dots(*pairs: tuple[int, int]) -> tuple[Row, ...]:
    return tuple(Row(RowKind.DOT, a, b) for a, b in pairs)


def _angles(*axes: int) -> tuple[Row, ...]:
    return tuple(Row(RowKind.ANGLE0, axis) for axis in axes)


ALIGNED: Final = _dots((X, Y), (Y, Z), (Z, X))
PARALLEL_Z: Final = _dots((X, Z), (Y, Z))


@dataclasses.dataclass(frozen=True)
class Element:
    """`dofs` in the order of `joint_q`; `rows` are the bilateral rows of the element when it closes a loop."""

    dofs: tuple[Row, ...]
    rows: tuple[Row, ...]
    tree: bool


ELEMENTS: Final[dict[JointType, Element]] = {
    JointType.FREE: Element(_points(X, Y, Z) + _angles(X, Y, Z), (), True),
    JointType.FIXED: Element((), _points(X, Y, Z) + ALIGNED, True),
    JointType.REVOLUTE: Element(_angles(Z), _points(X, Y, Z) + PARALLEL_Z, True),
    JointType.PRISMATIC: Element(_points(Z), _points(X, Y) + ALIGNED, True),
    JointType.SPHERICAL: Element(_angles(X, Y, Z), _points(X, Y, Z), True),
    JointType.CYLINDRICAL: Element(_points(Z) + _angles(Z), _points(X, Y) + PARALLEL_Z, True),
    JointType.UNIVERSAL: Element(
        (Row(RowKind.ANGLE0, X), Row(RowKind.ANGLE1, 0, Y)), _points(X, Y, Z) + _dots((X, Y)), True
    ),
    JointType.PLANAR: Element(_points(X, Y) + _angles(Z), _points(Z) + PARALLEL_Z, True),
    JointType.SHAFT: Element((Row(RowKind.SHAFT),), (), True),
    JointType.ELASTIC: Element(_points(X, Y, Z) + _angles(X, Y, Z), (), True),
    JointType.POINT_ON_PLANE: Element((), _points(Z), False),
    JointType.POINT_ON_LINE: Element((), _points(X, Y), False),
    JointType.PARALLEL: Element((), PARALLEL_Z, False),
    JointType.PERPENDICULAR: Element((), _dots((Z, Z)), False),
    JointType.OLDHAM: Element((), _points(Z) + ALIGNED, False),
    JointType.ROD: Element((), (Row(RowKind.DISTANCE),), False),
    JointType.DISTANCE: Element((Row(RowKind.DISTANCE),), (), False),
    JointType.REVOLUTE_SPHERICAL: Element((), (Row(RowKind.DISTANCE), *_points(Z)), False),
    JointType.REVOLUTE_TRANSLATIONAL: Element(
        (), (*_dots((Z, X), (Z, Y)), *_points(Z), Row(RowKind.POINT_AXIS1, 0, X)), False
    ),
    JointType.RELATIVE_ROTATION: Element((Row(RowKind.ANGLE1, 0, Z),), (), False),
    JointType.BUSHING: Element(_points(X, Y, Z) + _angles(X, Y, Z), (), False),
    JointType.COMBINATION: Element((Row(RowKind.SUM),), (), False),
}
"""Sources: lock masks of the usual joint catalogue (Haug 1989, chapter 9); massless links as distance rows."""

ROTATION_START: Final[dict[JointType, int]] = {JointType.SPHERICAL: 0, JointType.BUSHING: 3, JointType.FREE: 3}
"""Joints of which three coordinates are a rotation vector, and the first of these: springs act on the rotation as a
whole (kernels/dynamics/efforts.py)."""
