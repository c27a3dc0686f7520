"""The one loader: types with constraints hold values from files and in Python, and mistakes are one line."""

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import pytest

from simwarp.core.constraints import Angle, Count, Curve, Fraction, Ge, Infinite, Le, MinLen, Positive, Tagged
from simwarp.core.schema import Schema


class OwnError(ValueError):
    pass


class Colour(enum.Enum):
    RED = "red"
    BLUE = "blue"


OWN = Schema(OwnError, largest=1e6, least=1e-6, unit={"mass": "kg"}.get)  # type: ignore[arg-type]


class Held:
    def __post_init__(self) -> None:
        OWN.hold(self)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Square(Held):
    kind: Literal["square"] = "square"
    side: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class Circle(Held):
    kind: Literal["circle"] = "circle"
    radius: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class Thing(Held):
    mass: Positive = 1.0
    share: Fraction = 0.5
    count: Count = 1
    few: Annotated[int, Ge(0), Le(9)] = 0
    tilt: Annotated[float, Angle(0.25 * math.pi)] = 0.0
    limit: Annotated[float, Infinite()] = math.inf
    curve: Curve | None = None
    shape: Annotated[Square | Circle, Tagged("kind")] | None = None
    sizes: Positive | Annotated[tuple[Positive, ...], MinLen(1)] = 1.0
    colour: Colour = Colour.RED
    named: Mapping[str, Square] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Heavy(Thing):
    mass: float = 100.0


MISTAKES: list[tuple[Any, str]] = [
    ({"mass": 0}, "mass: must be positive, got 0"),
    ({"mass": 1e-9}, "mass: must be at least 1e-06 (float32), got 1e-09"),
    ({"mass": True}, "mass: must be a number [kg], got True"),
    ({"mass": "1"}, "mass: must be a number [kg], got '1'"),
    ({"mass": math.nan}, "mass: must be a finite number, got nan"),
    ({"mass": 1e9}, "mass: must be below 1e+06, got 1000000000.0"),
    ({"mass": 10**400}, "mass: must be a number [kg], got a number of 401 digits"),
    ({"share": 2}, "share: must be in [0, 1], got 2"),
    ({"count": 1.0}, "count: must be a whole number, got 1.0"),
    ({"few": 10}, "few: must be from 0 to 9, got 10"),
    ({"tilt": 3.0}, "tilt: must be within ±0.7854 rad (45°), got 3.0; if these are degrees, they are 0.05236 rad"),
    (
        {"curve": [[0, 0], [0, 1]]},
        "curve: must be two or more (x, y) pairs with increasing x, got x = 0 in [1] after 0",
    ),
    ({"curve": [[0, 0], [1]]}, "curve[1]: must be a list of 2 items, got [1]"),
    ({"shape": {"side": 1}}, "shape.kind: missing; give one of square, circle"),
    ({"shape": {"kind": "sqare"}}, "shape.kind: must be one of square, circle, got 'sqare' (did you mean 'square'?)"),
    ({"shape": {"kind": "square", "sid": 1}}, "shape.sid: unknown key (did you mean 'side'?); known: kind, side"),
    ({"shape": {"kind": "square", "side": -1}}, "shape.side: must be positive, got -1"),
    ({"shape": 3}, "shape: must be an object with a kind, got 3; kinds: square, circle"),
    ({"sizes": [1, -1]}, "sizes: must be positive, got [1, -1]"),
    ({"sizes": "x"}, "sizes: must be a number or a list, got 'x'"),
    ({"colour": "green"}, "colour: must be one of red, blue, got 'green'"),
    ({"named": {"a": {"side": "x"}}}, "named.a.side: must be a number, got 'x'"),
    ({"named": {1: {"side": 1}}}, "named."),
    ([], "must be an object with the keys of Thing, got []"),
]


@pytest.mark.parametrize(("value", "message"), MISTAKES, ids=[message[:50] for _, message in MISTAKES])
def test_mistakes_name_the_key_the_rule_and_the_value(value, message):
    with pytest.raises(OwnError) as caught:
        OWN.load(Thing, value)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_the_same_rules_hold_in_python():
    for value, _ in MISTAKES[:11]:
        with pytest.raises(OwnError, match=next(iter(value))):
            Thing(**value)


def test_values_become_those_of_their_types():
    thing = OWN.load(Thing, {"mass": 2, "sizes": [1, 2], "colour": "blue", "shape": {"kind": "circle", "radius": 1}})
    assert thing == Thing(mass=2.0, sizes=(1.0, 2.0), colour=Colour.BLUE, shape=Circle(radius=1.0))
    assert type(thing.mass) is float
    made = Thing(mass=np.float32(0.5), sizes=np.array([1.0, 2.0]), count=np.int64(3))  # type: ignore[arg-type]
    assert (made.mass, made.sizes, made.count) == (0.5, (1.0, 2.0), 3)
    assert Thing().limit == math.inf


def test_a_field_declared_again_keeps_its_constraints():
    assert Heavy().mass == 100.0
    with pytest.raises(OwnError, match="mass: must be positive, got -1"):
        Heavy(mass=-1.0)
    with pytest.raises(OwnError, match="mass: must be positive, got -1"):
        OWN.load(Heavy, {"mass": -1})


def test_a_schema_has_bounds_docstrings_and_choices():
    schema = OWN.json_schema(Thing, title="Things")
    fields = schema["$defs"]["Thing"]["properties"]
    assert schema["title"] == "Things"
    assert fields["mass"]["exclusiveMinimum"] == 0.0
    assert (fields["tilt"]["minimum"], fields["tilt"]["maximum"]) == (-0.25 * math.pi, 0.25 * math.pi)
    assert fields["shape"]["anyOf"][0]["discriminator"]["propertyName"] == "kind"
