"""Base class of walking tasks: a floating base on legs with torques at their joints, walking along X."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

import torch

from simwarp.tasks import Ge, Le, NotNegative, Positive

from ..framework.config import TaskConfig
from ..framework.frames import Orientation, euler_123, heading_quaternion, rotate_back
from ..framework.task import Task

if TYPE_CHECKING:
    from simwarp import SolverOptions

BASE = 0
"""Body that carries the legs."""
NEAR_LIMIT = 0.02
"""A joint counts as at its limit in the last part of its range."""
_FORCE_CLIP = 5.0
_TARGET_X = 1000.0
_ARENA = 49.0


@dataclasses.dataclass(frozen=True)
class WalkingConfig(TaskConfig):
    """Fields of every walking task."""

    max_episode_steps: int = 500
    """Control steps after which an episode is truncated: 10 s."""
    gravity: float = 9.81
    """Gravitational acceleration, downwards [m/s2]."""
    torque: Positive = 1.0
    """Joint torque of a full action [N·m]."""
    target_speed: Positive = 1.0
    """Speed along X for which the walk reward pays most [m/s]."""
    orientation: Orientation = Orientation.QUATERNION
    """Observation of the orientation: three Euler angles or the four numbers of a quaternion."""
    scaled: bool = False
    """Divide every observation by its usual size; without, they are in SI units."""
    start_angle: Annotated[float, Ge(0.0), Le(0.5)] = 0.1
    """Half-width of the uniform start angles of the joints and of the heading [rad]."""
    start_rate: NotNegative = 0.1
    """Half-width of the uniform start rates of the joints [rad/s]."""
    goal_distance: Positive = 10.0
    """Distance along X that a success has covered [m]."""
    goal_time: Positive = 10.0
    """Time in which it must be covered [s]."""
    goal_width: Positive = 1.0
    """Largest distance from the line y = 0 of a success, over the whole episode [m]."""
    tolerance: Positive = 1e-3
    """Residual at which the contact solve stops [m/s]."""


WalkingT = TypeVar("WalkingT", bound=WalkingConfig)


class WalkingTask(Task[WalkingT]):
    """A robot that walks along X. A subclass writes `build`, `apply`, `touching`, `foot_forces`, rewards and ends.

    Observation ``policy``: height, orientation, velocity, angular velocity, joint angles and rates, foot forces cut at
    5 N; SI units and axes of the base unless scaled.
    """

    legs: ClassVar[int]
    """The first joints are those of the legs at the body, one each; the others may only start bent one way."""
    usual_sizes: ClassVar[tuple[float, float, float, float]]
    """Of height [m], velocity [m/s], angular velocity and joint rate [rad/s], for scaled observations."""
    success_reasons: ClassVar[frozenset[str]] = frozenset()
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 250,
        "num_envs": 512,
        "steps_per_iteration": 32,
        "network.hidden": (128, 64),
        "ppo.gamma": 0.99,
        "ppo.entropy": 0.0,
    }

    def touching(self) -> torch.Tensor:
        """Return (W,) bool: something other than a foot touches the ground."""
        raise NotImplementedError

    def foot_forces(self) -> torch.Tensor:
        """Return (W, legs, 3) contact forces on the feet [N]."""
        raise NotImplementedError

    def solver_options(self) -> SolverOptions:
        """Contacts to ``tolerance``: far below the speed of a foot, so that it does not change a gait."""
        from simwarp import SolverOptions

        return SolverOptions(tolerance=self.config.tolerance)

    def setup(self) -> None:
        """Make views of positions of record, and allocate the state of an episode."""
        from simwarp import to_torch

        worlds, device, state = self.num_worlds, self.device, self.simulation.state
        self._x = to_torch(state.body_x)
        self._rotation = to_torch(state.body_rot)
        self._before = torch.zeros(worlds, dtype=torch.float64, device=device)
        self._farthest_aside = torch.zeros(worlds, device=device)
        self.touched = torch.zeros(worlds, dtype=torch.bool, device=device)
        self._reached = torch.zeros(worlds, dtype=torch.bool, device=device)
        turned = 3 if self.config.orientation is Orientation.EULER else 4
        height, speed, turn, rate = self.usual_sizes
        joints = self.action_size
        sizes = [height] + [0.3] * turned + [speed] * 3 + [turn] * 3 + [0.5] * joints + [rate] * joints
        self._sizes = torch.tensor(sizes + [_FORCE_CLIP] * self.legs, device=device)

    def begin_step(self) -> None:
        """Store the position of the base: progress is a difference."""
        self._before.copy_(self._distance())
        self.touched.zero_()

    def after_physics(self) -> None:
        """Notice a touch, which may be over before the control step is."""
        self.touched |= self.touching()

    def first_observation(self, pose: torch.Tensor) -> torch.Tensor:
        """Return the first observation, (W, 1), of the base's pose (W, 7): its height [m]."""
        return pose[:, 2:3]

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy`` (W, ...) float32."""
        config, views = self.config, self.views
        pose = views.body_q[:, BASE]
        rotation = pose[:, 3:]
        parts = [
            self.first_observation(pose),
            euler_123(rotation) if config.orientation is Orientation.EULER else rotation,
            rotate_back(rotation, views.body_v[:, BASE]),
            rotate_back(rotation, views.body_omega[:, BASE]),
            views.joint_q,
            views.joint_qd,
            self.foot_forces().norm(dim=2).clamp(max=_FORCE_CLIP),
        ]
        policy = torch.cat(parts, dim=1)
        return {"policy": policy / self._sizes if config.scaled else policy}

    def progress_speed(self) -> torch.Tensor:
        """Return (W,) float32: how fast the base came nearer to a target far ahead in this control step [m/s]."""
        return ((self._before - self._distance()) / self.config.control_dt).float()

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return ``arena``: the robot has left the original's floor of 50 m around the start."""
        return {"arena": (self._x[:, BASE, :2].abs() > _ARENA).any(dim=1)}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near the built pose and the heading +X."""
        angle, rate, joints = self.config.start_angle, self.config.start_rate, self.action_size
        heading = self.random.uniform("heading", -angle, angle)[:, 0].double()
        turned = torch.where(world_mask.unsqueeze(1), heading_quaternion(heading), self._rotation[:, BASE])
        self._rotation[:, BASE] = turned
        q = self.random.uniform("angles", -angle, angle, size=joints)
        # The outer joints only turn outwards and up: the feet stay above the ground
        q[:, self.legs :].abs_().neg_()
        self.simulation.set_joint_state(world_mask, q, self.random.uniform("rates", -rate, rate, size=joints))
        self.touched.masked_fill_(world_mask, False)
        self._farthest_aside.masked_fill_(world_mask, 0.0)
        self._reached.masked_fill_(world_mask, False)

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``success``, ``distance`` along X [m] and the largest ``lateral_error`` of the episode [m]."""
        config = self.config
        place = self.views.body_q[:, BASE]
        torch.maximum(self._farthest_aside, place[:, 1].abs(), out=self._farthest_aside)
        in_time = self.episode_steps * config.control_dt <= config.goal_time + 0.5 * config.control_dt
        self._reached |= (place[:, 0] >= config.goal_distance) & in_time
        straight = self._farthest_aside <= config.goal_width
        return {
            "success": self._reached & straight & ~self.touched,
            "distance": place[:, 0],
            "lateral_error": self._farthest_aside,
        }

    def extra_state(self) -> dict[str, torch.Tensor]:
        """State of the success criteria in the running episode."""
        return {"farthest_aside": self._farthest_aside, "reached": self._reached}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take it back."""
        self._farthest_aside.copy_(state["farthest_aside"])
        self._reached.copy_(state["reached"])

    def _distance(self) -> torch.Tensor:
        """(W,) distance to a target far ahead, as the original measures progress [m]."""
        place = self._x[:, BASE]
        return torch.hypot(place[:, 1], _TARGET_X - place[:, 0])
