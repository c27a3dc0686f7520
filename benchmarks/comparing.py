"""Comparisons of ways to train: the same seeds and budget for each, trained as a sweep, reported with intervals.

What the scripts share that compare: each is a table of arms and what it reports of them. A run is an ordinary run
folder. Its result is one JSON file, after which the folder may go; a run whose file exists is skipped, one that was
interrupted or killed goes on from its last checkpoint.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter
from rich.console import Console
from scipy import stats

from simwarp.bench.machine import describe
from simwarp.cli import UsageError
from simwarp.core.files import FileError, OutputError
from simwarp.core.stopping import stop_on_signals
from simwarp.core.warp_start import start_warp
from simwarp.tasks import InputError, TaskConfig, config_to_plain, make, replace_fields, task_class
from simwarp.train.algorithm.learner import TrainingError
from simwarp.train.config import LoggerKind, TrainConfig, default_config
from simwarp.train.evaluation.evaluation import Evaluation, evaluate
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.run_files import write_json
from simwarp.train.runs.run_folder import RunFolder, git_revision
from simwarp.train.runs.run_lock import writing
from simwarp.train.sweeps.launchers import LocalLauncher
from simwarp.train.sweeps.plan import SweepRun, run_name
from simwarp.train.sweeps.ranking import REWARD, result_of
from simwarp.train.sweeps.run_state import RunRecord, RunState
from simwarp.train.sweeps.running import RunList, SweepRunner, check_runs
from simwarp.train.sweeps.sweep_display import SweepDisplay

ROOT = Path(__file__).resolve().parents[1]
EVALUATION_SEED = 1_000_003
CONFIDENCE = 0.95
BAND_SEEDS = 5
"""The fewest seeds that a band is drawn of: that of three is two and a half standard deviations wide on each side."""
Result = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Arm:
    """One of the ways that are compared.

    Attributes:
        label: name in the picture.
        against: name of the arm it is compared with; empty: none.
        train: changed fields of the training configuration.
        task: changed fields of the task's configuration; a function takes the budget and returns the value.
        colour: of its curve.
        line: style of its curve.
    """

    label: str
    against: str = ""
    train: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    task: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    colour: str = "tab:blue"
    line: str = "-"


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A number of each run.

    Attributes:
        heading: of its column.
        source: key of the final evaluation; empty: the area under the learning curve.
        digits: shown after the point.
    """

    heading: str
    source: str
    digits: int


RETURN = Quantity("return", "mean_return", 0)
SUCCESS = Quantity("success", "success_rate", 2)
AREA = Quantity("area under the curve", "", 0)
"""Of the learning curve, divided by the steps: the mean return over training."""


@dataclasses.dataclass(frozen=True)
class Budget:
    """Training and evaluation of every run of a study.

    Attributes:
        iterations: of training.
        num_envs: worlds of training.
        episodes: of each evaluation.
        evaluations: of policies on their way, the final one among them; 0: the final one alone, and the learning curve
            is that of training. Where the worlds of training differ, only evaluations compare.
    """

    iterations: int
    num_envs: int
    episodes: int
    evaluations: int = 0

    def plain(self) -> dict[str, int]:
        """Return it as results keep it."""
        content = dataclasses.asdict(self)
        return content if self.evaluations else {key: content[key] for key in content if key != "evaluations"}


