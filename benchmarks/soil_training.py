"""One policy for rigid ground to soft soil, beside one that was trained on rigid ground alone: off-road by exact state.

    python benchmarks/soil_training.py [--seeds 1] [--jobs 1]    trains and evaluates what the tables do not have
    python benchmarks/soil_training.py --random RUN ... --rigid RUN ...

Final policies play the same episodes on every ground. Each RUN is a folder that ``simwarp train off-road --obs state``
made, with ``--task.soil random`` or without; it takes the place of its seed. Tables and numbers are written to
benchmarks/results/soil, and the picture is drawn from them. Interrupted, the same command goes on.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import EngFormatter, PercentFormatter
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import comparing
from benchmarks.comparing import ROOT, Arm, Budget, Study
from benchmarks.driving_curves import success, write_progress
from simwarp.tasks import replace_fields, task_class
from simwarp.tasks.driving.driving_config import Observing
from simwarp.tasks.driving.soil import SoilKind
from simwarp.train.config import task_config_from_plain
from simwarp.train.evaluation.evaluation import evaluate_policies
from simwarp.train.evaluation.figure_style import new_figure, save_figure
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.run_files import write_run_file
from simwarp.train.runs.run_folder import PROVENANCE, RunFolder, open_run

RESULTS = ROOT / "benchmarks" / "results" / "soil"
PICTURE = ROOT / "docs" / "images" / "off_road_soil.png"
ARMS = {
    "random": Arm("trained on soil, soft to rigid", task={"soil": SoilKind.RANDOM}, colour="tab:brown"),
    "rigid": Arm("trained on rigid ground alone", task={"soil": SoilKind.NONE}, colour="tab:blue"),
}
GROUNDS = tuple(kind.value for kind in (
    SoilKind.NONE, SoilKind.HARD, SoilKind.MID, SoilKind.SOFT, SoilKind.RANDOM, SoilKind.CLAY, SoilKind.SNOW,
))  # fmt: skip
STUDY = Study(
    "off-road", ARMS, Budget(120, 256, 200), {}, "off-road on soil",
    config={"obs": Observing.STATE}, train={"ppo.gamma": 0.99}, out=RESULTS, runs=Path("runs") / "soil",
)  # fmt: skip


def read_numbers(study: Study) -> dict[str, Any]:
    """Return what runs reached: arm -> seed -> numbers."""
    path = study.out / "success.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {arm: {} for arm in study.arms}


def evaluate_run(folder: RunFolder, episodes: int) -> dict[str, Any]:
    """Return what the final policy of a run reaches on each ground: name -> numbers as ``simwarp eval`` has them."""
    content = folder.load_latest()[1]
    name = content["task"]
    config = task_config_from_plain(task_class(name), content["task_config"])
    found = {}
    for ground in GROUNDS:
        [(_, evaluation)] = evaluate_policies(
            name, lambda task: network_policy(content, task), config=replace_fields(config, {"soil": ground}),
            episodes=episodes, seed=comparing.EVALUATION_SEED, baselines=False,
        )  # fmt: skip
        found[ground] = evaluation.as_json()
        print(f"{folder.path}: {ground} {evaluation.success_rate:.3f} {evaluation.end_reasons}", file=sys.stderr)
    return found


def conclude(study: Study, arm: str, folder: RunFolder) -> None:
    """Write the progress of an arm's run, and what it reached."""
    seed = str(folder.load_config()["train_config"]["seed"])
    study.out.mkdir(parents=True, exist_ok=True)
    write_progress(folder, study.out / f"{arm}.{seed}.csv")
    made = json.loads((folder.path / PROVENANCE).read_text(encoding="utf-8"))
    about = {key: made[key] for key in ("started", "git", "versions")}
    reached = evaluate_run(folder, study.budget.episodes)
    numbers = read_numbers(study)
    numbers[arm][seed] = {**about, "reached": reached}
    write_run_file(study.out / "success.json", (json.dumps(numbers, indent=1) + "\n").encode())


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


def draw(study: Study, picture: Path) -> None:
    """Draw learning curves, each on the ground it was trained on, and success by ground."""
    numbers, figure = read_numbers(study), new_figure(10.0, 3.4)
    curves, bars = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
    for place, (name, arm) in enumerate(study.arms.items()):
        for number, path in enumerate(sorted(study.out.glob(f"{name}.*.csv"))):
            with path.open(encoding="utf-8") as file:
                rows = list(csv.DictReader(file))
            curves.plot(*success(rows), color=arm.colour, label=arm.label if number == 0 else None)
        found = [bar_of(numbers[name], ground) for ground in GROUNDS]
        share = np.array([each.share for each in found])
        off = [share - [each.low for each in found], [each.high for each in found] - share]
        where = np.arange(len(GROUNDS)) + 0.4 * (place - 0.5)
        bars.bar(where, share, 0.38, yerr=off, capsize=2.0, color=arm.colour, label=arm.label)
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


def work(arguments: list[str], study: Study = STUDY, picture: Path = PICTURE) -> int:
    """Evaluate the runs that are given, train and evaluate those that are missing, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, arm in study.arms.items():
        parser.add_argument(f"--{name}", nargs="*", type=Path, metavar="RUN", default=[], help=arm.label)
    parser.add_argument("--seeds", type=int, default=study.seeds, help="seeds 0, 1, ... of each arm")
    parser.add_argument("--episodes", type=int, default=study.budget.episodes, help="of each evaluation")
    parser.add_argument("--jobs", type=int, default=1, help="trainings at a time, one thread each")
    options = comparing.read_options(parser, arguments)
    budget = dataclasses.replace(study.budget, episodes=options.episodes)
    study = dataclasses.replace(study, budget=budget, seeds=options.seeds, jobs=options.jobs)
    for name in study.arms:
        for run in getattr(options, name):
            conclude(study, name, open_run(run))
    numbers = read_numbers(study)
    missing = [(name, seed) for name, seed in study.wanted() if str(seed) not in numbers[name]]
    comparing.train(
        study, missing, Console(stderr=True), lambda name, record: conclude(study, name, record.run.folder)
    )  # fmt: skip
    draw(study, picture)
    print(picture, file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(comparing.exit_code("soil_training", lambda: work(sys.argv[1:])))
