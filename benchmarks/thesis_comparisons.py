"""The thesis's comparisons on the ant: scaled observations, Euler angles or a quaternion, clipping or a KL penalty.

    python benchmarks/thesis_comparisons.py [--seeds 5] [--iterations 75] [--plot] [--report-only]

Four configurations that share the baseline, each with the same seeds and budget, one run at a time:

    baseline     observations normalised by their running mean and deviation, Euler angles, clipped ratio
    unscaled     observations in SI units as they are
    quaternion   orientation observed as a quaternion
    kl-penalty   penalty on the KL divergence in place of the clipped ratio

Each run leaves one JSON file in --out. Runs whose file exists are skipped; Ctrl-C saves the running one, and the same
command goes on from there. When all are done, tables go to standard output and to summary.json: means over seeds with
95 % confidence intervals (Student's t), and differences from the baseline, paired by seed.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from rich.console import Console
from scipy import stats
from simwarp.tasks import InputError, TaskConfig, make, replace_fields, task_class
from simwarp.tasks.ant import Orientation
from simwarp.train.checkpoint import load_checkpoint
from simwarp.train.config import LoggerKind, Objective, TrainConfig, default_config, to_plain
from simwarp.train.evaluation import evaluate
from simwarp.train.policies import network_policy
from simwarp.train.run_folder import RunFolder, git_revision, latest_run, read_progress, write_json
from simwarp.train.training import train

from simwarp.cli.bench.machine import describe
from simwarp.cli.quiet import start_warp

ROOT = Path(__file__).resolve().parents[1]
TASK = "ant"
BASELINE = "baseline"
EVALUATION_SEED = 1_000_003
CONFIDENCE = 0.95
QUANTITIES = {
    "final_return": "return",
    "final_distance": "distance in 10 s [m]",
    "success_rate": "success",
    "area": "area under the curve",
}
"""Key of a run's numbers -> heading of its column; the area is the mean return over all training steps."""


@dataclasses.dataclass(frozen=True)
class Configuration:
    """What differs from the baseline.

    Attributes:
        label: what the picture calls it.
        versus: what the picture calls the baseline beside it.
        train: changed fields of the training configuration.
        task: changed fields of the task's configuration.
    """

    label: str
    versus: str = ""
    train: dict[str, Any] = dataclasses.field(default_factory=dict)
    task: dict[str, Any] = dataclasses.field(default_factory=dict)


CONFIGURATIONS = {
    BASELINE: Configuration("baseline"),
    "unscaled": Configuration("unscaled", "scaled", train={"network.normalise": False}),
    "quaternion": Configuration("quaternion", "Euler angles", task={"orientation": Orientation.QUATERNION}),
    "kl-penalty": Configuration("KL penalty", "clipping", train={"ppo.objective": Objective.KL_PENALTY}),
}


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


def settings(options: argparse.Namespace, configuration: Configuration, seed: int) -> tuple[TrainConfig, TaskConfig]:
    """Return the training and the task configuration of a run."""
    kind = task_class(TASK)
    common = {
        "iterations": options.iterations,
        "num_envs": options.num_envs,
        "device": options.device,
        "seed": seed,
        "logger": LoggerKind.CSV,
    }
    config = replace_fields(default_config(kind), common | configuration.train)
    return config, replace_fields(kind.config_type(), configuration.task)


def learning_curve(folder: RunFolder) -> tuple[dict[str, list[float]], float]:
    """Return a run's curve by column, and the seconds its iterations took."""
    rows = read_progress(folder.progress)
    steps = [int(row["env_steps"]) for row in rows]
    speeds = [float(row["env_steps_per_s"]) for row in rows]
    wall = sum(part / speed for part, speed in zip(np.diff([0, *steps]), speeds, strict=True))
    curve: dict[str, list[float]] = {"env_steps": [float(count) for count in steps]}
    for column in ("mean_reward", "mean_episode_length"):
        # Nothing is known before the first episode ends: the first value stands for what came before it
        values = np.array([float(row[column]) for row in rows])
        known = np.flatnonzero(np.isfinite(values))
        values[: known[0] if len(known) else 0] = values[known[0]] if len(known) else 0.0
        curve[column] = [round(float(value), 4) for value in values]
    return curve, float(wall)


def area(curve: dict[str, list[float]]) -> float:
    """Return the area under the curve of the return, divided by the steps: the mean return over training."""
    steps, values = np.array(curve["env_steps"]), np.array(curve["mean_reward"])
    if len(steps) < 2:
        return float(values.mean())
    return float(np.trapezoid(values, steps) / (steps[-1] - steps[0]))


