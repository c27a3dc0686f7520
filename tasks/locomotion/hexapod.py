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
import warp as wp

from simwarp.tasks import Positive

from ..framework.config import TaskConfig
from ..framework.recorded_launches import filled, launch_over
from ..framework.registry import register
from . import hexapod_kernels as kernels
from .walking import BASE, Touching, WalkingConfig, WalkingTask

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Visuals

_LEGS = 6
_CODE_TERMS = ("progress", "alive", "effort", "limits", "height")
_WALK_TERMS = (
    "progress", "alive", "effort", "limits", "posture", "height", "tilt", "smooth", "straight", "heading", "line",
)  # fmt: skip


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
        from simwarp.scenes import HEXAPOD_LIMIT

        super().setup()
        config, device, walks = self.config, str(self.device), self.config.reward is HexapodReward.WALK
        pay = filled(
            kernels.HexapodRewardWeights,
            variant=kernels.WALK if walks else kernels.CODE,
            control_dt=config.control_dt,
            target_speed=config.target_speed,
            start_height=wp.array(self.simulation.state.body_x.numpy()[:, BASE, 2], dtype=float, device=device),
            middle=wp.zeros(self.action_size, dtype=float, device=device),
            half=wp.full(self.action_size, HEXAPOD_LIMIT, dtype=float, device=device),
        )
        self._names = _WALK_TERMS if walks else _CODE_TERMS
        self._terms = torch.zeros(len(self._names), self.num_worlds, device=self.device)
        state = self.simulation.state.arrays
        self._pay = launch_over(self, kernels.compute_hexapod_rewards, pay, self.action, state, self.walk, self._terms)

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        self._pay.launch()
        return dict(zip(self._names, self._terms, strict=True))

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``contact``: anything but a foot touches the ground, in any physics step."""
        return {"contact": self._touched.clone()}

    def visuals(self, visuals: Visuals) -> None:
        """Show the links as rods between the hinges; the collision boxes are the servos."""
        from simwarp.viewer import add_skeleton

        add_skeleton(visuals, 0.008)
