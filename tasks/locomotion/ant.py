"""Ant: a ball on four legs of two links walks along X, driven by eight torques.

Numbers of ``chrono_ant-v0`` (gym-chrono, ``envs/basic/ChronoAnt.py``), turned from Y up to Z up: forward is +X, left
is +Y. The robot itself is :func:`simwarp.scenes.ant`.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import torch

from ..framework.config import TaskConfig
from ..framework.frames import Orientation, euler_123
from ..framework.registry import register
from .walking import BASE, NEAR_LIMIT, WalkingConfig, WalkingTask

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Visuals

_HIP_LIMIT = math.pi / 3.0
_ANKLE_LIMITS = (-math.pi / 2.0, math.pi / 4.0)


class AntReward(enum.Enum):
    """Variants of the reward.

    ``walk`` is this project's own: a speed that is enough, along the line. ``code`` is what the original's code pays,
    ``thesis`` what the thesis prints (its eq. 8.1; power of the torques in watts, and 0.2 per limit as in the code,
    since it gives no number).
    """

    WALK = "walk"
    CODE = "code"
    THESIS = "thesis"


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
    target_speed: float = 1.3
    """Speed along X for which the walk reward pays most [m/s]."""
    orientation: Orientation = Orientation.EULER
    """Observation of the torso's orientation: 30 observations with Euler angles, 31 with a quaternion."""
    lateral: bool = False
    """Observe the sideways position in place of the height, as the original's code does."""


@register("ant")
class AntTask(WalkingTask[AntConfig]):
    """Observation ``policy`` (W, 30), in this order, SI units and torso axes unless scaled.

    Height; Euler-123 angles; velocity; angular velocity; hip and ankle angles; their rates; contact forces on the feet,
    cut at 5 N. With a quaternion (x y z w) in place of the angles 31.
    """

    summary: ClassVar[str] = "ant: four legs of two links walk along X, 30 observations, 8 torques"
    config_type: ClassVar[type[TaskConfig]] = AntConfig
    action_size: int = 8
    legs: ClassVar[int] = 4
    usual_sizes: ClassVar[tuple[float, float, float, float]] = (0.4, 1.0, 2.0, 5.0)
    training: ClassVar[Mapping[str, Any]] = {**WalkingTask.training, "network.init_std": 0.6}

    def build(self, builder: ModelBuilder) -> ModelBuilder:
        """The ant of :mod:`simwarp.scenes`."""
        from simwarp.scenes import ant

        return ant()

    def setup(self) -> None:
        """Make views of contact forces and compute the ranges of the joints."""
        from simwarp import to_torch

        super().setup()
        simulation, device = self.simulation, self.device
        self._body_force = to_torch(simulation.contacts.body_contact_force)
        first, second = (simulation.model.body(f"ankle_{leg}") for leg in range(2))
        self._shins = slice(first, None, second - first)
        lower = [-_HIP_LIMIT] * 4 + [_ANKLE_LIMITS[0]] * 4
        upper = [_HIP_LIMIT] * 4 + [_ANKLE_LIMITS[1]] * 4
        self._middle = 0.5 * (torch.tensor(upper, device=device) + torch.tensor(lower, device=device))
        self._half_range = 0.5 * (torch.tensor(upper, device=device) - torch.tensor(lower, device=device))

    def touching(self) -> torch.Tensor:
        """Return (W,) bool: the torso touches the ground."""
        return (self._body_force[:, BASE] != 0.0).any(dim=1)

    def foot_forces(self) -> torch.Tensor:
        """Return (W, 4, 3) contact forces on the feet [N]."""
        return self._body_force[:, self._shins]

    def first_observation(self, pose: torch.Tensor) -> torch.Tensor:
        """Return the height, or the sideways position (W, 1) [m]."""
        return pose[:, 1:2] if self.config.lateral else super().first_observation(pose)

    def apply(self, action: torch.Tensor) -> None:
        """Turn the joints with ``torque`` newton metres per unit of action."""
        self.views.joint_force.copy_(action * self.config.torque)

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        config = self.config
        speed = self.progress_speed()
        power = self.action * self.views.joint_qd
        alive = 1.0 - 2.0 * self.touched.float()
        offset = (self.views.joint_q - self._middle).abs() / self._half_range
        limits = (offset > 1.0 - NEAR_LIMIT).sum(dim=1).float()
        if config.reward is AntReward.CODE:
            effort = -0.2 * power.abs().mean(dim=1)
            return {"progress": speed, "alive": alive, "effort": effort, "limits": -0.6 * limits}
        if config.reward is AntReward.THESIS:
            effort = -0.2 * config.torque * power.sum(dim=1)
            return {"progress": speed, "alive": alive, "effort": effort, "limits": -0.6 * limits}
        pose = self.views.body_q[:, BASE]
        heading = euler_123(pose[:, 3:])[:, 2]
        return {
            "progress": 2.0 * speed.clamp(max=config.target_speed) - (speed - config.target_speed).clamp(min=0.0),
            "alive": 0.5 * alive,
            "effort": -0.05 * power.abs().mean(dim=1),
            "limits": -0.05 * limits,
            "straight": -0.5 * self.views.body_v[:, BASE, 1].abs(),
            "heading": -0.5 * heading.abs(),
            "line": -pose[:, 1].abs().clamp(max=2.0),
        }

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``torso_contact``: the torso touches the ground, in any physics step."""
        return {"torso_contact": self.touched.clone()}

    def visuals(self, visuals: Visuals) -> None:
        """Show the legs as well, of which only the feet are collision shapes."""
        from simwarp.scenes import ANT_LIMB_RADIUS
        from simwarp.viewer import add_skeleton

        add_skeleton(visuals, ANT_LIMB_RADIUS)
