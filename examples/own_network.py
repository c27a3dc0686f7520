"""A network of one's own on a cloud of points: a ball rolls to the middle of posts that a lidar would see.

The network lets the points attend to each other's features, which no encoder of `--network.kind multi-input` does. From
the command line the same is

    simwarp train examples/own_network.py:BallTask --network.class examples/own_network.py:Attention --iterations 60

Run: python examples/own_network.py --iterations 60
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import nn

import simwarp as sw
from simwarp.tasks import Task, register, replace_fields
from simwarp.train import ExportFormat, default_config, export_policy, train

POINTS = 24


class Attention(nn.Module):
    """One layer of attention over a cloud of points, beside all vectors.

    Args:
        shapes: observation group -> shape, without the worlds.
        outputs: numbers to return: the actions of an actor, one value of a critic.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], outputs: int) -> None:
        super().__init__()
        self.lift = nn.Linear(shapes["cloud"][-1], 32)
        self.attention = nn.MultiheadAttention(32, num_heads=2, batch_first=True)
        self.head = nn.Sequential(nn.Linear(32 + shapes["policy"][0], 64), nn.ELU(), nn.Linear(64, outputs))

    def forward(self, groups: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Return (N, outputs) for groups by name, each (N, ...)."""
        points = self.lift(groups["cloud"])
        seen = self.attention(points, points, points, need_weights=False)[0].mean(dim=1)
        out: torch.Tensor = self.head(torch.cat([seen, groups["policy"]], dim=1))
        return out


@register("ball-among-posts")
class BallTask(Task):
    """The ball sees posts on a circle around the goal, from where it is, in an order that differs in each episode."""

    summary = "a ball rolls to the middle of a circle of posts"
    action_size = 2
    training: ClassVar[Mapping[str, Any]] = {
        "num_envs": 64, "iterations": 60, "ppo.gamma": 0.95, "network.init_std": 0.5,
    }  # fmt: skip

    def build(self, builder: sw.ModelBuilder) -> None:
        builder.add_shape_plane(sw.WORLD, name="ground")
        builder.add_solid("ball", "sphere", 0.1, mass=1.0, pose=sw.pose((0, 0, 0.1)))

    def setup(self) -> None:
        self.posts = torch.zeros(self.num_worlds, POINTS, 4, device=self.device)
        self.middle = torch.zeros(self.num_worlds, 2, device=self.device)

    def away(self) -> torch.Tensor:
        return self.middle - self.views.body_q[:, 0, :2]

    def apply(self, action: torch.Tensor) -> None:
        self.views.body_force[:, 0, :2] = 2.0 * action - self.views.body_v[:, 0, :2]

    def observations(self) -> dict[str, torch.Tensor]:
        cloud = self.posts.clone()
        cloud[:, :, :2] -= self.views.body_q[:, 0, None, :2]
        return {"policy": self.views.body_v[:, 0, :2].clone(), "cloud": cloud}

    def rewards(self) -> dict[str, torch.Tensor]:
        return {"near": 1.0 - self.away().norm(dim=1)}

    def terminations(self) -> dict[str, torch.Tensor]:
        return {}

    def metrics(self) -> dict[str, torch.Tensor]:
        return {"success": self.away().norm(dim=1) < 0.3}

    def reset(self, world_mask: torch.Tensor) -> None:
        middle = self.random.uniform("middle", -1.0, 1.0, size=2)
        angle = self.random.uniform("angles", 0.0, 6.2832, size=POINTS)
        circle = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)], dim=2)
        circle[:, :, :2] += middle.unsqueeze(1)
        self.middle.copy_(torch.where(world_mask[:, None], middle, self.middle))
        self.posts.copy_(torch.where(world_mask[:, None, None], circle, self.posts))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=60)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    options = parser.parse_args()
    task = sw.tasks.task_class("ball-among-posts")
    chosen = {"network.class_": f"{__file__}:Attention", "iterations": options.iterations, "device": "cpu"}
    config = replace_fields(default_config(task), chosen)
    # Ten actions a second, for six seconds
    result = train(task.name, config, task.config_type(decimation=10, max_episode_steps=60), root=options.runs)
    export = export_policy(Path(result.run), ExportFormat.ONNX, options.runs / "attention.onnx")
    print(f"mean return {result.mean_reward}, of 60 at best; the file differs by {export.max_difference:.1e} at most")


if __name__ == "__main__":
    main()
