"""Ant: a ball on four legs of two links walks along X, driven by eight torques.

Numbers of ``chrono_ant-v0`` (gym-chrono, ``envs/basic/ChronoAnt.py``), turned from Y up to Z up: forward is +X, left
is +Y. The robot itself is :func:`simwarp.scenes.ant`.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import NamedRows, RewardWeights, TaskConfig, Variant, filled, register
from simwarp.tasks.locomotion import BASE, Orientation, Touching, WalkingConfig, WalkingTask

from . import ant_kernels as kernels

_HIP_LIMIT = math.pi / 3.0
_ANKLE_LIMITS = (-math.pi / 2.0, math.pi / 4.0)


class AntReward(enum.Enum):
    """Variants of the reward.

    ``walk`` is this project's own: a speed that is enough, along the line. ``code`` is that of the original's code,
    ``thesis`` what the thesis prints (its eq. 8.1; power of the torques in watts), but for the limits, each of which
    costs 0.6 as in the code. The equation prints + 3 per limit, a reward for what its text wants avoided: with the
    variant ``thesis`` of the task each costs 3.
    """

    WALK = "walk"
    CODE = "code"
    THESIS = "thesis"


_VARIANTS = {AntReward.WALK: kernels.WALK, AntReward.CODE: kernels.CODE, AntReward.THESIS: kernels.THESIS}
_CODE_WEIGHTS = {"progress": 1.0, "alive": 1.0, "energy": -0.2, "joint_pos_limits": -0.6}
_WEIGHTS: Mapping[AntReward, Mapping[str, float]] = {
    AntReward.WALK: {
        "progress": 2.0, "alive": 0.5, "energy": -0.05, "joint_pos_limits": -0.05, "lin_vel_y_l1": -0.5,
        "heading": -0.5, "line": -1.0,
    },
    AntReward.CODE: _CODE_WEIGHTS,
    AntReward.THESIS: _CODE_WEIGHTS,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class AntRewards(RewardWeights):
    """Weights of the reward; None is that of its variant, of which ``code`` and ``thesis`` have the first four."""

    progress: float | None = None
    """Speed towards a target far ahead [m/s]; with ``walk`` at most ``target_speed``, less half of what exceeds it."""
    alive: float | None = None
    """1, and -1 where the torso touches the ground."""
    energy: float | None = None
    """Mean size of action times joint rate [rad/s]; with ``thesis`` their sum, of torques in watts."""
    joint_pos_limits: float | None = None
    """Joints at an end of their range."""
    lin_vel_y_l1: float | None = None
    """Size of the sideways speed [m/s]."""
    heading: float | None = None
    """Size of the heading [rad]."""
    line: float | None = None
    """Distance from the line y = 0 [m], at most 2."""


@dataclasses.dataclass(frozen=True)
class AntConfig(WalkingConfig):
    """Configuration of :class:`AntTask`."""

    # The original's physics step: a gait learnt with it walks as far at 5 and 2 ms. Its 100 actions a second are more
    # than a gait of a few Hz needs: with 50 exploration acts for longer and an episode is half as many decisions
    dt: float = 0.01
    """Physics step [s]."""
    decimation: int = 2
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    torque: float = 30.0
    """Joint torque of a full action [N·m]."""
    reward: AntReward = AntReward.WALK
    """Variant of the reward."""
    rewards: AntRewards = AntRewards()
    """Weights of the reward."""
    target_speed: float = 1.3
    """Speed along X for which the walk reward is largest [m/s]."""
    orientation: Orientation = Orientation.EULER
    """Observation of the torso's orientation: 30 observations with Euler angles, 31 with a quaternion."""
    lateral: bool = False
    """Observe the sideways position in place of the height, as the original's code does."""
    variant: Variant = Variant.SIMWARP
    """thesis: the reward of equation 8.1, 100 actions a second, starts and time as in the thesis."""

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {
            "reward": AntReward.THESIS,
            "rewards.joint_pos_limits": -3.0,
            "decimation": 1,
            "max_episode_steps": 10_000,  # of the code, as what follows: 100 s
            "start_angle": 0.0,
            "start_rate": 0.0,
            "gravity": 9.8,
        }
    }

    def usual_weights(self) -> Mapping[str, float]:
        """Weights of the variant."""
        return _WEIGHTS[self.reward]


