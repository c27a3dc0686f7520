"""``simwarp sweep``."""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import tyro
from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED, UsageError, shortened
from simwarp.cli.evaluation.grids import (
    check_field,
    combinations,
    field_of,
    grid_axes,
    option_words,
)
from simwarp.cli.options import expand_shorthands, finite, option_value, split_task
from simwarp.cli.training import StartOptions, read_options
from simwarp.core.stopping import stop_on_signals
from simwarp.core.threads import thread_count
from simwarp.tasks import task_class, task_names
from simwarp.train.runs.progress_table import check_column
from simwarp.train.runs.run_files import write_json
from simwarp.train.runs.run_folder import RunFolder, check_root
from simwarp.train.runs.run_lock import writing
from simwarp.train.sweeps.launchers import LocalLauncher
from simwarp.train.sweeps.leaving import LeaveRule
from simwarp.train.sweeps.plan import SweepRun, point_label, run_name, sweep_name
from simwarp.train.sweeps.ranking import REWARD, RankedPoint, RunResult, ranking, result_of
from simwarp.train.sweeps.run_state import RunRecord, RunState
from simwarp.train.sweeps.running import RunList, RunSource, SweepRunner, check_runs
from simwarp.train.sweeps.searching import Dimension, Search
from simwarp.train.sweeps.sweep_display import SweepDisplay
from simwarp.train.sweeps.time_to_bound import Bound, parse_bound, score_text, seconds_of

RESULTS: Final = "results.json"
CURVES: Final = "curves.png"
SEARCH: Final = "search.png"
MOST_RUNS: Final = 10_000
"""Of a sweep."""
_SEEDS = re.compile(r"([0-9]{1,18})(?:-([0-9]{1,18}))?")
_NOT_SWEPT = {"seed": "--seeds", "threads": "--threads, which the runs at a time share"}


class LauncherKind(enum.Enum):
    """Where the runs of a sweep are computed."""

    LOCAL = "local"
    SLURM = "slurm"


@dataclasses.dataclass(frozen=True)
class SweepOptions(StartOptions):
    """Train with several seeds and settings, and compare. The same command again goes on where it was."""

    seeds: str = "0-2"
    """Seeds of each point, such as 0-4 or 0,2,7."""
    grid: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="KEY=a,b,c")] = ()
    """Train for each value of an option of `simwarp train`, as task.hills; given again, for every combination."""
    search: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="KEY=low:high[:log]")] = ()
    """In place of a grid: search an option between two numbers, or among KEY=a,b,c, by Optuna."""
    trials: int = 20
    """Points that a search tries."""
    jobs: int | None = None
    """Runs at a time, among which --threads are shared; by default 1, and with --launcher slurm all."""
    launcher: LauncherKind = LauncherKind.LOCAL
    """local: processes of this machine; slurm: jobs of a cluster, by submitit."""
    slurm: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="KEY=VALUE")] = ()
    """A parameter of the jobs, as submitit calls it: timeout_min=240, slurm_partition=gpu, gpus_per_node=1."""
    rank_by: str = "mean_reward"
    """Column of progress.csv whose last tenth is the score, the larger the better; or `success`."""
    until: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="COLUMN>=NUMBER")] = ()
    """Rank by seconds of training until a column of progress.csv gets there, success>=0.9; given again, until all do.
    A run that is there is ended."""
    patience: float = 2.0
    """With --until: leave runs that have trained so many times as long as the best point took; inf: none."""
    retry: tyro.conf.FlagCreatePairsOff[bool] = False
    """Try runs again that failed by an error of their own; those that were killed go on anyway."""
    out: Path | None = None
    """Folder of the sweep; by default RUNS/sweeps/ and a name made of what is varied and what is held."""
    runs: Path = Path("runs")
    """Folder in which sweeps are made."""


