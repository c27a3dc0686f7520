"""Types that bound the fields of a configuration: `mass: Positive`, `share: Fraction`.

`simwarp.core.schema` holds values to them, from files and in Python, and writes them into JSON Schemas. Bounds are
those of `annotated_types`. Nothing here loads pydantic.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Annotated, Any, Final, TypeAlias

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen

__all__ = [
    "COINCIDENT",
    "Angle",
    "As",
    "Count",
    "Curve",
    "Different",
    "Direction",
    "Fraction",
    "Ge",
    "Gt",
    "Inertia",
    "Infinite",
    "Le",
    "Lt",
    "MaxLen",
    "Meaning",
    "MinLen",
    "NotNegative",
    "OneOrMany",
    "Parsed",
    "Point",
    "Positive",
    "Products",
    "Read",
    "Rule",
    "RuleError",
    "Tagged",
    "Whole",
]  # fmt: skip

COINCIDENT = 1.0e-6
"""Points nearer than this are one, and a direction is longer than this [m]."""


class RuleError(ValueError):
    """A value that breaks the rule of its field; an error says `must be {rule}, got {got}; {remedy}`."""

    def __init__(self, rule: str, remedy: str = "", got: str = "") -> None:
        super().__init__(rule)
        self.rule, self.remedy, self.got = rule, remedy, got


class Rule:
    """A rule beyond bounds: a function that raises `RuleError`, and what a JSON Schema says about it."""

    def __init__(self, hold: Callable[[Any], None], **schema: Any) -> None:
        self._hold, self._schema = hold, schema

    def _held(self, value: Any) -> Any:
        self._hold(value)
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(self._held, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Any:
        return {**handler(schema), **self._schema}


class Parsed:
    """A field whose values a function reads, which raises `RuleError`: arrays, names, poses, tables."""

    def __init__(self, read: Callable[[Any], Any]) -> None:
        self._read = read

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(self._read)


class Meaning:
    """What a field wants, in words with its unit: "a point (x, y, z) [m]". For errors and JSON Schemas."""

    def __init__(self, words: str) -> None:
        self.words = words

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Any:
        return {**handler(schema), "description": self.words}


class Tagged:
    """One of several classes, chosen by a key of the object: a `Literal` field of that name with a default."""

    def __init__(self, key: str) -> None:
        self.key = key

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic import Field

        return handler(Annotated[source, Field(discriminator=self.key)])


class Read:
    """A field whose objects in a file are read as another type, of which a function makes the field's own.

    Args:
        plain: type hint of the object.
        make: what makes the value of it.
        kind: class of values that are taken as they are; None: whatever is no object.
    """

    def __init__(self, plain: Any, make: Callable[[Any], Any] | None = None, kind: type | None = None) -> None:
        self.plain, self.kind, self._make = plain, kind, make

    def _read(self, value: Any, load: Callable[[Any], Any]) -> Any:
        own = not isinstance(value, dict) if self.kind is None else isinstance(value, self.kind)
        if own:
            return value
        return load(value) if self._make is None else self._make(load(value))

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_wrap_validator_function(self._read, handler.generate_schema(self.plain))


class As(Read):
    """A field whose values are all read as another type: `Annotated[Mode | str, As(Mode)]`."""

    def _read(self, value: Any, load: Callable[[Any], Any]) -> Any:
        return load(value)


class OneOrMany:
    """A list of names that may be one name alone."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        listed = core_schema.no_info_before_validator_function
        return listed(lambda value: (value,) if isinstance(value, str) else value, handler(source))


class Infinite:
    """Lets a number be infinite."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return {**handler(source), "allow_inf_nan": True}


class Angle(Rule):
    """An angle of at most this size [rad]: what is beyond are degrees."""

    def __init__(self, largest: float) -> None:
        def hold(value: float) -> None:
            if abs(value) > largest:
                remedy = f"if these are degrees, they are {math.radians(value):.4g} rad"
                raise RuleError(f"within ±{largest:.4g} rad ({math.degrees(largest):.0f}°)", remedy)

        super().__init__(hold, minimum=-largest, maximum=largest)


def _increase(points: Any) -> None:
    rule = "two or more (x, y) pairs with increasing x"
    if len(points) < 2:
        raise RuleError(rule)
    for index, (a, b) in enumerate(itertools.pairwise(points), start=1):
        if b[0] <= a[0]:
            raise RuleError(rule, "sort them by x", f"x = {b[0]:g} in [{index}] after {a[0]:g}")


def _differ(names: Any) -> None:
    if len(set(names)) < len(names):
        raise RuleError("different ones", "name each once")


Different: Final = Rule(_differ, uniqueItems=True)
"""Items of which none is there twice."""


def _have_length(axis: Any) -> None:
    if math.hypot(*axis) < COINCIDENT:
        raise RuleError("a direction")


Positive: TypeAlias = Annotated[float, Gt(0.0)]
"""A number above 0."""
NotNegative: TypeAlias = Annotated[float, Ge(0.0)]
"""A number that is 0 or above."""
Fraction: TypeAlias = Annotated[float, Ge(0.0), Le(1.0)]
"""A number from 0 to 1."""
Count: TypeAlias = Annotated[int, Ge(1)]
"""A whole number that is 1 or above."""
Whole: TypeAlias = Annotated[int, Ge(0)]
"""A whole number that is 0 or above."""
Point: TypeAlias = Annotated[tuple[float, float, float], Meaning("a point (x, y, z) [m]")]
Direction: TypeAlias = Annotated[tuple[float, float, float], Rule(_have_length), Meaning("a direction (x, y, z)")]
Inertia: TypeAlias = Annotated[
    tuple[Positive, Positive, Positive], Meaning("moments of inertia (Ixx, Iyy, Izz) [kg·m²]")
]
Products: TypeAlias = Annotated[tuple[float, float, float], Meaning("products of inertia (Ixy, Ixz, Iyz) [kg·m²]")]
Curve: TypeAlias = Annotated[tuple[tuple[float, float], ...], Rule(_increase, minItems=2)]
"""(x, y) pairs with increasing x of a piecewise linear function."""
