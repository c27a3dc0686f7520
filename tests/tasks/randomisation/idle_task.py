"""A task in which nobody does anything, for what is drawn in its worlds."""

import torch

from simwarp.tasks import Task


class IdleTask(Task):
    """Observes coordinates; a subclass builds the model."""

    summary = "for tests"
    action_size = 1

    def apply(self, action):
        pass

    def reset(self, world_mask):
        pass

    def observations(self):
        return {"policy": self.views.joint_q}

    def rewards(self):
        return {"none": torch.zeros(self.num_worlds, device=self.device)}

    def terminations(self):
        return {}
