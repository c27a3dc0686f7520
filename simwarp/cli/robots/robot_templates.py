"""Texts of a task around a robot.

@word@ is replaced; a line that begins with "%v " is there for tasks that follow a velocity, one with "%s " for those
that stand.
"""

from __future__ import annotations

from typing import Final

JOINTS: Final = '''ROBOT = Path(__file__).with_name("robot.json")
"""Made by `simwarp new-task` from @source@. `simwarp import robot.json` lists what is in it."""

JOINTS = {
    # name: (stiffness [N m/rad or N/m], damping, largest effort [N m or N], lowest and highest target)
@joints@
}
"""The joints that the policy moves: it gives targets, which drives pull towards."""

HOME = {
@pose@
}
"""Where joints stand at the start [rad or m]@posed@.@height@"""
'''

FLOATING: Final = '''"""@what@.

The first things to change: JOINTS, the fields of the configuration, the terms of `rewards`. All methods but `build`
work in torch, for all worlds (W) at once.
"""

import dataclasses
from pathlib import Path

import simwarp as sw
import torch
from simwarp.tasks import Positive, Task, TaskConfig, register

@table@
BASE = "@base@"
"""The body that is held upright; its x axis is forward."""


@dataclasses.dataclass(frozen=True)
class @Class@Config(TaskConfig):
    """Each field is an option of the command line, as --task.action-scale."""

    dt: float = 0.005
    """Physics step [s]."""
    decimation: int = 4
    """Physics steps per action."""
    max_episode_steps: int = 500
    """Actions after which an episode is truncated."""
    action_scale: Positive = 0.4
    """How far a full action moves a target away from the pose at the start [rad or m]."""
    start_noise: Positive = 0.05
    """Largest deviation of a joint from that pose at the start [rad or m]."""
%v     max_speed: Positive = 0.8
%v     """Largest commanded speed forwards and backwards [m/s]; the smallest is 0.4 of it, the largest sideways too."""
%v     max_turn: Positive = 0.5
%v     """Largest commanded rate about the vertical axis [rad/s]."""


@register("@name@")
class @Class@Task(Task[@Class@Config]):
%s     """Observation `policy` (W, 9 + 3 J), J joints: down, velocity and angular velocity in axes of the base, joints'
%s     positions and rates, last action.
%s     """
%v     """Observation `policy` (W, 12 + 3 J), J joints: down, velocity and angular velocity in axes of the base, joints'
%v     positions and rates, last action, command.
%v     """

    summary = "@summary@"
    config_type = @Class@Config
    action_size = len(JOINTS)
    action_joints = tuple(JOINTS)
    # Defaults of `simwarp train @name@`; a dot reaches into ppo and network
    training = {
        "iterations": 150, "num_envs": 256, "steps_per_iteration": 24, "network.hidden": (128, 64),
        "network.init_std": 0.5, "ppo.gamma": 0.97, "ppo.desired_kl": 0.02,
    }

    def build(self, builder):
        """One world: the robot on the ground."""
        self.robot = sw.importers.load_robot(ROBOT)
        for name, (stiffness, damping, effort, *_) in JOINTS.items():
            self.robot.set_drive(name, sw.PositionDrive(stiffness=stiffness, damping=damping, effort_limit=effort))
@ground@        return self.robot.builder

    def solver_options(self):
        """Contacts to 1 mm/s, which no gait notices, in half of the time that the default takes."""
        return sw.SolverOptions(tolerance=1e-3)

    def setup(self):
        """Buffers of the task's own, allocated once and written in place."""
        robot = self.robot
        columns = {**robot.tendons, **robot.dofs}
        self.joints = torch.tensor([columns[name] for name in JOINTS], device=self.device)
        self.home = torch.tensor(@home@, dtype=torch.float32, device=self.device)
        for name, value in HOME.items():
            self.home[robot.dofs[name]] = value
@stand@        self.pose = self.home[self.joints].clone()
        self.lowest, self.highest = torch.tensor([row[3:] for row in JOINTS.values()], device=self.device).T
        self.base = robot.bodies[BASE]
        self.targets = sw.to_torch(self.simulation.control.joint_target_q)
        self.down = torch.tensor([0.0, 0.0, -1.0], device=self.device).repeat(self.num_worlds, 1)
        self.height = torch.ones(self.num_worlds, device=self.device)
        self.before = torch.zeros_like(self.action)
%v         self.command = torch.zeros(self.num_worlds, 3, device=self.device)
%v         config = self.config
%v         self.most = torch.tensor([config.max_speed, 0.4 * config.max_speed, config.max_turn], device=self.device)

    def in_base(self, vector):
        """(W, 3) vectors of the world in axes of the base."""
        xyz, w = self.views.body_q[:, self.base, 3:6], self.views.body_q[:, self.base, 6:]
        across = 2.0 * torch.linalg.cross(xyz, vector)
        return vector - w * across + torch.linalg.cross(xyz, across)

    def begin_step(self):
        """What a difference between two steps needs."""
        self.before.copy_(self.action)

    def apply(self, action):
        """`action` is (W, A) in [-1, 1] and holds for one control step."""
        target = self.pose + self.config.action_scale * action
        self.targets[:, self.joints] = target.clamp(self.lowest, self.highest)

    def observations(self):
        """Named groups, each (W, ...)."""
        return {
            "policy": torch.cat(
                [
                    self.in_base(self.down),
                    self.in_base(self.views.body_v[:, self.base]),
                    0.25 * self.in_base(self.views.body_omega[:, self.base]),
                    self.views.joint_q[:, self.joints] - self.pose,
                    0.05 * self.views.joint_qd[:, self.joints],
                    self.action,
%v                     self.command,
                ],
                dim=1,
            )
        }

%v     def speed_error(self):
%v         """(W,) how far the horizontal velocity, in axes of the base, is from the commanded one [m/s]."""
%v         speed = self.in_base(self.views.body_v[:, self.base])
%v         return (speed[:, :2] - self.command[:, :2]).norm(dim=1)
%v
    def rewards(self):
        """Named terms, each (W,); the reward is their sum."""
        speed = self.in_base(self.views.body_v[:, self.base])
        turn = self.in_base(self.views.body_omega[:, self.base])
        tilt = self.in_base(self.down)[:, :2]
        pose = self.views.joint_q[:, self.joints] - self.pose
        return {
%v             # nothing at 5/8 of the largest speed: who stands earns little, who goes the wrong way less
%v             "speed": (1.0 - 1.6 * self.speed_error() / self.config.max_speed).clamp(min=-1.0),
%v             "turn": 0.5 * torch.exp(-4.0 * (turn[:, 2] - self.command[:, 2]).square()),
%v             "bounce": -1.0 * speed[:, 2].square() - 0.05 * turn[:, :2].square().sum(dim=1),
%s             "still": torch.exp(-4.0 * speed.square().sum(dim=1) - turn.square().sum(dim=1)),
            "upright": 0.5 * torch.exp(-8.0 * tilt.square().sum(dim=1)),
            "pose": -0.1 * pose.square().mean(dim=1),
            "effort": -0.02 * self.action.square().mean(dim=1),
            "smooth": -0.05 * (self.action - self.before).square().mean(dim=1),
        }

    def terminations(self):
        """Named failures and goals, each (W,) bool."""
        tilted = self.in_base(self.down)[:, 2] > -0.5
        return {"fell": tilted | (self.views.body_q[:, self.base, 2] < 0.5 * self.height)}

%v     def metrics(self):
%v         """The metrics of `simwarp eval`, of the end of an episode; `success` decides about success."""
%v         error = self.speed_error()
%v         near = error < 0.25 * self.config.max_speed
%v         return {"speed_error": error, "success": near & ~self.terminations()["fell"]}
%v
    def reset(self, world_mask):
        """A new episode in the worlds of the mask, nothing in the others: choose with torch.where."""
        q = self.home.repeat(self.num_worlds, 1)
        noise = self.config.start_noise
        q[:, self.joints] += self.random.uniform("joints", -noise, noise, size=self.action_size)
        self.simulation.set_joint_state(world_mask, q, torch.zeros_like(q))
        self.height.copy_(torch.where(world_mask, self.views.body_q[:, self.base, 2], self.height))
        self.before.masked_fill_(world_mask[:, None], 0.0)
%v         command = self.random.uniform("command", -1.0, 1.0, size=3)
%v         command[:, 0] += command[:, 0].sign() * 0.4 * (1.0 - command[:, 0].abs())  # never near zero
%v         command = self.most * command
%v         self.command.copy_(torch.where(world_mask[:, None], command, self.command))
%v
%v     def extra_state(self):
%v         """State of the task's own that a checkpoint must keep."""
%v         return {"command": self.command}
%v
%v     def load_extra_state(self, state):
%v         """Take it back."""
%v         self.command.copy_(state["command"])
'''

