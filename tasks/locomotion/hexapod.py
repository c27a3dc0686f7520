"""Hexapod: the PhantomX Mark II walks along X on six legs of three links, driven by 18 torques.

Numbers of ``chrono_hexapod-v0`` (gym-chrono, ``envs/robotics/ChronoHexapod.py``), turned from Y up to Z up: forward is
+X, left is +Y. The robot itself, and how it was turned, is :func:`simwarp.scenes.hexapod`.
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
from simwarp.tasks import NamedRows, Positive, RewardWeights, TaskConfig, filled, register
from simwarp.tasks.locomotion import BASE, Touching, WalkingConfig, WalkingTask

from . import hexapod_kernels as kernels

_LEGS = 6


class HexapodReward(enum.Enum):
    """Variants of the reward.

    ``walk`` is this project's own: a speed that is enough, along the line, level and without trembling. ``code`` is
    that of the original's code.
    """

    WALK = "walk"
    CODE = "code"


_WEIGHTS: Mapping[HexapodReward, Mapping[str, float]] = {
    HexapodReward.WALK: {
        "progress": 5.0, "alive": 0.5, "energy": -0.02, "joint_pos_limits": -0.2, "joint_deviation_l2": -2.0,
        "height": -10.0, "tilt": -1.0, "action_rate_l2": -0.1, "lin_vel_y_l1": -1.0, "heading": -1.0, "line": -2.0,
    },
    HexapodReward.CODE: {"progress": 5.0, "alive": 1.0, "energy": -0.1, "joint_pos_limits": -0.8, "height": 2.0},
}  # fmt: skip
_SPEED_LIMIT = math.radians(354.0)


@dataclasses.dataclass(frozen=True)
class HexapodRewards(RewardWeights):
    """Weights of the reward; None is that of its variant, of which ``code`` has the first five."""

    progress: float | None = None
    """Speed towards a target far ahead [m/s]; with ``walk`` at most ``target_speed``, less what exceeds it."""
    alive: float | None = None
    """1, and -1 where anything but a foot touches the ground."""
    energy: float | None = None
    """Mean size of action times joint rate [rad/s]."""
    joint_pos_limits: float | None = None
    """Joints at an end of their range."""
    height: float | None = None
    """Rise of the base since the start [m]; with ``walk`` its size."""
    joint_deviation_l2: float | None = None
    """Mean square of the joint angles [rad²]."""
    tilt: float | None = None
    """Sizes of roll and pitch [rad]."""
    action_rate_l2: float | None = None
    """Mean square of the change of the action."""
    lin_vel_y_l1: float | None = None
    """Size of the sideways speed [m/s]."""
    heading: float | None = None
    """Size of the heading [rad]."""
    line: float | None = None
    """Distance from the line y = 0 [m], at most 1."""


@dataclasses.dataclass(frozen=True)
class HexapodConfig(WalkingConfig):
    """Configuration of :class:`HexapodTask`."""

    # The original's physics step. It acts in every one, 200 times a second; a gait of a few Hz needs no more than 50:
    # exploration acts for longer, and an episode is a quarter as many decisions. The original stops at 16 s
    dt: float = 0.005
    """Physics step [s]."""
    decimation: int = 4
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    torque: float = 1.5
    """Joint torque of a full action [N·m]."""
    speed_limit: Positive = _SPEED_LIMIT
    """Joint speed beyond which a torque that would drive it on is cut off [rad/s]: 59 turns a minute."""
    reward: HexapodReward = HexapodReward.WALK
    """Variant of the reward."""
    rewards: HexapodRewards = HexapodRewards()
    """Weights of the reward."""
    target_speed: float = 0.4
    """Speed along X for which the walk reward is largest [m/s]."""
    start_angle: float = 0.05
    """Half-width of the uniform start angles of the joints and of the heading [rad]."""
    goal_distance: float = 2.0
    """Distance along X that a success has covered [m]."""
    goal_width: float = 0.5
    """Largest distance from the line y = 0 of a success, over the whole episode [m]."""

    def usual_weights(self) -> Mapping[str, float]:
        """Weights of the variant."""
        return _WEIGHTS[self.reward]


@register("hexapod")
class HexapodTask(WalkingTask[HexapodConfig]):
    """Observation ``policy`` (W, 53), in this order, SI units and axes of the base unless scaled.

    Height of the base's centre of mass; quaternion x y z w; velocity; angular velocity; angles of hips, femurs and
    tibias, each of legs 1 to 6; their rates; contact forces on the feet of legs 1 to 6, cut at 5 N. With Euler-123
    angles in place of the quaternion 52. Actions are torques in the order of the angles.
    """

    summary: ClassVar[str] = "hexapod: six legs of three links walk along X, 53 observations, 18 torques"
    instruction: ClassVar[str] = "Walk forwards as fast as possible."
    config_type: ClassVar[type[TaskConfig]] = HexapodConfig
    action_size: int = 18
    legs: ClassVar[int] = _LEGS
    # The original's base is not quite its own image: parts are up to 2 mm from it
    sides: ClassVar[tuple[tuple[str, str], ...]] = (("_1", "_4"), ("_2", "_5"), ("_3", "_6"))
    turned: ClassVar[tuple[str, ...]] = ("hip_*",)
    sides_of_feet: ClassVar[tuple[tuple[int, int], ...]] = ((0, 3), (1, 4), (2, 5))
    usual_sizes: ClassVar[tuple[float, float, float, float]] = (0.15, 0.4, 1.0, 6.0)
    training: ClassVar[Mapping[str, Any]] = {
        **WalkingTask.training, "iterations": 130, "network.init_std": 0.3, "network.symmetric": True,
    }  # fmt: skip

    def build(self, builder: sw.ModelBuilder) -> sw.ModelBuilder:
        """The hexapod of :mod:`simwarp.scenes`."""
        return sw.scenes.hexapod()

    @property
    def speed_limit(self) -> float:
        """Joint speed beyond which a torque that would drive it on is cut off [rad/s]."""
        return self.config.speed_limit

    def touching(self) -> Touching:
        """Feet 1 to 6; nothing else must touch the ground."""
        simulation = self.simulation
        names = simulation.model.shape_names
        feet = [f"foot_{leg}" for leg in range(1, _LEGS + 1)]
        others = [index for index, name in enumerate(names) if name not in {*feet, "floor"}]
        return Touching(simulation.contacts.shape_contact_force, [names.index(name) for name in feet], others)

    def setup(self) -> None:
        """Store the height at the start, and record the reward."""
        super().setup()
        config, device, walks = self.config, str(self.device), self.config.reward is HexapodReward.WALK
        weights = config.reward_weights()
        numbers = filled(
            kernels.HexapodRewardWeights,
            **weights,
            variant=kernels.WALK if walks else kernels.CODE,
            control_dt=config.control_dt,
            target_speed=config.target_speed,
            start_height=wp.array(self.simulation.state.body_x.numpy()[:, BASE, 2], dtype=float, device=device),
            middle=wp.zeros(self.action_size, dtype=float, device=device),
            half=wp.full(self.action_size, sw.scenes.HEXAPOD_LIMIT, dtype=float, device=device),
        )
        arguments = [numbers, self.action, self.simulation.state.arrays, self.walk]
        self._compute_rewards = NamedRows(self, kernels.compute_hexapod_rewards, weights, *arguments)

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        return self._compute_rewards()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``contact``: anything but a foot touches the ground, in any physics step."""
        return {"contact": self._touched.clone()}

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show the links as rods between the hinges; the collision boxes are the servos."""
        sw.viewer.add_skeleton(visuals, 0.008)
