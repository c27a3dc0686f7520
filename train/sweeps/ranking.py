"""What came out of a sweep: a score of every run, and the points in the order of their median over seeds."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from scipy import stats

from ..runs.progress_table import read_progress, series
from .run_state import RunRecord, RunState
from .time_to_bound import Bound, TimeToBound, iteration_seconds, seconds_of, time_to_bound

REWARD: Final = "mean_reward"
CONFIDENCE: Final = 0.9
"""Least probability with which an interval holds the median, where there are seeds enough."""
_LAST = 0.1
"""Share of the iterations, the last ones, that a score is the mean of."""


@dataclasses.dataclass(frozen=True)
class MedianInterval:
    """A median over seeds, and an interval that holds the true one whatever the distribution is.

    The interval lies between two of the values, the k-th from below and from above. It misses the true median only if
    fewer than k of n values fall on one side of it, each with probability 1/2.

    Attributes:
        median: of the values.
        low: k-th value from below.
        high: k-th value from above.
        coverage: probability that such an interval holds the true median.
    """

    median: float
    low: float
    high: float
    coverage: float


def median_interval(values: Sequence[float]) -> MedianInterval:
    """Return the median and the narrowest interval of :data:`CONFIDENCE`, or the whole range where no one has it.

    Five values reach from the smallest to the largest with 0.9375, three with 0.75. Minus infinity is a value.

    Source: Conover, Practical Nonparametric Statistics, 3rd ed., section 3.2.
    """
    ordered = sorted(values)
    count = len(ordered)
    beyond = 0  # values left out at each end
    while 2 * (beyond + 1) < count and _coverage(beyond + 1, count) >= CONFIDENCE:
        beyond += 1
    middle = ordered[(count - 1) // 2 : count // 2 + 1]
    # The mean of two equal infinities is one of them
    median = middle[0] if middle[0] == middle[-1] else sum(middle) / 2.0
    return MedianInterval(median, ordered[beyond], ordered[-1 - beyond], _coverage(beyond, count))


def _coverage(beyond: int, count: int) -> float:
    return float(1.0 - 2.0 * stats.binom.cdf(beyond, count, 0.5)) if count > 1 else 0.0


@dataclasses.dataclass
class RunResult:
    """What came out of a run.

    Attributes:
        record: the run, and what became of it.
        steps: environment steps after each iteration.
        curve: the column that is ranked by, or that of the first bound, of the same iterations.
        score: mean of the last tenth of it, or that of the time to the bounds; minus infinity of a run that failed, NaN
            of one that did not end.
        seconds: time of training after each iteration [s].
        time: to the bounds; None where runs are not ranked by it.
    """

    record: RunRecord
    steps: list[float]
    curve: list[float]
    score: float
    seconds: list[float]
    time: TimeToBound | None = None

    @property
    def train_s(self) -> float:
        """Time that its iterations took [s]."""
        return self.seconds[-1] if self.seconds else 0.0

    def as_json(self) -> dict[str, Any]:
        """Return plain values."""
        run = self.record.run
        return {
            "values": dict(run.values),
            "seed": run.seed,
            "run": str(run.folder.path),
            "state": self.record.state.value,
            "iterations": self.record.iteration,
            "env_steps": round(self.steps[-1]) if self.steps else 0,
            "score": self.score if self.time is None else -seconds_of(self.score),
            "train_s": self.train_s,
            **({} if self.time is None else {"time_to_bound_s": self.time.seconds, "distance": self.time.distance}),
            **({"reason": self.record.reason} if self.record.reason else {}),
        }


def result_of(record: RunRecord, column: str, good: Iterable[str], bounds: Sequence[Bound] = ()) -> RunResult:
    """Return what came out of a run.

    Args:
        record: the run.
        column: that is ranked by, where there are no bounds.
        good: reasons of an end that are successes.
        bounds: the run is scored by the time to them; none: by the end of the column.

    Raises:
        InputError: its progress has no such column.
    """
    good = tuple(good)
    rows = read_progress(record.run.folder.progress)
    rows = rows[: record.run.config.iterations]
    steps = [float(row.get("env_steps") or 0.0) for row in rows]
    spent = list(itertools.accumulate(iteration_seconds(rows)))
    if not bounds:
        curve = series(rows, column, good)
        return RunResult(record, steps, curve, _score(record, _last_tenth(curve)), spent)
    curve, time = series(rows, bounds[0].column, good, "--until"), time_to_bound(rows, bounds, good)
    return RunResult(record, steps, curve, _score(record, time.score), spent, time)


def _last_tenth(curve: Sequence[float]) -> float:
    last = [value for value in curve[-max(1, round(_LAST * len(curve))) :] if math.isfinite(value)]
    return sum(last) / len(last) if last else math.nan


def _score(record: RunRecord, ended: float) -> float:
    if record.state is RunState.FAILED:
        return -math.inf
    return ended if record.state is RunState.DONE else math.nan


@dataclasses.dataclass(frozen=True)
class RankedPoint:
    """A point of a sweep, over its seeds.

    Attributes:
        label: its name.
        values: field -> value.
        results: of its runs, by seed.
        interval: of the scores of its runs that ended; None where there are none. A run that failed counts as worse
            than any other.
    """

    label: str
    values: Mapping[str, Any]
    results: list[RunResult]
    interval: MedianInterval | None

    @property
    def scores(self) -> list[float]:
        """Scores of the runs that ended, minus infinity of those that failed."""
        return [result.score for result in self.results if not math.isnan(result.score)]

    @property
    def failed(self) -> int:
        """Number of runs that failed."""
        return sum(result.record.state is RunState.FAILED for result in self.results)

    @property
    def done(self) -> int:
        """Number of runs that were finished."""
        return sum(result.record.state is RunState.DONE for result in self.results)

    @property
    def times(self) -> list[TimeToBound]:
        """Times to the bounds of the runs that were finished; none where runs are not ranked by them."""
        done = (result for result in self.results if result.record.state is RunState.DONE)
        return [result.time for result in done if result.time is not None]

    @property
    def reached(self) -> int:
        """Number of finished runs that reached their bounds."""
        return sum(not math.isnan(time.seconds) for time in self.times)

    def as_json(self, rank: int | None) -> dict[str, Any]:
        """Return plain values; ``score`` is the median, of times the negative one, NaN where no bound was reached."""
        known = self.interval or MedianInterval(*[math.nan] * 4)
        timed = any(result.time is not None for result in self.results)

        def plain(score: float) -> float:
            return -seconds_of(score) if timed else score

        scores = [plain(score) for score in sorted(self.scores)] or [math.nan]
        return {
            "rank": rank,
            "values": dict(self.values),
            "score": plain(known.median),
            "low": plain(known.low),
            "high": plain(known.high),
            "coverage": known.coverage,
            "mean": float(np.mean(scores)),
            "worst": scores[0],
            "best": scores[-1],
            "seeds": self.done,
            "failed": self.failed,
            "scores": {str(result.record.run.seed): plain(result.score) for result in self.results},
            **({"reached": self.reached, "time_to_bound_s": seconds_of(known.median)} if timed else {}),
        }


def ranking(results: Iterable[RunResult]) -> list[RankedPoint]:
    """Return the points, the best first: by the median of the scores, then by the worst one; unknown ones last."""
    points: dict[str, list[RunResult]] = {}
    for result in results:
        points.setdefault(result.record.run.label, []).append(result)
    ranked = []
    for label, members in points.items():
        members.sort(key=lambda result: result.record.run.seed)
        scores = [result.score for result in members if not math.isnan(result.score)]
        found = median_interval(scores) if scores else None
        ranked.append(RankedPoint(label, members[0].record.run.values, members, found))
    return sorted(ranked, key=_order)


def _order(point: RankedPoint) -> tuple[bool, float, float]:
    known = point.interval
    return (known is None, -known.median if known else 0.0, -min(point.scores, default=0.0))
