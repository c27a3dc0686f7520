"""Reaching: an arm with six torques moves the point between its fingers to a cube on the ground and stays there.

Benatti's thesis, section 9.2, where the Comau Racer3 does it; numbers are those of its code. One class for every arm of
:mod:`simwarp.scenes`. The thesis gives no criterion of success: here the grip is within 2 cm of the cube's centre
through the last 0.2 s.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import Drawing, Ge, Gt, Le, Line, NotNegative, Positive, Task, TaskConfig, Variant, register, require

from ..framework.config import RewardWeights
from ..framework.recorded_launches import (
    ComputedRows,
    NamedRows,
    TensorLaunch,
    WorldLaunch,
    filled,
    launch_over,
    share_over,
    zeros_of,
)
from . import reach_kernels as kernels
from .reach_kernels import ReachingArm, ReachState

if TYPE_CHECKING:
    from simwarp.kinematics import InverseKinematics


_HALF_CUBE = 0.015
_DRIVE_ERROR = 0.02
"""Error of a drive at which it gives its whole torque [rad]."""
_DRIVE_TIME = 0.02
"""Time in which it takes an error back [s]."""


class ReachReward(enum.Enum):
    """Variants of the reward.

    ``shaped`` is this project's own, at most 2 in a step: nearness on the scales of 0.3 m and 2 cm, less at most 1.4
    for touches, forces on the fingers, effort, joints at their stops and trembling. ``thesis`` has the terms that the
    thesis prints (its eq. 9.1), of whose coefficients it gives -1000 for a touch alone; the others are those of the
    original code: 1 / (d + 0.1 mm), less forces on the fingers, 0.001 |action x rate|, 2 per joint at a stop.
    """

    SHAPED = "shaped"
    THESIS = "thesis"


_WEIGHTS: Mapping[ReachReward, Mapping[str, float]] = {
    ReachReward.SHAPED: {
        "near": 1.0, "contact": -1.0, "fingers": -0.1, "energy": -0.1, "joint_pos_limits": -0.1, "action_rate_l2": -0.1,
    },
    ReachReward.THESIS: {
        "near": 1.0, "contact": -1000.0, "fingers": -1.0, "energy": -0.001, "joint_pos_limits": -2.0,
    },
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class ReachRewards(RewardWeights):
    """Weights of the reward; None is that of its variant, of which ``thesis`` has the first five."""

    near: float | None = None
    """Nearness of the grip to the target: with ``shaped`` on two scales, at most 2; with ``thesis`` 1 / distance."""
    contact: float | None = None
    """Base, upper arm or forearm touch something."""
    fingers: float | None = None
    """Mean force on the fingers [N]; with ``shaped`` as a share of 20 N, at most 1."""
    energy: float | None = None
    """Norm of action times joint rate [rad/s]; with ``shaped`` their mean size, as a share of the largest."""
    joint_pos_limits: float | None = None
    """Joints at an end of their range; with ``shaped`` their share."""
    action_rate_l2: float | None = None
    """Mean square of the change of the action, as a share of the largest."""


class ReachActions(enum.Enum):
    """Meaning of the actions: torques of the joints as shares of the largest ones; or displacements of the grip along
    X, Y and Z, which inverse kinematics turns into angles for stiff drives.
    """

    TORQUE = "torque"
    DISPLACEMENT = "displacement"


@dataclasses.dataclass(frozen=True)
class ReachConfig(TaskConfig):
    """Configuration of the reaching arms."""

    dt: Positive = 0.001
    """Physics step [s]."""
    decimation: Annotated[int, Ge(1), Le(100_000)] = 20
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    max_episode_steps: Annotated[int, Ge(1), Le(10**9)] = 100
    """Control steps after which an episode is truncated: 2 s."""
    gravity: float = 9.8
    """Gravitational acceleration, downwards [m/s2]."""
    actions: ReachActions = ReachActions.TORQUE
    """torque: six shares of the largest torques; displacement: of the grip along X, Y and Z."""
    displacement: Annotated[float, Gt(0.0), Le(0.2)] = 0.02
    """Way of the grip of a full action in one control step, where actions are displacements [m]."""
    reward: ReachReward = ReachReward.SHAPED
    """Variant of the reward."""
    rewards: ReachRewards = ReachRewards()
    """Weights of the reward."""
    fixed_target: bool = False
    """Leave the target in the middle of its range."""
    target_x: Annotated[float, Ge(-1.0), Le(1.0)] = -0.52
    """Place of the target's centre along X, in the middle of its range [m]; its height is 0.015 m."""
    target_spread: Annotated[float, Ge(0.0), Le(0.2)] = 0.05
    """Half-width of the uniform place of the target, along X and Y [m]."""
    start_angle: Annotated[float, Ge(0.0), Le(0.5)] = 0.05
    """Half-width of the uniform start angles of the joints [rad]."""
    near: Positive = 0.02
    """Distance of the grip from the target's centre below which it is reached [m]."""
    hold_time: NotNegative = 0.2
    """Time at the end of an episode through which a success stays that near [s]."""
    tolerance: Positive = 1e-3
    """Residual at which the contact solve stops [m/s]."""
    variant: Variant = Variant.SIMWARP
    """thesis: the reward of equation 9.1, an action in every physics step, and starts as in the thesis."""

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {
            "reward": ReachReward.THESIS,
            "decimation": 1,  # of the code, as what follows
            "max_episode_steps": 2000,
            "start_angle": 0.0,
        }
    }

    def validate(self) -> None:
        """Check that displacements act at once."""
        super().validate()
        if self.actions is ReachActions.DISPLACEMENT:
            require(self.action_rise_time == 0.0, self, "action_rise_time", "0 where actions are displacements")

    def usual_weights(self) -> Mapping[str, float]:
        """Weights of the variant."""
        return _WEIGHTS[self.reward]


