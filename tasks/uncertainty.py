"""What a configuration may make uncertain: model parameters, sensing, delays, and how hard all of it is.

These are fields of a :class:`~simwarp.tasks.TaskConfig`; a task sets them in its own configuration, or a program with
``make("ant", randomise={"body_mass": Range(0.8, 1.2)})``.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from .errors import InputError, near_names

ItemT = TypeVar("ItemT")


class Mode(enum.Enum):
    """How a drawn number acts on the built value of a parameter."""

    SCALE = "scale"
    ADD = "add"
    SET = "set"


class When(enum.Enum):
    """How often a parameter is drawn."""

    EPISODE = "episode"
    STEP = "step"


def _refuse(kind: str, rule: str, value: object) -> InputError:
    return InputError(f"{kind} must be {rule}, got {value!r}")


@dataclasses.dataclass(frozen=True)
class Range:
    """Uniform range of a model parameter, drawn for every world.

    Attributes:
        low, high: bounds of the draw: a factor for ``scale``, else in the parameter's own unit.
        mode: ``scale`` and ``add`` act on the value as built, ``set`` replaces it.
        when: a new draw in every episode, or in every control step.
        only: names of the bodies, joints or shapes concerned; all when empty.
        shared: one number for all of them, instead of one for each.
        draw: ranges with the same word use the same random numbers: a body whose mass and inertia grow together.
        grows: at level 0 of the curriculum there is no randomisation, at level 1 the whole range.
    """

    low: float
    high: float
    mode: Mode | str = Mode.SCALE
    when: When | str = When.EPISODE
    only: tuple[str, ...] | str = ()
    shared: bool = False
    draw: str = ""
    grows: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "mode", _member("mode of a Range", Mode, self.mode))
        object.__setattr__(self, "when", _member("when of a Range", When, self.when))
        object.__setattr__(self, "only", (self.only,) if isinstance(self.only, str) else tuple(self.only))
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            raise _refuse("bounds of a Range", "finite, low <= high", (self.low, self.high))
        if self.mode is Mode.SCALE and self.low < 0.0:
            raise _refuse("factor of a Range", "zero or positive", self.low)


@dataclasses.dataclass(frozen=True)
class Sensing:
    """What lies between the state and one observation group.

    Attributes:
        noise: standard deviation of normal noise in every step, of all components or of each.
        bias: standard deviation of an offset that stays for an episode, of all components or of each.
        delay: least and largest delay [control steps], drawn for every world and episode.
    """

    noise: float | tuple[float, ...] = 0.0
    bias: float | tuple[float, ...] = 0.0
    delay: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        for field in ("noise", "bias"):
            value = getattr(self, field)
            if isinstance(value, list | tuple):
                object.__setattr__(self, field, tuple(float(item) for item in value))
            items = getattr(self, field) if isinstance(value, list | tuple) else (value,)
            if not all(math.isfinite(item) and item >= 0.0 for item in items):
                raise _refuse(f"{field} of a Sensing", "zero or positive", value)
        object.__setattr__(self, "delay", delay_range("delay of a Sensing", self.delay))


class Driver(enum.Enum):
    """What moves the curriculum's level."""

    NONE = "none"
    ITERATION = "iteration"
    PROGRESS = "progress"


@dataclasses.dataclass(frozen=True)
class Curriculum:
    """How a level between 0 and 1 moves during training; every world has its own (``Task.level``).

    Attributes:
        driver: ``none`` leaves it at 1. ``iteration`` raises it from 0 to 1 over training iterations. ``progress``
            starts at 0; in each world a success raises it by ``up``, a failure lowers it by ``down``.
        first: iteration at which it leaves 0.
        last: iteration at which it reaches 1.
        up: rise after a success.
        down: fall after a failure.
    """

    driver: Driver = Driver.NONE
    first: int = 0
    last: int = 100
    up: float = 0.05
    down: float = 0.025

    def __post_init__(self) -> None:
        object.__setattr__(self, "driver", _member("driver of a Curriculum", Driver, self.driver))
        if not 0 <= self.first < self.last:
            raise _refuse("iterations of a Curriculum", "0 <= first < last", (self.first, self.last))
        if not (0.0 <= self.up <= 1.0 and 0.0 <= self.down <= 1.0):
            raise _refuse("steps of a Curriculum", "in [0, 1]", (self.up, self.down))

    def at_iteration(self, iteration: int) -> float:
        """Return the level of a training iteration."""
        return min(1.0, max(0.0, (iteration - self.first) / (self.last - self.first)))


def _member(what: str, kind: type[enum.Enum], value: Any) -> enum.Enum:
    """Return the member that a value or a member names."""
    try:
        return kind(value)
    except ValueError:
        raise _refuse(what, f"one of {', '.join(str(item.value) for item in kind)}", value) from None


def delay_range(what: str, value: Any) -> tuple[int, int]:
    """Return a checked (least, largest) delay [control steps]."""
    bounds = tuple(value) if isinstance(value, list | tuple) else (value,)
    if len(bounds) != 2 or not all(isinstance(item, int) for item in bounds) or not 0 <= bounds[0] <= bounds[1]:
        raise _refuse(what, "two whole numbers, 0 <= least <= largest", value)
    return (bounds[0], bounds[1])


def _from_fields(kind: Callable[..., ItemT], fields: Mapping[str, Any]) -> ItemT:
    """Return ``kind(**fields)``; a name that it does not have is an error that lists those it has."""
    known = [field.name for field in dataclasses.fields(kind)]  # type: ignore[arg-type]
    for name in fields:
        if name not in known:
            raise InputError(f"has no field '{name}'{near_names(name, known)}; fields: {', '.join(known)}")
    try:
        return kind(**fields)
    except TypeError as error:
        raise InputError(f"{error}; fields: {', '.join(known)}") from None


def coerce(field: str, kind: Callable[..., ItemT], values: Any) -> dict[str, ItemT]:
    """Return a dictionary of ``kind`` from one that may hold plain dictionaries, as a run folder keeps them."""
    if not isinstance(values, Mapping):
        raise _refuse(field, "a dictionary", values)
    made = {}
    for name, value in values.items():
        try:
            made[name] = _from_fields(kind, value) if isinstance(value, Mapping) else value
        except InputError as error:
            raise InputError(f"{field} '{name}': {error}") from None
        if not isinstance(kind, type) or not isinstance(made[name], kind):
            raise InputError(f"{field} '{name}' must be a {getattr(kind, '__name__', kind)}, got {value!r}")
    return made
