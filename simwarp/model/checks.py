"""Checks of what a ModelBuilder is given: every error names the thing, the rule, the value received and the remedy."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any, TypedDict, TypeVar

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import unit_vector
from simwarp.core.types import (
    FLOAT32_LEAST,
    FLOAT32_MAX,
    WORLD,
    Dof,
    JointType,
    ModelError,
    Pose,
    PositionDrive,
    Vec3,
    finite_vector,
    formatted,
    number,
    numbers,
)
from simwarp.core.wording import suggestion
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.keyword_argument_types import DRIVES, DofOptions
from simwarp.model.rules import Name, PoseField, held_fields
from simwarp.model.specifications import JointSpec

Array = npt.NDArray[np.float64]
Member = TypeVar("Member", bound=IntEnum)

PERPENDICULAR = 1.0e-6
"""Largest cosine between two directions that have to be perpendicular."""


def finite_number(thing: str, field: str, value: Any, remedy: str = "pass a number") -> float:
    """`value` as a float that float32 holds, or a ModelError."""
    given = number(value)
    if not abs(given) <= FLOAT32_MAX:
        raise ModelError(f"{thing}: {field} must be a finite number{_beyond(value)}, got {formatted(value)}; {remedy}")
    return given


def positive_number(thing: str, field: str, value: Any, unit: str, remedy: str) -> float:
    """`value` as a float above zero that stays so in float32, or a ModelError."""
    given = number(value)
    if FLOAT32_LEAST <= given <= FLOAT32_MAX:
        return given
    unit = unit and f" {unit}"
    rule = f"at least 1.2e-38{unit} (float32)" if given > 0.0 and math.isfinite(given) and not _beyond(value) else ""
    rule = rule or f"finite and > 0{unit}{_beyond(value)}"
    raise ModelError(f"{thing}: {field} must be {rule}, got {formatted(value)}; {remedy}")


def _beyond(value: Any) -> str:
    """Addition to a rule where `value` is a number outside the range of float32; otherwise empty."""
    given = number(value)
    beyond = (isinstance(value, int) and math.isinf(given)) or (math.isfinite(given) and abs(given) > FLOAT32_MAX)
    return " and at most 3.4e38" if beyond else ""


def whole_number(thing: str, field: str, value: Any, least: int, most: int, remedy: str) -> int:
    """`value` as an int between `least` and `most`, or a ModelError; truth values are no numbers."""
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or not least <= value <= most:
        rule = f">= {least} and <= {most}" if number(value) > most else f">= {least}"
        raise ModelError(f"{thing}: {field} must be an integer {rule}, got {formatted(value)}; {remedy}")
    return int(value)


def index_within(thing: str, rule: str, given: Any, count: int, remedy: str, *, least: int = 0) -> int:
    """An index from `least` to below `count`.

    Raises:
        ModelError: it is none; it says `{thing}: {rule}, got {given}; {remedy}`.
    """
    if not isinstance(given, (int, np.integer)) or isinstance(given, bool) or not least <= given < count:
        raise ModelError(f"{thing}: {rule}, got {formatted(given)}; {remedy}")
    return int(given)


def checked_index(
    thing: str, rule: str, given: Any, count: int, find: Callable[[str], int], remedy: str, *, least: int = 0
) -> int:
    """`index_within` of something that may be given by its name, which `find` looks up."""
    return find(given) if isinstance(given, str) else index_within(thing, rule, given, count, remedy, least=least)


def checked_instances(thing: str, field: str, given: Any, kind: Any, kinds: str, remedy: str) -> tuple[Any, ...]:
    """A collection of instances of a class, which messages call `kinds`."""
    if isinstance(given, (str, bytes, dict)) or not isinstance(given, Iterable):
        raise ModelError(f"{thing}: {field} must be a list, got {formatted(given)}; write {field}=[...]")
    listed = tuple(given)
    for part in listed:
        if not isinstance(part, kind):
            raise ModelError(f"{thing}: {field} must be {kinds}, got {formatted(part)} among them; {remedy}")
    return listed


def checked_member(thing: str, field: str, value: Any, kind: type[Member]) -> Member:
    """A member of a closed set, from itself or its name in small letters, or a ModelError that lists them."""
    if isinstance(value, kind):
        return value
    known = [member.name.lower() for member in kind]
    if not isinstance(value, str) or value not in known:
        hint = suggestion(value, known, f"write {kind.__name__}.{known[0].upper()}")
        raise ModelError(f"{thing}: {field} must be one of {', '.join(known)}, got {formatted(value)}; {hint}")
    return kind[value.upper()]


def checked_flag(thing: str, field: str, value: Any) -> bool:
    """`value` as a bool, or a ModelError: nothing else is true or false here."""
    if not isinstance(value, (bool, np.bool_)):
        raise ModelError(f"{thing}: {field} must be True or False, got {formatted(value)}; choose one")
    return bool(value)


def checked_names(thing: str, field: str, given: Any, known: Iterable[str]) -> set[str]:
    """The names in a collection, all of them known ones, or a ModelError."""
    if isinstance(given, str):
        raise ModelError(
            f"{thing}: {field} must be a list of names, got {formatted(given)}; write [{formatted(given)}]"
        )
    try:
        names = list(given)
    except TypeError:
        raise ModelError(
            f"{thing}: {field} must be a list of names, got {formatted(given)}; leave it out for none"
        ) from None
    listed = list(known)
    for name in names:
        if not isinstance(name, str) or name not in listed:
            hint = suggestion(name, listed, f"known: {', '.join(listed[:8])}, ...")
            raise ModelError(f"{thing}: {field} names an unknown parameter {formatted(name)}; {hint}")
    return set(names)


class _Named(TypedDict, total=False):
    name: Name


class _Posed(TypedDict, total=False):
    pose: PoseField


def checked_name(kind: str, name: Any) -> str:
    """The thing's name for errors, such as "body 'arm'"; a ModelError where `name` cannot be one."""
    return f"{kind} '{held_fields(kind, _Named, {'name': name})['name']}'"


