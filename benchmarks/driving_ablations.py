"""Ablations of the thesis's chapter on driving: each is a comparison with equal seeds and budget.

    python benchmarks/driving_ablations.py --dry-run            what there is to do, and about how long it takes
    python benchmarks/driving_ablations.py [--ablations fusion,frame] [--seeds 3] [--plot] [--report-only]

    fusion        off-road by camera, 30 obstacles: image and vector meet before four layers, or after all but one
    frame         off-road, without and with 30 obstacles: goal in the vehicle's axes, or in the world's
    curriculum    off-road on hills with 30 obstacles: first flat, then obstacles, then hills; or all from the start
    curriculum-camera  the same by camera (only if asked for)
    start         hallway: episodes begin on a turn, or on a straight; both evaluated from anywhere
    start-camera  the same by camera (only if asked for)
    minibatch     off-road: 2, 4, 16 or 64 mini-batches per pass
    minibatch-camera  obstacle-avoidance by camera: 2, 4 or 16 (only if asked for)

Each run leaves one JSON file in --out/FINDING. Runs whose file exists are skipped; Ctrl-C saves the running one, and
the same command goes on from there. Tables go to standard output and to summary.json: means over seeds with 95 %
confidence intervals (Student's t), and differences paired by seed. Where arms train in different worlds, the learning
curve is that of evaluations in the same ones. --iterations and its like replace the budget of every ablation.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import comparing
from benchmarks.comparing import Arm, Budget, Quantity, Result, Study
from simwarp.tasks.driving.driving_config import Frame, Observing
from simwarp.tasks.driving.lapping import Start
from simwarp.tasks.randomisation.randomisation_config import Driver
from simwarp.train.config import NetworkKind
from simwarp.train.evaluation.figure_style import new_figure, save_figure

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red")
STARTING = 8.0
"""CPU time for which a run builds its worlds and loads its kernels [s]."""
SMALL = {"camera_width": 48, "camera_height": 36}
"""An image at which a CPU learns."""


def reported(key: str, heading: str, digits: int) -> dict[str, Quantity]:
    """Return what is reported, given a number of the task's own."""
    return {
        "final_return": Quantity("return", "mean_return", 2),
        f"final_{key}": Quantity(heading, key, digits),
        "success_rate": comparing.SUCCESS,
        "area": Quantity("area under the curve", "", 2),
    }


