"""The thesis's comparisons on the ant: scaled observations, Euler angles or a quaternion, clipping or a KL penalty.

    python benchmarks/thesis_comparisons.py [--seeds 5] [--iterations 75] [--plot] [--report-only]

Four configurations that share the baseline, each with the same seeds and budget:

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
import sys
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import comparing
from benchmarks.comparing import Arm, Budget, Quantity, Result, Study
from simwarp.tasks.locomotion.ant import Orientation
from simwarp.train.config import Objective
from simwarp.train.evaluation.figure_style import new_figure, save_figure

BASELINE = "baseline"
CONFIGURATIONS = {
    BASELINE: Arm("baseline"),
    "unscaled": Arm("unscaled", BASELINE, train={"network.normalise": False}),
    "quaternion": Arm("quaternion", BASELINE, task={"orientation": Orientation.QUATERNION}),
    "kl-penalty": Arm("KL penalty", BASELINE, train={"ppo.objective": Objective.KL_PENALTY}),
}
STUDY = Study(
    "ant", CONFIGURATIONS, Budget(75, 512, 64),
    quantities={
        "final_return": comparing.RETURN,
        "final_distance": Quantity("distance in 10 s [m]", "distance", 2),
        "success_rate": comparing.SUCCESS,
        "area": comparing.AREA,
    },
    title="scaling, orientation and objective on the ant",
)  # fmt: skip
OPPOSITES = {"unscaled": "scaled", "quaternion": "Euler angles", "kl-penalty": "clipping"}
"""Labels of the baseline beside a configuration, in the picture."""


def draw(studies: Mapping[str, Study], found: Mapping[str, dict[str, list[Result]]], picture: Path) -> None:
    """Draw one panel per comparison: mean return over environment steps with its 95 % band."""
    results = found[STUDY.task]
    compared = [name for name in results if name != BASELINE and results[name]]
    figure = new_figure(4.0 * max(1, len(compared)), 3.4)
    first = None
    for column, name in enumerate(compared):
        axes = figure.add_subplot(1, len(compared), column + 1, sharey=first)
        first = first or axes
        baseline = Arm(OPPOSITES[name])
        other = dataclasses.replace(CONFIGURATIONS[name], colour="tab:orange")
        comparing.draw_panel(axes, [(results.get(BASELINE, []), baseline), (results[name], other)])
        axes.legend(loc="upper left")
        if column == 0:
            axes.set_ylabel("mean return")
    save_figure(figure, picture, dpi=110)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read the options."""
    parser = comparing.study_parser(
        __doc__, seeds=5, results="thesis", runs="thesis", picture="thesis_comparisons.png"
    )  # fmt: skip
    parser.add_argument("--configurations", default=",".join(CONFIGURATIONS), help="which ones, by comma")
    options = comparing.read_options(parser, arguments)
    options.configurations = comparing.chosen(parser, "--configurations", options.configurations, CONFIGURATIONS)
    return options


def work(options: argparse.Namespace) -> int:
    """Do the runs that are missing, and report all."""
    arms = {name: CONFIGURATIONS[name] for name in options.configurations}
    asked = dataclasses.replace(STUDY, arms=arms).asked(options)
    return comparing.carry_out({asked.task: asked}, options, draw)


if __name__ == "__main__":
    sys.exit(comparing.exit_code("thesis_comparisons", lambda: work(parse(sys.argv[1:]))))
