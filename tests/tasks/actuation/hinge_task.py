"""A task of two hinges with motors, for tests."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import torch

import simwarp as sw
from simwarp.actuators import dc_motor, pd_actuator
from simwarp.tasks import ActuatorNetwork, Attachments, Task, TaskConfig, actuators_of

JOINTS = ("left", "right")
STIFFNESS, DAMPING, LIMIT = 12.0, 0.4, 3.0


@dataclasses.dataclass(frozen=True)
class HingeConfig(TaskConfig):
    """With a network's file, torques are the network's."""

    dt: float = 0.004
    decimation: int = 3
    substeps: int = 2
    max_episode_steps: int = 30
    network: str = ""
    driven: bool = False


class HingeTask(Task[HingeConfig]):
    """Targets of two hinges without weight."""

    config_type = HingeConfig
    action_size = 2

    def build(self, builder):
        for index, name in enumerate(JOINTS):
            body = builder.add_body(name, mass=1.0, inertia=(0.05, 0.05, 0.05), pose=sw.pose((0, index, 0)))
            drive = sw.PositionDrive(stiffness=1.0) if self.config.driven else None
            builder.add_joint_revolute(name, sw.WORLD, body, axis=(0, 0, 1), drive=drive)

    def attach(self, model):
        self.motors = None
        if self.config.network:
            return Attachments()
        pd = pd_actuator(
            "left", model.dof("left"), stiffness=STIFFNESS, damping=DAMPING, effort_limit=LIMIT, delay=0.006
        )  # fmt: skip
        motor = dc_motor(
            "right", model.dof("right"), stall_torque=4.0, free_speed=20.0, stiffness=STIFFNESS, damping=DAMPING,
            effort_limit=LIMIT,
        )  # fmt: skip
        self.motors = actuators_of(self, model, [pd, motor])
        return Attachments(elements=[self.motors])

    def setup(self):
        self.learned = None
        if self.motors is not None:
            self.ctrl = sw.to_torch(self.motors.ctrl)
        else:
            self.learned = ActuatorNetwork(self, Path(self.config.network), JOINTS, effort_limit=LIMIT, history=(0, 2))
        self.torques = []

    def apply(self, action):
        if self.learned is None:
            self.ctrl.copy_(action)
        else:
            self.learned.follow(action)

    def after_physics(self):
        if self.learned is not None:
            self.torques.append(self.learned.torque.clone())
            self.learned.advance()

    def observations(self):
        return {"policy": torch.cat([self.views.joint_q, self.views.joint_qd], dim=1)}

    def rewards(self):
        return {"none": torch.zeros(self.num_worlds, device=self.device)}

    def terminations(self):
        return {}

    def reset(self, world_mask):
        q = self.random.uniform("q", -0.5, 0.5, size=2)
        self.simulation.set_joint_state(world_mask, q, torch.zeros_like(q))
        if self.learned is not None:
            self.learned.begin(world_mask)

    def extra_state(self):
        return {} if self.learned is None else self.learned.state()

    def load_extra_state(self, state):
        if self.learned is not None:
            self.learned.load_state(state)


def hinges(worlds=3, seed=0, **config):
    """The task."""
    return HingeTask(HingeConfig(**config), worlds, seed=seed)