@dataclasses.dataclass(frozen=True)
class Study:
    """Ways to train that are compared.

    Attributes:
        task: a registered task.
        arms: configurations that are compared, by name.
        budget: of every run.
        quantities: reported quantities of a run, by the key in its result.
        title: of the tables, and of its panel in a picture.
        config: fields of the task's configuration that all arms share.
        train: fields of the training configuration that all arms share, where they are not the task's defaults.
        evaluation: fields of the task's configuration that all arms are evaluated with, whatever they train with.
        out: folder of the results.
        runs: folder of the run folders.
        seeds: 0, 1, ... of each arm.
        device: device of the training.
        jobs: trainings at a time, one thread each.
    """

    task: str
    arms: Mapping[str, Arm]
    budget: Budget
    quantities: Mapping[str, Quantity]
    title: str
    config: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    train: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    evaluation: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    out: Path = Path()
    runs: Path = Path("runs")
    seeds: int = 1
    device: str = "cpu"
    jobs: int = 1

    def asked(self, options: argparse.Namespace, name: str = "") -> Study:
        """Return it with the budget and the folders of the command line, of :func:`study_parser`.

        Args:
            options: that were read.
            name: of its folders within those that are given.
        """
        names = [field.name for field in dataclasses.fields(Budget)]
        given = {key: value for key in names if (value := getattr(options, key, None)) is not None}
        if not self.budget.evaluations:
            given.pop("evaluations", None)
        return dataclasses.replace(
            self, budget=dataclasses.replace(self.budget, **given), out=options.out / name, runs=options.runs / name,
            seeds=options.seeds, device=options.device, jobs=options.jobs,
        )  # fmt: skip

    def settings(self, name: str, seed: int) -> tuple[TrainConfig, TaskConfig]:
        """Return the training and the task configuration of a run."""
        kind, arm, budget = task_class(self.task), self.arms[name], self.budget
        fields = {key: value(budget) if callable(value) else value for key, value in arm.task.items()}
        config = replace_fields(kind.config_type(), {**self.config, **fields})
        common = {
            "iterations": budget.iterations,
            "num_envs": budget.num_envs,
            "device": self.device,
            "seed": seed,
            "logger": LoggerKind.CSV,
            "threads": 1,  # equal on all machines, and several runs side by side leave each other alone
        }
        if budget.evaluations:
            common |= {"save_interval": max(1, budget.iterations // budget.evaluations), "keep_checkpoints": 0}
        return replace_fields(default_config(kind, config), {**common, **self.train, **arm.train}), config

    def result_path(self, name: str, seed: int) -> Path:
        """Return the path of a run's result."""
        return self.out / f"{name}-{seed}.json"

    def wanted(self) -> list[tuple[str, int]]:
        """Return arm and seed of all runs, seed by seed, so that an early stop leaves whole pairs."""
        return [(name, seed) for seed in range(self.seeds) for name in self.arms]

    def missing(self) -> list[tuple[str, int]]:
        """Return the runs without a result."""
        return [pair for pair in self.wanted() if not self.result_path(*pair).is_file()]


@dataclasses.dataclass(frozen=True)
class Interval:
    """A mean over seeds and the half-width of its confidence interval; NaN for a single seed."""

    mean: float
    half: float

    def text(self, digits: int = 1) -> str:
        """Return ``mean ± half``."""
        return f"{self.mean:.{digits}f} ± {self.half:.{digits}f}"


def interval(values: list[float]) -> Interval:
    """Return mean and half-width of Student's 95 % interval."""
    if len(values) < 2:
        return Interval(float(np.mean(values)), math.nan)
    deviation = float(np.std(values, ddof=1))
    return Interval(float(np.mean(values)), t_quantile(len(values)) * deviation / math.sqrt(len(values)))


def t_quantile(count: int) -> float:
    """Return the two-sided 95 % quantile of Student's t for ``count`` values."""
    return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1))


# ---- one run -----------------------------------------------------------------------------------------------------


def learning_curve(record: RunRecord) -> tuple[dict[str, list[float]], float]:
    """Return a run's curve by column, and the seconds its iterations took."""
    results = {column: result_of(record, column, ()) for column in (REWARD, "mean_episode_length")}
    curve = {"env_steps": results[REWARD].steps}
    for column, found in results.items():
        # Nothing is known before the first episode ends: the first value stands for what came before it
        values = np.array(found.curve)
        known = np.flatnonzero(np.isfinite(values))
        values[: known[0] if len(known) else 0] = values[known[0]] if len(known) else 0.0
        curve[column] = [round(float(value), 4) for value in values]
    return curve, results[REWARD].train_s


def area(curve: dict[str, list[float]]) -> float:
    """Return the area under the curve of the return, divided by the steps: the mean return over training."""
    steps, values = np.array(curve["env_steps"]), np.array(curve["mean_reward"])
    if len(steps) < 2:
        return float(values.mean())
    return float(np.trapezoid(values, steps) / (steps[-1] - steps[0]))