def assess(options: argparse.Namespace, folder: RunFolder, task_config: TaskConfig) -> dict[str, Any]:
    """Return statistics of the final policy over fresh worlds."""
    task = make(TASK, options.episodes, device=options.device, seed=EVALUATION_SEED, config=task_config)
    policy = network_policy(load_checkpoint(folder.latest_checkpoint()), task)
    return evaluate(task, policy, options.episodes, EVALUATION_SEED).as_json()


def run(options: argparse.Namespace, name: str, seed: int, console: Console) -> None:
    """Train, evaluate and write the result of one run, or go on with one that was interrupted.

    Raises:
        KeyboardInterrupt: someone asked to stop; what was learnt is saved.
    """
    config, task_config = settings(options, CONFIGURATIONS[name], seed)
    root = options.runs / f"{name}-{seed}-{config.num_envs}x{config.iterations}"
    folder = latest_run(root, TASK)
    done = load_checkpoint(folder.latest_checkpoint())["iteration"] if folder is not None else 0
    if done < config.iterations:
        result = train(
            TASK, config, task_config, root=root, resume=folder.path if folder is not None else None, console=console
        )
        if result.interrupted:
            raise KeyboardInterrupt
        folder = RunFolder(Path(result.run))
    assert folder is not None
    curve, wall = learning_curve(folder)
    evaluation = assess(options, folder, task_config)
    machine = describe(wp.get_device(options.device))
    content = {
        "configuration": name,
        "seed": seed,
        "budget": budget(options),
        "command": shlex.join(["python", "benchmarks/thesis_comparisons.py", *sys.argv[1:]]),
        "revision": git_revision().get("revision"),
        "machine": machine,
        "wall_s": round(wall, 1),
        "final_return": evaluation["mean_return"],
        "final_distance": evaluation["distance"],
        "success_rate": evaluation["success_rate"],
        "area": area(curve),
        "evaluation": evaluation,
        "train_config": to_plain(config),
        "task_config": to_plain(task_config),
        "curve": curve,
    }
    write_json(result_path(options, name, seed), content)


def budget(options: argparse.Namespace) -> dict[str, int]:
    """Return what every run gets."""
    return {"iterations": options.iterations, "num_envs": options.num_envs, "episodes": options.episodes}


def result_path(options: argparse.Namespace, name: str, seed: int) -> Path:
    """Return where a run's result is written."""
    path: Path = options.out / f"{name}-{seed}.json"
    return path


def run_all(options: argparse.Namespace, console: Console) -> None:
    """Do the runs that have no result yet, seed by seed, so that an early stop leaves whole pairs."""
    wanted = [(name, seed) for seed in range(options.seeds) for name in options.configurations]
    missing = [pair for pair in wanted if not result_path(options, *pair).is_file()]
    for index, (name, seed) in enumerate(missing):
        console.print(f"{name}, seed {seed}: run {index + 1} of {len(missing)} that are missing", highlight=False)
        run(options, name, seed, console)


# ---- what came out -----------------------------------------------------------------------------------------------


def load(options: argparse.Namespace) -> dict[str, list[dict[str, Any]]]:
    """Return the results by configuration, in the order of seeds.

    Raises:
        InputError: a result was made with another budget.
    """
    results: dict[str, list[dict[str, Any]]] = {}
    for name in options.configurations:
        paths = [result_path(options, name, seed) for seed in range(options.seeds)]
        results[name] = [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.is_file()]
        for result in results[name]:
            if result["budget"] != budget(options):
                file = result_path(options, name, result["seed"])
                raise InputError(f"{file} was made with the budget {result['budget']}: give another --out")
    return results


