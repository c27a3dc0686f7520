"""A quadruped follows commanded velocities ahead and sideways, and turns, by twelve position drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import torch

from simwarp.scenes import QUADRUPED_FEET, QUADRUPED_STANCE, QUADRUPED_STANCE_HEIGHT, quadruped, show_quadruped

from ...framework.command import Command
from ...framework.config import TaskConfig
from ...framework.registry import register
from . import mdp
from .config import Seen, VelocityConfig
from .legged import LeggedTask

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Visuals


@register("quadruped-velocity")
class QuadrupedVelocity(LeggedTask[VelocityConfig]):
    """What the robot feels (9 + 3 J numbers, J joints): angular velocity of the trunk and where down is, in its axes;
    the command; angles from the stance, rates; last action.

    Observation ``policy``: velocity of the trunk in its axes, and that; with ``scan`` heights of the ground around as
    well; with ``history`` what the robot feels now and felt in the control steps before.
    """

    summary: ClassVar[str] = "quadruped: four legs follow commanded velocities and turns, 12 position drives"
    config_type: ClassVar[type[TaskConfig]] = VelocityConfig
    action_size: int = 12
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 400, "num_envs": 512, "steps_per_iteration": 24, "network.hidden": (128, 128), "ppo.gamma": 0.985,
        "network.init_std": 0.5, "ppo.desired_kl": 0.02, "ppo.entropy": 0.003, "ppo.symmetry": "augment",
    }  # fmt: skip
    sides: ClassVar[tuple[tuple[str, str], ...]] = (("FL", "FR"), ("RL", "RR"))
    turned: ClassVar[tuple[str, ...]] = ("*_hip_joint",)
    trunk, feet, stance, height = "trunk", QUADRUPED_FEET, QUADRUPED_STANCE, QUADRUPED_STANCE_HEIGHT

    def robot(self) -> ModelBuilder:
        """The quadruped of :mod:`simwarp.scenes`."""
        return quadruped(ground=False)

    def visuals(self, visuals: Visuals) -> None:
        """Show its motors as well."""
        show_quadruped(visuals)

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """What the class says, component by component."""
        joints, steps = self.action_joints, self.config.history
        sent = {"command": ("ahead", "left", "turn"), "angle": joints, "rate": joints, "action": joints}
        proprioception = mdp.names_of(turning=3, down=3, **sent)
        if self.config.obs is Seen.HISTORY:
            return {"policy": [f"{name} {age} steps ago" for age in range(steps) for name in proprioception]}
        around = self.config.scan.names() if self.config.obs is Seen.SCAN else []
        return {"policy": [*mdp.names_of(velocity=3), *proprioception, *around]}

    def setup(self) -> None:
        """Allocate commands, errors, and earlier observations, the newest first."""
        super().setup()
        config, worlds, device = self.config, self.num_worlds, self.device
        self.most = torch.tensor([config.max_speed, config.max_sideways, config.max_turn], device=device)
        self.command, self.heading = torch.zeros(worlds, 3, device=device), torch.zeros(worlds, device=device)
        self.errors, self.error_sums = torch.zeros(worlds, 2, device=device), torch.zeros(worlds, 2, device=device)
        self.past = torch.zeros(worlds, config.history - 1, self.proprioception().shape[1], device=device)

    def begin_step(self) -> None:
        """Add the errors of the step before; remember what was felt."""
        self.error_sums.add_(self.errors)
        if self.config.history > 1:
            self.past.copy_(torch.cat([self.proprioception().unsqueeze(1), self.past[:, :-1]], dim=1))
        super().begin_step()

    def proprioception(self) -> torch.Tensor:
        """Return (W, 9 + 3 J) what the robot feels."""
        turning, down = (tell(self.views, self.body) for tell in (mdp.turning_in_body, mdp.projected_gravity))
        return torch.cat([turning, down, self.command, self.angles, self.rates, self.action], dim=1)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``."""
        return self.observations_of(self.config.obs.value)

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor]:
        """Return ``policy`` of other observations: for teachers."""
        if obs == Seen.HISTORY.value:
            return {"policy": torch.cat([self.proprioception(), self.past.flatten(1)], dim=1)}
        exact = [mdp.velocity_in_body(self.views, self.body), self.proprioception()]
        return {"policy": torch.cat([*exact, self.heights()] if obs == Seen.SCAN.value else exact, dim=1)}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms; weights are per second, but for that of a fall."""
        tellers = (mdp.velocity_in_body, mdp.turning_in_body)
        velocity, turning = (tell(self.views, self.body) for tell in tellers)
        speed_error, turn_error = mdp.speed_error(velocity, self.command), mdp.turn_error(turning, self.command)
        self.errors.copy_(torch.stack((speed_error, turn_error), dim=1))
        self.ground.record(velocity[:, :2], self.command[:, :2])
        period, moving = self.config.control_dt, mdp.is_moving(self.command)
        terms = {
            "speed": 2.0 * mdp.tracking(speed_error, 0.5 * self.config.max_speed),
            "turn": 1.0 * mdp.tracking(turn_error, 0.5 * self.config.max_turn),
            "bounce": -2.0 * mdp.bouncing(velocity),
            "rock": -0.03 * mdp.rocking(turning),
            "tilt": -2.5 * mdp.tilt(mdp.projected_gravity(self.views, self.body)),
            "posture": -0.1 * mdp.squares(self.angles),
            "acceleration": -1e-7 * mdp.squares((self.rates - self.rates_before) / period),
            "smooth": -0.01 * mdp.squares(self.action - self.before),
            "steps": 0.25 * mdp.stepping(*self.on_feet.phases, moving, least=0.1, longest=0.3),
            "slip": -0.05 * mdp.slip(self.on_feet.velocity(), self.on_feet.touching),
        }
        return {**{name: period * term for name, term in terms.items()}, "fall": -5.0 * self.terminations()["fell"]}

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``fell``: the trunk touches something, or is tilted by more than 60 degrees."""
        tilted = mdp.projected_gravity(self.views, self.body)[:, 2] > -0.5
        return {"fell": tilted | self.on_trunk.touching[:, 0]}

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``success``: no fall; and means over the episode, ``speed_error`` [m/s] and ``turn_error`` [rad/s]."""
        means = (self.error_sums + self.errors) / self.episode_steps.clamp(min=1).unsqueeze(1)
        own = {"success": ~self.terminations()["fell"], "speed_error": means[:, 0], "turn_error": means[:, 1]}
        return {**own, **self.ground.metrics()}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start anew; draw the commands whose time has come, in the other worlds too."""
        super().reset(world_mask)
        config, draws = self.config, (self.random, self.episode_steps)
        every = config.steps_in(config.command_time)
        due = mdp.draw_command(self.command, *draws, every=every, most=self.most, standing=config.standing)
        if config.heading:
            mdp.draw_heading(self.heading, self.random, due)
            rotation = self.views.body_q[:, self.body, 3:]
            self.command[:, 2] = mdp.turn_towards(rotation, self.heading, gain=1.0, most=config.max_turn)
        for buffer in (self.errors, self.error_sums):
            buffer.masked_fill_(world_mask.unsqueeze(1), 0.0)
        self.past.copy_(torch.where(world_mask.view(-1, 1, 1), self.proprioception().unsqueeze(1), self.past))

    def commands(self) -> dict[str, Command]:
        """Return speeds ahead and to the left [m/s], and the turn [rad/s]."""
        named = zip(("ahead", "left", "turn"), self.command.unbind(1), self.most.tolist(), strict=True)
        return {name: Command(values, -most, most) for name, values, most in named}

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return commands and errors of the running episodes, too."""
        own = {name: getattr(self, name) for name in ("command", "heading", "errors", "error_sums", "past")}
        return {**super().extra_state(), **own}
