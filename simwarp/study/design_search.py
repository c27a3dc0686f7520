"""A search for the best design by Optuna: designs are proposed in groups, and each group is driven as one batch."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from simwarp.search.search_journal import STORAGE, import_optuna, open_study
from simwarp.study.design_goal import PASS_SPEED, Bound, Goal, PassSpeed, pass_speed
from simwarp.study.distributions import Distribution, Kind
from simwarp.study.study_error import StudyError
from simwarp.study.study_figures import figures_of
from simwarp.study.varied_vehicle import MANEUVER, VariedVehicle
from simwarp.study.world_runs import WorldRuns
from simwarp.vehicle.assessment.maneuver_variants import Outcome

STUDY: Final = "design"
ASKED: Final = "asked"
"""Attribute of the journal's study: what was asked for."""
FOUND: Final = "found"
"""Attribute of a trial: what became of it."""
LEFT_OUT: Final = 1.0e3
"""Distance to a bound of a design without figures, in shares of the limit."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Design:
    """One design that was driven.

    Attributes:
        number: of its trial; 0 is the vehicle as built, where that is within the ranges.
        values: of the keys.
        goal: figure that the search is about; NaN where it has none.
        objective: what the search was told, which also orders designs that pass at no speed; NaN of a failed one.
        highest: of the speeds that were driven and passed [m/s]; NaN where speeds are not searched.
        kept: whether all bounds are kept.
        figures: of the run that decides: at the highest speed passed.
        trouble: why it has no figures; empty of a sound one.
    """

    number: int
    values: tuple[float, ...]
    goal: float
    objective: float
    highest: float
    kept: bool
    figures: Mapping[str, float]
    trouble: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchPlan:
    """What a search is asked for.

    Attributes:
        vehicle: with the keys that are searched.
        goal: of the search.
        bounds: of figures.
        speeds: that every design is driven at, rising; None: as the manoeuvre's options say.
        trials: designs in all.
        at_once: designs that are proposed together.
        seed: of the proposals.
        batch: most worlds of one simulation.
    """

    vehicle: VariedVehicle
    goal: Goal
    bounds: tuple[Bound, ...]
    speeds: tuple[float, ...] | None
    trials: int
    at_once: int
    seed: int
    batch: int


class DesignSearch:
    """A search, its earlier trials first.

    Args:
        plan: what is asked for.
        runs: that drive documents.
        folder: of its journal.

    Attributes:
        designs: that are done, in the order of their trials.

    Raises:
        StudyError: the folder holds a search for something else, or a key is drawn from a normal distribution.
        ModelError: optuna is not installed.
        FileError: the journal is damaged.
    """

    def __init__(self, plan: SearchPlan, runs: WorldRuns, folder: Path) -> None:
        self.plan, self._runs = plan, runs
        self._optuna = import_optuna()
        self._space = {key.name: self._dimension(key.name, key.distribution) for key in plan.vehicle.keys}
        folder.mkdir(parents=True, exist_ok=True)
        self._study = open_study(folder / STORAGE, STUDY, maximise=plan.goal.maximise)
        self._hold_to_plan(folder)
        self.designs: list[Design] = []
        for trial in self._trials():
            if FOUND in trial.user_attrs and trial.state.is_finished():
                self.designs.append(_design(trial.number, self._values(trial.params), trial.user_attrs[FOUND]))

    def _dimension(self, name: str, each: Distribution) -> Any:
        kinds = self._optuna.distributions
        match each.kind:
            case Kind.CHOICES:
                return kinds.CategoricalDistribution(each.choices)
            case Kind.NORMAL:
                raise StudyError(f"--search {name}: must be LOW..HIGH or A,B,C, got a normal distribution {each.text}")
        return kinds.FloatDistribution(each.low, each.high, log=each.kind is Kind.LOG_UNIFORM)

    def _hold_to_plan(self, folder: Path) -> None:
        """Write what is asked for into a new journal, or compare it with that of an old one."""
        plan = self.plan
        document = json.dumps(plan.vehicle.document, sort_keys=True, default=str)
        asked = {
            "vehicle": hashlib.sha256(document.encode()).hexdigest()[:16], "maneuver": plan.vehicle.maneuver,
            "keys": {key.name: key.distribution.text for key in plan.vehicle.keys},
            "goal": f"{'maximise' if plan.goal.maximise else 'minimise'} {plan.goal.key}",
            "bounds": [bound.text for bound in plan.bounds],
            "speeds": None if plan.speeds is None else list(plan.speeds), "dt": self._runs.dt, "seed": plan.seed,
            "at_once": plan.at_once,
        }  # fmt: skip
        before = self._study.user_attrs.get(ASKED)
        if before is None:
            self._study.set_user_attr(ASKED, asked)
            nominal = self._within(plan.vehicle.nominal())
            if nominal is not None:
                self._study.enqueue_trial(nominal)
            return
        other = next((key for key, value in asked.items() if before.get(key) != value), None)
        if other is not None:
            was, now = json.dumps(before.get(other)), json.dumps(asked[other])
            raise StudyError(f"--out: {folder} holds a search with {other} {was}, not {now}; give another folder")

    def _within(self, nominal: Sequence[float]) -> dict[str, float] | None:
        """The vehicle as built as a proposal; None where it is outside of what is searched."""
        found = {}
        for key, value in zip(self.plan.vehicle.keys, nominal, strict=True):
            each = key.distribution
            drawn = value - 1.0 if each.relative else value
            if math.isnan(drawn) or not each.low <= drawn <= each.high or (each.choices and drawn not in each.choices):
                return None
            found[key.name] = drawn
        return found

    def _trials(self) -> list[Any]:
        return list(self._study.get_trials(deepcopy=False))

    def _values(self, params: Mapping[str, float]) -> tuple[float, ...]:
        """Values of the keys; changes in % as factors."""
        return tuple(
            1.0 + params[key.name] if key.distribution.relative else float(params[key.name])
            for key in self.plan.vehicle.keys
        )

    def steps(self, progress: Callable[[float], None] | None = None) -> Iterator[list[Design]]:
        """Drive one group of designs after another, and tell of each.

        A group that was interrupted is driven when the search goes on.

        Args:
            progress: called with the designs that are done, whole or in part.
        """
        while len(self.designs) < self.plan.trials:
            begun = self._proposed()
            made = len(self.designs)
            shown = None if progress is None else _counted(progress, made, len(begun))
            found = self._drive([self._values(trial.params) for trial in begun], shown)
            for trial, record in zip(begun, found, strict=True):
                self._record_result(trial, record)
                self.designs.append(_design(trial.number, self._values(trial.params), record))
            yield self.designs[made:]

    def _proposed(self) -> list[Any]:
        """Trials of the next group: those that were begun before, then new ones.

        A proposal depends on the seed, its number and the trials that were told before, wherever a search was stopped.
        """
        running = self._optuna.trial.TrialState.RUNNING
        begun = [trial for trial in self._trials() if trial.state == running]
        whole = [trial for trial in begun if trial.params.keys() == self._space.keys()]
        for trial in begun:
            if trial not in whole:
                self._study.tell(trial.number, state=self._optuna.trial.TrialState.FAIL)
        found = [self._optuna.trial.Trial(self._study, trial._trial_id) for trial in whole]
        count = min(self.plan.at_once - len(self.designs) % self.plan.at_once, self.plan.trials - len(self.designs))
        while len(found) < count:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # constraints are an experiment of some versions
                self._study.sampler = self._sampler(len(self.designs) + len(found))
                found.append(self._study.ask(self._space))
        return found

    def _sampler(self, number: int) -> Any:
        constraints = None if self._of_speeds or not self.plan.bounds else _broken_bounds
        return self._optuna.samplers.TPESampler(
            seed=(self.plan.seed * 1_000_003 + number) % 2**32, constant_liar=True, constraints_func=constraints
        )  # fmt: skip

    @property
    def _of_speeds(self) -> bool:
        return self.plan.goal.key == PASS_SPEED

    def _drive(self, rows: Sequence[tuple[float, ...]], progress: Callable[[float], None] | None) -> list[Any]:
        """What became of some designs, as the journal keeps it."""
        speeds = self.plan.speeds or (None,)
        documents = []
        for values in rows:
            document = self.plan.vehicle.changed(values)
            for speed in speeds:
                options = document[MANEUVER] if speed is None else document[MANEUVER] | {"speed": speed}
                documents.append({**document, MANEUVER: options})
        outcomes: list[Outcome | str] = []
        for first in range(0, len(documents), self.plan.batch):
            some = documents[first : first + self.plan.batch]
            share = None if progress is None else _part_of(progress, first, len(some), len(documents))
            outcomes += self._runs.run(some, share)
        count = len(speeds)
        return [self._record(outcomes[index * count : (index + 1) * count]) for index in range(len(rows))]

    def _record(self, outcomes: Sequence[Outcome | str]) -> dict[str, Any]:
        """One design from its runs."""
        sound = [each for each in outcomes if not isinstance(each, str)]
        if len(sound) < len(outcomes):
            trouble = next(each for each in outcomes if isinstance(each, str))
            return {"trouble": trouble, "goal": None, "objective": None, "highest": None, "figures": {}, "bounds": []}
        figures = [{} if each.broken else {key: item.value for key, item in figures_of(each).items()} for each in sound]
        found = PassSpeed(math.nan, math.nan, 0)
        bounds: list[float] = []
        if self._of_speeds:
            passed = [each.passed is True for each in sound]
            found = pass_speed(self.plan.speeds or (), figures, passed, self.plan.bounds)
            goal = math.nan if math.isnan(found.highest) else found.between
            objective = found.between
        else:
            goal = objective = figures[0].get(self.plan.goal.key, math.nan)
            bounds = [each.distance(figures[0].get(each.key, math.nan)) for each in self.plan.bounds]
        own = figures[found.decisive]
        return {
            "trouble": "" if own else "diverged", "goal": _plain(goal), "objective": _plain(objective),
            "highest": _plain(found.highest), "figures": {key: _plain(value) for key, value in own.items()},
            "bounds": [-LEFT_OUT if math.isnan(value) else value for value in bounds],
        }  # fmt: skip

    def _record_result(self, trial: Any, record: Mapping[str, Any]) -> None:
        """Write down what became of a trial."""
        trial.set_user_attr(FOUND, dict(record))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if record["objective"] is None:
                self._study.tell(trial.number, state=self._optuna.trial.TrialState.FAIL)
            else:
                self._study.tell(trial.number, record["objective"])

    @property
    def best(self) -> Design | None:
        """The best design that keeps all bounds; None if there is none."""
        found: Design | None = None
        for each in self.designs:
            valid = each.kept and not math.isnan(each.goal)
            if valid and (found is None or self.plan.goal.better(each.goal, found.goal)):
                found = each
        return found


def _broken_bounds(trial: Any) -> list[float]:
    """For Optuna: above 0 where a bound is broken."""
    return [-value for value in trial.user_attrs[FOUND]["bounds"]]


def _design(number: int, values: tuple[float, ...], record: Mapping[str, Any]) -> Design:
    return Design(
        number=number, values=values, goal=_number(record["goal"]), objective=_number(record["objective"]),
        highest=_number(record["highest"]), kept=all(value >= 0.0 for value in record["bounds"]),
        figures={key: _number(value) for key, value in record["figures"].items()}, trouble=record["trouble"],
    )  # fmt: skip


def _plain(value: float) -> float | None:
    """For a journal: JSON has no word for what is not finite."""
    return value if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _counted(progress: Callable[[float], None], first: int, count: int) -> Callable[[float], None]:
    return lambda share: progress(first + share * count)


def _part_of(progress: Callable[[float], None], first: int, count: int, total: int) -> Callable[[float], None]:
    return lambda share: progress((first + share * count) / total)
