"""What a mixed batch costs: its steps beside those of its models, each in a batch of its own, in one process.

    python benchmarks/mixed_batches.py obstacle-avoidance --obs state
    python benchmarks/mixed_batches.py off-road --obs camera --worlds 48

Both take the same worlds through the same actions, in turns, as a trainer steps them; results are compared bit by bit.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
import time
from pathlib import Path
from typing import Any

import torch

from simwarp.tasks import Task, make
from simwarp.train.algorithm.vec_env import TaskVecEnv

ROOT = Path(__file__).resolve().parents[1]


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of the comparison."""

    task: str
    obs: str
    vehicles: str
    worlds: int
    steps: int
    turns: int
    save: Path | None


def read_options() -> Options:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", nargs="?", default="obstacle-avoidance", help="task that is stepped")
    parser.add_argument("--obs", default="state", help="its observations")
    parser.add_argument("--vehicles", default="hmmwv,gator,sedan", help="models of the batch")
    parser.add_argument("--worlds", type=int, default=96, help="of all models together")
    parser.add_argument("--steps", type=int, default=10, help="control steps of a turn")
    parser.add_argument("--turns", type=int, default=7, help="turns of either")
    parser.add_argument("--save", type=Path, help="file to which the figures are added, as JSON")
    return Options(**vars(parser.parse_args()))


def seconds_of(envs: list[TaskVecEnv], actions: list[torch.Tensor]) -> tuple[float, torch.Tensor]:
    """Return the CPU time in which environments, one after another, take steps, and the observations at their end."""
    start = time.process_time()
    seen = []
    first = 0
    for env in envs:
        for action in actions:
            groups = env.step(action[first : first + env.num_envs])[0]
        first += env.num_envs
        seen.append(groups["policy"])
    return time.process_time() - start, torch.cat(seen)


def compare(options: Options) -> dict[str, Any]:
    """Return the figures of one comparison."""
    settings: dict[str, Any] = {"obs": options.obs, "seed": 1}
    whole = make(options.task, options.worlds, vehicle=options.vehicles, **settings)
    alone: list[Task[Any]] = [
        make(options.task, group.count, vehicle=group.name, first_world=group.rows.start, **settings)
        for group in whole.model_groups
    ]
    mixed, apart = [TaskVecEnv(whole)], [TaskVecEnv(task) for task in alone]
    generator = torch.Generator().manual_seed(0)
    shares = []
    spent: dict[str, list[float]] = {"mixed": [], "apart": []}
    for turn in range(options.turns + 1):  # the first one loads kernels
        actions = [torch.rand(options.worlds, 2, generator=generator) * 2.0 - 1.0 for _ in range(options.steps)]
        order = [("mixed", mixed), ("apart", apart)]
        found = {name: seconds_of(envs, actions) for name, envs in (order if turn % 2 else order[::-1])}
        assert torch.equal(found["mixed"][1], found["apart"][1]), "rows differ"
        if turn:
            shares.append(found["mixed"][0] / found["apart"][0])
            for name, times in spent.items():
                times.append(found[name][0])
    rate = options.worlds * options.steps
    return {
        "task": options.task, "obs": options.obs, "worlds": {group.name: group.count for group in whole.model_groups},
        "env_steps_per_cpu_s_mixed": rate / statistics.median(spent["mixed"]),
        "env_steps_per_cpu_s_apart": rate / statistics.median(spent["apart"]),
        "dearer_median": statistics.median(shares) - 1.0, "dearer_least": min(shares) - 1.0,
        "dearer_most": max(shares) - 1.0, "turns": options.turns, "threads": 1,
    }  # fmt: skip


def main(options: Options) -> None:
    """Compare, print and keep the figures."""
    torch.set_num_threads(1)
    found = compare(options)
    print(
        f"{found['task']}, {found['obs']}: {found['env_steps_per_cpu_s_mixed']:.0f} env steps per CPU-second mixed, "
        f"{found['env_steps_per_cpu_s_apart']:.0f} apart; dearer by {found['dearer_median']:+.1%} "
        f"({found['dearer_least']:+.1%} to {found['dearer_most']:+.1%} over {found['turns']} turns)"
    )
    if options.save is not None:
        known = json.loads(options.save.read_text(encoding="utf-8")) if options.save.exists() else []
        options.save.write_text(json.dumps([*known, found], indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(read_options())