def assess(study: Study, run: SweepRun, task_config: TaskConfig) -> dict[int, Evaluation]:
    """Return statistics over fresh worlds, of the final policy or of several, by their iterations."""
    config, path = run.config, run.folder.checkpoint_path
    iterations = [config.iterations]
    if study.budget.evaluations:
        last = range(config.save_interval, config.iterations, config.save_interval)
        iterations = [*[iteration for iteration in last if path(iteration).is_file()], *iterations]
    episodes = study.budget.episodes
    task = make(study.task, episodes, device=study.device, seed=EVALUATION_SEED, config=task_config)
    found = {}
    for iteration in iterations:
        policy = network_policy(load_checkpoint(path(iteration)), task)
        found[iteration] = evaluate(task, policy, episodes, EVALUATION_SEED)
    return found


def conclude(study: Study, name: str, record: RunRecord) -> None:
    """Evaluate a run of an arm that was trained, and write its result."""
    run = record.run
    config, task_config = run.config, run.task_config
    curve, wall = learning_curve(record)
    evaluated = replace_fields(task_config, study.evaluation)
    evaluations = assess(study, run, evaluated)
    content: Result = {
        "configuration": name,
        "seed": run.seed,
        "budget": study.budget.plain(),
        "command": shlex.join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *sys.argv[1:]]),
        "revision": git_revision().get("revision"),
        "machine": describe(wp.get_device(config.device)),
        "wall_s": round(wall, 1),
        "evaluation": evaluations[config.iterations].as_json(),
        "task": study.task,
        "train_config": config_to_plain(config),
        "task_config": config_to_plain(task_config),
        "curve": curve,
    }
    if study.evaluation:
        content["evaluation_config"] = config_to_plain(evaluated)
    if study.budget.evaluations:
        batch = config.num_envs * config.steps_per_iteration
        content["evaluations"] = {
            "env_steps": [float(batch * iteration) for iteration in evaluations],
            "mean_reward": [round(found.mean_return, 4) for found in evaluations.values()],
            "success_rate": [found.success_rate for found in evaluations.values()],
        }
    for key, quantity in study.quantities.items():
        content[key] = content["evaluation"][quantity.source] if quantity.source else area(learning_curve_of(content))
    write_json(study.result_path(name, run.seed), content)


def learning_curve_of(result: Result) -> dict[str, list[float]]:
    """Return a result's learning curve: of the evaluations on the way, or else of training."""
    curve: dict[str, list[float]] = result["evaluations" if "evaluations" in result else "curve"]
    return curve


# ---- all runs ----------------------------------------------------------------------------------------------------


def sweep_run(study: Study, name: str, seed: int) -> SweepRun:
    """Return the training of a run as sweeps know it."""
    config, task_config = study.settings(name, seed)
    label = f"{name}-{config.num_envs}x{config.iterations}"
    return SweepRun(label, {"arm": name}, config, task_config, RunFolder(study.runs / run_name(label, seed)))


def train(
    study: Study, wanted: Sequence[tuple[str, int]], console: Console, conclude: Callable[[str, RunRecord], None]
) -> None:
    """Train runs as a sweep, or go on with those that were interrupted.

    Args:
        study: what they are of.
        wanted: arms and seeds, in the order in which they begin.
        console: for the output.
        conclude: called with the arm and the record of each run that is trained.

    Raises:
        InputError: a folder holds a run of another configuration, or another process trains this study.
        KeyboardInterrupt: someone asked to stop; what was learnt is saved.
        TrainingError: runs failed; the others are concluded.
    """
    if not wanted:
        return
    console.print(f"{study.title}: {len(wanted)} runs are missing", highlight=False)
    runs = [sweep_run(study, *pair) for pair in wanted]

    def after(record: RunRecord) -> None:
        if record.state is RunState.DONE:
            conclude(record.run.values["arm"], record)

    check_runs(study.task, runs)
    study.runs.mkdir(parents=True, exist_ok=True)
    with writing(study.runs), SweepDisplay(console, len(runs), study.jobs) as display, stop_on_signals() as stop:
        runner = SweepRunner(
            study.task, RunList(runs), LocalLauncher(study.task),
            jobs=study.jobs, watcher=display, retry=True, after=after,
        )  # fmt: skip
        runner.run(stop)
    failed = [f"{record.run.name}: {record.reason}" for record in runner.records if record.state is RunState.FAILED]
    if failed:
        raise TrainingError(f"{len(failed)} runs failed: {'; '.join(failed)}")
    if sum(record.state is RunState.DONE for record in runner.records) < len(runs):
        raise KeyboardInterrupt


