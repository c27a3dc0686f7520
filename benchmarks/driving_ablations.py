"""Ablations of the thesis's chapter on driving: each is a comparison with equal seeds and budget.

    python benchmarks/driving_ablations.py --dry-run            what there is to do, and about how long it takes
    python benchmarks/driving_ablations.py [--ablations fusion,frame] [--seeds 3] [--plot] [--report-only]

    fusion        off-road by camera, 30 obstacles: image and vector meet before four layers, or after all but one
    frame         off-road, without and with 30 obstacles: goal in the vehicle's axes, or in the world's
    curriculum    off-road on hills with 30 obstacles: first flat, then obstacles, then hills; or all from the start
    start         hallway: episodes begin on a turn, or on a straight; both evaluated from anywhere
    start-camera  the same by camera (only if asked for)
    minibatch     off-road: 2, 4, 16 or 64 mini-batches per pass

Each run leaves one JSON file in --out/FINDING. Runs whose file exists are skipped; Ctrl-C saves the running one, and
the same command goes on from there. Tables go to standard output and to summary.json: means over seeds with 95 %
confidence intervals (Student's t), and differences paired by seed. Where arms train in different worlds, the learning
curve is that of evaluations in the same ones. --iterations and its like replace the budget of every ablation.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import comparing
from benchmarks.comparing import Arm, Budget, Quantity, Result, Study
from simwarp.tasks.driving.base import Frame, Observing
from simwarp.tasks.driving.lapping import Start
from simwarp.tasks.randomisation.uncertainty import Driver
from simwarp.train.config import NetworkKind
from simwarp.train.evaluation.figure_style import new_figure, save_figure

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red")
STARTING = 8.0
"""CPU time for which a run builds its worlds and loads its kernels [s]."""
SMALL = {"camera_width": 48, "camera_height": 36}
"""An image at which a CPU learns."""


@dataclasses.dataclass(frozen=True)
class Ablation:
    """A comparison.

    Attributes:
        title: of its panel in the picture.
        task: a registered task.
        arms: configurations that are compared, given the budget.
        budget: of every run.
        metric: the task's own number that is reported.
        speed: environment steps per CPU-second, learning included, as measured; for the estimate alone.
        episode_steps: the longest an episode may be; for the estimate alone.
        config: fields of the task's configuration that all arms share.
        evaluation: fields of the task's configuration that all arms are evaluated with.
    """

    title: str
    task: str
    arms: Callable[[Budget], dict[str, Arm]]
    budget: Budget
    metric: tuple[str, Quantity]
    speed: float
    episode_steps: int
    config: Mapping[str, Any]
    evaluation: Mapping[str, Any] = dataclasses.field(default_factory=dict)


def fusion(budget: Budget) -> dict[str, Arm]:
    """Compare the networks."""
    return {
        "early": Arm("early fusion", train={"network.kind": NetworkKind.EARLY_FUSION}),
        "late": Arm("late fusion", "early", train={"network.kind": NetworkKind.LATE_FUSION}, colour=COLOURS[1]),
    }


def frame(budget: Budget) -> dict[str, Arm]:
    """Compare the axes, without obstacles and with them."""
    arms = {}
    for count, line in ((0, "--"), (30, "-")):
        for axes, against, colour in (
            (Frame.VEHICLE, "", COLOURS[0]),
            (Frame.WORLD, f"{Frame.VEHICLE.value}-{count}", COLOURS[1]),
        ):
            task = {"goal_frame": axes, "obstacles": count}
            label = f"{axes.value}'s axes, {count} obstacles"
            arms[f"{axes.value}-{count}"] = Arm(label, against, task=task, colour=colour, line=line)
    return arms


def curriculum(budget: Budget) -> dict[str, Arm]:
    """Compare a level that rises over three fifths of the training with the full one from the start."""
    rising = {
        "curriculum.driver": Driver.ITERATION,
        "curriculum.first": 0,
        "curriculum.last": max(1, round(0.6 * budget.iterations)),
    }
    return {
        "curriculum": Arm("curriculum", task=rising),
        "at-once": Arm("hills from the start", "curriculum", colour=COLOURS[1]),
    }


def start(budget: Budget) -> dict[str, Arm]:
    """Compare where episodes begin."""
    return {
        "turn": Arm("start on a turn", task={"start": Start.TURN}),
        "straight": Arm("start on a straight", "turn", task={"start": Start.STRAIGHT}, colour=COLOURS[1]),
    }


def minibatch(budget: Budget) -> dict[str, Arm]:
    """Compare numbers of mini-batches with the default one, four."""
    return {
        f"parts-{count}": Arm(
            f"{count} mini-batches",
            "" if count == 4 else "parts-4",
            train={"ppo.mini_batches": count},
            colour=colour,
        )
        for count, colour in zip((2, 4, 16, 64), COLOURS, strict=True)
    }


TO_GOAL = ("final_distance", Quantity("distance to the goal [m]", "distance", 1))
LAPS = ("final_laps", Quantity("laps", "laps", 2))
STATE, CAMERA = {"obs": Observing.STATE}, {"obs": Observing.CAMERA, **SMALL}
ABLATIONS = {
    "fusion": Ablation(
        "early or late fusion", "off-road", fusion, Budget(150, 32, 64), TO_GOAL, 450.0, 200,
        config=CAMERA | {"obstacles": 30},
    ),
    "frame": Ablation(
        "goal in the vehicle's or the world's axes", "off-road", frame, Budget(120, 64, 100), TO_GOAL, 1800.0, 200,
        config=STATE,
    ),
    "curriculum": Ablation(
        "curriculum or hills from the start", "off-road", curriculum, Budget(60, 64, 64, 10), TO_GOAL, 1640.0, 200,
        config=STATE | {"obstacles": 30, "hills": 1.0}, evaluation={"curriculum.driver": Driver.NONE},
    ),
    "start": Ablation(
        "start on a turn or a straight", "hallway", start, Budget(24, 64, 32, 8), LAPS, 830.0, 930,
        config=STATE, evaluation={"start": Start.ANYWHERE},
    ),
    "start-camera": Ablation(
        "start on a turn or a straight, by camera", "hallway", start, Budget(150, 32, 32, 5), LAPS, 340.0, 930,
        config=CAMERA, evaluation={"start": Start.ANYWHERE},
    ),
    "minibatch": Ablation(
        "number of mini-batches", "off-road", minibatch, Budget(80, 64, 100), TO_GOAL, 1450.0, 200,
        config=STATE,
    ),
}  # fmt: skip
USUAL = ("fusion", "frame", "curriculum", "start", "minibatch")


def study(name: str, options: argparse.Namespace) -> Study:
    """Return an ablation with the budget and the folders of the command line."""
    ablation = ABLATIONS[name]
    budget = comparing.chosen_budget(ablation.budget, options)
    key, metric = ablation.metric
    return Study(
        task=ablation.task,
        arms=ablation.arms(budget),
        budget=budget,
        quantities={
            "final_return": dataclasses.replace(comparing.RETURN, digits=2),
            key: metric,
            "success_rate": comparing.SUCCESS,
            "area": dataclasses.replace(comparing.AREA, digits=2),
        },
        out=options.out / name,
        runs=options.runs / name,
        seeds=options.seeds,
        title=ablation.title,
        device=options.device,
        jobs=options.jobs,
        config=ablation.config,
        evaluation=ablation.evaluation,
    )


# ---- what it costs -----------------------------------------------------------------------------------------------


def cost(ablation: Ablation, asked: Study) -> tuple[int, float]:
    """Return the training steps of a run, and the CPU time it takes with its evaluations at most [s]."""
    budget = asked.budget
    config, _ = asked.settings(next(iter(asked.arms)), 0)
    steps = config.iterations * config.num_envs * config.steps_per_iteration
    evaluated = max(1, budget.evaluations) * budget.episodes * ablation.episode_steps
    return steps, STARTING + (steps + evaluated) / ablation.speed


def estimate(studies: Mapping[str, Study]) -> str:
    """Return a table of what there is to do."""
    lines = [
        "| | runs | missing | iterations x worlds | steps per run | min per run | min missing |",
        "|---|---|---|---|---|---|---|",
    ]
    total = 0.0
    for name, asked in studies.items():
        steps, seconds = cost(ABLATIONS[name], asked)
        missing = len(asked.missing())
        total += missing * seconds
        lines.append(
            f"| {name} | {len(asked.arms) * asked.seeds} | {missing} |"
            f" {asked.budget.iterations} x {asked.budget.num_envs} | {steps} |"
            f" {seconds / 60:.1f} | {missing * seconds / 60:.0f} |"
        )
    lines.append(f"\nabout {total / 3600:.1f} h on one quiet CPU core, at the speeds that were measured on one")
    return "\n".join(lines)


# ---- what came out -----------------------------------------------------------------------------------------------


def draw(studies: Mapping[str, Study], results: Mapping[str, dict[str, list[Result]]], picture: Path) -> None:
    """Draw one panel per ablation."""
    columns = min(3, len(results))
    rows = math.ceil(len(results) / columns)
    figure = new_figure(5.0 * columns, 3.8 * rows)
    for index, (name, runs) in enumerate(results.items()):
        axes = figure.add_subplot(rows, columns, index + 1)
        arms = studies[name].arms
        comparing.draw_panel(axes, [(runs[arm], arms[arm]) for arm in arms])
        axes.set_xlim(left=0.0)
        axes.set_title(studies[name].title, fontsize="medium")
        axes.set_ylabel("mean return in evaluation" if studies[name].budget.evaluations else "mean return in training")
        axes.legend(loc="best", fontsize="small")
    save_figure(figure, picture, dpi=110)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read the options."""
    parser = comparing.study_parser(
        __doc__, seeds=3, results="driving", runs="driving-ablations", picture="driving_ablations.png"
    )
    parser.add_argument("--ablations", default=",".join(USUAL), help=f"by comma, of {', '.join(ABLATIONS)}")
    parser.add_argument("--evaluations", type=int, help="policies that are evaluated, where more than the final one is")
    parser.add_argument("--dry-run", action="store_true", help="tell what there is to do, and do nothing")
    options = comparing.read_options(parser, arguments)
    options.ablations = comparing.chosen(parser, "--ablations", options.ablations, ABLATIONS)
    return options


def work(options: argparse.Namespace) -> int:
    """Do the runs that are missing, and report all."""
    studies = {name: study(name, options) for name in options.ablations}
    if options.dry_run:
        print(estimate(studies))
        return 0
    return comparing.carry_out(studies, options, draw)


if __name__ == "__main__":
    sys.exit(comparing.exit_code("driving_ablations", lambda: work(parse(sys.argv[1:]))))