FIXED: Final = '''"""@what@.

The first things to change: JOINTS, the fields of the configuration, the terms of `rewards`. All methods but `build`
work in torch, for all worlds (W) at once.
"""

import dataclasses
from pathlib import Path

import simwarp as sw
import torch
from simwarp.tasks import Positive, Task, TaskConfig, register

@table@

@dataclasses.dataclass(frozen=True)
class @Class@Config(TaskConfig):
    """Each field is an option of the command line, as --task.action-scale."""

    dt: float = 0.005
    """Physics step [s]."""
    decimation: int = 4
    """Physics steps per action."""
    max_episode_steps: int = 150
    """Actions after which an episode is truncated."""
    action_scale: Positive = 0.1
    """How far a full action moves a joint's target in one step, as a share of its range."""
    start_noise: Positive = 0.05
    """Largest deviation of a joint from the pose at the start, as a share of its range."""
    max_rate: Positive = 50.0
    """Rate of a joint at which an episode fails [rad/s or m/s]."""


@register("@name@")
class @Class@Task(Task[@Class@Config]):
    """Observation `policy` (W, 4 J), J joints, positions as shares of their ranges: joints, their rates, the way to
    their goals, last action.
    """

    summary = "@summary@"
    config_type = @Class@Config
    action_size = len(JOINTS)
    action_joints = tuple(JOINTS)
    # Defaults of `simwarp train @name@`; a dot reaches into ppo and network
    training = {
        "iterations": 150, "num_envs": 256, "steps_per_iteration": 32, "network.hidden": (128, 64),
        "network.init_std": 0.5, "ppo.gamma": 0.98, "ppo.desired_kl": 0.03,
    }

    def build(self, builder):
        """One world: the robot alone."""
        self.robot = sw.importers.load_robot(ROBOT)
        for name, (stiffness, damping, effort, *_) in JOINTS.items():
            self.robot.set_drive(name, sw.PositionDrive(stiffness=stiffness, damping=damping, effort_limit=effort))
        return self.robot.builder

    def setup(self):
        """Buffers of the task's own, allocated once and written in place."""
        robot = self.robot
        columns = {**robot.tendons, **robot.dofs}
        self.joints = torch.tensor([columns[name] for name in JOINTS], device=self.device)
        self.home = torch.tensor(@home@, dtype=torch.float32, device=self.device)
        for name, value in HOME.items():
            self.home[robot.dofs[name]] = value
        self.lowest, self.highest = torch.tensor([row[3:] for row in JOINTS.values()], device=self.device).T
        self.span = self.highest - self.lowest
        self.targets = sw.to_torch(self.simulation.control.joint_target_q)
        self.pose = self.home[self.joints].clone()
        self.goal = self.pose.repeat(self.num_worlds, 1)

    def apply(self, action):
        """`action` is (W, A) in [-1, 1] and holds for one control step."""
        target = self.views.joint_q[:, self.joints] + self.config.action_scale * self.span * action
        self.targets[:, self.joints] = target.clamp(self.lowest, self.highest)

    def away(self):
        """(W, J) way to the goals, as a share of each joint's range."""
        return (self.goal - self.views.joint_q[:, self.joints]) / self.span

    def observations(self):
        """Named groups, each (W, ...)."""
        q = (self.views.joint_q[:, self.joints] - self.lowest) / self.span
        rates = 0.2 * self.views.joint_qd[:, self.joints] / self.span
        return {"policy": torch.cat([q, rates, self.away(), self.action], dim=1)}

    def rewards(self):
        """Named terms, each (W,); the reward is their sum."""
        error = self.away().square().mean(dim=1)
        return {
            "near": torch.exp(-100.0 * error),
            "far": -error.sqrt(),
            "effort": -0.02 * self.action.square().mean(dim=1),
        }

    def terminations(self):
        """Named failures and goals, each (W,) bool."""
        return {"too_fast": self.views.joint_qd[:, self.joints].abs().amax(dim=1) > self.config.max_rate}

    def metrics(self):
        """The metrics of `simwarp eval`; `success` decides about success."""
        error = self.away().abs().amax(dim=1)
        return {"final_error": error, "success": error < 0.05}

    def reset(self, world_mask):
        """A new episode in the worlds of the mask, nothing in the others: choose with torch.where."""
        q, noise = self.home.repeat(self.num_worlds, 1), self.config.start_noise
        start = self.pose + self.span * self.random.uniform("start", -noise, noise, size=self.action_size)
        q[:, self.joints] = start.clamp(self.lowest, self.highest)
        self.simulation.set_joint_state(world_mask, q, torch.zeros_like(q))
        goal = self.lowest + self.span * self.random.uniform("goal", 0.0, 1.0, size=self.action_size)
        self.goal.copy_(torch.where(world_mask[:, None], goal, self.goal))

    def extra_state(self):
        """State of the task's own that a checkpoint must keep."""
        return {"goal": self.goal}

    def load_extra_state(self, state):
        """Take it back."""
        self.goal.copy_(state["goal"])
'''