def run_missing(study: Study, console: Console) -> None:
    """Do the runs that have no result yet; raises what :func:`train` does."""
    study.out.mkdir(parents=True, exist_ok=True)
    train(study, study.missing(), console, lambda name, record: conclude(study, name, record))


# ---- what came out -----------------------------------------------------------------------------------------------


def load(study: Study) -> dict[str, list[Result]]:
    """Return the results by arm, in the order of seeds.

    Raises:
        InputError: a result was made with another budget.
    """
    results: dict[str, list[Result]] = {}
    for name in study.arms:
        paths = [study.result_path(name, seed) for seed in range(study.seeds)]
        results[name] = [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.is_file()]
        for result in results[name]:
            if result["budget"] != study.budget.plain():
                file = study.result_path(name, result["seed"])
                raise InputError(f"{file} was made with the budget {result['budget']}: give another --out")
    return results


def summarise(
    results: Mapping[str, list[Result]], arms: Mapping[str, Arm], quantities: Mapping[str, Quantity]
) -> dict[str, Any]:
    """Return means over seeds, and differences from the arm compared with, paired by seed, with 95 % half-widths."""
    summary: dict[str, Any] = {"means": {}, "differences": {}, "wall_s": {}}
    for name, runs in results.items():
        if not runs:
            continue
        summary["wall_s"][name] = [run["wall_s"] for run in runs]
        summary["means"][name] = {
            key: dataclasses.asdict(interval([run[key] for run in runs])) | {"values": [run[key] for run in runs]}
            for key in quantities
        }
        others = {run["seed"]: run for run in results.get(arms[name].against, [])}
        pairs = [(run, others[run["seed"]]) for run in runs if run["seed"] in others]
        if not pairs:
            continue
        summary["differences"][name] = {
            key: dataclasses.asdict(interval([run[key] - other[key] for run, other in pairs])) for key in quantities
        }
    return summary


def write_summary(study: Study, results: Mapping[str, list[Result]]) -> dict[str, Any]:
    """Write ``summary.json`` and return what is in it."""
    summary = {"budget": study.budget.plain()} | summarise(results, study.arms, study.quantities)
    write_json(study.out / "summary.json", summary)
    return summary


