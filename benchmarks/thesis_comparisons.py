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
from pathlib import Path
from typing import Any

from rich.console import Console

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import comparing  # noqa: E402
from benchmarks.comparing import Arm, Budget, Quantity, Study  # noqa: E402
from simwarp.core.warp_start import start_warp  # noqa: E402
from simwarp.tasks.locomotion.ant import Orientation  # noqa: E402
from simwarp.train.config import Objective  # noqa: E402

BASELINE = "baseline"
QUANTITIES = {
    "final_return": comparing.RETURN,
    "final_distance": Quantity("distance in 10 s [m]", "distance", 2),
    "success_rate": comparing.SUCCESS,
    "area": comparing.AREA,
}
"""Key of a run's numbers -> what it is."""
CONFIGURATIONS = {
    BASELINE: Arm("baseline"),
    "unscaled": Arm("unscaled", BASELINE, train={"network.normalise": False}),
    "quaternion": Arm("quaternion", BASELINE, task={"orientation": Orientation.QUATERNION}),
    "kl-penalty": Arm("KL penalty", BASELINE, train={"ppo.objective": Objective.KL_PENALTY}),
}
OPPOSITES = {"unscaled": "scaled", "quaternion": "Euler angles", "kl-penalty": "clipping"}
"""Labels of the baseline beside a configuration, in the picture."""


def study(options: argparse.Namespace) -> Study:
    """Return the study."""
    return Study(
        task="ant",
        arms={name: CONFIGURATIONS[name] for name in options.configurations},
        budget=Budget(options.iterations, options.num_envs, options.episodes),
        quantities=QUANTITIES,
        out=options.out,
        runs=options.runs,
        seeds=options.seeds,
        device=options.device,
        jobs=options.jobs,
    )


def draw(results: dict[str, list[dict[str, Any]]], picture: Path) -> None:
    """Draw one panel per comparison: mean return over environment steps with its 95 % band."""
    compared = [name for name in results if name != BASELINE and results[name]]
    figure = comparing.new_figure(4.0 * max(1, len(compared)), 3.4)
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
    comparing.save_figure(figure, picture)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read the options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="seeds 0, 1, ... of each configuration")
    parser.add_argument("--iterations", type=int, default=75, help="training iterations of every run")
    parser.add_argument("--num-envs", type=int, default=512, help="worlds of every run")
    parser.add_argument("--episodes", type=int, default=64, help="evaluation episodes of every final policy")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--jobs", type=int, default=1, help="trainings at a time, one thread each")
    parser.add_argument("--configurations", default=",".join(CONFIGURATIONS), help="which ones, by comma")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results" / "thesis", help="results")
    parser.add_argument("--runs", type=Path, default=Path("runs") / "thesis", help="run folders")
    parser.add_argument("--plot", action="store_true", help="draw the learning curves")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "images" / "thesis_comparisons.png")
    parser.add_argument("--report-only", action="store_true", help="no new runs: what is there is reported")
    options = parser.parse_args(arguments)
    options.configurations = comparing.chosen(parser, "--configurations", options.configurations, CONFIGURATIONS)
    comparing.require_positive(parser, options, "seeds", "jobs", "iterations", "num_envs", "episodes")
    return options


def work(options: argparse.Namespace) -> int:
    """Do the runs that are missing, and report all."""
    start_warp()
    asked = study(options)
    comparing.load(asked)  # a foreign budget is told before hours of work
    if not options.report_only:
        comparing.run_missing(asked, Console(stderr=True))
    results = comparing.load(asked)
    if not any(results.values()):
        print(f"thesis_comparisons: there are no results in {options.out}", file=sys.stderr)
        return 2
    summary = comparing.write_summary(asked, results)
    print(comparing.table(summary["means"], f"mean of {options.seeds} seeds, 95 %", QUANTITIES))
    if summary["differences"]:
        print("\n" + comparing.table(summary["differences"], "minus the baseline, paired", QUANTITIES))
    if options.plot:
        draw(results, options.picture)
        print(f"\n{options.picture}")
    return 0


def main() -> int:
    options = parse(sys.argv[1:])
    return comparing.exit_code("thesis_comparisons", lambda: work(options))


if __name__ == "__main__":
    sys.exit(main())
