"""Learning curves of the driving tasks in one picture, from tables in benchmarks/results/driving.

    python benchmarks/driving_curves.py [RUN ...]

Each RUN, a folder that ``simwarp train`` or ``distill`` made, replaces the table of its task and observations; then the
picture is drawn from all tables: the share of episodes that succeeded while it learnt, exploration included.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from matplotlib.ticker import EngFormatter, PercentFormatter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.comparing import exit_code
from simwarp.tasks import InputError, task_class
from simwarp.train.algorithm.distiller import LESSON
from simwarp.train.evaluation.figure_style import new_figure, save_figure
from simwarp.train.runs.progress_table import read_progress, success_share
from simwarp.train.runs.run_folder import RunFolder, open_run

ROOT = Path(__file__).resolve().parents[1]
TABLES = ROOT / "benchmarks" / "results" / "driving"
PICTURE = ROOT / "docs" / "images" / "driving_learning_curves.png"
COLUMNS = ("iteration", "env_steps", "wall_s", "mean_reward", "mean_episode_length", "episodes", "successes")
COLOURS = {"state": "tab:blue", "camera": "tab:orange", "camera.distilled": "tab:green"}
LABELS = {"camera.distilled": "by camera, from the policy by state"}
EPISODES = 256
"""At least so many episodes are counted together, where a success is told as a number."""
DRAWN_TOGETHER = 16, 256
"""Least and most of them in the picture, where a tenth of all is counted: students live through few long episodes."""


def write_table(run: Path) -> Path:
    """Write what a run's progress says, shortened, and return where.

    Raises:
        InputError: it is of a task without a choice of observations.
    """
    folder = open_run(run)
    saved = folder.load_config()
    kind = ".distilled" if LESSON in saved else ""
    obs = saved["task_config"].get("obs")
    if obs is None:
        raise InputError(f"{run} is of task '{saved['task']}', which is no driving task")
    path = TABLES / f"{saved['task']}.{obs}{kind}.csv"
    write_progress(folder, path)
    return path


def successes_of(row: Mapping[str, str], good: Iterable[str]) -> int:
    """Return how many episodes of an iteration were a success."""
    share = success_share(row, good)
    return 0 if math.isnan(share) else round(share * int(row["episodes"] or 0))


def write_progress(folder: RunFolder, path: Path) -> None:
    """Write the progress of a run, shortened."""
    reasons = task_class(folder.load_config()["task"]).success_reasons
    short = [
        {key: row[key] for key in ("iteration", "env_steps", "episodes")}
        | {key: f"{float(row[key]):.6g}" for key in COLUMNS[2:5]}
        | {"successes": successes_of(row, reasons)}
        for row in read_progress(folder.progress)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(short)


def success(rows: list[dict[str, str]], episodes: int = EPISODES) -> tuple[np.ndarray, np.ndarray]:
    """Return environment steps, and the share of the last ``episodes`` or more that succeeded."""
    steps, ended, good = (np.array([float(row[key]) for row in rows]) for key in ("env_steps", "episodes", "successes"))
    ended, good = (np.concatenate([[0.0], np.cumsum(values)]) for values in (ended, good))
    last = np.arange(1, len(ended))
    first = np.maximum(np.searchsorted(ended, ended[1:] - episodes, side="right") - 1, 0)
    enough = ended[1:] >= episodes
    share = (good[last] - good[first]) / np.maximum(ended[last] - ended[first], 1.0)
    return steps[enough], share[enough]


def draw(picture: Path) -> None:
    """Draw all tables, a panel per task."""
    tables: dict[str, dict[str, Path]] = {}
    for path in sorted(TABLES.glob("*.csv")):
        name, obs = path.stem.split(".", 1)
        tables.setdefault(name, {})[obs] = path
    across = 3
    down = -(-len(tables) // across)
    figure = new_figure(10.0, 2.6 * down)
    for place, (name, paths) in enumerate(tables.items()):
        axes = figure.add_subplot(down, across, place + 1)
        for obs, path in sorted(paths.items(), reverse=True):
            with path.open(encoding="utf-8") as file:
                rows = list(csv.DictReader(file))
            tenth = round(0.1 * sum(float(row["episodes"]) for row in rows))
            axes.plot(
                *success(rows, int(np.clip(tenth, *DRAWN_TOGETHER))),
                color=COLOURS[obs],
                label=LABELS.get(obs, f"by {obs}"),
            )
        axes.set_title(name)
        axes.set_ylim(0.0, 1.02)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.xaxis.set_major_formatter(EngFormatter())
        axes.set_xlabel("environment steps")
        axes.set_ylabel("success")
        axes.grid(alpha=0.3)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower right", bbox_to_anchor=(0.97, 0.15))
    save_figure(figure, picture)


def main() -> int:
    """Read runs, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN")
    for run in parser.parse_args().runs:
        print(write_table(run), file=sys.stderr)
    draw(PICTURE)
    print(PICTURE, file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(exit_code("driving_curves", main))
