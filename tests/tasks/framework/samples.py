"""Tasks that exist only to be tested."""

import dataclasses

import torch

from simwarp.tasks import Task, TaskConfig


@dataclasses.dataclass(frozen=True)
class SampleConfig(TaskConfig):
    max_episode_steps: int = 5


class Counter(Task):
    """Each world counts its own steps in the buffer it returns; the action is added to a second group."""

    name = "counter"
    config_type = SampleConfig
    action_size = 2
    physics = False

    def setup(self):
        self.count = torch.zeros(self.num_worlds, 1, device=self.device)
        self.image = torch.zeros(self.num_worlds, 2, 3, 1, dtype=torch.uint8, device=self.device)
        self.fail = torch.zeros(self.num_worlds, dtype=torch.bool, device=self.device)

    def apply(self, action):
        self.count += 1.0
        self.image += 1

    def observations(self):
        return {"policy": self.count, "camera": self.image}

    def rewards(self):
        return {"one": torch.ones_like(self.count[:, 0]), "count": self.count[:, 0].clone()}

    def terminations(self):
        return {"failed": self.fail.clone()}

    def reset(self, world_mask):
        self.count.masked_fill_(world_mask.unsqueeze(1), 0.0)
        self.image.masked_fill_(world_mask.view(-1, 1, 1, 1), 0)
        self.fail.masked_fill_(world_mask, False)

    def extra_state(self):
        return {"count": self.count}

    def load_extra_state(self, state):
        self.count.copy_(state["count"])


def counter(worlds=3, **config):
    return Counter(SampleConfig(**config), worlds)
