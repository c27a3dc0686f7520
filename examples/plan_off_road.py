"""A Gator finds its way between rocks and trees without a policy: 48 imagined ones drive ahead, ten times a second.

Run: python examples/plan_off_road.py --film gator.gif

What a sample of steering and pedals costs is what the task itself says of it: metres to the goal, and what ends a trip
badly. The film shows the ways that are tried, in grey, and the goal.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import torch

from simwarp.planning import Imagination, Mppi, MppiConfig
from simwarp.tasks import make
from simwarp.train import Frame, write_video
from simwarp.viewer import FollowCamera, Polyline


class Trip:
    """One Gator with a goal, and imagined ones.

    Args:
        samples: imagined Gators.
        seed: of ground, goal and samples.
    """

    def __init__(self, samples: int = 48, seed: int = 0) -> None:
        self.real: Any = make("off-road", 1, device="cpu", seed=seed, obs="state")
        self.imagined = make("off-road", samples, device="cpu", seed=seed, obs="state")
        config = MppiConfig(horizon=20, knots=5, noise=(0.5, 0.4), temperature=0.3, seed=seed)
        self.planner = Mppi(Imagination(self.real, self.imagined), self.cost, config)
        self.ways: list[torch.Tensor] = []
        """Places of the imagined Gators, (samples, 3) [m] after each control step of a plan."""

    def cost(self, task: Any, action: torch.Tensor) -> torch.Tensor:
        """Of one control step, from the rewards of the task: an end counts in every step that follows it."""
        self.ways.append(task.map_position().clone())
        rewards = task.rewards()
        return -10.0 * rewards["progress"] - 0.2 * rewards["goal"] - rewards["failure"] + 0.02 * action[:, 0] ** 2

    def step(self) -> str:
        """One control step of the real Gator; how the trip ended, or nothing."""
        self.ways.clear()
        result = self.real.step(self.planner.plan())
        reason = int(result.end_reason[0])
        return self.real.end_reasons[reason] if reason >= 0 else ""

    def lines(self) -> list[Polyline]:
        """Ways that were tried, and what the task draws."""
        ways = torch.stack(self.ways, dim=1).float().cpu().numpy()[::3]
        goal = self.real.drawing().lines[0].points[0].cpu().numpy()
        green, grey = (0.2, 0.7, 0.3), (0.8, 0.8, 0.8)
        return [*(Polyline(way, grey, 1.0) for way in ways), Polyline(goal, green, 2.5)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=48, help="imagined Gators")
    parser.add_argument("--seconds", type=float, default=20.0, help="the longest")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--film", type=Path, default=None, help=".gif or .mp4 to write")
    args = parser.parse_args()
    trip = Trip(args.samples, args.seed)
    period = trip.real.config.control_dt
    camera = None
    if args.film:
        camera = FollowCamera(trip.real.simulation, trip.real.scene(), trip.real.shot(), width=480, height=300)
    frames, reason, step = [], "", 0
    while not reason and step < round(args.seconds / period):
        time = step * period
        if camera is not None and step:
            frames.append(Frame(time, camera.render(time, [trip.lines()])))
        reason = trip.step()
        step += 1
    print(f"after {step * period:.1f} s: {reason or 'on the way'}")
    if args.film:
        write_video(args.film, frames, "A Gator without a policy")
        print(f"{len(frames)} pictures: {args.film}")


if __name__ == "__main__":
    main()
