"""A quadruped follows commanded velocities ahead and sideways, and turns, by twelve position drives."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import torch

from simwarp.scenes import QUADRUPED_FEET, QUADRUPED_STANCE, QUADRUPED_STANCE_HEIGHT, quadruped, show_quadruped
from simwarp.tasks import Fraction, Positive

from ...framework.command import Command
from ...framework.config import TaskConfig
from ...framework.registry import register
from . import pieces
from .legged import LeggedConfig, LeggedTask

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Visuals


@dataclasses.dataclass(frozen=True)
class VelocityConfig(LeggedConfig):
    """Configuration of :class:`QuadrupedVelocity`."""

    max_speed: Positive = 1.0
    """Bound of the commanded speed ahead and back [m/s]."""
    max_sideways: Positive = 0.5
    """Bound of the commanded speed to either side [m/s]."""
    max_turn: Positive = 1.0
    """Bound of the commanded turn about the vertical [rad/s]."""
    command_time: Positive = 5.0
    """Time between two commands [s]."""
    standing: Fraction = 0.0
    """Share of commands that are to stand."""
    heading: bool = False
    """Command headings, drawn over the whole circle, in place of turns."""


@register("quadruped-velocity")
class QuadrupedVelocity(LeggedTask[VelocityConfig]):
    """Observation ``policy`` (W, 12 + 3 J), J joints: velocity and angular velocity of the trunk and where down is, in
    its axes; command; angles from the stance, rates; last action.
    """

    summary: ClassVar[str] = "quadruped: four legs follow commanded velocities and turns, 12 position drives"
    config_type: ClassVar[type[TaskConfig]] = VelocityConfig
    action_size: int = 12
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 300, "num_envs": 512, "steps_per_iteration": 24, "network.hidden": (128, 128),
        "network.init_std": 0.5, "ppo.gamma": 0.98, "ppo.desired_kl": 0.02, "ppo.entropy": 0.003,
    }  # fmt: skip
    trunk, feet, stance, height = "trunk", QUADRUPED_FEET, QUADRUPED_STANCE, QUADRUPED_STANCE_HEIGHT

    def robot(self) -> ModelBuilder:
        """The quadruped of :mod:`simwarp.scenes`."""
        return quadruped()

    def visuals(self, visuals: Visuals) -> None:
        """Show its motors as well."""
        show_quadruped(visuals)

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """What the class says, component by component."""
        command, joints = ("ahead", "left", "turn"), self.action_joints
        parts = {"velocity": 3, "turning": 3, "down": 3, "command": command, "angle": joints, "rate": joints}
        return {"policy": pieces.names_of(**parts, action=joints)}

    def setup(self) -> None:
        """Allocate commands and errors."""
        super().setup()
        config, worlds, device = self.config, self.num_worlds, self.device
        self.most = torch.tensor([config.max_speed, config.max_sideways, config.max_turn], device=device)
        self.command, self.heading = torch.zeros(worlds, 3, device=device), torch.zeros(worlds, device=device)
        self.errors, self.error_sums = torch.zeros(worlds, 2, device=device), torch.zeros(worlds, 2, device=device)

    def begin_step(self) -> None:
        """Add the errors of the step before."""
        super().begin_step()
        self.error_sums.add_(self.errors)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``."""
        tellers = (pieces.velocity_in_body, pieces.turning_in_body, pieces.projected_gravity)
        seen = [tell(self.views, self.body) for tell in tellers]
        return {"policy": torch.cat([*seen, self.command, self.angles, self.rates, self.action], dim=1)}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms; weights are per second, but for that of a fall."""
        velocity, turning = (
            pieces.velocity_in_body(self.views, self.body),
            pieces.turning_in_body(self.views, self.body),
        )
        speed_error, turn_error = pieces.speed_error(velocity, self.command), pieces.turn_error(turning, self.command)
        self.errors.copy_(torch.stack((speed_error, turn_error), dim=1))
        period, moving = self.config.control_dt, pieces.is_moving(self.command)
        terms = {
            "speed": 2.0 * pieces.tracking(speed_error, 0.5),
            "turn": 1.0 * pieces.tracking(turn_error, 0.5),
            "bounce": -1.0 * pieces.bouncing(velocity),
            "rock": -0.02 * pieces.rocking(turning),
            "tilt": -2.5 * pieces.tilt(pieces.projected_gravity(self.views, self.body)),
            "posture": -0.1 * pieces.squares(self.angles),
            "acceleration": -1e-7 * pieces.squares((self.rates - self.rates_before) / period),
            "smooth": -0.01 * pieces.squares(self.action - self.before),
            "swing": 0.5 * pieces.swinging(self.on_feet.time_in_air, moving, least=0.1, longest=0.3),
            "slip": -0.05 * pieces.slip(self.on_feet.velocity(), self.on_feet.touching),
        }
        paid = {name: period * term for name, term in terms.items()}
        return {**paid, "fall": -1.0 * self.terminations()["fell"]}

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``fell``: the trunk touches something, or is tilted by more than 60 degrees."""
        tilted = pieces.projected_gravity(self.views, self.body)[:, 2] > -0.5
        return {"fell": tilted | self.on_trunk.touching[:, 0]}

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``success``: no fall; and means over the episode, ``speed_error`` [m/s] and ``turn_error`` [rad/s]."""
        means = (self.error_sums + self.errors) / self.episode_steps.clamp(min=1).unsqueeze(1)
        return {"success": ~self.terminations()["fell"], "speed_error": means[:, 0], "turn_error": means[:, 1]}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start anew; draw the commands whose time has come, in the other worlds too."""
        super().reset(world_mask)
        config, draws = self.config, (self.random, self.episode_steps)
        every = config.steps_in(config.command_time)
        due = pieces.draw_command(self.command, *draws, every=every, most=self.most, standing=config.standing)
        if config.heading:
            pieces.draw_heading(self.heading, self.random, due)
            rotation = self.views.body_q[:, self.body, 3:]
            self.command[:, 2] = pieces.turn_towards(rotation, self.heading, gain=1.0, most=config.max_turn)
        for buffer in (self.errors, self.error_sums):
            buffer.masked_fill_(world_mask.unsqueeze(1), 0.0)

    def commands(self) -> dict[str, Command]:
        """Return speeds ahead and to the left [m/s], and the turn [rad/s]."""
        named = zip(("ahead", "left", "turn"), self.command.unbind(1), self.most.tolist(), strict=True)
        return {name: Command(values, -most, most) for name, values, most in named}

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return commands and errors of the running episodes, too."""
        own = {name: getattr(self, name) for name in ("command", "heading", "errors", "error_sums")}
        return {**super().extra_state(), **own}
