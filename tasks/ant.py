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

from .config import TaskConfig, require
from .frames import Orientation, euler_123, heading_quaternion, rotate_back
from .registry import register
from .task import Task

if TYPE_CHECKING:
    from simwarp import ModelBuilder, SolverOptions
    from simwarp.sensors import Visuals

_TORSO = 0
_JOINTS = 8
_FORCE_CLIP = 5.0
_HIP_LIMIT = math.pi / 3.0
_ANKLE_LIMITS = (-math.pi / 2.0, math.pi / 4.0)
# A joint counts as at its limit in the last part of its range
_NEAR_LIMIT = 0.02
_TARGET_X = 1000.0
_ARENA = 49.0


class AntReward(enum.Enum):
    """Which reward is paid.

    ``walk`` is this project's own: a speed that is enough, along the line. ``code`` is what the original's code pays,
    ``thesis`` what the thesis prints (its eq. 8.1; power of the torques in watts, and 0.2 per limit as in the code,
    since it gives no number).
    """

    WALK = "walk"
    CODE = "code"
    THESIS = "thesis"


@dataclasses.dataclass(frozen=True)
class AntConfig(TaskConfig):
    """Configuration of :class:`AntTask`."""

    # The original's physics step: a gait learnt with it walks as far at 5 and 2 ms. Its 100 actions a second are more
    # than a gait of a few Hz needs: with 50 exploration acts for longer and an episode is half as many decisions
    dt: float = 0.01
    """Physics step [s]."""
    decimation: int = 2
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    max_episode_steps: int = 500
    """Control steps after which an episode is truncated: 10 s."""
    gravity: float = 9.81
    """Gravitational acceleration, downwards [m/s2]."""
    torque: float = 30.0
    """Joint torque of a full action [N·m]."""
    reward: AntReward = AntReward.WALK
    """Which reward is paid."""
    target_speed: float = 1.3
    """Speed along X for which the walk reward pays most [m/s]."""
    orientation: Orientation = Orientation.EULER
    """How the torso's orientation is observed: 30 observations with Euler angles, 31 with a quaternion."""
    scaled: bool = False
    """Divide every observation by its usual size; without, they are in SI units."""
    lateral: bool = False
    """Observe the sideways position in place of the height, as the original's code does."""
    start_angle: float = 0.1
    """Half-width of the uniform start angles of the joints and of the heading [rad]."""
    start_rate: float = 0.1
    """Half-width of the uniform start rates of the joints [rad/s]."""
    goal_distance: float = 10.0
    """Distance along X that a success has covered [m]."""
    goal_time: float = 10.0
    """Time in which it must be covered [s]."""
    goal_width: float = 1.0
    """Largest distance from the line y = 0 of a success, over the whole episode [m]."""
    tolerance: float = 1e-3
    """Residual at which the contact solve stops [m/s]."""

    def validate(self) -> None:
        """Check that sizes are positive."""
        for field in ("torque", "target_speed", "goal_distance", "goal_time", "goal_width", "tolerance"):
            require(getattr(self, field) > 0.0, self, field, "positive")
        require(0.0 <= self.start_angle <= 0.5, self, "start_angle", "in [0, 0.5]")
        require(self.start_rate >= 0.0, self, "start_rate", "zero or positive")