@dataclasses.dataclass(frozen=True)
class SweepPlan:
    """A sweep as the command line asks for it, checked.

    Attributes:
        word: the task, as commands take it.
        task: its registered name.
        options: all options.
        seeds: of each point.
        points: values and options of the points of a grid; one without values where there is none.
        space: field -> what is searched; empty without a search.
        at: returns the options at a point of the search.
        folder: of the sweep.
        bounds: to which runs are trained; none: they are ranked by a column.
    """

    word: str
    task: str
    options: Any
    seeds: list[int]
    points: list[tuple[dict[str, Any], Any]]
    space: dict[str, Dimension]
    at: Callable[[Mapping[str, Any]], Any]
    folder: Path
    bounds: tuple[Bound, ...] = ()

    @property
    def good(self) -> tuple[str, ...]:
        """Reasons of an end that are successes."""
        return tuple(task_class(self.word).success_reasons)

    @property
    def measure(self) -> str:
        """What runs are ranked by, for people."""
        if not self.bounds:
            return str(self.options.rank_by)
        return f"seconds of training until {' and '.join(bound.text for bound in self.bounds)}"

    @property
    def total(self) -> int:
        """Number of runs."""
        return len(self.seeds) * (self.options.trials if self.space else len(self.points))

    @property
    def jobs(self) -> int:
        """Runs at a time."""
        usual = 1 if self.options.launcher is LauncherKind.LOCAL else self.total
        return min(self.total, self.options.jobs or usual)

    def runs_at(self, label: str, values: Mapping[str, Any], options: Any) -> list[SweepRun]:
        """Return the runs of a point, one per seed."""
        threads = options.flat_train.threads
        if options.launcher is LauncherKind.LOCAL:
            threads = max(1, thread_count(threads) // self.jobs)
        runs = []
        for seed in self.seeds:
            config = dataclasses.replace(options.flat_train, seed=seed, threads=threads)
            folder = RunFolder(self.folder / run_name(label, seed))
            runs.append(SweepRun(label, values, config, options.task, folder, options.warm_start))
        return runs

    def trial(self, number: int, values: Mapping[str, Any]) -> list[SweepRun]:
        """Return the runs of a trial of the search."""
        return self.runs_at(f"trial-{number:03d}", values, self.at(values))

    def grid_runs(self) -> list[SweepRun]:
        """Return the runs of the grid, seed by seed, so that an early stop leaves all points with some."""
        points = [self.runs_at(point_label(values), values, options) for values, options in self.points]
        return [run for same_seed in zip(*points, strict=True) for run in same_seed]


def run(arguments: list[str]) -> int:
    """Run the sweep; 130 after an interruption, 1 where runs failed."""
    word, arguments = split_task(arguments, "sweep", task_names())
    plan = read_plan(word, arguments)
    options = plan.options

    check_root(plan.folder, "--runs" if options.out is None else "--out")
    options.check(options.warm_start)
    launcher = _launcher(plan)
    plan.folder.mkdir(parents=True, exist_ok=True)
    console = options.console()
    console.print(f"sweep folder  {plan.folder}", highlight=False, soft_wrap=True)
    report = SweepReport(plan)
    rule = LeaveRule(plan.bounds, plan.good, options.patience, len(plan.seeds))

    def ended(record: RunRecord) -> None:
        rule.settled(record, report.ended(record, runner.records).score)

    with writing(plan.folder), SweepDisplay(console, plan.total, plan.jobs) as display, stop_on_signals() as stop:
        runner = SweepRunner(
            plan.task, _source(plan, report), launcher,
            jobs=plan.jobs, watcher=display, retry=options.retry, after=ended, rule=rule,
        )  # fmt: skip
        try:
            runner.run(stop)
        finally:
            report.save(runner.records)
    report.print_to(console)
    options.emit(report.content())
    return report.exit_code(stop.requested)


def _launcher(plan: SweepPlan) -> Any:
    if plan.options.launcher is LauncherKind.LOCAL:
        return LocalLauncher(plan.word)
    from simwarp.train.sweeps.slurm import SlurmLauncher

    return SlurmLauncher(plan.word, plan.folder, _slurm_parameters(plan.options.slurm))


def _slurm_parameters(texts: Sequence[str]) -> dict[str, str]:
    pairs = [text.partition("=") for text in texts]
    for text, (key, _, word) in zip(texts, pairs, strict=True):
        if not (key.isidentifier() and word):
            raise UsageError(f"--slurm wants KEY=VALUE, got '{shortened(text)}'")
    return {key: word for key, _, word in pairs}


def _source(plan: SweepPlan, report: SweepReport) -> RunSource:
    """Return what tells the runs; those of a grid that are there are held to what is asked for."""
    if plan.space:
        return Search(plan.folder, plan.space, plan.options.trials, plan.trial, lambda record: report.add(record).score)
    runs = plan.grid_runs()
    check_runs(plan.task, runs)
    return RunList(runs)


# ---- what is asked for -----------------------------------------------------------------------------------------------


def read_plan(word: str, arguments: list[str]) -> SweepPlan:
    """Return the sweep that the words after the task ask for.

    Raises:
        UsageError: one of them is wrong; all points are checked.
    """
    cls = task_class(word)
    arguments = expand_shorthands(arguments, cls.name, cls.config_type())
    if option_value(arguments, "--seed") is not None:
        raise UsageError("--seed: a sweep takes several, --seeds 0-4")

    def parse(more: list[str]) -> Any:
        return read_options(word, [*arguments, *more], "sweep", SweepOptions)

    options = parse([])
    _check_counts(options)
    seeds = parse_seeds(options.seeds)
    axes, space = grid_axes(options.grid), search_words(options.search)
    for key in (*axes, *space):
        _check_key("--grid" if key in axes else "--search", key, _read(options, key))

    def words_of(key: str, value: str) -> list[str]:
        return option_words(key, value, _read(options, key), f"{'--search' if key in space else '--grid'} {key}")

    points = combinations(axes, words_of, parse, _read)

    def typed(key: str, value: str) -> Any:
        return _read(parse(words_of(key, value)), key)

    dimensions = {key: _dimension(key, words, functools.partial(typed, key)) for key, words in space.items()}

    def at(values: Mapping[str, Any]) -> Any:
        return parse([part for key, value in values.items() for part in words_of(key, str(value))])

    plan = SweepPlan(
        word, cls.name, options, seeds, points, dimensions, at, _folder(cls.name, options, axes, space, seeds),
        tuple(parse_bound(text) for text in options.until),
    )  # fmt: skip
    if plan.total > MOST_RUNS:
        raise UsageError(f"{plan.total} runs are asked for, at most {MOST_RUNS} are made; give fewer seeds or values")
    return plan


def _folder(task: str, options: Any, axes: Mapping[str, Any], space: Mapping[str, list[str]], seeds: list[int]) -> Path:
    """Return the folder of a sweep: the same for the same command, and for one with more values or seeds."""
    if options.out is not None:
        return Path(options.out)
    more: dict[str, Any] = {"warm_start": str(options.warm_start)}
    if space:  # the score of a trial is of all seeds
        more |= {"space": space, "seeds": seeds}
        if options.until:
            more |= {"until": sorted(options.until)}
    name = sweep_name(task, options.flat_train, options.task, [*axes, *space], more)
    return Path(options.runs) / "sweeps" / name


def _check_counts(options: Any) -> None:

    for field in ("jobs", "trials"):
        value = getattr(options, field)
        if value is not None and value < 1:
            raise UsageError(f"--{field} must be at least 1, got {value}")
    check_column(options.rank_by)
    if options.until and options.rank_by != REWARD:
        raise UsageError("--until and --rank-by: runs are ranked by one of them; give one")
    if not options.patience >= 1.0:
        raise UsageError(f"--patience must be at least 1, got {options.patience:g}")
    if options.grid and options.search:
        raise UsageError("--grid and --search: give one of them; a fixed value is an option of its own")
    if options.slurm and options.launcher is not LauncherKind.SLURM:
        raise UsageError("--slurm is of jobs of a cluster: give --launcher slurm, too")


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that a text such as ``0-4`` or ``0,2,7-9`` names.

    Raises:
        UsageError: it names none, too many, or one twice.
    """
    seeds: list[int] = []
    for word in text.split(","):
        found = _SEEDS.fullmatch(word.strip())
        if found is None:
            raise UsageError(f"--seeds must be whole numbers and ranges such as 0-4 or 0,2,7, got '{shortened(text)}'")
        first, last = int(found[1]), int(found[2] or found[1])
        if last < first:
            raise UsageError(f"--seeds {word.strip()}: the second number must not be below the first one")
        if last - first >= MOST_RUNS:
            raise UsageError(f"--seeds {word.strip()}: at most {MOST_RUNS} runs are made; give fewer")
        seeds += range(first, last + 1)
    if len(set(seeds)) < len(seeds):
        raise UsageError(f"--seeds names a seed twice, got '{shortened(text)}'; give each once")
    return seeds


def search_words(texts: Sequence[str]) -> dict[str, list[str]]:
    """Return the words of each key of ``KEY=low:high[:log]`` or ``KEY=a,b,c`` texts.

    Raises:
        UsageError: a text is no such thing, or a key stands there twice.
    """
    space: dict[str, list[str]] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip().replace("-", "_")
        numbers = values.split(":")
        words = values.split(",") if len(numbers) == 1 else [":", *numbers]
        right = 2 <= len(numbers) <= 3 and numbers[2:] in ([], ["log"]) if words[0] == ":" else len(words) > 1
        named = bool(equals) and all(part.isidentifier() for part in key.split("."))
        if not (named and right and all(word.strip() for word in words)):
            raise UsageError(f"--search wants KEY=low:high, KEY=low:high:log or KEY=a,b,c, got '{shortened(text)}'")
        if key in space:
            raise UsageError(f"--search has the key {shortened(key)} twice: give it once")
        space[key] = [word.strip() for word in words]
    return space


def _dimension(key: str, words: Sequence[str], typed: Callable[[str], Any]) -> Dimension:
    """Return what is searched, both ends and all choices held to the type and the rules of the field."""
    if words[0] != ":":
        for word in words:
            typed(word)
        return Dimension(choices=tuple(words))
    low, high = (typed(word) for word in words[1:3])
    log = "log" in words[3:]
    if isinstance(low, bool) or not isinstance(low, int | float):
        raise UsageError(f"--search {key}: is no number; give words, {key}=a,b,c")
    if not low < high:
        raise UsageError(f"--search {key}: the second number must be above the first one, got {words[1]}:{words[2]}")
    if log and low <= 0:
        raise UsageError(f"--search {key}: the logarithm needs numbers above zero, got {words[1]}")
    return Dimension(low, high, log)


def _check_key(option: str, key: str, value: Any) -> None:
    if key in _NOT_SWEPT:
        raise UsageError(f"{option} {key}: is an option of the sweep itself, {_NOT_SWEPT[key]}")
    check_field(f"{option} {key}", key, value)
    if isinstance(value, Mapping):
        raise UsageError(f"{option} {key}: takes fields that are numbers or words; run a sweep per value")


def _read(options: Any, key: str) -> Any:
    """Return the value of ``ppo.gamma`` or ``task.hills``; None if there is no such field."""
    return field_of(options if key.startswith("task.") else options.flat_train, key)


# ---- what came out ---------------------------------------------------------------------------------------------------


class SweepReport:
    """Results of a sweep, saved after every run.

    Args:
        plan: what is asked for.
    """

    def __init__(self, plan: SweepPlan) -> None:
        self._plan = plan
        self._ended: dict[str, RunResult] = {}
        self._open: list[RunResult] = []

    @property
    def results(self) -> list[RunResult]:
        """Results of all runs that were begun; those that ended first."""
        return [*self._ended.values(), *self._open]

    def add(self, record: RunRecord) -> RunResult:
        """Take a run that is done or has failed, and return its result."""
        name = record.run.name
        if name not in self._ended:
            self._ended[name] = self._read(record)
        return self._ended[name]

    def ended(self, record: RunRecord, records: Sequence[RunRecord]) -> RunResult:
        """Take a run that is done or has failed, save what is known of all, and return its result."""
        result = self.add(record)
        if not record.kept:
            self.save(records)
        return result

    def _read(self, record: RunRecord) -> RunResult:
        return result_of(record, self._plan.options.rank_by, self._plan.good, self._plan.bounds)

    def save(self, records: Sequence[RunRecord]) -> None:
        """Write results and pictures, of unfinished runs what there is."""
        from simwarp.train.sweeps.sweep_curves import draw_curves, draw_search
        from simwarp.train.sweeps.sweep_times import draw_times

        self._open = [self._read(record) for record in records if record.run.name not in self._ended]
        if not self.results:
            return
        plan = self._plan
        write_json(plan.folder / RESULTS, finite(self.content()))
        points = self.ranking()
        if any(result.steps for result in self.results):
            title = f"{plan.task}: {', '.join(self._keys()) or 'seeds'}"
            if plan.bounds:
                draw_times(plan.folder / CURVES, title, plan.bounds, points)
            else:
                draw_curves(plan.folder / CURVES, title, plan.options.rank_by, points)
            if plan.space and plan.bounds:
                draw_search(plan.folder / SEARCH, title, "training [s]", points, seconds_of)
            elif plan.space:
                draw_search(plan.folder / SEARCH, title, plan.options.rank_by, points)

    def _keys(self) -> list[str]:
        plan = self._plan
        return list(plan.space) or list(plan.points[0][0])

    def ranking(self) -> list[RankedPoint]:
        """Return the points, the best first."""
        return ranking(self.results)

    def content(self) -> dict[str, Any]:
        """Return the keys of ``--json`` and ``results.json``."""
        results = self.results
        ranked = self.ranking()
        return {
            "task": self._plan.task,
            "folder": str(self._plan.folder),
            "rank_by": self._plan.options.rank_by,
            "until": [bound.text for bound in self._plan.bounds],
            "keys": self._keys(),
            "seeds": self._plan.seeds,
            "runs": [result.as_json() for result in results],
            "ranking": [
                point.as_json(index + 1 if point.interval is not None else None) for index, point in enumerate(ranked)
            ],
            "failed": [
                {"run": str(result.record.run.folder.path), "name": result.record.run.name, **_why(result.record)}
                for result in results
                if result.record.state is RunState.FAILED
            ],
        }

    def print_to(self, console: Console) -> None:
        """Print the ranking, and where things are; failures go to standard error."""
        console.print(self._table())
        folder = self._plan.folder
        for name, word in ((CURVES, "curves"), (SEARCH, "search"), (RESULTS, "results")):
            if (folder / name).is_file() and (name != SEARCH or self._plan.space):
                console.print(f"{word:<8}  {folder / name}", highlight=False, soft_wrap=True)
        failed = [result.record for result in self.results if result.record.state is RunState.FAILED]
        for record in failed:
            print(f"simwarp: run {record.run.folder.path} failed: {record.reason}", file=sys.stderr)
        left = self._plan.total - len(self._ended)
        if left > 0:  # a search that had more --trials before keeps all of them
            words = f"{left} of {self._plan.total} runs are not finished: the same command goes on with them"
            console.print(words, highlight=False, soft_wrap=True)
        if any(record.kept for record in failed):
            console.print("failed runs are tried again with --retry", highlight=False, soft_wrap=True)

    def _table(self) -> Table:
        bounds = self._plan.bounds
        table = Table(title=f"by {self._plan.measure}, median over seeds", box=None, title_justify="left")
        table.add_column("rank", justify="right")
        for key in self._keys() or ["point"]:
            table.add_column(key, overflow="fold")
        for column in ("median", "interval", "worst", "best", *(["reached"] if bounds else ()), "seeds", "failed"):
            table.add_column(column, justify="right")
        text = score_text if bounds else _short
        for index, point in enumerate(self.ranking()):
            known, scores = point.interval, point.scores
            values = [_short(value) for value in point.values.values()] or ["all seeds"]
            if known is None:
                table.add_row("", *values, *[""] * (5 if bounds else 4), str(point.done), "")
                continue
            table.add_row(
                str(index + 1), *values, text(known.median), f"{text(known.low)} .. {text(known.high)}",
                text(min(scores)), text(max(scores)), *([str(point.reached)] if bounds else ()), str(point.done),
                str(point.failed or ""),
            )  # fmt: skip
        return table

    def exit_code(self, interrupted: bool) -> int:
        """Return 0 if all runs are done, 1 if one failed or stopped, 130 after an interruption."""
        states = [result.record.state for result in self.results]
        if len(states) >= self._plan.total and all(state is RunState.DONE for state in states):
            return DONE
        return INTERRUPTED if interrupted else FELL_SHORT


def _why(record: RunRecord) -> dict[str, Any]:
    return {"values": dict(record.run.values), "seed": record.run.seed, "reason": record.reason}


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else "-"
    return "x".join(map(str, value)) if isinstance(value, list) else str(value)
