"""A ball on rough ground: the smallest task that has a ground with levels."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import torch

import simwarp as sw
from simwarp.scenery import GroundKind
from simwarp.tasks import Task, TaskConfig
from simwarp.tasks.locomotion.velocity.ground import FlatGround, Ground, RoughConfig, RoughGround, ground_of
from simwarp.tasks.locomotion.velocity.height_scan import ScanConfig

RADIUS = 0.1
DROP = 0.005
"""Height above the ground at which an episode begins [m]."""


@dataclasses.dataclass(frozen=True)
class RollingConfig(TaskConfig):
    dt: float = 0.005
    decimation: int = 4
    max_episode_steps: int = 40
    ground: Ground = Ground.ROUGH
    rough: RoughConfig = dataclasses.field(
        default_factory=lambda: RoughConfig(kinds=(GroundKind.ROUGH, GroundKind.STAIRS_UP, GroundKind.STAIRS_DOWN))
    )
    scan: ScanConfig = dataclasses.field(default_factory=lambda: ScanConfig(ahead=5, across=3, spacing=0.15))


class Rolling(Task[RollingConfig]):
    """A force pushes the ball along x and y; it should roll along x with 1 m/s."""

    name = "rolling"
    config_type = RollingConfig
    action_size = 2
    per_world = RoughGround.model_arrays

    def build(self, builder: sw.ModelBuilder) -> None:
        self.ground: FlatGround = ground_of(
            self.config.ground, RADIUS, rough=self.config.rough, scan=self.config.scan
        )  # fmt: skip
        self.ground.build(builder, material=sw.Material(friction=1.0))
        self.ball = builder.add_solid(
            "ball", "sphere", RADIUS, mass=1.0, pose=sw.pose((0.0, 0.0, RADIUS + DROP)),
            material=sw.Material(friction=1.0),
        )  # fmt: skip

    def setup(self) -> None:
        self.ground.bind(self)
        self.yaw = torch.zeros(self.num_worlds, device=self.device)
        self.command = torch.tensor([1.0, 0.0], device=self.device).repeat(self.num_worlds, 1)

    def apply(self, action: torch.Tensor) -> None:
        self.views.body_force[:, self.ball, :2] = 10.0 * action

    def observations(self) -> dict[str, torch.Tensor]:
        return {"policy": self.ground.scan(self.views.body_q[:, self.ball, :3], self.yaw)}

    def rewards(self) -> dict[str, torch.Tensor]:
        self.ground.record(self.views.body_v[:, self.ball, :2], self.command)
        return {"speed": self.views.body_v[:, self.ball, 0].clone()}

    def terminations(self) -> dict[str, torch.Tensor]:
        return {}

    def truncations(self) -> dict[str, torch.Tensor]:
        return {"outside": self.ground.outside(self.views.body_q[:, self.ball, :2])}

    def reset(self, world_mask: torch.Tensor) -> None:
        self.ground.choose(world_mask)

    def metrics(self) -> dict[str, torch.Tensor]:
        return self.ground.metrics()

    def on_iteration(self, iteration: int) -> Mapping[str, torch.Tensor]:
        super().on_iteration(iteration)
        self.ground.climb()
        return self.ground.metrics()

    def extra_state(self) -> dict[str, torch.Tensor]:
        return self.ground.extra_state()

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        self.ground.load_extra_state(state)

    def scene(self) -> Any:
        return self.ground.scene(self)


def rolling(worlds: int = 4, seed: int = 0, first_world: int = 0, **config: Any) -> Rolling:
    """A batch of them on the CPU."""
    return Rolling(RollingConfig(**config), worlds, seed=seed, first_world=first_world)
