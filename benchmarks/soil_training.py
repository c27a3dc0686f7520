"""One policy for rigid ground to soft soil, beside one that was trained on rigid ground alone: off-road by exact state.

    simwarp train off-road --obs state --seed 0 --task.soil random --runs random
    simwarp train off-road --obs state --seed 0 --runs rigid
    python benchmarks/soil_training.py --random RUN ... --rigid RUN ...
    python benchmarks/soil_training.py                # the picture again, from the tables

Each RUN is a folder that ``simwarp train`` made, one of each kind per seed. Its final policy plays the same episodes on
every ground. Tables and numbers are written to benchmarks/results/soil, and the picture is drawn from them.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import EngFormatter, PercentFormatter

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.driving_curves import success, write_progress  # noqa: E402
from simwarp.tasks import replace_fields, task_class  # noqa: E402
from simwarp.tasks.driving.soil import SoilKind  # noqa: E402
from simwarp.train.config import task_config_from_plain  # noqa: E402
from simwarp.train.evaluation.evaluation import evaluate_policies  # noqa: E402
from simwarp.train.evaluation.figure_style import new_figure, save_figure  # noqa: E402
from simwarp.train.networks.policies import network_policy  # noqa: E402
from simwarp.train.runs.run_folder import PROVENANCE, open_run  # noqa: E402

RESULTS = ROOT / "benchmarks" / "results" / "soil"
NUMBERS = RESULTS / "success.json"
PICTURE = ROOT / "docs" / "images" / "off_road_soil.png"
ARMS = {"random": "trained on soil, soft to rigid", "rigid": "trained on rigid ground alone"}
COLOURS = {"random": "tab:brown", "rigid": "tab:blue"}
GROUNDS = tuple(kind.value for kind in (
    SoilKind.NONE, SoilKind.HARD, SoilKind.MID, SoilKind.SOFT, SoilKind.RANDOM, SoilKind.CLAY, SoilKind.SNOW,
))  # fmt: skip
EPISODES = 200
SEED = 1_000_003
"""Of the worlds, none of which training sees."""


def evaluate_run(run: Path, grounds: Sequence[str], episodes: int) -> dict[str, Any]:
    """Return what the final policy of a run reaches on each ground: name -> numbers as ``simwarp eval`` has them."""
    content = open_run(run).load_latest()[1]
    name = content["task"]
    config = task_config_from_plain(task_class(name), content["task_config"])
    found = {}
    for ground in grounds:
        [(_, evaluation)] = evaluate_policies(
            name, lambda task: network_policy(content, task), config=replace_fields(config, {"soil": ground}),
            episodes=episodes, seed=SEED, baselines=False,
        )  # fmt: skip
        found[ground] = evaluation.as_json()
        print(f"{run}: {ground} {evaluation.success_rate:.3f} {evaluation.end_reasons}", file=sys.stderr)
    return found


def read_runs(arm: str, runs: Sequence[Path], grounds: Sequence[str], episodes: int) -> dict[str, Any]:
    """Write the progress of an arm's runs, and return what they reached, by seed."""
    found = {}
    for run in runs:
        folder = open_run(run)
        seed = str(folder.load_config()["train_config"]["seed"])
        write_progress(folder, RESULTS / f"{arm}.{seed}.csv")
        made = json.loads((folder.path / PROVENANCE).read_text(encoding="utf-8"))
        about = {key: made[key] for key in ("started", "git", "versions")}
        found[seed] = {**about, "reached": evaluate_run(run, grounds, episodes)}
    return found


@dataclasses.dataclass(frozen=True)
class Bar:
    """Success of an arm's seeds on one ground: their mean share, and the ends of the lowest and highest interval."""

    share: float
    low: float
    high: float


def bar_of(seeds: dict[str, Any], ground: str) -> Bar:
    """Return the bar of a ground."""
    rows = [seed["reached"][ground] for seed in seeds.values()]
    low, high = (np.array([row["success_ci95"][end] for row in rows]) for end in (0, 1))
    return Bar(float(np.mean([row["success_rate"] for row in rows])), float(low.min()), float(high.max()))


def draw(numbers: dict[str, Any], picture: Path) -> None:
    """Draw learning curves, each on the ground it was trained on, and success by ground."""
    figure = new_figure(10.0, 3.4)
    curves, bars = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
    for place, (arm, label) in enumerate(ARMS.items()):
        for number, path in enumerate(sorted(RESULTS.glob(f"{arm}.*.csv"))):
            with path.open(encoding="utf-8") as file:
                rows = list(csv.DictReader(file))
            curves.plot(*success(rows), color=COLOURS[arm], label=label if number == 0 else None)
        found = [bar_of(numbers[arm], ground) for ground in GROUNDS]
        share = np.array([each.share for each in found])
        off = [share - [each.low for each in found], [each.high for each in found] - share]
        where = np.arange(len(GROUNDS)) + 0.4 * (place - 0.5)
        bars.bar(where, share, 0.38, yerr=off, capsize=2.0, color=COLOURS[arm], label=label)
    bars.set_xticks(range(len(GROUNDS)), ["rigid" if ground == "none" else ground for ground in GROUNDS])
    curves.set_xlabel("environment steps")
    curves.set_ylabel("success while it learnt")
    curves.xaxis.set_major_formatter(EngFormatter())
    bars.set_ylabel("success, 95 % interval")
    for axes in (curves, bars):
        axes.set_ylim(0.0, 1.02)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.grid(alpha=0.3)
    curves.legend(loc="lower right", fontsize="small")
    save_figure(figure, picture)


def main() -> None:
    """Read runs, evaluate, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for arm, label in ARMS.items():
        parser.add_argument(f"--{arm}", nargs="*", type=Path, metavar="RUN", default=[], help=label)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    options = parser.parse_args()
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8")) if NUMBERS.exists() else {arm: {} for arm in ARMS}
    RESULTS.mkdir(parents=True, exist_ok=True)
    for arm in ARMS:
        numbers[arm] |= read_runs(arm, getattr(options, arm), GROUNDS, options.episodes)
        NUMBERS.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    draw(numbers, PICTURE)
    print(PICTURE, file=sys.stderr)


if __name__ == "__main__":
    main()
