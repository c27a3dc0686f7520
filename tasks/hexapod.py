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

from .config import TaskConfig, require
from .frames import Orientation, euler_123, heading_quaternion, rotate_back
from .registry import register
from .task import Task

if TYPE_CHECKING:
    from simwarp import ModelBuilder, SolverOptions
    from simwarp.sensors import Visuals

_BASE = 0
_LEGS = 6
_JOINTS = 18
_FORCE_CLIP = 5.0
# A joint counts as at its limit in the last part of its range
_NEAR_LIMIT = 0.02
_TARGET_X = 1000.0
_ARENA = 49.0


class HexapodReward(enum.Enum):
    """Which reward is paid.

    ``walk`` is this project's own: a speed that is enough, along the line, level and without trembling. ``code`` is
    what the original's code pays.
    """

    WALK = "walk"
    CODE = "code"


@dataclasses.dataclass(frozen=True)
class HexapodConfig(TaskConfig):
    """Configuration of :class:`HexapodTask`."""

    # The original's physics step. It acts in every one, 200 times a second; a gait of a few Hz needs no more than 50:
    # exploration acts for longer, and an episode is a quarter as many decisions
    dt: float = 0.005
    """Physics step [s]."""
    decimation: int = 4
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    max_episode_steps: int = 500
    """Control steps after which an episode is truncated: 10 s; the original stops at 16 s."""
    gravity: float = 9.81
    """Gravitational acceleration, downwards [m/s2]."""
    torque: float = 1.5
    """Joint torque of a full action [N·m]."""
    speed_limit: float = math.radians(354.0)
    """Joint speed beyond which a torque that would drive it on is cut off [rad/s]: 59 turns a minute."""
    reward: HexapodReward = HexapodReward.WALK
    """Which reward is paid."""
    target_speed: float = 0.4
    """Speed along X for which the walk reward pays most [m/s]."""
    orientation: Orientation = Orientation.QUATERNION
    """How the base's orientation is observed: 53 observations with a quaternion, 52 with Euler angles."""
    scaled: bool = False
    """Divide every observation by its usual size; without, they are in SI units."""
    start_angle: float = 0.05
    """Half-width of the uniform start angles of the joints and of the heading [rad]."""
    start_rate: float = 0.1
    """Half-width of the uniform start rates of the joints [rad/s]."""
    goal_distance: float = 2.0
    """Distance along X that a success has covered [m]."""
    goal_time: float = 10.0
    """Time in which it must be covered [s]."""
    goal_width: float = 0.5
    """Largest distance from the line y = 0 of a success, over the whole episode [m]."""
    tolerance: float = 1e-3
    """Residual at which the contact solve stops [m/s]."""

    def validate(self) -> None:
        """Check that sizes are positive."""
        sizes = ("torque", "speed_limit", "target_speed", "goal_distance", "goal_time", "goal_width", "tolerance")
        for field in sizes:
            require(getattr(self, field) > 0.0, self, field, "positive")
        require(0.0 <= self.start_angle <= 0.5, self, "start_angle", "in [0, 0.5]")
        require(self.start_rate >= 0.0, self, "start_rate", "zero or positive")


