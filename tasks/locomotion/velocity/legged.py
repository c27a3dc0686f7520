"""Base of tasks of robots on legs with position drives: parts by name, stance, actions, ground, starts, pushes."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeVar

import torch

import simwarp as sw

from ...framework.errors import InputError
from ...framework.mirror import Mirror
from ...framework.rotations import heading_of
from ...framework.task import Task
from ...framework.task_simulation import Attachments
from . import mdp
from .config import VelocityConfig, VelocityObs
from .ground import RoughGround, ground_of
from .mirroring import mirror_of
from .walked_soil import WalkedSoil

LeggedT = TypeVar("LeggedT", bound=VelocityConfig)


class LeggedTask(Task[LeggedT]):
    """A robot on legs. A subclass names its parts and writes `robot`, observations, rewards and ends."""

    instruction: ClassVar[str] = "Walk with the commanded velocity and turn at the commanded rate."
    trunk: ClassVar[str]
    """Body that carries the legs, x forward; the shape of this name must not touch anything."""
    feet: ClassVar[Sequence[str]]
    """Shapes, or bodies, that stand on the ground."""
    gait: ClassVar[Sequence[float]] = ()
    """Offsets of the feet in the cycle of a gait, as shares of it; empty: the robot has no gait to keep to. Left and
    right differ by 0.5, which is what a mirror makes of the clock."""
    stance: ClassVar[Mapping[str, float]]
    """Joint -> angle that actions are deviations from, in the order of the actions [rad]."""
    height: ClassVar[float]
    """Of the frame of `base` over the ground in the stance [m]."""
    base: ClassVar[str] = "base"
    """Free joint of the trunk, which places the robot."""
    sides: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Words in the names of joints that change places in the robot's mirror image; empty: it is not its own."""
    turned: ClassVar[tuple[str, ...]] = ()
    """Joints whose angles change their sign there; * stands for letters."""
    friction: ClassVar[float] = 1.0
    """Of the ground; where it meets a foot, the smaller one counts."""
    per_world: ClassVar[tuple[str, ...]] = RoughGround.model_arrays
    soil: WalkedSoil | None
    """Soil below the robot; None on rigid ground. From `attach` on."""
    state_buffers: ClassVar[Mapping[str, str]] = {"before": "before", "rates_before": "rates_before"}

    @abstractmethod
    def robot(self) -> sw.ModelBuilder:
        """Return the robot without a ground, with position drives at the joints of `stance`.

        Its shapes meet those of group 2.
        """

    def build(self, builder: sw.ModelBuilder) -> sw.ModelBuilder:
        """The robot on its ground."""
        config, robot = self.config, self.robot()
        self.ground = ground_of(config.surface, self.height, rough=config.rough, scan=config.scan)
        meets = {"mask": 0} if config.on_soil else {}  # what sinks in meets no surface
        self.ground.build(robot, material=sw.Material(friction=self.friction), group=2, **meets)
        return robot

    def attach(self, model: sw.Model) -> Attachments:
        """Return the soil, where there is one. A subclass puts elements of its own before those of ``super()``."""
        self.soil = None
        if not self.config.on_soil:
            return Attachments()
        self.soil = WalkedSoil(model, self.ground.shape, self.config.soil, self.random, friction=self.friction)
        return Attachments(elements=[self.soil.element])

    def solver_options(self) -> sw.SolverOptions:
        """Contacts to 1 mm/s, which no gait notices."""
        return sw.SolverOptions(tolerance=1e-3)

    @property
    def action_joints(self) -> Sequence[str]:
        """The joints of the stance."""
        return tuple(self.stance)

    @property
    def action_scale(self) -> Sequence[float]:
        """Deviations of full actions [rad]."""
        return (self.config.action_scale,) * self.action_size

    @property
    def default_positions(self) -> Sequence[float]:
        """The stance [rad]."""
        return tuple(self.stance.values())

    def mirror(self) -> Mirror | None:
        """Return the mirror image of what is seen and done, of a robot that is its own."""
        if not self.sides:
            return None
        return mirror_of(self.observation_names, self.action_joints, sides=self.sides, turned=self.turned)

    @property
    def clock_names(self) -> Mapping[str, Sequence[str]]:
        """Names of what :meth:`clock` returns."""
        return {"clock": ("sine", "cosine")} if self.config.gait.rate > 0.0 else {}

    def clock(self) -> list[torch.Tensor]:
        """Return (W, 2) of the gait's clock, if there is one."""
        return [mdp.gait_clock(self.gait_phase)] if self.config.gait.rate > 0.0 else []

    def gait_terms(self, moving: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return ``gait_contacts``: how well the feet keep to the clock, if there is one.

        Args:
            moving: (W,) 1 where the robot is to move.
        """
        config = self.config.gait
        if config.rate == 0.0:
            return {}
        kept = mdp.gait_contacts(self.on_feet.touching, self.gait_phase, self._gait, moving, stance=config.stance)
        return {"gait_contacts": kept}

    def setup(self) -> None:
        """Allocate buffers, and find the robot's parts.

        Raises:
            InputError: a clock is asked for, of a robot without a gait.

        Afterwards there are ``body``, index of the trunk; ``on_feet`` and ``on_trunk``, contacts by name; ``before``
        and ``rates_before``, (W, J) action and rates [rad/s] of the step before.
        """
        model, device = self.simulation.model, self.device
        if self.config.gait.rate > 0.0 and len(self.gait) != len(self.feet):
            raise InputError(
                f"--task.gait.rate must be 0 for task '{self.name}', got {self.config.gait.rate:g}: the class names no "
                f"`gait`, offsets of its {len(self.feet)} feet"
            )
        self.ground.bind(self)
        self.body = model.body(self.trunk)
        self._mass = float(model.body_mass.numpy()[0].sum())
        self._weight = 9.81 * self._mass
        light = 0.01 * self._weight  # no touch by mistake, and none missed
        below = None if self.soil is None else self.soil.forces
        self.on_feet = self.contacts(*self.feet, threshold=light, soil=below)
        self.on_trunk = self.contacts(self.trunk, threshold=light, soil=below)
        self._gait = torch.tensor(self.gait, device=device)
        self._columns = torch.tensor([model.dof(joint) for joint in self.stance], device=device)
        self._stance = torch.tensor(self.default_positions, device=device)
        self._targets = sw.to_torch(self.simulation.control.joint_target_q)
        self._place = model.dof(self.base)
        self._start = torch.zeros(self.num_worlds, model.dof_count, device=device)
        self._start[:, self._place + 2] = self.height + 0.02  # legs that are less bent are longer
        self._at_rest = torch.zeros_like(self._start)
        self.before, self.rates_before = torch.zeros_like(self.action), torch.zeros_like(self.action)

    @property
    def gait_phase(self) -> torch.Tensor:
        """(W,) of the clock, in cycles since the episode began."""
        return self.config.gait.rate * self.config.control_dt * self.episode_steps

    @property
    def angles(self) -> torch.Tensor:
        """(W, J) of the joints, from the stance [rad]."""
        return self.views.joint_q[:, self._columns] - self._stance

    @property
    def rates(self) -> torch.Tensor:
        """(W, J) of the joints [rad/s]."""
        return self.views.joint_qd[:, self._columns]

    def heights(self) -> torch.Tensor:
        """Return (W, N) heights of the ground around, over that of a standing robot's feet [m]."""
        place = self.views.body_q[:, self.body]
        return self.ground.scan(place[:, :3], heading_of(place[:, 3:]))

    def privileged(self) -> torch.Tensor | None:
        """Return the observations with a scan, and forces on the feet as shares of the weight, for a critic alone."""
        groups = self.observations_of(VelocityObs.SCAN.value)
        assert groups is not None  # all tasks on legs have them
        return torch.cat([groups["policy"], self.on_feet.force.flatten(1) / self._weight], dim=1)

    def begin_step(self) -> None:
        """Store what a difference needs; push, where there are pushes."""
        config = self.config
        self.before.copy_(self.action)
        self.rates_before.copy_(self.rates)
        if config.push_speed > 0.0:
            self.views.body_force[:, self.body] = mdp.push_by_force(
                self.random, self.episode_steps, every=config.steps_in(config.push_time), speed=config.push_speed,
                mass=self._mass, period=config.control_dt,
            )  # fmt: skip

    def apply(self, action: torch.Tensor) -> None:
        """Set the targets of the drives, from the stance."""
        self._targets[:, self._columns] = self._stance + self.config.action_scale * action

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return ``edge``: the robot has come to the rim of rough ground."""
        return {"edge": self.ground.outside(self.views.body_q[:, self.body, :3])}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near the stance in the middle of the ground, with any heading."""
        self.ground.choose(world_mask)
        if self.soil is not None:
            self.soil.draw(world_mask)
        self._start[:, self._place + 5] = self.random.uniform("heading", -math.pi, math.pi)[:, 0]
        angles = mdp.reset_joints_by_offset(self.random, "angles", self._stance, self.config.start_angle)
        self._start[:, self._columns] = angles
        self.simulation.set_joint_state(world_mask, self._start, self._at_rest)
        for buffer in (self.before, self.rates_before):
            buffer.masked_fill_(world_mask.unsqueeze(1), 0.0)

    def on_iteration(self, iteration: int) -> Mapping[str, torch.Tensor]:
        """In training, levels of rough ground follow what robots achieve; the log tells where they are."""
        told = super().on_iteration(iteration) or {}
        self.ground.climb()
        return {**told, **self.ground.metrics()}

    def scene(self) -> sw.sensors.Scene:
        """The ground with the colours of its levels or with footprints, and the robot."""
        scene = self.ground.scene(self)
        return scene if self.soil is None else self.soil.show_in(scene)

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return what differences need, and the levels of the ground."""
        return {**super().extra_state(), **self.ground.extra_state()}

    def load_extra_state(self, state: Mapping[str, Any]) -> None:
        """Take it back."""
        super().load_extra_state(state)
        self.ground.load_extra_state(state)
        if self.soil is not None:  # a checkpoint does not keep its parameters
            self.soil.draw(torch.ones(self.num_worlds, dtype=torch.bool, device=self.device))
