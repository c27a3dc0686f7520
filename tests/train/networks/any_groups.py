"""A task without physics that shows the place of a point in any kinds of observations, and networks of one's own."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from rsl_rl.models import MLPModel
from torch import nn

from simwarp.tasks import Task, TaskConfig, register

SHAPES: Mapping[str, Mapping[str, tuple[int, ...]]] = {
    "vector": {"policy": (3,)},
    "image": {"camera": (12, 10, 3)},
    "depth": {"depth": (9, 40, 1)},
    "ranges": {"lidar": (16, 90, 2)},
    "one-row": {"lidar": (1, 61, 2)},
    "points": {"cloud": (50, 4)},
    "grid-of-points": {"cloud": (4, 9, 4)},
    "scan": {"scan": (61, 2)},
    "history": {"history": (5, 4)},
    "mixture": {"policy": (3,), "camera": (12, 10, 3), "depth": (9, 40, 1), "cloud": (50, 4), "scan": (61, 2)},
}
"""Observations by name: groups and their shapes."""
BYTES = ("camera",)
"""Groups of uint8; the others are float32."""
NAMED: Mapping[str, Mapping[str, str]] = {
    "grid-of-points": {"cloud": "points"},
    "history": {"history": "sequence"},
}
"""Kinds that the shape does not say."""


class Seen(enum.Enum):
    """What a policy observes."""

    VECTOR = "vector"
    IMAGE = "image"
    DEPTH = "depth"
    RANGES = "ranges"
    ONE_ROW = "one-row"
    POINTS = "points"
    GRID_OF_POINTS = "grid-of-points"
    SCAN = "scan"
    HISTORY = "history"
    MIXTURE = "mixture"


@dataclasses.dataclass(frozen=True)
class AnyGroupsConfig(TaskConfig):
    """Configuration."""

    max_episode_steps: int = 12
    obs: Seen = Seen.VECTOR


@register("any-groups")
class AnyGroups(Task[AnyGroupsConfig]):
    """A point on a line is to be brought to the origin."""

    config_type = AnyGroupsConfig
    listed: ClassVar[bool] = False
    action_size = 2
    physics = False
    training: ClassVar[Mapping[str, Any]] = {
        "num_envs": 8, "steps_per_iteration": 8, "ppo.epochs": 1, "ppo.mini_batches": 2, "network.hidden": (16,),
    }  # fmt: skip

    @property
    def observation_kinds(self) -> Mapping[str, str]:
        return NAMED.get(self.config.obs.value, {})

    def setup(self) -> None:
        self.x = torch.zeros(self.num_worlds)

    def apply(self, action: torch.Tensor) -> None:
        self.x.add_(action[:, 0], alpha=0.1)

    def observations(self) -> dict[str, torch.Tensor]:
        found = self.observations_of(self.config.obs.value)
        assert found is not None
        return found

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor] | None:
        groups = {}
        for name, shape in SHAPES[str(obs)].items():
            count = torch.Size(shape).numel()
            wave = torch.sin(0.37 * torch.arange(count) + 2.0 * self.x.unsqueeze(1)).view(-1, *shape)
            groups[name] = (127.0 + 127.0 * wave).to(torch.uint8) if name in BYTES else 20.0 * wave
        return groups

    def privileged(self) -> torch.Tensor | None:
        return self.x.unsqueeze(1)

    def rewards(self) -> dict[str, torch.Tensor]:
        return {"near": 1.0 - self.x.abs()}

    def terminations(self) -> dict[str, torch.Tensor]:
        return {}

    def reset(self, world_mask: torch.Tensor) -> None:
        start = self.random.uniform("start", -1.0, 1.0)[:, 0]
        self.x.copy_(torch.where(world_mask, start, self.x))

    def extra_state(self) -> dict[str, torch.Tensor]:
        return {"x": self.x}

    def load_extra_state(self, state: Any) -> None:
        self.x.copy_(state["x"])


class Flat(nn.Module):
    """One layer over all numbers of all groups."""

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], outputs: int) -> None:
        super().__init__()
        self.names = sorted(shapes)
        self.layer = nn.Linear(sum(torch.Size(shape).numel() for shape in shapes.values()), outputs)

    def forward(self, groups: Mapping[str, torch.Tensor]) -> torch.Tensor:
        numbers = [groups[name].flatten(1) / (255.0 if name in BYTES else 1.0) for name in self.names]
        out: torch.Tensor = self.layer(torch.cat(numbers, dim=1))
        return out


class Wide(Flat):
    """It returns one number more than it should."""

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], outputs: int) -> None:
        super().__init__(shapes, outputs + 1)


class Odd(Flat):
    """It returns no tensor."""

    def forward(self, groups: Any) -> Any:
        return [super().forward(groups)]


class Lost(Flat):
    """It asks for a group that is not there."""

    def forward(self, groups: Any) -> torch.Tensor:
        out: torch.Tensor = groups["radar"]
        return out


class Idle(Flat):
    """It has a layer that nothing goes through."""

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], outputs: int) -> None:
        super().__init__(shapes, outputs)
        self.spare = nn.Linear(2, 2)


class Lonely(nn.Module):
    """It wants other arguments."""

    def __init__(self) -> None:
        super().__init__()


class Model(MLPModel):
    """A model of rsl-rl: its perceptron over vectors, twice as wide as asked for."""

    def __init__(self, *arguments: Any, hidden_dims: list[int], **options: Any) -> None:
        super().__init__(*arguments, hidden_dims=[2 * units for units in hidden_dims], **options)


class NoNetwork:
    """It is no torch module."""


def build(*arguments: Any) -> Flat:
    """A function, where a class is wanted."""
    return Flat(*arguments)
