"""Hexapod: the PhantomX Mark II walks along X on six legs of three links, driven by 18 torques.

Numbers of ``chrono_hexapod-v0`` (gym-chrono, ``envs/robotics/ChronoHexapod.py``), turned from Y up to Z up: forward is
+X, left is +Y. The robot itself, and how it was turned, is :func:`simwarp.scenes.hexapod`.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import torch

from simwarp.tasks import Positive

from ..framework.config import TaskConfig
from ..framework.frames import euler_123
from ..framework.registry import register
from .walking import BASE, NEAR_LIMIT, WalkingConfig, WalkingTask

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Visuals

_LEGS = 6


class HexapodReward(enum.Enum):
    """Variants of the reward.

    ``walk`` is this project's own: a speed that is enough, along the line, level and without trembling. ``code`` is
    what the original's code pays.
    """

    WALK = "walk"
    CODE = "code"


_SPEED_LIMIT = math.radians(354.0)


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
    target_speed: float = 0.4
    """Speed along X for which the walk reward pays most [m/s]."""
    start_angle: float = 0.05
    """Half-width of the uniform start angles of the joints and of the heading [rad]."""
    goal_distance: float = 2.0
    """Distance along X that a success has covered [m]."""
    goal_width: float = 0.5
    """Largest distance from the line y = 0 of a success, over the whole episode [m]."""


@register("hexapod")
class HexapodTask(WalkingTask[HexapodConfig]):
    """Observation ``policy`` (W, 53), in this order, SI units and axes of the base unless scaled.

    Height of the base's centre of mass; quaternion x y z w; velocity; angular velocity; angles of hips, femurs and
    tibias, each of legs 1 to 6; their rates; contact forces on the feet of legs 1 to 6, cut at 5 N. With Euler-123
    angles in place of the quaternion 52. Actions are torques in the order of the angles.
    """

    summary: ClassVar[str] = "hexapod: six legs of three links walk along X, 53 observations, 18 torques"
    config_type: ClassVar[type[TaskConfig]] = HexapodConfig
    action_size: int = 18
    legs: ClassVar[int] = _LEGS
    usual_sizes: ClassVar[tuple[float, float, float, float]] = (0.15, 0.4, 1.0, 6.0)
    training: ClassVar[Mapping[str, Any]] = {**WalkingTask.training, "network.init_std": 0.3}

    def build(self, builder: ModelBuilder) -> ModelBuilder:
        """The hexapod of :mod:`simwarp.scenes`."""
        from simwarp.scenes import hexapod

        return hexapod()

    def setup(self) -> None:
        """Make views of contact forces, and store the height at the start."""
        from simwarp import to_torch
        from simwarp.scenes import HEXAPOD_LIMIT

        super().setup()
        device, simulation = self.device, self.simulation
        names = simulation.model.shape_names
        self._shape_force = to_torch(simulation.contacts.shape_contact_force)
        feet = [f"foot_{leg}" for leg in range(1, _LEGS + 1)]
        self._feet = torch.tensor([names.index(name) for name in feet], device=device)
        others = [index for index, name in enumerate(names) if name not in {*feet, "floor"}]
        self._others = torch.tensor(others, device=device)
        self._limit = HEXAPOD_LIMIT
        self._start_height = self._x[:, BASE, 2].clone().float()
        self._last_action = torch.zeros(self.num_worlds, self.action_size, device=device)

    def touching(self) -> torch.Tensor:
        """Return (W,) bool: anything but a foot touches the ground."""
        return (self._shape_force[:, self._others] != 0.0).flatten(1).any(dim=1)

    def foot_forces(self) -> torch.Tensor:
        """Return (W, 6, 3) contact forces on the feet of legs 1 to 6 [N]."""
        return self._shape_force[:, self._feet]

    def begin_step(self) -> None:
        """Store the last action, too: trembling is a difference."""
        super().begin_step()
        self._last_action.copy_(self.action)

    def apply(self, action: torch.Tensor) -> None:
        """Turn the joints with ``torque`` newton metres per unit of action, none that drives beyond the limit."""
        rate = self.views.joint_qd
        driven = (rate.abs() < self.config.speed_limit) | (action * rate <= 0.0)
        self.views.joint_force.copy_(torch.where(driven, self.config.torque * action, 0.0))

    def after_physics(self) -> None:
        """Cut the torques anew, and notice a touch."""
        self.apply(self.action)
        super().after_physics()

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        config, views = self.config, self.views
        speed = self.progress_speed()
        power = (self.action * views.joint_qd).abs().mean(dim=1)
        alive = 1.0 - 2.0 * self.touched.float()
        limits = (views.joint_q.abs() > (1.0 - NEAR_LIMIT) * self._limit).sum(dim=1).float()
        pose = views.body_q[:, BASE]
        rise = pose[:, 2] - self._start_height
        if config.reward is HexapodReward.CODE:
            return {
                "progress": 5.0 * speed,
                "alive": alive,
                "effort": -0.1 * power,
                "limits": -0.8 * limits,
                "height": 2.0 * rise,
            }
        turned = euler_123(pose[:, 3:])
        return {
            "progress": 5.0 * (speed.clamp(max=config.target_speed) - (speed - config.target_speed).clamp(min=0.0)),
            "alive": 0.5 * alive,
            "effort": -0.02 * power,
            "limits": -0.2 * limits,
            "posture": -2.0 * views.joint_q.square().mean(dim=1),
            "height": -10.0 * rise.abs(),
            "tilt": -turned[:, :2].abs().sum(dim=1),
            "smooth": -0.1 * (self.action - self._last_action).square().mean(dim=1),
            "straight": -views.body_v[:, BASE, 1].abs(),
            "heading": -turned[:, 2].abs(),
            "line": -2.0 * pose[:, 1].abs().clamp(max=1.0),
        }

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``contact``: anything but a foot touches the ground, in any physics step."""
        return {"contact": self.touched.clone()}

    def visuals(self, visuals: Visuals) -> None:
        """Show the links as rods between the hinges; the collision boxes are the servos."""
        from simwarp.viewer import add_skeleton

        add_skeleton(visuals, 0.008)