def table(rows: Mapping[str, Any], heading: str, quantities: Mapping[str, Quantity]) -> str:
    """Return a Markdown table of intervals."""
    headings = [quantity.heading for quantity in quantities.values()]
    lines = [" | ".join(["", heading, *headings, ""]).strip(), "|" + "---|" * (1 + len(quantities))]
    for name, row in rows.items():
        cells = [
            Interval(row[key]["mean"], row[key]["half"]).text(quantity.digits) for key, quantity in quantities.items()
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def band(runs: list[Result]) -> tuple[npt.NDArray[np.float64], ...]:
    """Return steps, mean return and the half-width of its 95 % interval, each (points of the curve,)."""
    values = np.array([learning_curve_of(run)["mean_reward"] for run in runs])
    half = np.zeros(values.shape[1])
    if len(runs) > 1:
        half = t_quantile(len(runs)) * values.std(axis=0, ddof=1) / math.sqrt(len(runs))
    return np.array(learning_curve_of(runs[0])["env_steps"]), values.mean(axis=0), half


def draw_panel(axes: Axes, curves: list[tuple[list[Result], Arm]]) -> None:
    """Draw mean return over environment steps of the arms that have results.

    Around it lies its 95 % band, or, of fewer than ``BAND_SEEDS`` seeds, each seed's own curve.
    """
    for runs, arm in curves:
        if not runs:
            continue
        steps, mean, half = band(runs)
        marker = "o" if "evaluations" in runs[0] else ""
        axes.plot(steps, mean, color=arm.colour, linestyle=arm.line, marker=marker, markersize=3, label=arm.label)
        if len(runs) >= BAND_SEEDS:
            axes.fill_between(steps, mean - half, mean + half, color=arm.colour, alpha=0.25, linewidth=0)
            continue
        for run in runs:
            values = learning_curve_of(run)["mean_reward"]
            axes.plot(steps, values, color=arm.colour, linestyle=arm.line, linewidth=0.6, alpha=0.6)
    axes.set_xlabel("environment steps")
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.grid(alpha=0.3)


# ---- the command line --------------------------------------------------------------------------------------------


def study_parser(about: str | None, *, seeds: int, results: str, runs: str, picture: str) -> argparse.ArgumentParser:
    """Return the options that all comparisons have.

    Args:
        about: what the script does.
        seeds: of each arm, by default.
        results: folder of the results, under `benchmarks/results`.
        runs: folder of the run folders, under `runs`.
        picture: name in `docs/images`.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=seeds, help="seeds 0, 1, ... of each arm")
    parser.add_argument("--iterations", type=int, help="training iterations of every run")
    parser.add_argument("--num-envs", type=int, help="worlds of every run")
    parser.add_argument("--episodes", type=int, help="episodes of every evaluation")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--jobs", type=int, default=1, help="trainings at a time, one thread each")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results" / results, help="results")
    parser.add_argument("--runs", type=Path, default=Path("runs") / runs, help="run folders")
    parser.add_argument("--plot", action="store_true", help="draw the learning curves")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "images" / picture)
    parser.add_argument("--report-only", action="store_true", help="no new runs: what is there is reported")
    return parser


def read_options(parser: argparse.ArgumentParser, arguments: list[str]) -> argparse.Namespace:
    """Read the options; numbers that are below 1 are refused."""
    options = parser.parse_args(arguments)
    for name, value in vars(options).items():
        if isinstance(value, int) and not isinstance(value, bool) and value < 1:
            parser.error(f"--{name.replace('_', '-')} must be at least 1")
    return options


def chosen(parser: argparse.ArgumentParser, option: str, given: str, known: Mapping[str, Any]) -> list[str]:
    """Return the names in a list by comma, each of which must be known."""
    names = given.split(",")
    unknown = set(names) - set(known)
    if unknown:
        parser.error(f"{option}: {', '.join(sorted(unknown))} not among {', '.join(known)}")
    return names


def report(study: Study, results: Mapping[str, list[Result]]) -> None:
    """Print the tables of a study, and write its summary."""
    summary = write_summary(study, results)
    print(f"{study.title}\n")
    print(table(summary["means"], f"mean of {study.seeds} seeds, 95 %", study.quantities) + "\n")
    if summary["differences"]:
        rows = {f"{arm} minus {study.arms[arm].against}": row for arm, row in summary["differences"].items()}
        print(table(rows, "paired by seed", study.quantities) + "\n")


def carry_out(
    studies: Mapping[str, Study],
    options: argparse.Namespace,
    draw: Callable[[Mapping[str, Study], Mapping[str, dict[str, list[Result]]], Path], None],
) -> int:
    """Do the runs of studies that are missing, report all, and draw them where asked for.

    Args:
        studies: by name.
        options: of :func:`study_parser`.
        draw: given the studies, their results by arm, and the picture.
    """
    start_warp()
    for study in studies.values():
        load(study)  # a foreign budget is told before hours of work
    if not options.report_only:
        for study in studies.values():
            run_missing(study, Console(stderr=True))
    results = {name: found for name, study in studies.items() if any((found := load(study)).values())}
    if not results:
        raise InputError(f"there are no results in {options.out}")
    for name, found in results.items():
        report(studies[name], found)
    if options.plot:
        options.picture.parent.mkdir(parents=True, exist_ok=True)
        draw(studies, results, options.picture)
        print(options.picture)
    return 0


def exit_code(script: str, work: Callable[[], int]) -> int:
    """Do the work; return its exit code, or that of a user's mistake or of an interruption, after a word on it."""
    try:
        return work()
    except (InputError, FileError, UsageError) as error:
        print(f"{script}: {error}", file=sys.stderr)
        return 2
    except (TrainingError, OutputError) as error:
        print(f"{script}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped; what was learnt is saved, and the same command goes on from there", file=sys.stderr)
        return 130