@register("ant")
class AntTask(WalkingTask[AntConfig]):
    """Observation ``policy`` (W, 30), in this order, SI units and torso axes unless scaled.

    Height; Euler-123 angles; velocity; angular velocity; hip and ankle angles; their rates; contact forces on the feet,
    cut at 5 N. With a quaternion (x y z w) in place of the angles 31.
    """

    summary: ClassVar[str] = "ant: four legs of two links walk along X, 30 observations, 8 torques"
    instruction: ClassVar[str] = "Walk forwards as fast as possible."
    config_type: ClassVar[type[TaskConfig]] = AntConfig
    action_size: int = 8
    legs: ClassVar[int] = 4
    sides: ClassVar[tuple[tuple[str, str], ...]] = (("_0", "_3"), ("_1", "_2"))
    turned: ClassVar[tuple[str, ...]] = ("hip_*",)
    sides_of_feet: ClassVar[tuple[tuple[int, int], ...]] = ((0, 3), (1, 2))
    usual_sizes: ClassVar[tuple[float, float, float, float]] = (0.4, 1.0, 2.0, 5.0)
    training: ClassVar[Mapping[str, Any]] = {
        **WalkingTask.training, "iterations": 110, "network.init_std": 0.6, "network.symmetric": True,
    }  # fmt: skip
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {
            "iterations": 250,
            "network.kind": "thesis-mlp",
            "network.activation": "tanh",
            "network.symmetric": False,
            "ppo.epochs": 5,
        }
    }

    def build(self, builder: sw.ModelBuilder) -> sw.ModelBuilder:
        """The ant of :mod:`simwarp.scenes`."""
        return sw.scenes.ant()

    @property
    def lateral(self) -> bool:
        """Observe the sideways position in place of the height."""
        return self.config.lateral

    def touching(self) -> Touching:
        """The shins end in feet; the torso must not touch the ground."""
        simulation = self.simulation
        feet = [simulation.model.body(f"ankle_{leg}") for leg in range(self.legs)]
        return Touching(simulation.contacts.body_contact_force, feet, [BASE])

    def setup(self) -> None:
        """Compute the ranges of the joints, and record the reward."""
        super().setup()
        config, device = self.config, str(self.device)
        lower = [-_HIP_LIMIT] * 4 + [_ANKLE_LIMITS[0]] * 4
        upper = [_HIP_LIMIT] * 4 + [_ANKLE_LIMITS[1]] * 4
        weights = config.reward_weights()
        numbers = filled(
            kernels.AntRewardWeights,
            **weights,
            variant=_VARIANTS[config.reward],
            control_dt=config.control_dt,
            target_speed=config.target_speed,
            torque=config.torque,
            middle=wp.array([0.5 * (high + low) for low, high in zip(lower, upper, strict=True)], dtype=float,
                            device=device),
            half=wp.array([0.5 * (high - low) for low, high in zip(lower, upper, strict=True)], dtype=float,
                          device=device),
        )  # fmt: skip
        arguments = [numbers, self.action, self.simulation.state.arrays, self.walk]
        self._compute_rewards = NamedRows(self, kernels.compute_ant_rewards, weights, *arguments)

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        return self._compute_rewards()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``torso_contact``: the torso touches the ground, in any physics step."""
        return {"torso_contact": self._touched.clone()}

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show the legs as well, of which only the feet are collision shapes."""
        sw.viewer.add_skeleton(visuals, sw.scenes.ANT_LIMB_RADIUS)