TO_GOAL = reported("distance", "distance to the goal [m]", 1)
ALONG = reported("distance", "distance along the road [m]", 1)
LAPS = reported("laps", "laps", 2)
SMALL_CAMERA = {"obs": Observing.CAMERA, "camera_width": 64, "camera_height": 36}
"""An image of the usual shape at which a CPU learns as well as at the usual size, in half the time."""
STATE, CAMERA = {"obs": Observing.STATE}, {"obs": Observing.CAMERA, **SMALL}
DISCOUNT = {"ppo.gamma": 0.99}
"""Of the ablations of off-road by state; its default is for whole policies, over hills and among 50 obstacles."""
RISING = {
    "curriculum.driver": Driver.ITERATION,
    "curriculum.first": 0,
    "curriculum.last": lambda budget: max(1, round(0.6 * budget.iterations)),
}
"""A level that rises over three fifths of the training."""
STARTS = {
    "turn": Arm("start on a turn", task={"start": Start.TURN}),
    "straight": Arm("start on a straight", "turn", task={"start": Start.STRAIGHT}, colour=COLOURS[1]),
}
RISES = {
    "curriculum": Arm("curriculum", task=RISING),
    "at-once": Arm("hills from the start", "curriculum", colour=COLOURS[1]),
}
PARTS = {
    f"parts-{count}": Arm(
        f"{count} mini-batches", "" if count == 4 else "parts-4", train={"ppo.mini_batches": count}, colour=colour
    )
    for count, colour in zip((2, 4, 16, 64), COLOURS, strict=True)
}
ABLATIONS = {
    "fusion": Study(
        "off-road",
        {
            "early": Arm("early fusion", train={"network.kind": NetworkKind.EARLY_FUSION}),
            "late": Arm("late fusion", "early", train={"network.kind": NetworkKind.LATE_FUSION}, colour=COLOURS[1]),
        },
        Budget(150, 32, 64), TO_GOAL, "early or late fusion", config=CAMERA | {"obstacles": 30},
    ),
    "frame": Study(
        "off-road",
        {
            f"{axes.value}-{count}": Arm(
                f"{axes.value}'s axes, {count} obstacles", f"{Frame.VEHICLE.value}-{count}" if colour else "",
                task={"goal_frame": axes, "obstacles": count}, colour=COLOURS[colour], line=line,
            )
            for count, line in ((0, "--"), (30, "-"))
            for colour, axes in enumerate((Frame.VEHICLE, Frame.WORLD))
        },
        Budget(120, 64, 100), TO_GOAL, "goal in the vehicle's or the world's axes", config=STATE, train=DISCOUNT,
    ),
    "curriculum": Study(
        "off-road", RISES, Budget(60, 64, 64, 10), TO_GOAL, "curriculum or hills from the start",
        config=STATE | {"obstacles": 30, "hills": 1.0}, train=DISCOUNT, evaluation={"curriculum.driver": Driver.NONE},
    ),
    "curriculum-camera": Study(
        "off-road", RISES, Budget(80, 128, 64, 5), TO_GOAL, "curriculum or hills from the start, by camera",
        config=SMALL_CAMERA | {"obstacles": 30, "hills": 1.0}, evaluation={"curriculum.driver": Driver.NONE},
    ),
    "start": Study(
        "hallway", STARTS, Budget(24, 64, 32, 8), LAPS, "start on a turn or a straight",
        config=STATE, evaluation={"start": Start.ANYWHERE},
    ),
    "start-camera": Study(
        "hallway", STARTS, Budget(150, 32, 32, 5), LAPS, "start on a turn or a straight, by camera",
        config=CAMERA, evaluation={"start": Start.ANYWHERE},
    ),
    "minibatch": Study(
        "off-road", PARTS, Budget(80, 64, 100), TO_GOAL, "number of mini-batches", config=STATE, train=DISCOUNT
    ),
    "minibatch-camera": Study(
        "obstacle-avoidance",
        {name: arm for name, arm in PARTS.items() if name != "parts-64"}, Budget(20, 256, 128), ALONG,
        "number of mini-batches, by camera", config=SMALL_CAMERA,
    ),
}  # fmt: skip
USUAL = ("fusion", "frame", "curriculum", "start", "minibatch")
SPEEDS = {
    "fusion": (450.0, 200),
    "frame": (1800.0, 200),
    "curriculum": (1640.0, 200),
    "curriculum-camera": (600.0, 200),
    "start": (830.0, 930),
    "start-camera": (340.0, 930),
    "minibatch": (1450.0, 200),
    "minibatch-camera": (900.0, 140),
}
"""Of the estimate: environment steps per CPU-second, learning included, as measured; longest episode [steps]."""


# ---- what it costs -----------------------------------------------------------------------------------------------


def cost(name: str, asked: Study) -> tuple[int, float]:
    """Return the training steps of a run, and the CPU time it takes with its evaluations at most [s]."""
    budget, (speed, episode_steps) = asked.budget, SPEEDS[name]
    config, _ = asked.settings(next(iter(asked.arms)), 0)
    steps = config.iterations * config.num_envs * config.steps_per_iteration
    evaluated = max(1, budget.evaluations) * budget.episodes * episode_steps
    return steps, STARTING + (steps + evaluated) / speed


def estimate(studies: Mapping[str, Study]) -> str:
    """Return a table of what there is to do."""
    lines = [
        "| | runs | missing | iterations x worlds | steps per run | min per run | min missing |",
        "|---|---|---|---|---|---|---|",
    ]
    total = 0.0
    for name, asked in studies.items():
        steps, seconds = cost(name, asked)
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
    studies = {name: ABLATIONS[name].asked(options, name) for name in options.ablations}
    if options.dry_run:
        print(estimate(studies))
        return 0
    return comparing.carry_out(studies, options, draw)


if __name__ == "__main__":
    sys.exit(comparing.exit_code("driving_ablations", lambda: work(parse(sys.argv[1:]))))