@dataclasses.dataclass(frozen=True)
class Aiming:
    """Displacements of the grip, turned into coordinates of the drives.

    Attributes:
        search: coordinates that bring the grip to its target.
        target_q: (W, dofs) of the drives, from which each search begins.
        aim: displaces that target by an action.
        drive: takes the drives to what was found.
        rest: aims at where the grip is, in the worlds of a mask.
    """

    search: InverseKinematics
    target_q: wp.array
    aim: TensorLaunch
    drive: TensorLaunch
    rest: TensorLaunch


class ReachTask(Task[ReachConfig]):
    """Observation ``policy`` (W, 18), in this order: joint angles [rad], their rates [rad/s], the target's centre [m],
    the grip [m], both in the world. Actions are torques of the joints as shares of the largest ones.
    """

    fused_physics: ClassVar[bool] = True
    arm: ClassVar[sw.scenes.Arm]
    """The robot."""
    config_type: ClassVar[type[TaskConfig]] = ReachConfig
    action_size: int = 6
    per_world: ClassVar[tuple[str, ...]] = ("shape_x",)
    state_buffers: ClassVar[Mapping[str, str]] = {"target": "_target", "near_steps": "_near_steps"}
    success_reasons: ClassVar[frozenset[str]] = frozenset()
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 120,
        "num_envs": 128,
        "steps_per_iteration": 32,
        "network.hidden": (128, 64),
        "network.init_std": 0.4,
        "ppo.gamma": 0.98,
        "ppo.entropy": 0.0,
    }
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {"network.kind": "thesis-mlp", "network.activation": "tanh", "ppo.reward_scale": 0.01}
    }

    def __init__(self, config: ReachConfig, num_worlds: int, **options: Any) -> None:
        if config.actions is ReachActions.DISPLACEMENT:
            self.action_size = 3
        super().__init__(config, num_worlds, **options)

    @property
    def action_names(self) -> Sequence[str]:
        """Ways of the grip, where actions are displacements."""
        return ("grip x", "grip y", "grip z") if self.config.actions is ReachActions.DISPLACEMENT else ()

    @property
    def action_joints(self) -> Sequence[str]:
        """The joints of the arm, where actions are torques."""
        return () if self.action_names else self._joint_names()

    def _joint_names(self) -> list[str]:
        """Return the names of the joints that turn."""
        model = self.simulation.model
        starts = model.joint_dof_start
        return [name for index, name in enumerate(model.joint_names) if starts[index] < starts[index + 1]]

    @property
    def action_scale(self) -> Sequence[float]:
        """Torques [N·m] or ways [m] of full actions."""
        if self.config.actions is ReachActions.DISPLACEMENT:
            return (self.config.displacement,) * 3
        return [joint.torque for joint in self.arm.joints]

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """What :class:`ReachTask` lists, component by component."""
        names = [f"{kind} {joint}" for kind in ("angle", "rate") for joint in self._joint_names()]
        return {"policy": [*names, *(f"{point} {axis}" for point in ("target", "grip") for axis in "xyz")]}

    def build(self, builder: sw.ModelBuilder) -> sw.ModelBuilder:
        """The arm of :mod:`simwarp.scenes` and a cube on the ground."""
        drives = None
        if self.config.actions is ReachActions.DISPLACEMENT:
            drives = [
                sw.PositionDrive(
                    stiffness=joint.torque / _DRIVE_ERROR, damping=joint.torque / _DRIVE_ERROR * _DRIVE_TIME,
                    effort_limit=joint.torque,
                )
                for joint in self.arm.joints
            ]  # fmt: skip
        made = sw.scenes.robot_arm(self.arm, drives=drives)
        self.cube = made.add_shape_box(
            sw.WORLD, half=(_HALF_CUBE,) * 3, pose=sw.pose((self.config.target_x, 0.0, _HALF_CUBE)), name="target",
            material=sw.Material(friction=0.5),
        )  # fmt: skip
        return made

    def solver_options(self) -> sw.SolverOptions:
        """Contacts to ``tolerance``."""
        return sw.SolverOptions(tolerance=self.config.tolerance)

    def setup(self) -> None:
        """Allocate the state of an episode, and record what a control step launches."""
        config, simulation, device = self.config, self.simulation, self.device
        state, torque = simulation.state.arrays, simulation.control.joint_force
        self.reach = zeros_of(ReachState, self, last_action=self.action_size)
        self.reaching = self._make_arm()
        self._touched, self._near_steps = sw.to_torch(self.reach.touched), sw.to_torch(self.reach.near_steps)
        self._target = sw.to_torch(self.reach.target)
        self._cube_x = sw.to_torch(simulation.model.shape_x)[:, self.cube]
        self._success = torch.zeros(self.num_worlds, dtype=torch.bool, device=device)
        self._distance = torch.zeros(self.num_worlds, device=device)
        self._start_q, self._start_qd = (wp.zeros_like(torque) for _ in range(2))
        named = config.reward_weights()
        variant = kernels.SHAPED if config.reward is ReachReward.SHAPED else kernels.THESIS
        weights = filled(kernels.ReachRewardWeights, variant=variant, **named)
        hold_steps = round(config.hold_time / config.dt)
        spread = 0.0 if config.fixed_target else config.target_spread
        place = [wp.vec3d(config.target_x, 0.0, _HALF_CUBE), wp.vec3d(spread, spread, 0.0)]
        streams = [self.random.stream(purpose) for purpose in ("angles", "target")]
        moved = [self.reaching, state, self.reach]
        self._aiming = self._make_aiming() if config.actions is ReachActions.DISPLACEMENT else None
        self._begin_reach = launch_over(self, kernels.begin_reach, self.action, self.reach)
        self._drive = launch_over(self, kernels.turn_joints, self.action, self.reaching, state, torque)
        self._finish = launch_over(self, kernels.finish_reach, self.action, *moved, torque)
        self._observe = ComputedRows(self, kernels.observe_reach, *moved, width=2 * len(self.arm.joints) + 6)
        self._compute_rewards = NamedRows(
            self, kernels.compute_reach_rewards, named, weights, float(config.decimation), self.action, *moved
        )
        self._measure = launch_over(self, kernels.measure_reach, hold_steps, *moved, self._success, self._distance)
        self._start = launch_over(
            self, kernels.begin_reach_episode, self._every_world, config.start_angle, *place, *streams,
            self.random.draws, self.cube, simulation.model.shape_x, self.reach, self._start_q, self._start_qd,
        )  # fmt: skip

    def _make_arm(self) -> ReachingArm:
        """Return what the arm is."""
        arm, model, device = self.arm, self.simulation.model, str(self.device)
        names = list(model.shape_names)

        def numbers(values: Sequence[float]) -> wp.array:
            return wp.array([*values], dtype=float, device=device)

        def shapes(wanted: Sequence[str]) -> wp.array:
            return wp.array([names.index(name) for name in wanted], dtype=int, device=device)

        return filled(
            ReachingArm,
            hand=model.body(arm.links[-1].name),
            grip=wp.vec3d(*self._grip()),
            torque=numbers([joint.torque for joint in arm.joints]),
            speed=numbers([joint.speed for joint in arm.joints]),
            middle=numbers([0.5 * sum(joint.limit) for joint in arm.joints]),
            half=numbers([0.5 * (joint.limit[1] - joint.limit[0]) for joint in arm.joints]),
            barred=shapes(arm.barred),
            fingers=shapes(arm.fingers),
            force=self.simulation.contacts.shape_contact_force,
            near=self.config.near,
            driven=int(self.config.actions is ReachActions.DISPLACEMENT),
        )

    def _grip(self) -> list[float]:
        """Return the grip from the hand's centre of mass [m]."""
        arm = self.arm
        return [float(a) - float(b) for a, b in zip(arm.grip, arm.links[-1].centre, strict=True)]

    def _make_aiming(self) -> Aiming:
        """Return what turns displacements of the grip into coordinates of the drives."""
        from simwarp.kinematics import InverseKinematics

        config, simulation, arm = self.config, self.simulation, self.reaching
        state, target_q = simulation.state.arrays, simulation.control.joint_target_q
        search = InverseKinematics(
            simulation, self.arm.links[-1].name, self._grip(), iterations=10, tolerance=1e-4, damping=0.02
        )
        return Aiming(
            search, target_q,
            aim=launch_over(self, kernels.aim_grip, self.action, config.displacement, arm, state, search.target),
            drive=launch_over(self, kernels.aim_drives, search.q, config.control_dt, arm, target_q),
            rest=launch_over(self, kernels.rest_drives, self._every_world, arm, state, search.target, target_q),
        )  # fmt: skip

    def _move_grip(self, action: torch.Tensor) -> None:
        """Set the drives to a displacement of the grip, if actions are displacements."""
        if self._aiming is not None:
            self._aiming.aim.on(action)
            self._aiming.search.solve(self._aiming.target_q)
            self._aiming.drive.launch()

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return the action's way, torques and touches."""
        path, simulation = self._path, self.simulation
        parts = [self.reaching, simulation.state.arrays, self.reach, simulation.control.joint_force]
        return [share_over(simulation, kernels.reach_on, path.reach, path.request, self.action, *parts)]

    def finish_physics(self) -> None:
        """Notice the last touch."""
        self._finish.launch()

    def begin_step(self) -> None:
        """Forget the touches of the last control step, store its action, and aim where that is a displacement."""
        self._begin_reach.launch()
        self._move_grip(self._path.request)

    def apply(self, action: torch.Tensor) -> None:
        """Turn the joints with a share of their largest torques, none that drives beyond the largest speed; or move
        the grip.
        """
        self._drive.on(action)
        self._move_grip(action)

    def after_physics(self) -> None:
        """Notice a touch, which may be over before the control step is; cut the torques anew."""
        self._finish.launch()

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy`` (W, 18) float32, the buffer itself."""
        return {"policy": self._observe()}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms of the chosen reward."""
        return self._compute_rewards()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``contact``: base, upper arm or forearm touch anything, in any physics step."""
        return {"contact": self._touched.clone()}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near the zero pose, at rest; the target is anywhere in its range."""
        self._start.on(world_mask)
        self.simulation.set_joint_state(world_mask, self._start_q, self._start_qd)
        if self._aiming is not None:
            self._aiming.rest.on(world_mask)

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``success`` and the ``distance`` of the grip from the target [m]."""
        self._measure.launch()
        return {"success": self._success, "distance": self._distance}

    def extra_state(self) -> dict[str, torch.Tensor]:
        """The target, how long the grip has been near it, and where displacements have brought its aim."""
        aim = {} if self._aiming is None else {"aim": sw.to_torch(self._aiming.search.target)}
        return {**super().extra_state(), **aim}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Load it, and place the cube."""
        super().load_extra_state(state)
        self._cube_x.copy_(self._target)
        if self._aiming is not None:
            sw.to_torch(self._aiming.search.target).copy_(state["aim"])

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show the links as rods between the joints, and the target in red."""
        sw.viewer.add_skeleton(visuals, 0.03)
        visuals.show(self.cube, color=(0.75, 0.1, 0.08))

    def shot(self) -> sw.viewer.Shot:
        """From the side, at rest: arm and target are in sight."""
        return sw.viewer.Shot(
            body=sw.WORLD, target=(0.5 * self.config.target_x, 0.0, 0.35), eye=(0.0, -1.9, 0.5), fov=0.9
        )

    def drawing(self) -> Drawing:
        """Draw the edge of the cube from above, and the way that is left."""
        half = self._target.new_tensor([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1], [-1, -1, 1]]) * _HALF_CUBE
        edge = (self._target[:, None] + half).float()
        left = torch.stack([self._observe()[:, -3:], self._target.float()], dim=1)
        return Drawing((Line(edge, "tab:red", 2.0), Line(left, "tab:orange", 1.0)))

    def map_position(self) -> torch.Tensor:
        """The grip, (W, 3) [m]."""
        return self._observe()[:, -3:]


@register("racer3-reach")
class Racer3ReachTask(ReachTask):
    """The Comau Racer3; see :class:`ReachTask`."""

    summary: ClassVar[str] = "arm: the Racer3 moves its grip to a cube, 18 observations, 6 torques"
    instruction: ClassVar[str] = "Move the grip to the cube and hold it there."
    arm: ClassVar[sw.scenes.Arm] = sw.scenes.RACER3


@dataclasses.dataclass(frozen=True)
class Irb120ReachConfig(ReachConfig):
    """Configuration of :class:`Irb120ReachTask`."""

    target_x: Annotated[float, Ge(-1.0), Le(1.0)] = 0.40
    """Place of the target's centre along X, in the middle of its range [m]; its height is 0.015 m."""


@register("irb120-reach")
class Irb120ReachTask(ReachTask):
    """The ABB IRB 120 with the Racer3's hand; see :class:`ReachTask`."""

    summary: ClassVar[str] = "arm: the IRB 120 moves its grip to a cube, 18 observations, 6 torques"
    instruction: ClassVar[str] = "Move the grip to the cube and hold it there."
    config_type: ClassVar[type[TaskConfig]] = Irb120ReachConfig
    arm: ClassVar[sw.scenes.Arm] = sw.scenes.IRB120
