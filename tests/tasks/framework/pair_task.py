"""Two cart-poles on one rail, each with a policy's action of its own: a task of two agents."""

import dataclasses
import math
from typing import ClassVar

import torch

import simwarp as sw
from simwarp.tasks import Task, TaskConfig

APART = 3.0
PUSH = 10.0


@dataclasses.dataclass(frozen=True)
class PairConfig(TaskConfig):
    dt: float = 0.01
    decimation: int = 2
    max_episode_steps: int = 60
    start: float = 0.05


class PairTask(Task[PairConfig]):
    """Agents do not touch: what one does is nothing to the other. Agent 0 pushes to +X, agent 1 in its own rail."""

    name: ClassVar[str] = "pair"
    config_type = PairConfig
    action_size = 1
    agents = 2
    resting_action = -1.0

    def build(self, builder):
        for agent in range(2):
            cart = builder.add_body(
                f"cart_{agent}", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((agent * APART, 0, 0))
            )
            pole = builder.add_body(
                f"pole_{agent}", mass=0.1, inertia=(0.01, 0.01, 0.001), pose=sw.pose((agent * APART, 0, 0.5))
            )
            builder.add_joint_prismatic(f"slide_{agent}", sw.WORLD, cart, axis=(1, 0, 0))
            builder.add_joint_revolute(f"hinge_{agent}", cart, pole, anchor=(agent * APART, 0, 0), axis=(0, 1, 0))

    def setup(self):
        model = self.simulation.model
        dofs = [[model.dof(f"{kind}_{agent}") for kind in ("slide", "hinge")] for agent in range(2)]
        self.dofs = torch.tensor(dofs, device=self.device)
        self.slides = self.dofs[:, 0].clone()

    def pair(self, values):
        """(W, dofs) as (W, 2, 2): agent, then slide and hinge."""
        return values[:, self.dofs.flatten()].view(-1, 2, 2)

    def apply(self, action):
        self.views.joint_force.index_copy_(1, self.slides, action[..., 0] * PUSH)

    def observations(self):
        return {"policy": torch.cat([self.pair(self.views.joint_q), self.pair(self.views.joint_qd)], dim=2)}

    def rewards(self):
        return {"alive": torch.ones(self.num_worlds, 2, device=self.device)}

    def terminations(self):
        q = self.pair(self.views.joint_q)
        return {"fell": q[..., 1].abs() > math.radians(24.0), "off_track": q[..., 0].abs() > 1.2}

    def reset(self, world_mask):
        spread = self.config.start
        start = self.random.uniform("start", -spread, spread, size=2 * len(self.dofs.flatten()))
        q, qd = torch.zeros_like(start[:, :4]), torch.zeros_like(start[:, :4])
        q.index_copy_(1, self.dofs.flatten(), start[:, :4])
        qd.index_copy_(1, self.dofs.flatten(), start[:, 4:])
        self.simulation.set_joint_state(world_mask, q, qd)

    def metrics(self):
        return {"place": self.pair(self.views.joint_q)[..., 0]}


def pair(worlds=3, seed=0, **config):
    return PairTask(PairConfig(**config), worlds, seed=seed)