@register("hexapod")
class HexapodTask(Task[HexapodConfig]):
    """Observation ``policy`` (W, 53), in this order, SI units and axes of the base unless scaled.

    Height of the base's centre of mass; quaternion x y z w; velocity; angular velocity; angles of hips, femurs and
    tibias, each of legs 1 to 6; their rates; contact forces on the feet of legs 1 to 6, cut at 5 N. With Euler-123
    angles in place of the quaternion 52. Actions are torques in the order of the angles.
    """

    summary: ClassVar[str] = "hexapod: six legs of three links walk along X, 53 observations, 18 torques"
    config_type: ClassVar[type[TaskConfig]] = HexapodConfig
    action_size: int = _JOINTS
    success_reasons: ClassVar[frozenset[str]] = frozenset()
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 250,
        "num_envs": 512,
        "steps_per_iteration": 32,
        "network.hidden": (128, 64),
        "network.init_std": 0.3,
        "ppo.gamma": 0.99,
        "ppo.entropy": 0.0,
    }

    def build(self, builder: ModelBuilder) -> ModelBuilder:
        """The hexapod of :mod:`simwarp.scenes`."""
        from simwarp.scenes import hexapod

        return hexapod()

    def solver_options(self) -> SolverOptions:
        """Contacts to ``tolerance``: far below the speed of a foot."""
        from simwarp import SolverOptions

        return SolverOptions(tolerance=self.config.tolerance)

    def setup(self) -> None:
        """Make views of positions of record and of contact forces, and allocate what an episode remembers."""
        from simwarp import to_torch
        from simwarp.scenes.phantomx import HEXAPOD_LIMIT

        worlds, device, simulation = self.num_worlds, self.device, self.simulation
        names = simulation.model.shape_names
        self._x = to_torch(simulation.state.body_x)
        self._rotation = to_torch(simulation.state.body_rot)
        self._shape_force = to_torch(simulation.contacts.shape_contact_force)
        feet = [f"foot_{leg}" for leg in range(1, _LEGS + 1)]
        self._feet = torch.tensor([names.index(name) for name in feet], device=device)
        others = [index for index, name in enumerate(names) if name not in {*feet, "floor"}]
        self._others = torch.tensor(others, device=device)
        self._limit = HEXAPOD_LIMIT
        self._start_height = self._x[:, _BASE, 2].clone().float()
        self._before = torch.zeros(worlds, dtype=torch.float64, device=device)
        self._last_action = torch.zeros(worlds, _JOINTS, device=device)
        self._farthest_aside = torch.zeros(worlds, device=device)
        self._touched = torch.zeros(worlds, dtype=torch.bool, device=device)
        self._reached = torch.zeros(worlds, dtype=torch.bool, device=device)
        turned = [0.3] * 3 if self.config.orientation is Orientation.EULER else [0.3] * 4
        sizes = [0.15] + turned + [0.4] * 3 + [1.0] * 3 + [0.5] * _JOINTS + [6.0] * _JOINTS + [_FORCE_CLIP] * _LEGS
        self._sizes = torch.tensor(sizes, device=device)

    def begin_step(self) -> None:
        """Remember where the base is and what acted: progress and trembling are differences."""
        self._before.copy_(self._distance())
        self._last_action.copy_(self.action)
        self._touched.zero_()

    def apply(self, action: torch.Tensor) -> None:
        """Turn the joints with ``torque`` newton metres per unit of action, none that drives beyond the limit."""
        rate = self.views.joint_qd
        driven = (rate.abs() < self.config.speed_limit) | (action * rate <= 0.0)
        self.views.joint_force.copy_(torch.where(driven, self.config.torque * action, 0.0))

    def after_physics(self) -> None:
        """Cut the torques anew, and notice a touch that may be over before the control step is."""
        self.apply(self.action)
        self._touched |= (self._shape_force[:, self._others] != 0.0).flatten(1).any(dim=1)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``: (W, 53) float32, or (W, 52) with Euler angles."""
        config, views = self.config, self.views
        pose = views.body_q[:, _BASE]
        rotation = pose[:, 3:]
        parts = [
            pose[:, 2:3],
            euler_123(rotation) if config.orientation is Orientation.EULER else rotation,
            rotate_back(rotation, views.body_v[:, _BASE]),
            rotate_back(rotation, views.body_omega[:, _BASE]),
            views.joint_q,
            views.joint_qd,
            self._shape_force[:, self._feet].norm(dim=2).clamp(max=_FORCE_CLIP),
        ]
        policy = torch.cat(parts, dim=1)
        return {"policy": policy / self._sizes if config.scaled else policy}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        config, views = self.config, self.views
        speed = ((self._before - self._distance()) / config.control_dt).float()
        power = (self.action * views.joint_qd).abs().mean(dim=1)
        alive = 1.0 - 2.0 * self._touched.float()
        limits = (views.joint_q.abs() > (1.0 - _NEAR_LIMIT) * self._limit).sum(dim=1).float()
        pose = views.body_q[:, _BASE]
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
            "straight": -views.body_v[:, _BASE, 1].abs(),
            "heading": -turned[:, 2].abs(),
            "line": -2.0 * pose[:, 1].abs().clamp(max=1.0),
        }

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``contact``: anything but a foot touches the ground, in any physics step."""
        return {"contact": self._touched.clone()}

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return ``arena``: the robot has left the original's floor of 50 m around the start."""
        return {"arena": (self._x[:, _BASE, :2].abs() > _ARENA).any(dim=1)}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near the built pose and the heading +X."""
        angle, rate = self.config.start_angle, self.config.start_rate
        heading = self.random.uniform("heading", -angle, angle)[:, 0].double()
        turned = torch.where(world_mask.unsqueeze(1), heading_quaternion(heading), self._rotation[:, _BASE])
        self._rotation[:, _BASE] = turned
        q = self.random.uniform("angles", -angle, angle, size=_JOINTS)
        # Femurs and tibias only turn upwards: the feet stay above the ground
        q[:, _LEGS:].abs_().neg_()
        self.simulation.set_joint_state(world_mask, q, self.random.uniform("rates", -rate, rate, size=_JOINTS))
        self._touched.masked_fill_(world_mask, False)
        self._farthest_aside.masked_fill_(world_mask, 0.0)
        self._reached.masked_fill_(world_mask, False)

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``success``, ``distance`` along X [m] and the largest ``lateral_error`` of the episode [m]."""
        config = self.config
        place = self.views.body_q[:, _BASE]
        torch.maximum(self._farthest_aside, place[:, 1].abs(), out=self._farthest_aside)
        in_time = self.episode_steps * config.control_dt <= config.goal_time + 0.5 * config.control_dt
        self._reached |= (place[:, 0] >= config.goal_distance) & in_time
        straight = self._farthest_aside <= config.goal_width
        return {
            "success": self._reached & straight & ~self._touched,
            "distance": place[:, 0],
            "lateral_error": self._farthest_aside,
        }

    def visuals(self, visuals: Visuals) -> None:
        """Show the links as rods between the hinges; the collision boxes are the servos."""
        from simwarp.viewer import add_skeleton

        add_skeleton(visuals, 0.008)

    def extra_state(self) -> dict[str, torch.Tensor]:
        """What success remembers of the running episode."""
        return {"farthest_aside": self._farthest_aside, "reached": self._reached}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take it back."""
        self._farthest_aside.copy_(state["farthest_aside"])
        self._reached.copy_(state["reached"])

    def _distance(self) -> torch.Tensor:
        """(W,) distance to a target far ahead, as the original measures progress [m]."""
        place = self._x[:, _BASE]
        return torch.hypot(place[:, 1], _TARGET_X - place[:, 0])
