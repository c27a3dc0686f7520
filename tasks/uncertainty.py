"""Uncertainty that a configuration may add: model parameters, sensing, delays, and the level of difficulty.

These are fields of a :class:`~simwarp.tasks.TaskConfig`; a task sets them in its own configuration, or a program with
``make("ant", randomise={"body_mass": Range(0.8, 1.2)})``.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeVar

from simwarp.core.types import FLOAT32_MAX, number, shown

from .errors import InputError, near_names

ItemT = TypeVar("ItemT")

LATEST: Final = 2**63
"""An iteration that no training reaches."""
LONGEST_DELAY: Final = 2**31 - 1
"""Control steps of the longest delay: draws of whole numbers have 31 bits."""


class Mode(enum.Enum):
    """Effect of a drawn number on the built value of a parameter."""

    SCALE = "scale"
    ADD = "add"
    SET = "set"


class When(enum.Enum):
    """Interval at which a parameter is drawn."""

    EPISODE = "episode"
    STEP = "step"


def _refuse(kind: str, rule: str, value: object) -> InputError:
    return InputError(f"{kind} must be {rule}, got {shown(value)}")


def _finite(kind: str, rule: str, value: object, least: float = -FLOAT32_MAX, most: float = FLOAT32_MAX) -> float:
    """Return a number within bounds that float32 holds."""
    if not least <= number(value) <= most:
        raise _refuse(kind, rule, value)
    return number(value)


def _flag(kind: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise _refuse(kind, "true or false", value)
    return value


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
        inertia: of ``body_mass``, where it is scaled: the inertia is scaled by the same factor, as that of a denser
            body. Not where ``body_inertia_b`` has a range of its own, nor with ``inertia=False``: then the mass alone
            changes, as if it sat in the centre of mass.
    """

    low: float
    high: float
    mode: Mode | str = Mode.SCALE
    when: When | str = When.EPISODE
    only: tuple[str, ...] | str = ()
    shared: bool = False
    draw: str = ""
    grows: bool = False
    inertia: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "mode", _member("mode of a Range", Mode, self.mode))
        object.__setattr__(self, "when", _member("when of a Range", When, self.when))
        only = (self.only,) if isinstance(self.only, str) else self.only
        if not isinstance(only, list | tuple) or not all(isinstance(name, str) and name for name in only):
            raise _refuse("only of a Range", "names of bodies, joints or shapes", self.only)
        object.__setattr__(self, "only", tuple(only))
        if not isinstance(self.draw, str) or not self.draw.isprintable():
            raise _refuse("draw of a Range", "a word", self.draw)
        for field in ("shared", "grows", "inertia"):
            _flag(f"{field} of a Range", getattr(self, field))
        for field in ("low", "high"):
            object.__setattr__(self, field, _finite("bounds of a Range", "finite, low <= high", getattr(self, field)))
        if self.low > self.high:
            raise _refuse("bounds of a Range", "finite, low <= high", (self.low, self.high))
        if self.mode is Mode.SCALE and self.low < 0.0:
            raise _refuse("factor of a Range", "zero or positive", self.low)


@dataclasses.dataclass(frozen=True)
class Sensing:
    """Noise, bias and delay of one observation group.

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
            listed = isinstance(value, list | tuple)
            kind, rule = f"{field} of a Sensing", "zero or positive"
            items = tuple(_finite(kind, rule, item, 0.0) for item in (value if listed else (value,)))
            object.__setattr__(self, field, items if listed else items[0])
        object.__setattr__(self, "delay", delay_range("delay of a Sensing", self.delay))


class Driver(enum.Enum):
    """Schedule of the curriculum's level."""

    NONE = "none"
    ITERATION = "iteration"
    PROGRESS = "progress"


@dataclasses.dataclass(frozen=True)
class Curriculum:
    """Level of difficulty between 0 and 1 during training; every world has its own (``Task.level``).

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
        whole = all(isinstance(item, int) and not isinstance(item, bool) for item in (self.first, self.last))
        if not whole or not 0 <= self.first < self.last < LATEST:
            raise _refuse("iterations of a Curriculum", "whole numbers, 0 <= first < last", (self.first, self.last))
        for field in ("up", "down"):
            object.__setattr__(
                self, field, _finite("steps of a Curriculum", "in [0, 1]", getattr(self, field), 0.0, 1.0)
            )

    def at_iteration(self, iteration: int) -> float:
        """Return the level of a training iteration."""
        return min(1.0, max(0.0, (iteration - self.first) / (self.last - self.first)))


def _member(what: str, kind: type[enum.Enum], value: Any) -> enum.Enum:
    """Return the member that a value or a member names."""
    try:
        return kind(value)
    except (TypeError, ValueError):
        raise _refuse(what, f"one of {', '.join(str(item.value) for item in kind)}", value) from None


def delay_range(what: str, value: Any) -> tuple[int, int]:
    """Return a checked (least, largest) delay [control steps]."""
    bounds = tuple(value) if isinstance(value, list | tuple) else (value,)
    whole = all(isinstance(item, int) and not isinstance(item, bool) for item in bounds)
    if len(bounds) != 2 or not whole or not 0 <= bounds[0] <= bounds[1]:
        raise _refuse(what, "two whole numbers, 0 <= least <= largest", value)
    if bounds[1] > LONGEST_DELAY:
        raise _refuse(what, f"below {LONGEST_DELAY + 1} control steps", value)
    return (bounds[0], bounds[1])


def _from_fields(kind: Callable[..., ItemT], fields: Mapping[str, Any]) -> ItemT:
    """Return ``kind(**fields)``; a name that it does not have is an error that lists those it has."""
    known = [field.name for field in dataclasses.fields(kind)]  # type: ignore[arg-type]
    for name in fields:
        if name not in known:
            raise InputError(f"has no field {shown(name)}{near_names(str(name), known)}; fields: {', '.join(known)}")
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
        if not isinstance(name, str):
            raise _refuse(f"a name in {field}", "a string", name)
        try:
            made[name] = _from_fields(kind, value) if isinstance(value, Mapping) else value
        except InputError as error:
            raise InputError(f"{field} {shown(name)}: {error}") from None
        if not isinstance(kind, type) or not isinstance(made[name], kind):
            raise InputError(f"{field} {shown(name)} must be a {getattr(kind, '__name__', kind)}, got {shown(value)}")
    return made