def checked_pose(thing: str, value: Any) -> Pose:
    """A Pose with a unit quaternion; identity when None."""
    pose: Pose = held_fields(thing, _Posed, {"pose": value})["pose"]
    return pose


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
    checked_flag(thing, "strict", strict)
    matrix = numbers(inertia)
    if matrix.shape == (3,):
        matrix = np.diag(matrix)
    if matrix.shape != (3, 3) or not bool((np.abs(matrix) <= FLOAT32_MAX).all()):
        beyond = " of at most 3.4e38" if matrix.shape == (3, 3) and np.isfinite(matrix).all() else ""
        raise ModelError(
            f"{thing}: inertia must be three diagonal entries or a 3x3 matrix of finite numbers{beyond} [kg·m²], "
            f"got {formatted(inertia)}; pass for example (ixx, iyy, izz)"
        )
    # relative to the largest entry, so that grams and millimetres are judged like tonnes
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-6 * float(np.abs(matrix).max())):
        raise ModelError(f"{thing}: inertia must be symmetric, got {formatted(inertia)}; symmetrise it")
    values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if values[0] <= 0.0:
        raise ModelError(
            f"{thing}: inertia must be positive definite, got principal values {values.tolist()}; "
            "give a thin body a small inertia, not zero"
        )
    if values[0] < FLOAT32_LEAST:
        raise ModelError(
            f"{thing}: inertia must have principal values of at least 1.2e-38 kg·m² (float32), got {values.tolist()}; "
            "give a thin body a larger one"
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
    if options.keys() - DofOptions.__annotations__:
        held_fields(thing, DofOptions, options)
    return checked_dof(thing, Dof(**options))


def checked_dofs(thing: str, kind: str, count: int, dofs: Sequence[Dof]) -> tuple[Dof, ...]:
    """`count` checked degrees of freedom; none given means passive ones."""
    if not isinstance(dofs, Sequence):
        raise ModelError(f"{thing}: dofs must be a sequence of Dof, got {formatted(dofs)}; write dofs=[Dof(...), ...]")
    if len(dofs) not in (0, count):
        raise ModelError(
            f"{thing}: dofs must have {count} entries for a {kind} joint, got {len(dofs)}; "
            "write Dof() for a coordinate without anything on it"
        )
    if kind == JointType.FREE.name:
        for dof in dofs:
            _check_floating(thing, dof)
    if kind == JointType.ELASTIC.name:
        for dof in dofs:
            _check_elastic(thing, dof)
    return tuple(checked_dof(thing, dof) for dof in dofs) or (Dof(),) * count


def _check_elastic(thing: str, dof: Dof) -> None:
    """What acts on strains is linear."""
    for field, value in vars(checked_dof(thing, dof)).items():
        if field not in ("stiffness", "damping", "rest", "preload") and value != getattr(Dof(), field):
            raise ModelError(
                f"{thing}: an ELASTIC joint has stiffness, damping, rest and preload, got {field}={formatted(value)}; "
                "put it on a joint at an end"
            )


def _check_floating(thing: str, dof: Dof) -> None:
    """Laws of a floating body are rows beside the tree, which bounded impulses and motions do not know."""
    dof = checked_dof(thing, dof)
    drive = dof.drive
    unbounded = drive is None or (isinstance(drive, PositionDrive) and np.isinf(numbers(drive.effort_limit)).all())
    found = {"limit": dof.limit is not None, "friction": dof.friction > 0.0, "drive": not unbounded}
    for field, there in found.items():
        if there:
            raise ModelError(
                f"{thing}: a FREE joint has springs, dampers and PositionDrives without effort limit, "
                f"got {field}={formatted(getattr(dof, field))}; tie the body by another joint"
            )


def checked_dof(thing: str, dof: Dof) -> Dof:
    """The Dof itself, or a ModelError for the first field that cannot be used."""
    if not isinstance(dof, Dof):
        raise ModelError(f"{thing}: a degree of freedom must be a Dof, got {formatted(dof)}; write Dof(stiffness=...)")
    held_fields(thing, DofOptions, vars(dof))
    if dof.drive is not None:
        held_fields(thing, DRIVES[type(dof.drive)], vars(dof.drive), "drive.")
    return dof


def check_floats(thing: str, child: int, name: str, joints: Sequence[JointSpec]) -> None:
    """A FREE joint only makes sense on a floating tree, and once: its coordinates would contradict others.

    Raises:
        ModelError: the body `child`, called `name`, is tied to the world by one of the joints.
    """
    tied = {child}
    fresh = True
    while fresh:
        fresh = False
        for spec in joints:
            ends = {spec.parent, spec.child}
            in_tree = ELEMENTS[spec.type].tree and spec.type != JointType.SHAFT and not spec.closes_loop
            if not in_tree or not (ends & tied):
                continue
            if WORLD in ends:
                how = "floats under" if spec.type == JointType.FREE else "is tied to the world by"
                raise ModelError(
                    f"{thing}: body '{name}' must float and have no other FREE joint, but it {how} joint "
                    f"'{spec.name}'; leave this one out"
                )
            fresh = fresh or not ends <= tied
            tied |= ends
