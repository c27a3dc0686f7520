"""The schema of what a builder is given, and the field types of specifications: names, poses, vectors, tables, efforts.

`RULES` holds values to them; every error names the thing, the rule, the value received and the remedy.
"""

from __future__ import annotations

import enum
import functools
import math
import unicodedata
from collections.abc import Sequence
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Ge, Le, Meaning, NotNegative, Parsed, Positive, RuleError
from simwarp.core.object_repr import ReadableFields
from simwarp.core.schema import Fault, Schema, dotted
from simwarp.core.types import (
    FLOAT32_LEAST,
    FLOAT32_MAX,
    DamperMap,
    EffortLimit,
    ModelError,
    Pose,
    Table,
    Vec3,
    number,
    numbers,
    pose as make_pose,
)
from simwarp.core.wording import suggestion

Array: TypeAlias = npt.NDArray[np.float64]


def _fault_text(fault: Fault, kind: type) -> str:
    """A fault of a configuration in Python: names the class and the field."""
    return fault.what if fault.kind == "check" else f"{kind.__name__}: {dotted(fault.keys)} {fault.what}"


RULES: Final = Schema(ModelError, least=FLOAT32_LEAST, describe=_fault_text)
"""Holds arguments, specifications and configurations to their annotations."""


class Configuration(ReadableFields):
    """Base of configurations: frozen dataclasses whose fields are held to their types."""

    def __post_init__(self) -> None:
        RULES.hold(self)
        self.check()

    def check(self) -> None:
        """Rules between the fields."""


LONGEST_NAME: Final = 255
"""Bytes of the longest name in UTF-8: of a body, a joint, a shape, a sensor."""

INFINITE: Final = 1.0e30
"""Stands for "no limit" in float32 parameters."""

ALL_GROUPS: Final = 0x7FFFFFFF
"""Bits of all groups of shapes."""


def held_fields(thing: str, kind: Any, values: Any, inside: str = "") -> dict[str, Any]:
    """Values by name as `kind` declares them, or a ModelError that begins with `thing`; see `Schema.fields`.

    Args:
        thing: such as "body 'arm'".
        kind: a dataclass or a `TypedDict`.
        values: by name.
        inside: what comes before the name of a field: "material.".
    """

    def line(fault: Fault) -> str:
        if fault.kind == "unknown":
            return f"{thing}: unknown option '{dotted(fault.keys)}'{fault.what.removeprefix('unknown key')}"
        return f"{thing}: {inside}{dotted(fault.keys)} {fault.what}"

    return RULES.fields(kind, values, line)


# ---- names, poses, vectors -------------------------------------------------------------------------------------------