@register("ant")
class AntTask(Task[AntConfig]):
    """Observation ``policy`` (W, 30), in this order, SI units and torso axes unless scaled.

    Height; Euler-123 angles; velocity; angular velocity; hip and ankle angles; their rates; contact forces on the feet,
    cut at 5 N. With a quaternion (x y z w) in place of the angles 31.
    """

    summary: ClassVar[str] = "ant: four legs of two links walk along X, 30 observations, 8 torques"
    config_type: ClassVar[type[TaskConfig]] = AntConfig
    action_size: int = _JOINTS
    success_reasons: ClassVar[frozenset[str]] = frozenset()
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 250,
        "num_envs": 512,
        "steps_per_iteration": 32,
        "network.hidden": (128, 64),
        "network.init_std": 0.6,
        "ppo.gamma": 0.99,
        "ppo.entropy": 0.0,
    }

    def build(self, builder: ModelBuilder) -> ModelBuilder:
        """The ant of :mod:`simwarp.scenes`."""
        from simwarp.scenes import ant

        return ant()

    def solver_options(self) -> SolverOptions:
        """Contacts to ``tolerance``: a thousandth of the walking speed does not change a gait."""
        from simwarp import SolverOptions

        return SolverOptions(tolerance=self.config.tolerance)

    def setup(self) -> None:
        """Make views of positions of record and of contact forces, and allocate what an episode remembers."""
        from simwarp import to_torch

        worlds, device, simulation = self.num_worlds, self.device, self.simulation
        model = simulation.model
        self._x = to_torch(simulation.state.body_x)
        self._rotation = to_torch(simulation.state.body_rot)
        self._body_force = to_torch(simulation.contacts.body_contact_force)
        self._thighs = [model.body(f"leg_{leg}") for leg in range(4)]
        self._shins = [model.body(f"ankle_{leg}") for leg in range(4)]
        self._first_shin, self._shin_stride = self._shins[0], self._shins[1] - self._shins[0]
        self._before = torch.zeros(worlds, dtype=torch.float64, device=device)
        self._farthest_aside = torch.zeros(worlds, device=device)
        self._touched = torch.zeros(worlds, dtype=torch.bool, device=device)
        self._reached = torch.zeros(worlds, dtype=torch.bool, device=device)
        lower = [-_HIP_LIMIT] * 4 + [_ANKLE_LIMITS[0]] * 4
        upper = [_HIP_LIMIT] * 4 + [_ANKLE_LIMITS[1]] * 4
        self._middle = 0.5 * (torch.tensor(upper, device=device) + torch.tensor(lower, device=device))
        self._half_range = 0.5 * (torch.tensor(upper, device=device) - torch.tensor(lower, device=device))
        turned = 3 if self.config.orientation is Orientation.EULER else 4
        sizes = [0.4] + [0.3] * turned + [1.0] * 3 + [2.0] * 3 + [0.5] * 8 + [5.0] * 8 + [_FORCE_CLIP] * 4
        self._sizes = torch.tensor(sizes, device=device)

    def begin_step(self) -> None:
        """Remember where the torso is: progress is a difference."""
        self._before.copy_(self._distance())
        self._touched.zero_()

    def after_physics(self) -> None:
        """Notice a touch of the torso, which may be over before the control step is."""
        self._touched |= (self._body_force[:, _TORSO] != 0.0).any(dim=1)

    def apply(self, action: torch.Tensor) -> None:
        """Turn the joints with ``torque`` newton metres per unit of action."""
        self.views.joint_force.copy_(action * self.config.torque)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``: (W, 30) float32, or (W, 31) with a quaternion."""
        config, views = self.config, self.views
        pose = views.body_q[:, _TORSO]
        rotation = pose[:, 3:]
        turned = euler_123(rotation) if config.orientation is Orientation.EULER else rotation
        parts = [
            pose[:, 1:2] if config.lateral else pose[:, 2:3],
            turned,
            rotate_back(rotation, views.body_v[:, _TORSO]),
            rotate_back(rotation, views.body_omega[:, _TORSO]),
            views.joint_q,
            views.joint_qd,
            self._foot_forces(),
        ]
        policy = torch.cat(parts, dim=1)
        return {"policy": policy / self._sizes if config.scaled else policy}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        config = self.config
        speed = ((self._before - self._distance()) / config.control_dt).float()
        power = self.action * self.views.joint_qd
        alive = 1.0 - 2.0 * self._touched.float()
        offset = (self.views.joint_q - self._middle).abs() / self._half_range
        limits = (offset > 1.0 - _NEAR_LIMIT).sum(dim=1).float()
        if config.reward is AntReward.CODE:
            effort = -0.2 * power.abs().mean(dim=1)
            return {"progress": speed, "alive": alive, "effort": effort, "limits": -0.6 * limits}
        if config.reward is AntReward.THESIS:
            effort = -0.2 * config.torque * power.sum(dim=1)
            return {"progress": speed, "alive": alive, "effort": effort, "limits": -0.6 * limits}
        pose = self.views.body_q[:, _TORSO]
        heading = euler_123(pose[:, 3:])[:, 2]
        return {
            "progress": 2.0 * speed.clamp(max=config.target_speed) - (speed - config.target_speed).clamp(min=0.0),
            "alive": 0.5 * alive,
            "effort": -0.05 * power.abs().mean(dim=1),
            "limits": -0.05 * limits,
            "straight": -0.5 * self.views.body_v[:, _TORSO, 1].abs(),
            "heading": -0.5 * heading.abs(),
            "line": -pose[:, 1].abs().clamp(max=2.0),
        }

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``torso_contact``: the torso touches the ground, in any physics step."""
        return {"torso_contact": self._touched.clone()}

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return ``arena``: the ant has left the original's floor of 50 m around the start."""
        return {"arena": (self._x[:, _TORSO, :2].abs() > _ARENA).any(dim=1)}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near the built pose and the heading +X."""
        angle, rate = self.config.start_angle, self.config.start_rate
        heading = self.random.uniform("heading", -angle, angle)[:, 0].double()
        turned = torch.where(world_mask.unsqueeze(1), heading_quaternion(heading), self._rotation[:, _TORSO])
        self._rotation[:, _TORSO] = turned
        q = self.random.uniform("angles", -angle, angle, size=_JOINTS)
        # Ankles only turn outwards and up: the feet stay above the ground
        q[:, 4:].abs_().neg_()
        self.simulation.set_joint_state(world_mask, q, self.random.uniform("rates", -rate, rate, size=_JOINTS))
        self._touched.masked_fill_(world_mask, False)
        self._farthest_aside.masked_fill_(world_mask, 0.0)
        self._reached.masked_fill_(world_mask, False)

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``success``, ``distance`` along X [m] and the largest ``lateral_error`` of the episode [m]."""
        config = self.config
        place = self.views.body_q[:, _TORSO]
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
        """Show the legs as well, of which only the feet are collision shapes."""
        from simwarp.scenes.contact import ANT_LIMB_RADIUS
        from simwarp.viewer import add_skeleton

        add_skeleton(visuals, ANT_LIMB_RADIUS)

    def extra_state(self) -> dict[str, torch.Tensor]:
        """What success remembers of the running episode."""
        return {"farthest_aside": self._farthest_aside, "reached": self._reached}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take it back."""
        self._farthest_aside.copy_(state["farthest_aside"])
        self._reached.copy_(state["reached"])

    def _distance(self) -> torch.Tensor:
        """(W,) distance to a target far ahead, as the original measures progress [m]."""
        place = self._x[:, _TORSO]
        return torch.hypot(place[:, 1], _TARGET_X - place[:, 0])

    def _foot_forces(self) -> torch.Tensor:
        """(W, 4) sizes of the contact forces on the feet, clipped as in the original [N]."""
        return self._body_force[:, self._first_shin :: self._shin_stride].norm(dim=2).clamp(max=_FORCE_CLIP)
