"""A task with a camera that exists only to be tested: a bright column stands where the point is."""

import dataclasses

import pytest
import torch

from simwarp.tasks import Task, TaskConfig
from simwarp.tasks.framework import registry

HEIGHT, WIDTH = 36, 40


@dataclasses.dataclass(frozen=True)
class CameraConfig(TaskConfig):
    max_episode_steps: int = 20
    vectors: bool = True
    images: bool = True


class CameraTask(Task):
    """Move a point on a line to the middle; `camera` shows where it is, `policy` how fast it moved."""

    config_type = CameraConfig
    action_size = 2
    physics = False

    def setup(self):
        self.x = torch.zeros(self.num_worlds, device=self.device)
        self.image = torch.zeros(self.num_worlds, HEIGHT, WIDTH, 3, dtype=torch.uint8, device=self.device)
        self.columns = torch.arange(WIDTH, device=self.device)

    def apply(self, action):
        self.x.add_(action[:, 0], alpha=0.1).clamp_(-1.0, 1.0)

    def observations(self):
        column = ((self.x + 1.0) * 0.5 * (WIDTH - 1)).round().unsqueeze(1)
        bright = ((self.columns - column).abs() < 3).to(torch.uint8) * 255
        self.image.copy_(bright.view(-1, 1, WIDTH, 1).expand_as(self.image))
        groups = {}
        if self.config.vectors:
            groups["policy"] = torch.stack([self.action[:, 0], self.action[:, 1], self.x], dim=1)
        if self.config.images:
            groups["camera"] = self.image
        return groups

    def rewards(self):
        return {"near": 1.0 - self.x.abs()}

    def terminations(self):
        return {}

    def reset(self, world_mask):
        start = self.random.uniform("start", -1.0, 1.0)[:, 0]
        self.x.copy_(torch.where(world_mask, start, self.x))

    def extra_state(self):
        return {"x": self.x}

    def load_extra_state(self, state):
        self.x.copy_(state["x"])


@pytest.fixture
def camera_task(monkeypatch):
    """Register the task for one test; its name."""
    registry.task_names()
    monkeypatch.setattr(CameraTask, "name", "camera-test")
    monkeypatch.setitem(registry._tasks, "camera-test", CameraTask)
    return "camera-test"
