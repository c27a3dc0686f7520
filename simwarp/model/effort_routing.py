"""Ways in which an effort along a coordinate reaches the bodies: this is the one place that decides between them.

- TREE: coordinates of joints of the tree; along the joint's own degree of freedom (`load_tree_dofs`).
- DISTANCE: springs between the two bodies of a tree joint of one degree of freedom; along that one, times a lever
  (`load_distances`).
- ROW: joints that close loops, and combinations, with a stiff or inertial effort, or a motion; a compliant row
  (`loop_joint_rows`, `combination_laws`). Also balls of the tree whose springs differ from axis to axis
  (`rotation_rows`), and floating bodies with an effort.
- TERMS: combinations without an effort; `joint_force` alone, on the coordinates of their terms (`load_combinations`).
- BODY_FORCE: all others, free bodies and loop joints without an effort; `joint_force` alone, on the bodies.

Beside its path, what has bounds (limits, dry friction, motors, drives with an effort limit) is a box constraint each.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from simwarp.core.types import (
    BoxKind,
    Dof,
    DriveMode,
    JointType,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    VelocityMotor,
)
from simwarp.model.joint_types import ROTATION_START

PASSIVE = tuple(
    each.name for each in dataclasses.fields(Dof) if each.default == 0.0 and each.name not in ("rest", "friction")
)
"""Numbers of a `Dof` of which each is an effort; a rest length alone is none, and friction is a box constraint."""


class EffortRoute(enum.Enum):
    """See the module."""

    TREE = enum.auto()
    DISTANCE = enum.auto()
    ROW = enum.auto()
    TERMS = enum.auto()
    BODY_FORCE = enum.auto()


def effort_route(kind: JointType, dof: Dof, *, in_tree: bool, along_tree_dof: bool) -> EffortRoute:
    """The path of a coordinate's effort.

    Args:
        kind: of its joint.
        dof: the coordinate.
        in_tree: whether the joint is one of the spanning tree.
        along_tree_dof: whether a tree joint of one degree of freedom ties the joint's bodies.
    """
    if in_tree:
        if kind is not JointType.FREE:
            return EffortRoute.TREE
        return EffortRoute.ROW if has_effort(dof) else EffortRoute.BODY_FORCE
    if not has_effort(dof):
        return EffortRoute.TERMS if kind is JointType.COMBINATION else EffortRoute.BODY_FORCE
    if kind is JointType.DISTANCE and along_tree_dof and not is_prescribed(dof):
        return EffortRoute.DISTANCE
    return EffortRoute.ROW


def joint_routes(kind: JointType, dofs: Sequence[Dof], *, in_tree: bool, along_tree_dof: bool) -> list[EffortRoute]:
    """The paths of all coordinates of a joint, as `effort_route` of each. A rotation vector is one thing: an effort on
    one of its coordinates makes rows of all three. A ball of the tree needs none, unless its springs differ from axis
    to axis: then their stiffness is a matrix, which changes with the rotation.
    """
    routes = [effort_route(kind, dof, in_tree=in_tree, along_tree_dof=along_tree_dof) for dof in dofs]
    start = ROTATION_START.get(kind)
    if start is None:
        return routes
    turning = dofs[start : start + 3]
    if in_tree and kind is JointType.SPHERICAL:
        if is_isotropic(turning):
            return routes
        return [EffortRoute.TREE if is_prescribed(dof) else EffortRoute.ROW for dof in turning]
    if any(has_effort(dof) for dof in turning):
        return [*routes[:start], *[EffortRoute.ROW] * 3]
    return routes


def is_isotropic(dofs: Sequence[Dof]) -> bool:
    """Whether springs, and drives without an effort limit, are as stiff about each axis of a rotation that is free to
    turn: then their stiffness is a number.
    """
    stiffness = set()
    for dof in dofs:
        if not is_prescribed(dof):
            driven = isinstance(dof.drive, PositionDrive) and not has_bounded_drive(dof)
            stiffness.add((dof.stiffness, getattr(dof.drive, "stiffness", 0.0) if driven else 0.0))
            if dof.spring_table is not None:
                return False
    return len(stiffness) <= 1


def box_constraint_kinds(dof: Dof) -> list[BoxKind]:
    """The box constraints of a coordinate."""
    drive = dof.drive
    there = {
        BoxKind.LIMIT: dof.limit is not None,
        BoxKind.FRICTION: dof.friction > 0.0,
        BoxKind.MOTOR: isinstance(drive, VelocityMotor),
        BoxKind.DRIVE: has_bounded_drive(dof),
    }
    return [kind for kind, is_there in there.items() if is_there]


def effort_bounds(drive: PositionDrive | VelocityMotor) -> tuple[float, float]:
    """Least and largest effort of a drive [N or N·m], infinite where it has no limit."""
    limit = np.asarray(drive.effort_limit, np.float64)
    lower, upper = limit.tolist() if limit.ndim else (-float(limit), float(limit))
    return lower, upper


def has_bounded_drive(dof: Dof) -> bool:
    """True if the coordinate has a PositionDrive whose effort is limited, at least on one side."""
    return isinstance(dof.drive, PositionDrive) and any(map(math.isfinite, effort_bounds(dof.drive)))


MODES: Final = {
    type(None): DriveMode.NONE, PositionDrive: DriveMode.POSITION, VelocityMotor: DriveMode.VELOCITY,
    PrescribedPosition: DriveMode.PRESCRIBED_POSITION, PrescribedSpeed: DriveMode.PRESCRIBED_SPEED,
}  # fmt: skip


def drive_mode(dof: Dof) -> DriveMode:
    """The DriveMode of a degree of freedom's drive."""
    return MODES[type(dof.drive)]


def is_prescribed(dof: Dof) -> bool:
    """True if the coordinate's motion is given."""
    return drive_mode(dof) >= DriveMode.PRESCRIBED_POSITION


def has_effort(dof: Dof) -> bool:
    """True if the coordinate of a loop joint needs a row of its own: a stiff or inertial effort, or a motion."""
    driven = drive_mode(dof) is DriveMode.POSITION or is_prescribed(dof)
    tables = (dof.spring_table, dof.damper_table, dof.damper_map)
    return any(getattr(dof, name) for name in PASSIVE) or any(table is not None for table in tables) or driven


def damped_by_table(dof: Dof) -> bool:
    """True if a table or a map replaces the coordinate's linear damper."""
    return dof.damper_table is not None or dof.damper_map is not None


@dataclasses.dataclass(frozen=True)
class EffortModel:
    """Parts of a coordinate's effort that are fixed when the model is made: path, kind of drive, is there a spring."""

    path: EffortRoute
    mode: DriveMode
    stiff: bool

    @classmethod
    def of(cls, dof: Dof, path: EffortRoute) -> EffortModel:
        """That of a degree of freedom."""
        return cls(path, drive_mode(dof), dof.stiffness > 0.0 or dof.spring_table is not None)

    @property
    def is_computed(self) -> bool:
        """True if a step computes the effort, unless the motion is given."""
        alone = self.path in (EffortRoute.BODY_FORCE, EffortRoute.TERMS)
        return not alone and self.mode < DriveMode.PRESCRIBED_POSITION
