"""A task with every kind of observation and episodes of different lengths, and a policy for it: data to record."""

import dataclasses

import pytest
import torch

from simwarp.tasks import Task, TaskConfig
from simwarp.tasks.framework import registry


@dataclasses.dataclass(frozen=True)
class RecordedConfig(TaskConfig):
    dt: float = 0.03
    max_episode_steps: int = 14
    height: int = 36
    width: int = 40
    images: bool = True
    flags: bool = True
    """Truth values, which no network takes."""


class RecordedTask(Task):
    """Worlds end after a number of steps that they draw; every fourth number ends by failure."""

    config_type = RecordedConfig
    action_size = 2
    physics = False
    instruction = "Count to the end."
    action_names = ("left", "right")
    observation_names = {"policy": ("step", "noise")}  # noqa: RUF012 - as a task writes it

    def setup(self):
        config = self.config
        device = self.device
        self.count = torch.zeros(self.num_worlds, device=device)
        self.length = torch.zeros(self.num_worlds, device=device)
        shape = (self.num_worlds, config.height, config.width)
        rows = torch.arange(config.height, device=device).view(-1, 1, 1)
        columns = torch.arange(config.width, device=device).view(1, -1, 1)
        self.ramp = (2 * rows + columns + torch.tensor([0, 40, 80], device=device)).to(torch.uint8)
        self.camera = torch.zeros(*shape, 3, dtype=torch.uint8, device=device)
        self.depth = torch.zeros(self.num_worlds, 4, 6, 1, device=device)

    def apply(self, action):
        self.count += 1.0

    def observations(self):
        noise = self.random.uniform("noise", -1.0, 1.0)[:, 0]
        groups = {
            "policy": torch.stack([self.count, noise], dim=1),
            "one": 0.1 * self.count.unsqueeze(1),
        }
        if self.config.flags:
            groups["flags"] = torch.stack([self.count > 3, self.count > 5], dim=1)
        if self.config.images:
            shift = (5.0 * self.count).to(torch.uint8).view(-1, 1, 1, 1)
            self.camera.copy_(self.ramp + shift)
            self.depth.copy_(noise.view(-1, 1, 1, 1) + torch.arange(24, device=self.device).view(4, 6, 1))
            groups |= {"camera": self.camera, "grey": self.camera[..., :1], "depth": self.depth}
            groups["beams"] = self.depth[..., 0]
        return groups

    def rewards(self):
        return {"count": self.count.clone()}

    def terminations(self):
        return {"failed": (self.count >= self.length) & (self.length % 4 == 0)}

    def truncations(self):
        return {"late": self.count >= self.length}

    def reset(self, world_mask):
        drawn = self.random.uniform("length", 3.0, 12.0)[:, 0].floor()
        self.length.copy_(torch.where(world_mask, drawn, self.length))
        self.count.masked_fill_(world_mask, 0.0)


def by_noise(observations):
    noise = observations["policy"][:, 1]
    return torch.stack([noise, -0.5 * noise], dim=1)


@pytest.fixture
def recorded_task(monkeypatch):
    """Register the task for one test; its name."""
    registry.task_names()
    monkeypatch.setattr(RecordedTask, "name", "recorded-test")
    monkeypatch.setitem(registry._tasks, "recorded-test", RecordedTask)
    return "recorded-test"
