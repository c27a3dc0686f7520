"""A task without physics: for tests of training code, and for measuring what the framework itself costs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import torch

from simwarp.tasks import NotNegative, Positive

from .framework.config import RewardWeights, TaskConfig, require
from .framework.drawing import Drawing, Line
from .framework.mirror import Mirror, Reflection
from .framework.registry import register
from .framework.task import Task


@dataclasses.dataclass(frozen=True)
class FastRewards(RewardWeights):
    """Weights of the reward."""

    near: float = 1.0
    """One minus the distance from the origin [m]."""


@dataclasses.dataclass(frozen=True)
class FastConfig(TaskConfig):
    """Configuration of :class:`FastTask`."""

    rewards: FastRewards = FastRewards()
    """Weights of the reward."""
    max_episode_steps: int = 64
    """Control steps after which an episode is truncated."""
    gain: Positive = 0.1
    """Distance a full action moves the point [m]."""
    start_radius: NotNegative = 1.0
    """Half-width of the uniform start position, per axis [m]."""
    bound: float = 2.0
    """Coordinate at which an episode ends as a failure [m]."""

    goal_radius: Positive = 0.2
    """Distance from the origin below which the end of an episode is a success [m]."""

    def validate(self) -> None:
        """Check gain, start and bound."""
        require(self.bound > self.start_radius, self, "bound", "larger than start-radius")


@register("fast")
class FastTask(Task[FastConfig]):
    """A point in a plane that an action moves; the reward is one minus its distance from the origin."""

    summary: ClassVar[str] = "point in a plane, no physics: a dummy for tests and for measuring overhead"
    instruction: ClassVar[str] = "Move the point to the middle of the plane."
    config_type: ClassVar[type[TaskConfig]] = FastConfig
    action_size: int = 2
    listed: ClassVar[bool] = False
    physics: ClassVar[bool] = False
    state_buffers: ClassVar[Mapping[str, str]] = {"position": "position"}
    training: ClassVar[Mapping[str, Any]] = {"iterations": 30, "num_envs": 128, "steps_per_iteration": 16}

    def setup(self) -> None:
        """Allocate the state: (W, 2) position [m]."""
        self.position = torch.zeros(self.num_worlds, 2, device=self.device)
        self.nearest = torch.full((self.num_worlds,), self.config.rewards.near, device=self.device)

    def apply(self, action: torch.Tensor) -> None:
        """Move the point."""
        self.position.add_(action, alpha=self.config.gain)

    def mirror(self) -> Mirror:
        """Return the reflection that turns y."""
        turned = Reflection((0, 1), (1.0, -1.0))
        return Mirror({"policy": turned}, turned)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``: (W, 2) position, the buffer itself."""
        return {"policy": self.position}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``near``: one minus the distance from the origin."""
        return {"near": torch.sub(self.nearest, self.position.norm(dim=1), alpha=self.config.rewards.near)}

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``out_of_bounds``."""
        return {"out_of_bounds": (self.position.abs() > self.config.bound).any(dim=1)}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start anywhere in the start square."""
        radius = self.config.start_radius
        start = self.random.uniform("start", -radius, radius, size=2)
        torch.where(world_mask.unsqueeze(1), start, self.position, out=self.position)

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``final_distance`` [m], and ``success`` where it is below ``goal_radius``."""
        distance = self.position.norm(dim=1)
        return {"final_distance": distance, "success": distance < self.config.goal_radius}

    def drawing(self) -> Drawing:
        """Draw the point as a line from the origin, around which is the goal."""
        tip = torch.nn.functional.pad(self.position, (0, 1))
        angle = torch.linspace(0.0, 2.0 * math.pi, 33, device=self.device)
        ring = self.config.goal_radius * torch.stack([angle.cos(), angle.sin(), 0.0 * angle], dim=1)
        window = ((-self.config.bound, self.config.bound),) * 2
        goal = Line(ring.to(tip.dtype).expand(self.num_worlds, -1, -1), "tab:green", 2.5)
        return Drawing((goal, Line(torch.stack([torch.zeros_like(tip), tip], dim=1), "tab:blue", 3.0)), window)

    def map_position(self) -> torch.Tensor:
        """Position of the point, (W, 3) [m]."""
        return torch.nn.functional.pad(self.position, (0, 1))
