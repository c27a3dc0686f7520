"""Base class of walking tasks: a floating base on legs with torques at their joints, walking along X."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, TypeVar

import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import Ge, Le, NotNegative, Positive

from ..framework.config import TaskConfig
from ..framework.mirror import Mirror, reflection
from ..framework.recorded_launches import ComputedRows, WorldLaunch, filled, launch_over, share_over, zeros_of
from ..framework.task import Task
from .walking_kernels import (
    FORCE_CLIP,
    Walker,
    WalkState,
    begin_walk,
    begin_walk_episode,
    drive_joints,
    find_outside,
    finish_physics,
    measure_success,
    observe_walk,
    walk_on,
)

BASE = 0
"""Body that carries the legs."""


class Orientation(enum.Enum):
    """Representation of a torso's orientation in observations."""

    EULER = "euler"
    QUATERNION = "quaternion"


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
    """Speed along X for which the walk reward is largest [m/s]."""
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


@dataclasses.dataclass(frozen=True)
class Touching:
    """Parts of a robot whose contacts count.

    Attributes:
        force: (W, N) vec3, contact forces of the parts [N].
        feet: indices of those that stand on the ground, in the order of observations.
        others: indices of those that must not touch it.
    """

    force: wp.array
    feet: Sequence[int]
    others: Sequence[int]


