"""What a search for a design wants: a figure as great or small as can be, and bounds of others."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from simwarp.core.types import formatted
from simwarp.study.distributions import NUMBER
from simwarp.study.study_error import StudyError
from simwarp.study.study_figures import MARGIN

PASS_SPEED: Final = "pass_speed"
"""The highest speed that is passed, between those that were driven by where the rule that breaks first is reached."""


@dataclasses.dataclass(frozen=True)
class Goal:
    """A figure that is to be as great as can be, or as small.

    Attributes:
        key: of the figure, or `PASS_SPEED`.
        maximise: whether large values are good.
    """

    key: str
    maximise: bool

    def better(self, one: float, other: float) -> bool:
        """Whether one value is better than another."""
        return one > other if self.maximise else one < other


@dataclasses.dataclass(frozen=True)
class Bound:
    """A bound of a figure.

    Attributes:
        key: of the figure.
        limit: of it.
        at_most: whether it is the largest value; False: the smallest.
    """

    key: str
    limit: float
    at_most: bool

    def distance(self, value: float) -> float:
        """By how much it is kept, negative where it is broken, in shares of the limit where that is not 0; NaN of a
        value that is missing.
        """
        size = abs(self.limit) or 1.0
        return (self.limit - value if self.at_most else value - self.limit) / size

    @property
    def text(self) -> str:
        """As it is written."""
        return f"{self.key}{'<=' if self.at_most else '>='}{self.limit:g}"


def parse_bound(text: str) -> Bound:
    """A bound from `FIGURE<=X` or `FIGURE>=X`.

    Raises:
        StudyError: it is neither.
    """
    found = re.fullmatch(rf"\s*(\w+)\s*(<=|>=)\s*({NUMBER})\s*", text)
    if found is None or found[3].endswith("%"):
        raise StudyError(f'--subject-to: must be "FIGURE<=X" or "FIGURE>=X", got {formatted(text)}')
    return Bound(found[1], float(found[3]), found[2] == "<=")


@dataclasses.dataclass(frozen=True)
class PassSpeed:
    """How fast a design passes.

    Attributes:
        highest: of the speeds that were driven, below which none failed [m/s]; NaN if there is none.
        between: where the rule that breaks first is reached on the way to the next speed [m/s]; below the first speed
            where that is not passed, by up to a step.
        decisive: index of the run at the highest speed passed, or of the first one.
    """

    highest: float
    between: float
    decisive: int


def pass_speed(
    speeds: Sequence[float], figures: Sequence[Mapping[str, float]], passed: Sequence[bool], bounds: Sequence[Bound]
) -> PassSpeed:
    """The highest speed at which rules and bounds are kept.

    Args:
        speeds: that were driven, rising [m/s].
        figures: of each run; a run that broke down has none.
        passed: whether each run kept its rules.
        bounds: that count as rules.
    """
    kept = [
        [_or(run.get(MARGIN, math.nan)), *(_or(each.distance(run.get(each.key, math.nan))) for each in bounds)]
        for run in figures
    ]
    good = [fine and min(each) >= 0.0 for fine, each in zip(passed, kept, strict=True)]
    first = next((index for index, fine in enumerate(good) if not fine), len(good))
    if first == len(good):
        return PassSpeed(speeds[-1], speeds[-1], len(good) - 1)
    if first == 0:
        step = speeds[1] - speeds[0] if len(speeds) > 1 else 1.0
        return PassSpeed(math.nan, speeds[0] - step * min(1.0, -min(kept[0])), 0)
    share = min(
        (before / (before - after) for before, after in zip(kept[first - 1], kept[first], strict=True) if after < 0.0),
        default=0.0,
    )
    low, high = speeds[first - 1], speeds[first]
    return PassSpeed(low, low + share * (high - low), first - 1)


def _or(value: float) -> float:
    """A distance; of what is missing it is minus infinity."""
    return -math.inf if math.isnan(value) else value
