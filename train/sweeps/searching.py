"""Search instead of a grid: Optuna proposes the next point from the scores of those before it."""

from __future__ import annotations

import dataclasses
import importlib
import json
import math
import os
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from simwarp.core.files import check_input, output_error
from simwarp.tasks import InputError

from .plan import SweepRun
from .ranking import median_interval
from .run_state import RunRecord

STORAGE: Final = "search.log"
"""Journal of the trials, in the folder of the sweep."""
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


def import_optuna() -> Any:
    """Return the module optuna.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module("optuna")
    except ImportError as error:
        raise InputError("--search needs the package optuna: pip install 'simwarp[sweep]'") from error


def _damaged(path: Path, why: str) -> InputError:
    remedy = "put a whole copy in its place, or give another --out"
    return InputError(f"journal of the search {path} is damaged ({why}); {remedy}")


def _check_journal(path: Path) -> None:
    """Refuse a journal that is none, and drop the end of one whose writer was killed in the middle of a line.

    What is added to it would stand in the same line.

    Raises:
        InputError: a line is no object of JSON.
        FileError: it is no regular file.
        OutputError: it cannot be shortened.
    """
    if not os.path.lexists(path):
        return
    data = check_input(path, "journal of the search").read_bytes()
    whole = data.rfind(b"\n") + 1
    for number, line in enumerate(data[:whole].splitlines(), 1):
        try:
            known = isinstance(json.loads(line), dict)
        except (ValueError, RecursionError):
            known = False
        if not known:
            raise _damaged(path, f"line {number}")
    if whole < len(data):
        try:
            os.truncate(path, whole)
        except OSError as error:
            raise output_error(path, error) from error


class Search:
    """The trials of a search, those of earlier times first; each is a run per seed, and its score their median.

    Args:
        folder: of the sweep.
        space: field -> values that it may take.
        trials: number of trials in all.
        make: returns the runs of a trial, one per seed, by its number and its values.
        score: returns the score of a run that has ended; minus infinity where it failed.

    Raises:
        InputError: optuna is not installed, the folder holds a search of other fields, or its journal is damaged.
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
        self._optuna.logging.set_verbosity(self._optuna.logging.WARNING)
        self._study = self._opened(folder / STORAGE)
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

    def _opened(self, path: Path) -> Any:
        """Return the study that a journal holds, or begin both."""
        _check_journal(path)
        try:
            backend = importlib.import_module("optuna.storages.journal").JournalFileBackend(str(path))
            study = self._optuna.create_study(
                storage=self._optuna.storages.JournalStorage(backend), study_name=_STUDY, direction="maximize",
                load_if_exists=True,
            )  # fmt: skip
            study.get_trials(deepcopy=False)
        except OSError as error:
            raise output_error(path, error) from error
        except Exception as error:  # Optuna trusts its journal: a damaged one may raise anything
            raise _damaged(path, type(error).__name__) from error
        return study

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
