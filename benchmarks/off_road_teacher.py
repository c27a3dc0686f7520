"""A teacher for several vehicles off-road: the shipped policy by state, with a governor that holds its speed.

    python benchmarks/off_road_teacher.py --output governed.npz
    simwarp clone off-road --data governed.npz --output governed.pt --epochs 30

Students of ``simwarp distill off-road --teacher governed.pt`` learn it by camera (docs/results.md has the command).
The policy learnt in the Gator, whose engine limits its speed; faster vehicles roll over or leave the map with it. The
governor releases the throttle and then brakes as the speed comes near a limit that all of them stand. Half of the
worlds act with noise, so that the trajectories show how to come back; its mean is zero, and cloning averages it out.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import torch

from simwarp.tasks import Task, make
from simwarp.train.datasets.episodes import record
from simwarp.train.datasets.trajectories import Trajectories, save_trajectories
from simwarp.train.networks.policies import network_policy, shipped_policy
from simwarp.train.runs.checkpoint import load_checkpoint

SPEED_COLUMN = 5
"""Of the state: the speed ahead."""
SPEED_UNIT = 8.0
"""What it is measured in [m/s]."""
SUCCESS_REWARD = 3.0
"""A last step with more reward than this has reached the goal."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of the recording."""

    output: Path
    vehicles: str
    worlds: int
    episodes: int
    limit: float
    gain: float
    noise: float
    seed: int


def read_options() -> Options:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("governed.npz"), help="file of trajectories to write")
    parser.add_argument("--vehicles", default="hmmwv-14dof,gator-14dof,sedan-14dof", help="they share the batch")
    parser.add_argument("--worlds", type=int, default=96, help="of all vehicles together")
    parser.add_argument("--episodes", type=int, default=384, help="episodes that are recorded")
    parser.add_argument("--limit", type=float, default=8.0, help="speed at which no throttle is left [m/s]")
    parser.add_argument("--gain", type=float, default=0.5, help="pedal per speed below or above that limit [s/m]")
    parser.add_argument("--noise", type=float, default=0.3, help="deviation of actions in every second world")
    parser.add_argument("--seed", type=int, default=1, help="of worlds and noise")
    return Options(**vars(parser.parse_args()))


class Governed:
    """The shipped policy whose pedal is at most ``gain`` times the speed that is left to the limit."""

    def __init__(self, task: Task, options: Options) -> None:
        path = shipped_policy("off-road", "state")
        assert path is not None
        self.inner = network_policy(load_checkpoint(path), task)
        self.options = options
        self.generator = torch.Generator().manual_seed(options.seed)
        self.deviation = options.noise * (torch.arange(task.num_worlds) % 2).unsqueeze(1)

    def __call__(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return the actions, (W, 2)."""
        actions = self.inner(observations).clamp(-1.0, 1.0)
        left = self.options.limit - SPEED_UNIT * observations["policy"][:, SPEED_COLUMN]
        actions[:, 1] = torch.minimum(actions[:, 1], self.options.gain * left)
        return actions + self.deviation * torch.randn(actions.shape, generator=self.generator)


def told(task: Task, found: Trajectories, options: Options) -> None:
    """Print the success of each vehicle, without noise and with it."""
    rounds = options.episodes // options.worlds
    last = np.flatnonzero(found.terminated | found.truncated)
    reached = found.rewards[last] > SUCCESS_REWARD
    world = np.arange(len(last)) // rounds  # episodes of a world follow each other
    for group in task.model_groups:
        mine = (world >= group.rows.start) & (world < group.rows.stop)
        speed = SPEED_UNIT * found.observations["policy"][:, SPEED_COLUMN]
        rows = np.isin(found.episode, np.flatnonzero(mine))
        rates = [f"{reached[mine & (world % 2 == odd)].mean():.3f}" for odd in (0, 1)]
        quantiles = np.quantile(speed[rows], (0.5, 0.95)).round(1).tolist()
        print(f"{group.name}: success {rates[0]}, with noise {rates[1]}; speed median, 95 %: {quantiles} m/s")


def main(options: Options) -> None:
    """Record the governed policy."""
    worlds: dict[str, Any] = {"obstacles": 50, "hills": 1.0, "varied": True}
    task = make("off-road", options.worlds, obs="state", vehicle=options.vehicles, seed=options.seed, **worlds)
    found = record(task, Governed(task, options), options.episodes, options.seed, {"governor": options.limit})
    save_trajectories(options.output, found)
    told(task, found, options)


if __name__ == "__main__":
    main(read_options())
