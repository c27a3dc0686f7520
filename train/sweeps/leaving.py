"""When a run of a sweep needs no more training: it has reached its bounds, or it is slower than the best."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from simwarp.tasks import InputError

from ..runs.progress_table import read_progress
from .ranking import median_interval
from .run_state import RunRecord, RunState
from .time_to_bound import Bound, iteration_seconds, seconds_of, time_to_bound


class LeaveRule:
    """Says of runs under way whether they are to be left.

    A run that trained longer than the best point's median cannot bring that of its own point below it: leaving it
    changes no winner. With an even number of seeds a median is the mean of two runs, and that holds from twice as long.

    Args:
        bounds: that runs are trained to; none: nothing is left.
        good: reasons of an end that are successes.
        patience: a run is left that has trained so many times as long as the best point took; 1 or more.
        seeds: runs of each point.

    Attributes:
        name: of what runs are left for; a run that was left for something else goes on.
    """

    def __init__(self, bounds: Sequence[Bound], good: Iterable[str], patience: float, seeds: int) -> None:
        self._bounds, self._good = tuple(bounds), tuple(good)
        self._patience, self._seeds = patience, seeds
        self.name = f"{' '.join(bound.text for bound in self._bounds)}, patience {patience:g}" if self._bounds else ""
        self._best = math.inf
        self._scores: dict[str, dict[int, float]] = {}
        self._seen: dict[str, int] = {}

    def reason(self, record: RunRecord) -> str:
        """Return why a run needs no more training; empty where it does.

        Args:
            record: of the run, after a look at its progress.
        """
        key = record.run.name
        if not self._bounds or self._seen.get(key) == record.iteration:
            return ""
        self._seen[key] = record.iteration
        rows = read_progress(record.run.folder.progress)[: record.run.config.iterations]
        try:
            time = time_to_bound(rows, self._bounds, self._good)
        except InputError:  # a column that comes with the first episode that ends so
            return ""
        if not math.isnan(time.seconds):
            return f"reached after {time.seconds:.4g} s"
        spent = sum(iteration_seconds(rows))
        if spent > self._patience * self._best:
            return f"left after {spent:.4g} s, the best point took {self._best:.4g} s"
        return ""

    def settled(self, record: RunRecord, score: float) -> None:
        """Learn the score of a run that is done or has failed."""
        scores = self._scores.setdefault(record.run.label, {})
        scores[record.run.seed] = -math.inf if record.state is RunState.FAILED else score
        if self._bounds and len(scores) == self._seeds:
            seconds = seconds_of(median_interval(list(scores.values())).median)
            if seconds < self._best:
                self._best = seconds
                self._seen.clear()