def summarise(results: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return means over seeds, and differences from the baseline paired by seed, with 95 % half-widths."""
    summary: dict[str, Any] = {"means": {}, "differences": {}, "wall_s": {}}
    baseline = {run["seed"]: run for run in results.get(BASELINE, [])}
    for name, runs in results.items():
        if not runs:
            continue
        summary["wall_s"][name] = [run["wall_s"] for run in runs]
        summary["means"][name] = {
            key: dataclasses.asdict(interval([run[key] for run in runs])) | {"values": [run[key] for run in runs]}
            for key in QUANTITIES
        }
        pairs = [(run, baseline[run["seed"]]) for run in runs if run["seed"] in baseline]
        if name == BASELINE or not pairs:
            continue
        summary["differences"][name] = {
            key: dataclasses.asdict(interval([run[key] - base[key] for run, base in pairs])) for key in QUANTITIES
        }
    return summary


def table(rows: dict[str, Any], heading: str) -> str:
    """Return a Markdown table of intervals."""
    lines = [" | ".join(["", heading, *QUANTITIES.values(), ""]).strip(), "|" + "---|" * (1 + len(QUANTITIES))]
    for name, row in rows.items():
        cells = [
            Interval(row[key]["mean"], row[key]["half"]).text(2 if key in ("final_distance", "success_rate") else 0)
            for key in QUANTITIES
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def band(runs: list[dict[str, Any]]) -> tuple[npt.NDArray[np.float64], ...]:
    """Return steps, mean return and the half-width of its 95 % interval, each (iterations,)."""
    values = np.array([run["curve"]["mean_reward"] for run in runs])
    half = np.zeros(values.shape[1])
    if len(runs) > 1:
        half = t_quantile(len(runs)) * values.std(axis=0, ddof=1) / math.sqrt(len(runs))
    return np.array(runs[0]["curve"]["env_steps"]), values.mean(axis=0), half


def draw(results: dict[str, list[dict[str, Any]]], picture: Path) -> None:
    """Draw one panel per comparison: mean return over environment steps with its 95 % band."""
    compared = [name for name in results if name != BASELINE and results[name]]
    figure = Figure(figsize=(4.0 * max(1, len(compared)), 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    first = None
    for column, name in enumerate(compared):
        axes = figure.add_subplot(1, len(compared), column + 1, sharey=first)
        first = first or axes
        configuration = CONFIGURATIONS[name]
        shown = [(BASELINE, configuration.versus, "tab:blue"), (name, configuration.label, "tab:orange")]
        for key, label, colour in shown:
            if not results.get(key):
                continue
            steps, mean, half = band(results[key])
            axes.plot(steps, mean, color=colour, label=label)
            axes.fill_between(steps, mean - half, mean + half, color=colour, alpha=0.25, linewidth=0)
        axes.set_xlabel("environment steps")
        axes.xaxis.set_major_formatter(EngFormatter())
        axes.grid(alpha=0.3)
        axes.legend(loc="upper left")
        if column == 0:
            axes.set_ylabel("mean return")
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=110)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read the options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="seeds 0, 1, ... of each configuration")
    parser.add_argument("--iterations", type=int, default=75, help="training iterations of every run")
    parser.add_argument("--num-envs", type=int, default=512, help="worlds of every run")
    parser.add_argument("--episodes", type=int, default=64, help="evaluation episodes of every final policy")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--configurations", default=",".join(CONFIGURATIONS), help="which ones, by comma")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results" / "thesis", help="results")
    parser.add_argument("--runs", type=Path, default=Path("runs") / "thesis", help="run folders")
    parser.add_argument("--plot", action="store_true", help="draw the learning curves")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "images" / "thesis_comparisons.png")
    parser.add_argument("--report-only", action="store_true", help="no new runs: what is there is reported")
    options = parser.parse_args(arguments)
    options.configurations = options.configurations.split(",")
    unknown = set(options.configurations) - set(CONFIGURATIONS)
    if unknown:
        parser.error(f"--configurations: {', '.join(sorted(unknown))} not among {', '.join(CONFIGURATIONS)}")
    for name in ("seeds", "iterations", "num_envs", "episodes"):
        if getattr(options, name) < 1:
            parser.error(f"--{name.replace('_', '-')} must be at least 1")
    return options


def main() -> int:
    options = parse(sys.argv[1:])
    console = Console(stderr=True)
    start_warp()
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        load(options)  # a foreign budget is told before hours of work
        if not options.report_only:
            run_all(options, console)
        results = load(options)
    except InputError as error:
        print(f"thesis_comparisons: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; what was learnt is saved, and the same command goes on from there", file=sys.stderr)
        return 130
    if not any(results.values()):
        print(f"thesis_comparisons: there are no results in {options.out}", file=sys.stderr)
        return 2
    summary = summarise(results)
    write_json(options.out / "summary.json", {"budget": budget(options)} | summary)
    print(table(summary["means"], f"mean of {options.seeds} seeds, 95 %"))
    if summary["differences"]:
        print("\n" + table(summary["differences"], "minus the baseline, paired"))
    if options.plot:
        draw(results, options.picture)
        print(f"\n{options.picture}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
