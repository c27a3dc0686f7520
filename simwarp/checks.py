"""Checks of what a ModelBuilder is given: every error names the thing, the rule, the value received and the remedy."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.rotation import unit_vector
from simwarp.types import (
    Dof,
    ModelError,
    Pose,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    Vec3,
    VelocityMotor,
    finite_vector,
    shown,
)
from simwarp.types import (
    pose as make_pose,
)

Array = npt.NDArray[np.float64]

PERPENDICULAR = 1.0e-6
"""Largest cosine between two directions that have to be perpendicular."""


def finite_number(thing: str, field: str, value: Any, remedy: str = "pass a number") -> float:
    """`value` as a finite float, or a ModelError."""
    number = _number(value)
    if not math.isfinite(number):
        raise ModelError(f"{thing}: {field} must be a finite number, got {shown(value)}; {remedy}")
    return number


def positive_number(thing: str, field: str, value: Any, unit: str, remedy: str) -> float:
    """`value` as a finite float above zero, or a ModelError."""
    number = _number(value)
    if not (math.isfinite(number) and number > 0.0):
        raise ModelError(f"{thing}: {field} must be finite and > 0{unit and f' {unit}'}, got {shown(value)}; {remedy}")
    return number


def _number(value: Any) -> float:
    """`value` as a float; NaN where it is no number."""
    try:
        return float("nan") if isinstance(value, (str, bytes)) else float(value)
    except (TypeError, ValueError):
        return float("nan")


def checked_pose(thing: str, value: Any) -> Pose:
    """A Pose with a unit quaternion; identity when None."""
    if value is None:
        return make_pose()
    if not isinstance(value, Pose):
        raise ModelError(f"{thing}: pose must be a Pose, got {shown(value)}; write simwarp.pose(position, rotation)")
    return make_pose(value.position, value.rotation)


def distance_between(thing: str, anchor0: Vec3, anchor1: Vec3) -> float:
    """Distance of two anchors that must be apart [m]."""
    p0, p1 = finite_vector(thing, "anchor0", anchor0, 3), finite_vector(thing, "anchor1", anchor1, 3)
    distance = float(np.linalg.norm(p1 - p0))
    if distance < 1e-9:
        raise ModelError(f"{thing}: anchor0 and anchor1 must be apart, got {distance} m between them; move one")
    return distance


def check_link_across_axis(thing: str, anchor0: Vec3, anchor1: Vec3, axis: Vec3) -> None:
    """A massless hinged link lies in the plane through `anchor0` across its axis.

    Raises:
        ModelError: anchor1 is off that plane by more than 1e-6 of the distance.
    """
    p0, p1 = finite_vector(thing, "anchor0", anchor0, 3), finite_vector(thing, "anchor1", anchor1, 3)
    along = float((p1 - p0) @ unit_vector(thing, "axis", axis))
    if abs(along) > PERPENDICULAR * max(float(np.linalg.norm(p1 - p0)), 1e-9):
        raise ModelError(
            f"{thing}: anchor1 - anchor0 must be perpendicular to axis, got {along:.3g} m along it; "
            "move anchor0 along the axis by that much"
        )


def check_perpendicular(thing: str, name0: str, vector0: Vec3, name1: str, vector1: Vec3) -> None:
    """Two directions at a right angle, to 1e-6, or a ModelError."""
    cosine = float(unit_vector(thing, name0, vector0) @ unit_vector(thing, name1, vector1))
    if abs(cosine) > PERPENDICULAR:
        raise ModelError(
            f"{thing}: {name0} and {name1} must be perpendicular, got a cosine of {cosine:.3g}; "
            f"take the component of {name1} along {name0} out"
        )


def checked_inertia(thing: str, inertia: Any, strict: bool = True) -> Array:
    """A 3x3 inertia, symmetrised; one that some body can have unless not `strict`."""
    try:
        matrix = np.asarray(inertia, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape == (3,):
        matrix = np.diag(matrix)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ModelError(
            f"{thing}: inertia must be three diagonal entries or a 3x3 matrix of finite numbers [kg·m²], "
            f"got {inertia!r}; pass for example (ixx, iyy, izz)"
        )
    # relative to the largest entry, so that grams and millimetres are judged like tonnes
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-6 * float(np.abs(matrix).max())):
        raise ModelError(f"{thing}: inertia must be symmetric, got {inertia!r}; symmetrise it")
    values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if values[0] <= 0.0:
        raise ModelError(
            f"{thing}: inertia must be positive definite, got principal values {values.tolist()}; "
            "give a thin body a small inertia, not zero"
        )
    # 1 % of slack: published tables are rounded
    if strict and values[2] > (values[0] + values[1]) * 1.01:
        raise ModelError(
            f"{thing}: principal inertias must obey a + b >= c, got {values.tolist()}; check units and axes, "
            "or pass strict=False for published data"
        )
    return 0.5 * (matrix + matrix.T)


def dof_from_options(thing: str, options: Mapping[str, Any]) -> Dof:
    """A checked Dof from keyword arguments; an unknown one is answered with the nearest name."""
    known = [field.name for field in dataclasses.fields(Dof)]
    for key in options:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(known)}"
            raise ModelError(f"{thing}: unknown option '{key}'; {hint}")
    return checked_dof(thing, Dof(**options))


def checked_dofs(thing: str, kind: str, count: int, dofs: Sequence[Dof]) -> tuple[Dof, ...]:
    """`count` checked degrees of freedom; none given means passive ones."""
    if not isinstance(dofs, Sequence):
        raise ModelError(f"{thing}: dofs must be a sequence of Dof, got {dofs!r}; write dofs=[Dof(...), ...]")
    if len(dofs) not in (0, count):
        raise ModelError(
            f"{thing}: dofs must have {count} entries for a {kind} joint, got {len(dofs)}; "
            "write Dof() for a coordinate without anything on it"
        )
    return tuple(checked_dof(thing, dof) for dof in dofs) or (Dof(),) * count


def checked_dof(thing: str, dof: Dof) -> Dof:
    """The Dof itself, or a ModelError for the first field that cannot be used."""
    if not isinstance(dof, Dof):
        raise ModelError(f"{thing}: a degree of freedom must be a Dof, got {dof!r}; write Dof(stiffness=...)")
    for field in ("armature", "stiffness", "damping", "friction"):
        value = getattr(dof, field)
        if not (math.isfinite(_number(value)) and _number(value) >= 0.0):
            raise ModelError(f"{thing}: {field} must be finite and >= 0, got {value!r}; use 0 for none")
    for field in ("preload", "rest"):
        finite_number(thing, field, getattr(dof, field), "use 0 for none")
    _check_limit(thing, dof.limit)
    for field in ("spring_table", "damper_table"):
        _check_table(f"{thing}: {field}", getattr(dof, field))
    if dof.damper_map is not None:
        _check_map(f"{thing}: damper_map", dof.damper_map)
    _check_drive(thing, dof.drive)
    return dof


def _check_limit(thing: str, limit: Any) -> None:
    if limit is None:
        return
    pair = tuple(limit) if isinstance(limit, (Sequence, np.ndarray)) and not isinstance(limit, str) else ()
    lower, upper = [_number(value) for value in pair] if len(pair) == 2 else (math.nan, math.nan)
    if not lower < upper:  # also where one is NaN
        raise ModelError(
            f"{thing}: limit must be (lower, upper) with lower < upper, got {limit!r}; "
            "use float('inf') for a side without a stop, None for no limit"
        )


def _check_map(thing: str, table: Any) -> None:
    try:
        places, rates, forces = (np.asarray(part, float) for part in table)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{thing} must be (coordinates, rates, forces[rate][coordinate]), got {table!r}") from error
    for row in forces:
        _check_table(thing, (places.tolist(), row.tolist()))
    if forces.shape != (len(rates), len(places)):
        raise ModelError(
            f"{thing}: forces must have {len(rates)} rows of {len(places)} numbers, got {forces.shape}; "
            "one row for every rate"
        )
    _check_table(thing, (rates.tolist(), forces[:, 0].tolist()))


def _check_drive(thing: str, drive: Any) -> None:
    match drive:
        case None:
            return
        case PositionDrive():
            for field in ("stiffness", "damping"):
                value = getattr(drive, field)
                if not (math.isfinite(_number(value)) and _number(value) >= 0.0):
                    raise ModelError(f"{thing}: drive {field} must be finite and >= 0, got {value!r}; use 0 for none")
            if not _number(drive.effort_limit) > 0.0:
                raise ModelError(
                    f"{thing}: drive effort_limit must be > 0, got {drive.effort_limit!r}; use float('inf') for none"
                )
        case VelocityMotor():
            positive_number(
                thing,
                "drive effort_limit",
                drive.effort_limit,
                "N or N·m",
                "use PrescribedSpeed for a motor without one",
            )
        case PrescribedPosition() | PrescribedSpeed():
            _check_table(f"{thing}: drive table", drive.table)
        case _:
            raise ModelError(
                f"{thing}: drive must be None or a PositionDrive, VelocityMotor, PrescribedPosition or "
                f"PrescribedSpeed, got {drive!r}; construct one of them"
            )


def _check_table(thing: str, table: Any) -> None:
    if table is None:
        return
    rule = "must be two equally long sequences of finite numbers with increasing abscissae"
    remedy = "write ((x0, x1, ...), (y0, y1, ...)) with at least two points"
    try:
        x, y = (np.asarray(values, np.float64) for values in table)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{thing} {rule}, got {table!r}; {remedy}") from error
    usable = x.ndim == 1 and x.shape == y.shape and len(x) >= 2
    if not (usable and np.isfinite(x).all() and np.isfinite(y).all() and (np.diff(x) > 0.0).all()):
        raise ModelError(f"{thing} {rule}, got {table!r}; {remedy}")
