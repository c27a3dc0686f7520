"""A robot of several sizes: a chain of links that a torque swings, which exists only to be tested."""

import dataclasses
from typing import Annotated

import torch

import simwarp as sw
from simwarp.tasks import Ge, Le, Positive, Task, TaskConfig


@dataclasses.dataclass(frozen=True)
class ChainConfig(TaskConfig):
    max_episode_steps: int = 5
    links: Annotated[int, Ge(1), Le(4)] = 1
    length: Positive = 0.5
    """Of a link [m]."""
    told_of_all: bool = False
    """Observe every joint, of which models of other sizes have another number."""


class ChainTask(Task[ChainConfig]):
    """Observations: angle and rate of the first joint, and a draw of the episode."""

    name = "chain"
    config_type = ChainConfig
    action_size = 1
    action_names = ("torque",)

    def build(self, builder):
        previous, length = sw.WORLD, self.config.length
        for link in range(self.config.links):
            middle = sw.pose((0.0, 0.0, -(link + 0.5) * length))
            body = builder.add_body(f"link_{link}", mass=1.0, inertia=(0.02, 0.02, 0.01), pose=middle)
            anchor = (0.0, 0.0, -link * length)
            builder.add_joint_revolute(f"hinge_{link}", previous, body, axis=(0, 1, 0), anchor=anchor)
            previous = body

    def setup(self):
        self.drawn = torch.zeros(self.num_worlds, 1, device=self.device)

    def apply(self, action):
        self.views.joint_force[:, :1] = 5.0 * action

    def observations(self):
        joints = slice(None) if self.config.told_of_all else slice(1)
        return {"policy": torch.cat([self.views.joint_q[:, joints], self.views.joint_qd[:, joints], self.drawn], dim=1)}

    def rewards(self):
        return {"rate": self.views.joint_qd[:, 0].abs(), "angle": -self.views.joint_q[:, 0].abs()}

    def terminations(self):
        return {"turned": self.views.joint_q[:, 0].abs() > 1.5}

    def metrics(self):
        return {"reach": self.views.joint_q[:, 0].clone()}

    def reset(self, world_mask):
        self.drawn.copy_(torch.where(world_mask[:, None], self.random.uniform("drawn", -1.0, 1.0), self.drawn))
        start = self.random.uniform("start", -0.5, 0.5, size=self.config.links)
        self.simulation.set_joint_state(world_mask, start, torch.zeros_like(start))

    def extra_state(self):
        return {"drawn": self.drawn}

    def load_extra_state(self, state):
        self.drawn.copy_(state["drawn"])
