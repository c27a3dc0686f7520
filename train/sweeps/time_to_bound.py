"""Time to a bound: seconds of training until columns of ``progress.csv`` have reached what is asked of them."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import formatted
from simwarp.tasks import InputError

from ..runs.progress_table import check_column, series

WINDOW: Final = 5
"""Iterations of which the mean of a column must reach its bound: one lucky iteration does not."""
NEVER: Final = 1.0e9
"""Time of runs that did not reach their bounds [s], longer with their distance: they come after all that did."""
FARTHEST: Final = 1.0e3
"""Distance of a run in which a column never had a value."""
_BOUND = re.compile(r"\s*([\w./-]+?)\s*(>=|<=)\s*(\S+)\s*")


@dataclasses.dataclass(frozen=True)
class Bound:
    """What a column has to reach.

    Attributes:
        column: of ``progress.csv``, or `success`.
        value: the bound.
        at_least: True: from below; False: from above.
    """

    column: str
    value: float
    at_least: bool

    @property
    def text(self) -> str:
        """As options have it."""
        return f"{self.column}{'>=' if self.at_least else '<='}{self.value:g}"

    def distances(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return how far (n,) values are off, in shares of the bound, of a bound of 0 in the column's unit; 0 where
        they reach it.
        """
        off = self.value - values if self.at_least else values - self.value
        shares = np.maximum(off, 0.0) / (abs(self.value) or 1.0)
        return np.minimum(np.where(np.isnan(shares), FARTHEST, shares), FARTHEST)


def parse_bound(text: str) -> Bound:
    """Return the bound that a text such as ``success>=0.9`` names.

    Raises:
        InputError: it names none, or the column is of no task.
    """
    found = _BOUND.fullmatch(text)
    try:
        value = math.nan if found is None else float(found[3])
    except ValueError:
        value = math.nan
    if found is None or not math.isfinite(value):
        raise InputError(f"--until must be COLUMN>=NUMBER or COLUMN<=NUMBER, as success>=0.9, got {formatted(text)}")
    check_column(found[1], "--until")
    return Bound(found[1], value, found[2] == ">=")


@dataclasses.dataclass(frozen=True)
class TimeToBound:
    """When a run reached its bounds.

    Attributes:
        seconds: of training until then; NaN where it did not.
        distance: from the bounds where the run was nearest, summed over them (`Bound.distances`); 0 where it reached
            them.
    """

    seconds: float
    distance: float

    @property
    def score(self) -> float:
        """The larger, the better: a shorter time, or where there is none a smaller distance."""
        return -NEVER * (1.0 + self.distance) if math.isnan(self.seconds) else -self.seconds


def seconds_of(score: float) -> float:
    """Return the time behind a score, or behind the mean of two [s]; NaN where a run did not reach its bounds."""
    return -score if score > -0.25 * NEVER else math.nan


def score_text(score: float) -> str:
    """Return a score for people: seconds, or how far off its run stayed."""
    if math.isnan(score) or math.isinf(score):
        return "-"
    if not math.isnan(seconds_of(score)):
        return f"{-score:.4g}"
    distance = -score / NEVER - 1.0
    # the mean of a run that reached the bounds and one that did not is of no run
    return f"{100.0 * distance:.3g} % off" if 0.0 < distance < FARTHEST else "not reached"


def iteration_seconds(rows: Iterable[Mapping[str, str]]) -> list[float]:
    """Return how long each iteration took [s]: without what is between iterations, as films and checkpoints; 0 where
    its rate is not known.
    """
    steps, rates = [], []
    for row in rows:
        steps.append(float(row.get("env_steps") or 0.0))
        rates.append(float(row.get("env_steps_per_s") or "nan"))
    made = [after - before for before, after in itertools.pairwise([0.0, *steps])]
    return [part / rate if rate > 0.0 else 0.0 for part, rate in zip(made, rates, strict=True)]


def time_to_bound(rows: Sequence[Mapping[str, str]], bounds: Sequence[Bound], good: Iterable[str]) -> TimeToBound:
    """Return when the means over `WINDOW` iterations reached all bounds at once.

    Args:
        rows: of ``progress.csv``.
        bounds: one or more.
        good: reasons of an end that are successes.

    Raises:
        InputError: there is no such column.
    """
    good = tuple(good)
    if len(rows) < WINDOW:
        return TimeToBound(math.nan, FARTHEST)
    off = np.zeros(len(rows) - WINDOW + 1)
    for bound in bounds:
        off += bound.distances(window_means(np.array(series(rows, bound.column, good, "--until"))))
    reached = np.flatnonzero(off == 0.0)
    if not reached.size:
        return TimeToBound(math.nan, float(off.min()))
    return TimeToBound(sum(iteration_seconds(rows[: int(reached[0]) + WINDOW])), 0.0)


def window_means(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the means of the known ones of `WINDOW` values in a row; NaN where none is known."""
    windows = np.lib.stride_tricks.sliding_window_view(values, WINDOW)
    known = np.isfinite(windows)
    count = known.sum(axis=1)
    return np.where(count, np.where(known, windows, 0.0).sum(axis=1) / np.maximum(count, 1), math.nan)