class WalkingTask(Task[WalkingT]):
    """A robot that walks along X. A subclass writes `build`, `touching`, rewards and ends.

    Observation ``policy``: height, orientation, velocity, angular velocity, joint angles and rates, foot forces cut at
    5 N; SI units and axes of the base unless scaled.
    """

    fused_physics: ClassVar[bool] = True
    legs: ClassVar[int]
    """The first joints are those of the legs at the body, one each; the others may only start bent one way."""
    usual_sizes: ClassVar[tuple[float, float, float, float]]
    """Of height [m], velocity [m/s], angular velocity and joint rate [rad/s], for scaled observations."""
    sides: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Words in the names of joints that change places in the robot's mirror image; empty: it is not its own."""
    turned: ClassVar[tuple[str, ...]] = ()
    """Joints whose angles change their sign there; * stands for letters."""
    sides_of_feet: ClassVar[tuple[tuple[int, int], ...]] = ()
    """Feet that change places there, by their places in `touching`."""
    success_reasons: ClassVar[frozenset[str]] = frozenset()
    state_buffers: ClassVar[Mapping[str, str]] = {"farthest_aside": "_aside", "reached": "_reached"}
    training: ClassVar[Mapping[str, Any]] = {
        "num_envs": 512,
        "steps_per_iteration": 32,
        "network.hidden": (64, 64),
        "ppo.epochs": 3,
        "ppo.gamma": 0.99,
        "ppo.entropy": 0.0,
    }

    def touching(self) -> Touching:
        """Return the parts whose contacts count."""
        raise NotImplementedError

    @property
    def action_joints(self) -> Sequence[str]:
        """All joints of the legs."""
        names: tuple[str, ...] = self.simulation.model.joint_names
        return names

    @property
    def action_scale(self) -> Sequence[float]:
        """Torques of full actions [N·m]."""
        return (self.config.torque,) * self.action_size

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """What :class:`WalkingTask` lists, component by component."""
        euler = self.config.orientation is Orientation.EULER
        joints = self.action_joints
        names = ["y" if self.lateral else "height"]
        names += [f"orientation {axis}" for axis in ("123" if euler else "xyzw")]
        names += [f"{kind} {axis}" for kind in ("velocity", "angular velocity") for axis in "xyz"]
        names += [f"{kind} {joint}" for kind in ("angle", "rate") for joint in joints]
        return {"policy": [*names, *(f"contact force of foot {foot}" for foot in range(len(self.touching().feet)))]}

    def mirror(self) -> Mirror | None:
        """Return what left and right, y of the world, make of observations and actions; None where no sides are."""
        if not self.sides:
            return None
        names = self.observation_names["policy"]
        euler = self.config.orientation is Orientation.EULER
        joints = [f"{kind} {joint}" for kind in ("angle", "rate") for joint in self.turned]
        flips = ["orientation [13]" if euler else "orientation [xz]", "velocity y", "angular velocity [xz]", *joints]
        feet = [(f"foot {one}", f"foot {other}") for one, other in self.sides_of_feet]
        seen = reflection(names, swap=[*feet, *self.sides], flip=[*flips, "y"] if self.lateral else flips)
        return Mirror({"policy": seen}, reflection(self.action_joints, swap=self.sides, flip=self.turned))

    @property
    def lateral(self) -> bool:
        """Observe the sideways position in place of the height."""
        return False

    @property
    def speed_limit(self) -> float:
        """Joint speed beyond which a torque that would drive it on is cut off [rad/s]."""
        return math.inf

    def solver_options(self) -> sw.SolverOptions:
        """Contacts to ``tolerance``: far below the speed of a foot, so that it does not change a gait."""
        return sw.SolverOptions(tolerance=self.config.tolerance)

    def setup(self) -> None:
        """Allocate the state of an episode, and record what a control step launches."""
        config, simulation, worlds, device = self.config, self.simulation, self.num_worlds, self.device
        state, torque = simulation.state.arrays, simulation.control.joint_force
        self.walk = zeros_of(WalkState, self, last_action=self.action_size)
        self._touched, self._aside, self._reached = (
            sw.to_torch(array) for array in (self.walk.touched, self.walk.aside, self.walk.reached)
        )
        self.walker, width = self._make_walker()
        walker = self.walker
        self._success = torch.zeros(worlds, dtype=torch.bool, device=device)
        self._distance = torch.zeros(worlds, device=device)
        self._start_q, self._start_qd = (wp.zeros_like(torque) for _ in range(2))
        goal = [config.goal_distance, config.goal_time + 0.5 * config.control_dt, config.goal_width]
        streams = [self.random.stream(purpose) for purpose in ("heading", "angles", "rates")]
        self._begin_walk = launch_over(self, begin_walk, state, self.action, self.walk)
        self._drive = launch_over(self, drive_joints, self.action, walker, state, torque)
        self._finish = launch_over(self, finish_physics, self.action, walker, state, self.walk, torque)
        self._observe = ComputedRows(self, observe_walk, walker, state, width=width)
        self._find_outside = ComputedRows(self, find_outside, state, width=None, dtype=torch.bool)
        self._measure = launch_over(
            self, measure_success, self.episode_steps, config.control_dt, *goal, state, self.walk, self._success,
            self._distance,
        )  # fmt: skip
        self._start = launch_over(
            self, begin_walk_episode, self._every_world, config.start_angle, config.start_rate, *streams,
            self.random.draws, walker, state, self.walk, self._start_q, self._start_qd,
        )  # fmt: skip

    def _make_walker(self) -> tuple[Walker, int]:
        """Return what a robot is, and the number of its observations."""
        touching, config = self.touching(), self.config
        turned = 3 if config.orientation is Orientation.EULER else 4
        height, speed, turn, rate = self.usual_sizes
        joints, feet = self.action_size, len(touching.feet)
        sizes = [height] + [0.3] * turned + [speed] * 3 + [turn] * 3 + [0.5] * joints + [rate] * joints
        sizes += [FORCE_CLIP] * feet
        device = str(self.device)
        walker = filled(
            Walker,
            feet=wp.array([*touching.feet], dtype=int, device=device),
            others=wp.array([*touching.others], dtype=int, device=device),
            force=touching.force,
            sizes=wp.array(sizes if config.scaled else [], dtype=float, device=device),
            legs=self.legs,
            quaternion=int(turned == 4),
            lateral=int(self.lateral),
            torque=config.torque,
            speed_limit=self.speed_limit,
            cut_anew=int(math.isfinite(self.speed_limit)),
        )
        return walker, len(sizes)

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return the action's way, torques and touches."""
        path, simulation = self._path, self.simulation
        moved = [path.reach, path.request, self.action]
        parts = [self.walker, simulation.state.arrays, self.walk, simulation.control.joint_force]
        return [share_over(self.simulation, walk_on, *moved, *parts)]

    def finish_physics(self) -> None:
        """Notice the last touch."""
        self._finish.launch()

    def begin_step(self) -> None:
        """Store the position of the base and the last action: progress and trembling are differences."""
        self._begin_walk.launch()

    def apply(self, action: torch.Tensor) -> None:
        """Turn the joints with ``torque`` newton metres per unit of action, none that drives beyond the limit."""
        self._drive.on(action)

    def after_physics(self) -> None:
        """Notice a touch, which may be over before the control step is; cut the torques anew."""
        self._finish.launch()

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy`` (W, ...) float32, the buffer itself."""
        return {"policy": self._observe()}

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return ``arena``: the robot has left the original's floor of 50 m around the start."""
        return {"arena": self._find_outside()}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near the built pose and the heading +X."""
        self._start.on(world_mask)
        self.simulation.set_joint_state(world_mask, self._start_q, self._start_qd)

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``success``, ``distance`` along X [m] and the largest ``lateral_error`` of the episode [m]."""
        self._measure.launch()
        return {"success": self._success, "distance": self._distance, "lateral_error": self._aside}
