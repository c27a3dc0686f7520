"""Success of driving policies over conditions that they were not trained in: one axis at a time, and maps of two.

    python benchmarks/robustness.py obstacle-avoidance off-road                    # the shipped policies by camera
    python benchmarks/robustness.py obstacle-avoidance --policies shipped drawn=runs/obstacle-avoidance/NAME
    python benchmarks/robustness.py off-road --obs state --axes friction mass --maps
    python benchmarks/robustness.py hallway --values 3 --maps                      # coarse: long episodes are dear
    python benchmarks/robustness.py off-road --report-only                         # tables and picture, from the rows
    python benchmarks/robustness.py off-road convoy --summary                      # the worst of each condition

A policy is LABEL=WHERE, WHERE being what `simwarp eval --checkpoint` takes; {task} in it is the task's name. All axes
start from the nominal point, where policies are evaluated by default; `drawn` is a point too, with all conditions
drawn. The same worlds are driven at all points, by all policies.

Rows are written to benchmarks/results/robustness/TASK.OBS.LABEL.csv as points finish. A point that is there, of the
same policy and as many episodes, is not evaluated again; after Ctrl-C the same command goes on. Beside the rows:
TASK.OBS.json with the machine, TASK.OBS.md with the tables, and docs/images/robustness_TASK_OBS.png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import torch
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.comparing import exit_code
from benchmarks.robustness_points import (
    AXES,
    MAPS,
    NOMINAL,
    axes_of_task,
    changed,
    digest_of,
    nominal_config,
    path_of,
    read_rows,
    thinned,
    wanted_points,
    write_row,
)
from benchmarks.robustness_report import SEED, report, summary
from simwarp.core.stopping import stop_on_signals
from simwarp.core.warp_start import start_warp
from simwarp.tasks import make, resolve_device, task_class
from simwarp.tasks.driving import DrivingTask
from simwarp.train.evaluation.grid import (
    EvaluationStoppedError,
    GridDisplay,
    GridPoint,
    GridSettings,
    PointResult,
    evaluate_grid,
)
from simwarp.train.networks.policies import PolicySource, find_policy

EPISODES: Final = {"hallway": 48, "barrier-track": 48, "convoy": 64}
"""Of tasks whose episodes are long; of others `USUAL_EPISODES`."""
USUAL_EPISODES: Final = 128
"""At 95 % the interval is from 90 to 98 %, at 50 % from 41 to 59 %."""
SUN: Final = frozenset({"sun_elevation", "sun_azimuth"})
"""Axes of tasks that have a sun."""


def has_sun(task: str, config: Any) -> bool:
    """Return True if there is a sun in a task's light: one world is built for it."""
    built: Any = make(task, 1, config=config)
    return bool(built.camera.lights.sun_direction.shape[1])


def evaluate_policy(task: str, label: str, where: str, options: argparse.Namespace, console: Console) -> bool:
    """Evaluate a policy at the points that are not there yet; False if it was asked to stop."""
    source = find_policy(task, Path(where.replace("{task}", task)), obs=options.obs)
    config, path = nominal_config(source, task), path_of(task, options.obs, label)
    episodes = options.episodes or EPISODES.get(task, USUAL_EPISODES)
    axes = axes_of_task(task, options.obs, options.axes)
    if SUN & axes.keys() and not has_sun(task, config):
        axes = {name: axis for name, axis in axes.items() if name not in SUN}
    if options.values:
        axes = {name: thinned(axis, options.values) for name, axis in axes.items()}
    points = {
        point: GridPoint(changes or {"conditions": NOMINAL}, changed(config, changes))
        for point, changes in wanted_points(config, axes, options.maps).items()
    }
    settings = GridSettings(
        episodes=episodes, seed=SEED, device=resolve_device(options.device), num_envs=options.num_envs,
        paths_driven=False,
    )  # fmt: skip
    return evaluate_points(task, f"{task}, {label}", source, points, path, settings, console)


def evaluate_points(
    task: str, name: str, source: PolicySource, points: Mapping[str, GridPoint], path: Path, settings: GridSettings,
    console: Console,
) -> bool:  # fmt: skip
    """Evaluate a policy at the points that its file of rows lacks, and add their rows one by one.

    Args:
        task: name of the task.
        name: of the policy, for the output.
        source: the policy.
        points: by their names in the rows.
        path: of the rows.
        settings: of the evaluation.
        console: for the output.

    Returns:
        False if it was asked to stop.
    """
    digest, episodes = digest_of(source), settings.episodes
    there = read_rows(path, digest)
    missing = {
        point: each for point, each in points.items() if point not in there or there[point]["episodes"] < episodes
    }
    console.print(f"{name}: {source.origin}; {len(missing)} points to evaluate", highlight=False)
    if not missing:
        return True
    names = {id(each): point for point, each in missing.items()}
    results: list[PointResult] = []
    written: list[PointResult] = []

    def after() -> None:
        for result in results[len(written) :]:
            write_row(path, digest, names[id(result.point)], result)
            written.append(result)

    wanted = list(missing.values())
    with stop_on_signals() as stop, GridDisplay(console, len(wanted), 1, episodes) as display:
        try:
            evaluate_grid(task, source.policy, wanted, settings, results=results, display=display, stop=stop,
                          after=after)  # fmt: skip
        except EvaluationStoppedError as stopped:
            console.print(f"stopped at {stopped.where}; the same command goes on", highlight=False)
            return False
    return True


def policy_word(text: str) -> tuple[str, str]:
    """Return label and place of ``LABEL=WHERE``; a place alone is its own label."""
    label, equals, where = text.partition("=")
    if not equals:
        return Path(text).name, text
    if not label or not where or "/" in label:
        raise argparse.ArgumentTypeError(f"must be LABEL=WHERE, got {text!r}")
    return label, where


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluate what is missing, then report; 130 after an interruption."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="+", help="names of driving tasks")
    parser.add_argument("--policies", nargs="+", type=policy_word, default=[("shipped", "shipped")])
    parser.add_argument("--obs", choices=("camera", "state"), default="camera")
    parser.add_argument("--axes", nargs="*", choices=tuple(AXES), default=tuple(AXES))
    parser.add_argument(
        "--values", type=int, choices=range(2, 10), metavar="N", help="at most, of each axis: 2 or more"
    )
    parser.add_argument("--maps", nargs="*", choices=tuple(MAPS), default=tuple(MAPS))
    parser.add_argument("--episodes", type=int, help="of each point; by default 128, fewer where they are long")
    parser.add_argument("--num-envs", type=int, help="worlds stepped together; by default one per episode")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--summary", action="store_true", help="the least success along each condition, from the rows")
    parser.add_argument("--report-only", action="store_true")
    options = parser.parse_args(arguments)
    start_warp()
    torch.set_num_threads(1)
    console = Console(stderr=True)
    device, first = resolve_device(options.device), [label for label, _ in options.policies]
    for task in options.tasks:
        if not issubclass(task_class(task), DrivingTask):
            parser.error(f"{task} is no driving task")
    if options.episodes is not None and options.episodes < 1:
        parser.error(f"--episodes must be at least 1, got {options.episodes}")
    if options.summary:
        print(summary(options.tasks, options.obs, first))
        return 0
    for task in options.tasks:
        for label, where in () if options.report_only else options.policies:
            if not evaluate_policy(task, label, where, options, console):
                report(task, options.obs, first, device, console)
                return 130
        report(task, options.obs, first, device, console, again=options.report_only)
    return 0


if __name__ == "__main__":
    sys.exit(exit_code("robustness", main))
