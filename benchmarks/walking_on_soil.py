"""Policies of a task on legs beside each other on soil, over several seeds.

    python benchmarks/walking_on_soil.py quadruped-velocity rigid=shipped soft=RUN --kinds soft --seeds 10 --episodes 16

Every policy plays the same episodes: those of ``simwarp eval TASK --task.ground soil --task.soil.kind KIND --seed S``
for each seed. A seed's mean return, errors and share without a fall is one number; printed are means over the seeds
with intervals of 95 % (Student's t). ``flat`` as a kind is the plane.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from simwarp.tasks import make, task_class
from simwarp.tasks.framework.registry import config_to_train_in
from simwarp.tasks.locomotion.velocity import Ground, VelocityConfig, WalkedSoilConfig, WalkedSoilKind
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import find_policy

FIRST_SEED: Final = 1_000_003
"""That of `simwarp eval`."""
FLAT: Final = "flat"
MEASURES: Final = ("return", "no fall", "speed error", "turn error")


def task_on(name: str, kind: str, worlds: int) -> Any:
    """The task as it is trained, on a soil or on the plane."""
    config = config_to_train_in(task_class(name))
    assert isinstance(config, VelocityConfig), name
    if kind != FLAT:
        config = dataclasses.replace(config, ground=Ground.SOIL, soil=WalkedSoilConfig(kind=WalkedSoilKind(kind)))
    return make(name, worlds, config=config)


def interval(values: np.ndarray) -> tuple[float, float]:
    """Mean and half of Student's interval of 95 %."""
    half = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return float(values.mean()), float(half)


def main() -> None:
    """Plays the episodes and prints a row for each policy and soil."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("policies", nargs="+", metavar="NAME=CHECKPOINT")
    parser.add_argument("--kinds", nargs="+", default=["soft"])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--episodes", type=int, default=16)
    given = parser.parse_args()
    named = dict(each.split("=", 1) for each in given.policies)
    for kind in given.kinds:
        task = task_on(given.task, kind, given.episodes)
        for name, checkpoint in named.items():
            policy = find_policy(given.task, Path(checkpoint)).policy(task)
            rows = []
            for seed in range(given.seeds):
                found = evaluate(task, policy, given.episodes, FIRST_SEED + seed)
                metrics = found.metrics
                rows.append([found.mean_return, found.success_rate, metrics["speed_error"], metrics["turn_error"]])
                print(f"  {kind} {name} seed {FIRST_SEED + seed}: {np.round(rows[-1], 3).tolist()}", flush=True)
            table = [interval(column) for column in np.array(rows).T]
            cells = [f"{m} {mean:.3f} ± {half:.3f}" for m, (mean, half) in zip(MEASURES, table, strict=True)]
            print(f"{kind}, {name}: {'; '.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
