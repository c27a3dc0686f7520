"""A task without physics and with two sets of observations: where the point is, and noisy readings of it."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import Any, ClassVar

import torch

from simwarp.tasks import Task, TaskConfig, register


class Sight(enum.Enum):
    """What a policy observes."""

    PLACE = "place"
    READINGS = "readings"


@dataclasses.dataclass(frozen=True)
class TwoSightsConfig(TaskConfig):
    """Configuration."""

    max_episode_steps: int = 24
    obs: Sight = Sight.READINGS


@register("two-sights")
class TwoSights(Task[TwoSightsConfig]):
    """A point on a line is to be brought to the origin."""

    config_type = TwoSightsConfig
    physics = False
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 20,
        "num_envs": 32,
        "steps_per_iteration": 8,
        "network.hidden": (16,),
    }
    distilling: ClassVar[Mapping[str, Any]] = {"iterations": 6, "steps_per_iteration": 8}

    def setup(self) -> None:
        self.x = torch.zeros(self.num_worlds)

    def apply(self, action: torch.Tensor) -> None:
        self.x.add_(action[:, 0], alpha=0.2)

    def observations(self) -> dict[str, torch.Tensor]:
        seen = self.observations_of(self.config.obs.value)
        assert seen is not None
        return seen

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor] | None:
        if obs == "place":
            return {"policy": self.x.unsqueeze(1)}
        if obs != "readings":
            return None
        # The point, in another measure and among numbers that say nothing
        return {"readings": torch.stack([torch.ones_like(self.x), 3.0 * self.x - 0.5, (7.0 * self.x).sin()], dim=1)}

    def rewards(self) -> dict[str, torch.Tensor]:
        return {"near": 1.0 - self.x.abs()}

    def terminations(self) -> dict[str, torch.Tensor]:
        return {"away": self.x.abs() > 4.0}

    def reset(self, world_mask: torch.Tensor) -> None:
        start = self.random.uniform("start", -2.0, 2.0)
        torch.where(world_mask, start.view_as(self.x), self.x, out=self.x)

    def metrics(self) -> dict[str, torch.Tensor]:
        return {"success": self.x.abs() < 0.3}

    def extra_state(self) -> dict[str, torch.Tensor]:
        return {"x": self.x}

    def load_extra_state(self, state: Any) -> None:
        self.x.copy_(state["x"])
