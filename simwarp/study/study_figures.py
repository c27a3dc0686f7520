"""Figures of a run that a study is about: its results, and by how much it kept its rules."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Final

from simwarp.vehicle.assessment.maneuver_variants import Outcome
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.results.run_result import Result

MARGIN: Final = "margin"
"""Key of the figure that tells by how much all rules were kept; below 0: broken."""


@dataclasses.dataclass(frozen=True)
class Figure:
    """A number that every run has.

    Attributes:
        key: of it.
        label: in words.
        unit: of it.
    """

    key: str
    label: str
    unit: str


def margin(found: Sequence[Verdict], on_course: bool) -> float:
    """The least distance of all rules to their limits, negative where one is broken; NaN where a value is missing.

    Of a course of lanes in metres, the exit counting only where it was not reached; else in shares of the limits.
    """
    distances = []
    for verdict in found:
        if math.isnan(verdict.value):
            return math.nan
        size = abs(verdict.value - verdict.limit)
        if not on_course and verdict.limit != 0.0:
            size /= abs(verdict.limit)
        is_exit = on_course and verdict.limit != 0.0
        if not verdict.passed:
            distances.append(-size)
        elif not is_exit:
            distances.append(size)
    return min(distances, default=math.nan)


def figures_of(outcome: Outcome) -> dict[str, Result]:
    """All figures of a run by key; without rules there is no margin."""
    found = {item.key: item for item in outcome.results}
    if outcome.verdicts:
        on_course = outcome.maneuver.course is not None
        value = math.nan if outcome.broken else margin(outcome.verdicts, on_course)
        unit = "m" if on_course else ""
        found = {MARGIN: Result(MARGIN, "margin to the rules", value, unit)} | found
    return found
