"""Closed sets, the value types of the builder, and the one error type of model construction."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from enum import IntEnum, IntFlag
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

WORLD: Final = -1
"""The index of the fixed world, wherever a body index is asked for."""

Vec3: TypeAlias = Sequence[float] | npt.NDArray[np.floating]
Quat: TypeAlias = Sequence[float] | npt.NDArray[np.floating]


class ModelError(ValueError):
    """A model that cannot be built: names the thing, the rule, the value received and the remedy."""


class JointType(IntEnum):
    """Every element between two frames. Axes are those of DESIGN: a joint's own axis is z of its frames.

    The first group can be eliminated in articulated form; the second only adds rows between two bodies.
    """

    FREE = 0
    FIXED = 1
    REVOLUTE = 2
    PRISMATIC = 3
    SPHERICAL = 4
    CYLINDRICAL = 5
    UNIVERSAL = 6
    PLANAR = 7
    SHAFT = 8
    # row-only elements
    POINT_ON_PLANE = 16
    POINT_ON_LINE = 17
    PARALLEL = 18
    PERPENDICULAR = 19
    OLDHAM = 20
    ROD = 21
    LINE = 22
    REVOLUTE_SPHERICAL = 23
    REVOLUTE_TRANSLATIONAL = 24
    BUSHING = 25


class RowKind(IntEnum):
    """Geometry of one scalar row between frame 0 and frame 1 of an element (kernels/rows.py)."""

    POINT_AXIS0 = 0
    """(A1 - A0) . e_i of frame 0, both bodies taken at A1."""
    POINT_AXIS1 = 1
    """(A1 - A0) . e_i of frame 1, both bodies taken at A0."""
    DOT = 2
    """e_i of frame 0 . e_j of frame 1."""
    DISTANCE = 3
    """|A1 - A0|."""
    ANGLE0 = 4
    """Rotation about e_i of frame 0."""
    ANGLE1 = 5
    """Rotation about e_i of frame 1."""
    SHAFT = 6
    """The coordinate of a one-degree-of-freedom shaft; no body moves."""


class DriveMode(IntEnum):
    """What acts on a degree of freedom besides its spring, damper, friction and `joint_force`."""

    NONE = 0
    POSITION = 1
    """Implicit PD: effort = stiffness (target_q - q) + damping (target_qd - qd), bounded by the effort limit."""
    VELOCITY = 2
    """Keeps target_qd with whatever effort it takes, up to the effort limit."""
    PRESCRIBED_POSITION = 3
    """q follows a table or `joint_target_q`, whatever the effort."""
    PRESCRIBED_SPEED = 4
    """qd follows a table or `joint_target_qd`, whatever the effort."""


class BoundedKind(IntEnum):
    """Rows with a bounded impulse: solved by accelerated gradient on the joint-eliminated system."""

    LIMIT = 0
    FRICTION = 1
    MOTOR = 2
    DRIVE = 3


class WorldStatus(IntFlag):
    """Bits of `State.world_status`."""

    OK = 0
    NON_FINITE = 1
    """A value of this world became NaN or infinite: the world is frozen until it is reset."""
    NOT_ASSEMBLED = 2
    """The closed loops could not be assembled for the coordinates that were set."""


class Pose(NamedTuple):
    """Position [m] and orientation (xyzw quaternion), both float64: kilometres keep their micrometres."""

    position: npt.NDArray[np.float64]
    rotation: npt.NDArray[np.float64]


def pose(position: Vec3 = (0.0, 0.0, 0.0), rotation: Quat = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    """Pose from a position [m] and an xyzw quaternion (normalised here).

    Raises:
        ModelError: the quaternion has zero length or a component is not finite.
    """
    p = finite_vector("pose", "position", position, 3)
    q = finite_vector("pose", "rotation", rotation, 4)
    norm = float(np.linalg.norm(q))
    if norm < 1e-12:
        raise ModelError("pose: rotation must be a quaternion of non-zero length (xyzw), got zeros; use (0, 0, 0, 1)")
    return Pose(p, q / norm)


def finite_vector(thing: str, field: str, value: Vec3 | Quat, length: int) -> npt.NDArray[np.float64]:
    """`value` as float64 of the given length, or a ModelError that names it."""
    try:
        array = np.asarray(value, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{thing}: {field} must be {length} numbers, got {value!r}; pass a sequence") from error
    if array.shape != (length,) or not np.isfinite(array).all():
        raise ModelError(f"{thing}: {field} must be {length} finite numbers, got {value!r}; pass a sequence")
    return array


Table: TypeAlias = tuple[Sequence[float], Sequence[float]]
"""Abscissae (increasing) and values of a piecewise linear function, extrapolated with its end slopes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PositionDrive:
    """PD drive, integrated implicitly [N/m or N·m/rad, N·s/m or N·m·s/rad, N or N·m]."""

    stiffness: float
    damping: float = 0.0
    effort_limit: float = float("inf")


@dataclasses.dataclass(frozen=True, kw_only=True)
class VelocityMotor:
    """Holds `joint_target_qd` with at most `effort_limit` [N or N·m]."""

    effort_limit: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class PrescribedPosition:
    """q(t): a table over time [s], or `joint_target_q` (and `joint_target_qd` as its rate) when None."""

    table: Table | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class PrescribedSpeed:
    """qd(t): a table over time [s], or `joint_target_qd` when None."""

    table: Table | None = None


Drive: TypeAlias = PositionDrive | VelocityMotor | PrescribedPosition | PrescribedSpeed


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dof:
    """What acts along one degree of freedom. Units are N and m, or N·m and rad, as the coordinate is.

    The passive effort is preload - stiffness (q - rest) - damping qd, taken implicitly; a table replaces
    the linear law: -spring_table(q - rest), -damper_table(qd), linearised every step.
    """

    limit: tuple[float, float] | None = None
    armature: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    preload: float = 0.0
    friction: float = 0.0
    spring_table: Table | None = None
    damper_table: Table | None = None
    drive: Drive | None = None