def _name(value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise RuleError("a non-empty string", "give it one")
    if any(unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp") for letter in value):
        raise RuleError("one line of printable text", "leave such letters out")
    if len(value.encode("utf-8")) > LONGEST_NAME:
        raise RuleError(f"at most {LONGEST_NAME} bytes long", "shorten it")
    return value


def _pose(value: Any) -> Pose:
    if value is None:
        return make_pose()
    if not isinstance(value, Pose):
        raise RuleError("a Pose", "write simwarp.pose(position, rotation)")
    try:
        return make_pose(value.position, value.rotation)
    except ModelError as error:
        raise RuleError("a Pose of finite numbers", str(error)) from None


def _finite(length: int, value: Any) -> Array:
    array = numbers(value)
    if array.shape == (length,) and bool((np.abs(array) <= FLOAT32_MAX).all()):
        return array
    beyond = " of at most 3.4e38" if np.isfinite(array).all() else ""
    raise RuleError(f"{length} finite numbers{beyond}", "pass a sequence")


def vector(length: int) -> Parsed:
    """A field of so many finite numbers, read as an array of float64."""
    return Parsed(functools.partial(_finite, length))


Name: TypeAlias = Annotated[str, Parsed(_name)]
"""A line of printable text."""
PoseField: TypeAlias = Annotated[Pose | None, Parsed(_pose)]
"""A Pose with a unit quaternion; identity when None."""
Vector3: TypeAlias = Annotated[Vec3, vector(3)]
"""Three finite numbers, read as an array of float64."""


# ---- bounds, tables, efforts -----------------------------------------------------------------------------------------


def pair_of(value: Any) -> tuple[float, float]:
    """Two numbers, or two NaN where there are others."""
    pair = numbers(value)
    return (float(pair[0]), float(pair[1])) if pair.shape == (2,) else (math.nan, math.nan)


def _range(value: Any) -> Any:
    lower, upper = pair_of(value)
    if not lower < upper:  # also where one is NaN
        raise RuleError("(lower, upper) with lower < upper", "use float('inf') for an open side, None for no bounds")
    if lower >= INFINITE or upper <= -INFINITE:
        raise RuleError("(lower, upper) with a bound nearer than 1e30", "use None for none")
    return value


def _arrays(table: Any, count: int) -> list[Array]:
    """The arrays of a table; none where it has another number of them."""
    some = isinstance(table, Sequence) or (isinstance(table, np.ndarray) and table.ndim > 0)
    return [numbers(part) for part in table] if some and len(table) == count else []


def _table(value: Any) -> Any:
    parts = _arrays(value, 2)
    usable = [part.ndim for part in parts] == [1, 1] and parts[0].shape == parts[1].shape and len(parts[0]) >= 2
    usable = usable and all(bool((np.abs(part) <= FLOAT32_MAX).all()) for part in parts)
    if not (usable and bool((np.diff(parts[0]) > 0.0).all())):
        raise RuleError(
            "two equally long sequences of finite numbers with increasing abscissae",
            "write ((x0, x1, ...), (y0, y1, ...)) with at least two points",
        )
    return value


def _map(value: Any) -> Any:
    parts = _arrays(value, 3)
    if [part.ndim for part in parts] != [1, 1, 2]:
        raise RuleError("(coordinates, rates, forces[rate][coordinate])", "give three of them")
    places, rates, forces = parts
    if forces.shape != (len(rates), len(places)):
        rule = f"with {len(rates)} rows of {len(places)} forces"
        raise RuleError(rule, "one row for every rate", f"rows of shape {forces.shape}")
    for row in forces:
        _table((places, row))
    _table((rates, forces[:, 0] if len(places) else rates))
    return value


def _effort(bounded: bool, value: Any) -> Any:
    pair = numbers(value)
    remedy = "use PrescribedSpeed for a motor without one" if bounded else "use float('inf') for none"
    if pair.shape != (2,):
        if not FLOAT32_LEAST <= number(value) <= (FLOAT32_MAX if bounded else math.inf):
            raise RuleError("positive and finite" if bounded else "positive", remedy)
        return value
    lower, upper = pair.tolist()
    if not lower <= 0.0 <= upper or not upper - lower >= FLOAT32_LEAST:
        rule = "(lower, upper) with lower <= 0 <= upper and lower < upper"
        raise RuleError(rule, "use float('inf') for a side without a limit")
    if bounded and np.isinf(pair).all():
        raise RuleError("finite on one side", remedy)
    return value


def word_of(*known: str) -> Parsed:
    """A field that holds one of these words."""

    def read(value: Any) -> str:
        value = value.value if isinstance(value, enum.Enum) else value
        if not isinstance(value, str) or value not in known:
            raise RuleError(f"one of {', '.join(known)}", suggestion(value, known, "choose one"))
        return value

    return Parsed(read)


def name_in(kind: type[enum.Enum]) -> Parsed:
    """A field that holds the name of a member of a closed set, in small letters."""
    return word_of(*(member.name.lower() for member in kind))


def _points(fewest: int, value: Any) -> Array:
    points = numbers(value)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < fewest or not np.isfinite(points).all():
        raise RuleError(f"{fewest} or more (x, y) of finite numbers", "pass x and y of each", f"shape {points.shape}")
    return points


def _lengths(value: Any) -> Array:
    extent = _finite(3, value)
    if not (extent >= FLOAT32_LEAST).all():
        raise RuleError("three positive numbers", "pass lengths along x, y and z [m]")
    return extent


def _flag(value: Any) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise RuleError("True or False", "choose one")
    return bool(value)


def instance_of(kind: type, remedy: str) -> Parsed:
    """A field that holds an object of a class."""

    def read(value: Any) -> Any:
        if not isinstance(value, kind):
            raise RuleError(f"{'an' if kind.__name__[0] in 'AEIO' else 'a'} {kind.__name__}", remedy)
        return value

    return Parsed(read)


def one_of(*kinds: type) -> Parsed:
    """A field that holds an object of one of these classes, or None."""

    def read(value: Any) -> Any:
        if not isinstance(value, kinds):
            names = ", ".join(kind.__name__ for kind in kinds)
            raise RuleError(f"None or a {names}", f"construct a {kinds[0].__name__}(...)")
        return value

    return Parsed(read)


Flag: TypeAlias = Annotated[bool, Parsed(_flag)]
Range: TypeAlias = Annotated[tuple[float, float], Parsed(_range)]
"""(lower, upper), infinite for an open side."""
TableField: TypeAlias = Annotated[Table, Parsed(_table)]
Passive: TypeAlias = Annotated[NotNegative, Meaning("0 for none")]
Signed: TypeAlias = Annotated[float, Meaning("0 for none")]
MapField: TypeAlias = Annotated[DamperMap, Parsed(_map)]
DriveLimit: TypeAlias = Annotated[EffortLimit, Parsed(functools.partial(_effort, False))]
"""Of a drive that needs none."""
MotorLimit: TypeAlias = Annotated[EffortLimit, Parsed(functools.partial(_effort, True))]
GroupBits: TypeAlias = Annotated[int, Ge(0), Le(ALL_GROUPS), Meaning("31 bits; 1 is the default group")]
Margin: TypeAlias = Annotated[NotNegative, Meaning("metres; make the shape smaller for less")]
Metres: TypeAlias = Annotated[Positive, Meaning("metres")]
Lengths: TypeAlias = Annotated[Vec3, Parsed(_lengths)]
"""Three positive numbers, read as an array."""
POINTS: Final = Parsed(functools.partial(_points, 2))
"""Two or more (x, y), read as an array."""
POLYGON: Final = Parsed(functools.partial(_points, 3))
"""Three or more (x, y), read as an array."""
