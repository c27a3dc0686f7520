"""A task that is as hard as its level: an episode of one step succeeds where a draw in [0, 1) is not below it."""

import dataclasses

import torch

from simwarp.tasks import Curriculum, Driver, Task, TaskConfig, register


@dataclasses.dataclass(frozen=True)
class GradedConfig(TaskConfig):
    max_episode_steps: int = 1
    curriculum: Curriculum = dataclasses.field(
        default_factory=lambda: Curriculum(Driver.ITERATION, first=0, last=10)
    )  # fmt: skip


@register("graded")
class GradedTask(Task):
    config_type = GradedConfig
    physics = False

    def setup(self):
        self.luck = torch.zeros(self.num_worlds, device=self.device)

    def apply(self, action):
        pass

    def observations(self):
        return {"policy": self.drawn_level.unsqueeze(1).clone()}

    def rewards(self):
        return {"none": torch.zeros_like(self.luck)}

    def terminations(self):
        return {}

    def metrics(self):
        return {"success": self.luck >= self.drawn_level}

    def reset(self, world_mask):
        drawn = self.random.uniform("luck", 0.0, 1.0).flatten()
        self.luck.copy_(torch.where(world_mask, drawn, self.luck))
