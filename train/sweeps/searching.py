"""Search instead of a grid: Optuna proposes the next point from the scores of those before it."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from simwarp.search.search_journal import STORAGE, import_optuna, open_study
from simwarp.tasks import InputError

from .plan import SweepRun
from .ranking import median_interval
from .run_state import RunRecord

_STUDY = "sweep"


@dataclasses.dataclass(frozen=True)
class Dimension:
    """Values that a field may take.

    Attributes:
        low: smallest number; None where there are choices.
        high: largest number.
        log: numbers are searched by their logarithms.
        choices: words, in place of numbers.
    """

    low: float | int | None = None
    high: float | int | None = None
    log: bool = False
    choices: tuple[str, ...] = ()


class Search:
    """The trials of a search, those of earlier times first; each is a run per seed, and its score their median.

    Args:
        folder: of the sweep.
        space: field -> values that it may take.
        trials: number of trials in all.
        make: returns the runs of a trial, one per seed, by its number and its values.
        score: returns the score of a run that has ended; minus infinity where it failed.

    Raises:
        InputError: the folder holds a search of other fields.
        ModelError: optuna is not installed.
        FileError: its journal is damaged.
        FileError: the journal is no regular file.
        OutputError: the disk did not take it.
    """

    def __init__(
        self,
        folder: Path,
        space: Mapping[str, Dimension],
        trials: int,
        make: Callable[[int, Mapping[str, Any]], Sequence[SweepRun]],
        score: Callable[[RunRecord], float],
    ) -> None:
        self._optuna = import_optuna()
        self._study = open_study(folder / STORAGE, _STUDY)
        before = self._earlier_trials(folder, space)
        # A sampler that began anew with the same numbers would propose the same points again
        self._study.sampler = self._optuna.samplers.TPESampler(seed=len(before))
        self._distributions = {key: self._distribution(dimension) for key, dimension in space.items()}
        self._space, self._trials, self._make, self._score = space, trials, make, score
        self._old = deque((trial.number, trial.params) for trial in before)
        self._asked = len(before)
        self._queue: deque[SweepRun] = deque()
        self._number: dict[str, int] = {}
        self._open: dict[int, int] = {}
        self._scores: dict[int, list[float]] = {}

    def _earlier_trials(self, folder: Path, space: Mapping[str, Dimension]) -> list[Any]:
        """Return the trials that are there. One that was cut off while it was written began no run, and is left out."""
        states, whole = self._optuna.trial.TrialState, []
        for trial in self._study.get_trials(deepcopy=False):
            if trial.params.keys() == space.keys():
                whole.append(trial)
            elif trial.state is states.COMPLETE or not trial.params.keys() < space.keys():
                there = ", ".join(trial.params)
                raise InputError(f"{folder} holds a search over {there}, not {', '.join(space)}: give another --out")
            elif not trial.state.is_finished():
                self._study.tell(trial.number, state=states.FAIL)
        return whole

    def _distribution(self, dimension: Dimension) -> Any:
        kinds = self._optuna.distributions
        if dimension.choices:
            return kinds.CategoricalDistribution(dimension.choices)
        kind = kinds.IntDistribution if isinstance(dimension.low, int) else kinds.FloatDistribution
        return kind(dimension.low, dimension.high, log=dimension.log)

    def next_run(self) -> SweepRun | None:
        """Return the next run: of the trial that was begun, of one from earlier times, or of a new one."""
        if not self._queue:
            if self._old:
                self._begin(*self._old.popleft())
            elif self._asked < self._trials:
                trial = self._study.ask(self._distributions)
                self._asked += 1
                self._begin(trial.number, trial.params)
        return self._queue.popleft() if self._queue else None

    def _begin(self, number: int, params: Mapping[str, Any]) -> None:
        runs = self._make(number, {key: params[key] for key in self._space})
        self._queue.extend(runs)
        self._number |= {run.name: number for run in runs}
        self._open[number], self._scores[number] = len(runs), []

    def settled(self, record: RunRecord) -> None:
        """Tell Optuna the score of a trial whose runs have all ended."""
        number = self._number[record.run.name]
        self._open[number] -= 1
        self._scores[number].append(self._score(record))
        if self._open[number]:
            return
        known = [score for score in self._scores[number] if not math.isnan(score)]
        median = median_interval(known).median if known else math.nan
        states = self._optuna.trial.TrialState
        if self._study.get_trials(deepcopy=False)[number].state.is_finished():
            return
        if math.isfinite(median):
            self._study.tell(number, median)
        else:
            self._study.tell(number, state=states.FAIL)