TEST: Final = '''"""Tests of the task; run with pytest."""

import dataclasses

import pytest
import torch
from simwarp.tasks import InputError, make
from simwarp.train import default_config, train

import @module@.task as mine


def test_a_step_returns_what_it_should():
    task = make("@name@", num_worlds=4, seed=1)
    result = task.step(torch.zeros(4, task.action_size))
    assert result.observations["policy"].shape == (4, @size@)
    assert torch.isfinite(result.observations["policy"]).all()
    assert torch.isfinite(result.rewards).all()


def test_episodes_repeat_with_their_seed():
    def play(seed):
        task = make("@name@", num_worlds=4, seed=seed)
        return torch.stack([task.step(torch.full((4, task.action_size), 0.3)).rewards for _ in range(10)])

    assert torch.equal(play(1), play(1))
    assert not torch.equal(play(1), play(2))


def test_actions_move_their_joints():
    def joints(action):
        task = make("@name@", num_worlds=1, seed=1)
        task.step(torch.full((1, task.action_size), action))
        return task.views.joint_q[0, task.joints].clone()

    assert (joints(1.0) > joints(-1.0)).any()


def test_impossible_values_are_refused():
    with pytest.raises(InputError, match="action-scale must be positive"):
        make("@name@", action_scale=-1.0)


def test_it_trains(tmp_path):
    config = dataclasses.replace(default_config(mine.@Class@Task), iterations=2, num_envs=8, device="cpu")
    result = train("@name@", config, mine.@Class@Config(), root=tmp_path)
    assert result.iterations == 2
'''

README: Final = """# @name@

A task for simwarp: @summary@. `@module@/task.py` is the place to change.

```sh
pip install -e '.[dev]'
pytest
simwarp train @name@
simwarp eval @name@
simwarp play @name@ --video @name@.gif
```

`pip install -e .` makes the task known to the `simwarp` command through the entry point in `pyproject.toml`.

`@module@/robot.json` holds the robot of `@source@`: its bodies, joints, shapes of contact and names, but not what only
shows. `simwarp import @module@/robot.json --picture robot.png` draws it. To take another version of the file:
`simwarp import NEW_FILE --save @module@/robot.json`.
"""
