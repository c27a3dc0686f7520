"""Uncertainty that a configuration may add: model parameters, sensing, delays, and the level of difficulty.

These are fields of a :class:`~simwarp.tasks.TaskConfig`; a task sets them in its own configuration, or a program with
``make("ant", randomise={"body_mass": Range(0.8, 1.2)})``.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, TypeAlias

from simwarp.core.constraints import As, Fraction, Ge, Le, MinLen, NotNegative, OneOrMany, Rule, RuleError, Whole
from simwarp.core.types import formatted

from ..framework.config_values import Settings
from ..framework.errors import InputError

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


def _in_order(delay: tuple[int, int]) -> None:
    if delay[0] > delay[1]:
        raise RuleError("two whole numbers, 0 <= least <= largest")


def _printable(word: str) -> None:
    if not word.isprintable():
        raise RuleError("a word")


Name: TypeAlias = Annotated[str, MinLen(1)]
Names: TypeAlias = Annotated[tuple[Name, ...], OneOrMany()]
Steps: TypeAlias = Annotated[int, Ge(0), Le(LONGEST_DELAY)]
Delay: TypeAlias = Annotated[tuple[Steps, Steps], Rule(_in_order)]
"""Least and largest delay [control steps]."""


@dataclasses.dataclass(frozen=True)
class Range(Settings):
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

    NAMED: ClassVar[bool] = True
    low: float
    high: float
    mode: Annotated[Mode | str, As(Mode)] = Mode.SCALE
    when: Annotated[When | str, As(When)] = When.EPISODE
    only: Annotated[tuple[Name, ...] | str, As(Names)] = ()
    shared: bool = False
    draw: Annotated[str, Rule(_printable)] = ""
    grows: bool = False
    inertia: bool = True

    def validate(self) -> None:
        """Check that the bounds are in order.

        Raises:
            InputError: ``low`` is above ``high``, or a factor is negative.
        """
        if self.low > self.high:
            raise InputError(f"bounds of a Range must be in order, low <= high, got {formatted((self.low, self.high))}")
        if self.mode is Mode.SCALE and self.low < 0.0:
            raise InputError(f"factor of a Range must be zero or positive, got {formatted(self.low)}")


@dataclasses.dataclass(frozen=True)
class Sensing(Settings):
    """Noise, bias and delay of one observation group.

    Attributes:
        noise: standard deviation of normal noise in every step, of all components or of each.
        bias: standard deviation of an offset that stays for an episode, of all components or of each.
        delay: least and largest delay [control steps], drawn for every world and episode.
    """

    NAMED: ClassVar[bool] = True
    noise: NotNegative | tuple[NotNegative, ...] = 0.0
    bias: NotNegative | tuple[NotNegative, ...] = 0.0
    delay: Delay = (0, 0)


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """What a task draws, as its configuration has it in the end.

    Attributes:
        randomise: model parameter -> range.
        sensing: observation group -> noise, bias and delay.
        action_delay: least and largest delay of the actions [control steps].
    """

    randomise: Mapping[str, Range]
    sensing: Mapping[str, Sensing]
    action_delay: Delay


class Driver(enum.Enum):
    """Schedule of the curriculum's level."""

    NONE = "none"
    ITERATION = "iteration"
    PROGRESS = "progress"


@dataclasses.dataclass(frozen=True)
class Curriculum(Settings):
    """Level of difficulty between 0 and 1 during training; every world has its own (``Task.level``).

    Attributes:
        driver: ``none`` leaves it at 1. ``iteration`` raises it from 0 to 1 over training iterations. ``progress``
            starts at 0; in each world a success raises it by ``up``, a failure lowers it by ``down``.
        first: iteration at which it leaves 0.
        last: iteration at which it reaches 1.
        up: rise after a success.
        down: fall after a failure.
    """

    NAMED: ClassVar[bool] = True
    driver: Driver = Driver.NONE
    first: Whole = 0
    last: Whole = 100
    up: Fraction = 0.05
    down: Fraction = 0.025

    def validate(self) -> None:
        """Check that the level rises.

        Raises:
            InputError: ``first`` is not below ``last``.
        """
        if not self.first < self.last:
            rule = "whole numbers, 0 <= first < last"
            raise InputError(f"iterations of a Curriculum must be {rule}, got {formatted((self.first, self.last))}")

    def at_iteration(self, iteration: int) -> float:
        """Return the level of a training iteration, 0 to 1."""
        return min(1.0, max(0.0, (iteration - self.first) / (self.last - self.first)))
