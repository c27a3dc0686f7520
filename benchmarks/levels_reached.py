"""The level of rough ground that policies of `quadruped-velocity` and its like reach, as worlds climb.

    python benchmarks/levels_reached.py quadruped-velocity flat=runs/quadruped-velocity/ONE rough=runs/TWO
    python benchmarks/levels_reached.py quadruped-velocity --training "seed 0=runs/TWO" "seed 1=runs/THREE"

A policy is LABEL=WHERE, WHERE being what `simwarp eval --checkpoint` takes. All worlds begin on level 0 and climb and
fall as in training, but the policy acts without exploration, on patterns that it was not trained on. Levels settle
after ten to twenty episodes; the level reached is the mean over the worlds and the last quarter of the time. Who
masters the last level stays there; in training it begins again on a random one, so that 6 is the mean of those who
master all.

With --training LABEL=RUN the curve of the mean level while a run was trained is drawn beside them.

Writes benchmarks/results/levels/TASK.json, TASK.training.json and docs/images/levels_TASK.png, and prints a table.
What is in the files already is kept.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any, Final

import torch
from matplotlib.ticker import EngFormatter

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.bench.machine import describe  # noqa: E402
from simwarp.core.files import read_json  # noqa: E402
from simwarp.core.warp_start import start_warp  # noqa: E402
from simwarp.tasks import make, replace_fields, task_class  # noqa: E402
from simwarp.train.config import task_config_from_plain  # noqa: E402
from simwarp.train.evaluation.figure_style import new_figure, save_figure, style_axes  # noqa: E402
from simwarp.train.networks.policies import find_policy, network_policy  # noqa: E402
from simwarp.train.runs.progress_table import read_progress  # noqa: E402
from simwarp.train.runs.run_files import write_json  # noqa: E402
from simwarp.train.runs.run_folder import open_run  # noqa: E402

RESULTS: Final = ROOT / "benchmarks" / "results" / "levels"
PICTURES: Final = ROOT / "docs" / "images"
SEED: Final = 1_000_003
CHANGES: Final = {
    "ground": "rough", "rough.climbing": "always", "rough.first": 0, "rough.again": False, "rough.seed": SEED,
}  # fmt: skip
EVERY: Final = 50
"""Control steps between two points of the curve."""


def levels_of(name: str, where: str, worlds: int, steps: int) -> dict[str, Any]:
    """Let worlds climb under a policy.

    Args:
        name: of the task.
        where: the policy is.
        worlds: W.
        steps: control steps.

    Returns:
        curve of the mean level, the level reached, by kind too, and falls per episode.
    """
    source = find_policy(name, Path(where))
    plain = task_config_from_plain(task_class(name), source.content["task_config"])
    config: Any = replace_fields(plain, CHANGES)
    task: Any = make(name, worlds, device="cpu", seed=SEED, config=config)
    policy = network_policy(source.content, task)
    observations = task.restart(seed=SEED)
    curve, late, falls, ended = [], [], 0, 0
    began = time.perf_counter()
    for step in range(steps):
        with torch.inference_mode():
            result = task.step(policy(observations))
        observations = result.observations
        falls, ended = falls + int(result.terminated.sum()), ended + int((result.terminated | result.truncated).sum())
        if (step + 1) % EVERY == 0:
            curve.append(float(task.ground.level.float().mean()))
            if step >= 0.75 * steps:
                late.append(task.ground.level.float().clone())
            if sys.stderr.isatty():
                print(f"\r{where}: {step + 1}/{steps}, level {curve[-1]:.2f}", end="", file=sys.stderr)
    level, kinds = torch.stack(late).mean(dim=0), [kind.value for kind in config.rough.kinds]
    return {
        "policy": where, "worlds": worlds, "steps": steps, "level": float(level.mean()),
        "by_kind": {kind: float(level[task.ground.kind == index].mean()) for index, kind in enumerate(kinds)},
        "falls_per_episode": falls / max(ended, 1), "every": EVERY, "curve": curve,
        "wall_s": time.perf_counter() - began, "machine": describe(task.simulation.model.device),
    }  # fmt: skip


def training_of(where: str) -> dict[str, list[float]]:
    """Return environment steps, time [s] and mean level of every tenth iteration of a run."""
    rows = read_progress(open_run(Path(where)).progress)
    told = [row for row in rows if row.get("task/level") and int(row["iteration"]) % 10 == 0]
    if not told:
        raise SystemExit(f"{where}: its progress has no column task/level; it was not trained on rough ground")
    columns = {"env_steps": "env_steps", "seconds": "wall_s", "level": "task/level"}
    return {name: [float(row[column]) for row in told] for name, column in columns.items()}


def draw(rows: dict[str, Any], training: dict[str, Any], seconds: float, picture: Path) -> None:
    """Draw the curves of all policies over time, and of trainings over environment steps."""
    figure = new_figure(9.6 if training else 6.4, 3.6)
    axes, *beside = figure.subplots(1, 2 if training else 1, squeeze=False, sharey=True)[0]
    for other in beside:
        for label, run in sorted(training.items()):
            same = next((index for index, name in enumerate(rows) if name.endswith(label)), len(rows))
            other.plot(run["env_steps"], run["level"], label=label, color=f"C{same % 10}")  # as on the left
        other.set_xlabel("environment steps of training")
        other.set_title("who masters all levels begins on a random one", fontsize="medium")
        other.xaxis.set_major_formatter(EngFormatter())
        other.legend(frameon=False, loc="lower right")
        style_axes(other)
        axes.set_title("evaluated: who masters all levels stays", fontsize="medium")
    for label, row in rows.items():
        times = [seconds * row["every"] * (index + 1) for index in range(len(row["curve"]))]
        axes.plot(times, row["curve"], label=f"{label}: {row['level']:.1f}")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("mean level of the worlds")
    axes.set_ylim(0.0, 9.0)
    axes.legend(frameon=False)
    style_axes(axes)
    save_figure(figure, picture)


def report(rows: dict[str, Any]) -> None:
    """Print a table in Markdown."""
    kinds = list(next(iter(rows.values()))["by_kind"])
    print(f"| policy | level | {' | '.join(kinds)} | falls per episode |")
    print("|---" * (len(kinds) + 3) + "|")
    for label, row in rows.items():
        parts = [f"{row['by_kind'][kind]:.1f}" for kind in kinds]
        print(f"| {label} | {row['level']:.2f} | {' | '.join(parts)} | {row['falls_per_episode']:.2f} |")


def main() -> None:
    """Measure what is not there yet, and report all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("policies", nargs="*", help="LABEL=WHERE")
    parser.add_argument("--training", nargs="*", default=[], metavar="LABEL=RUN", help="runs whose curves are drawn")
    parser.add_argument("--worlds", type=int, default=70, help="ten of each kind")
    parser.add_argument("--steps", type=int, default=15_000, help="control steps")
    parser.add_argument("--again", action="store_true", help="measure policies that are there as well")
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    start_warp()
    torch.set_num_threads(1)
    path = options.out / f"{options.task}.json"
    rows = read_json(path, "levels") if path.is_file() else {}
    for word in options.policies:
        label, _, where = word.partition("=")
        if label not in rows or options.again:
            rows[label] = levels_of(options.task, where, options.worlds, options.steps)
            options.out.mkdir(parents=True, exist_ok=True)
            write_json(path, rows)
    curves = options.out / f"{options.task}.training.json"
    training = read_json(curves, "curves") if curves.is_file() else {}
    for word in options.training:
        label, _, where = word.partition("=")
        training[label] = training_of(where)
        options.out.mkdir(parents=True, exist_ok=True)
        write_json(curves, training)
    if rows:
        period = task_class(options.task).config_type().control_dt
        draw(rows, training, period, PICTURES / f"levels_{options.task}.png")
        report(rows)


if __name__ == "__main__":
    main()
