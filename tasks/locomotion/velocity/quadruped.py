"""A quadruped follows commanded velocities ahead and sideways, and turns, by twelve position drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch

import simwarp as sw

from ...framework.config import TaskConfig
from ...framework.registry import register
from ...framework.user_command import Command
from . import mdp
from .config import VelocityConfig, VelocityObs
from .legged import LeggedTask


@register("quadruped-velocity")
class QuadrupedVelocity(LeggedTask[VelocityConfig]):
    """Proprioception (9 + 3 J numbers, J joints): angular velocity of the trunk and down, in its axes; command;
    angles from the stance, rates; last action; of a gait's clock, if any, sine and cosine. Observation ``policy``:
    velocity of the trunk in its axes, and that; ``scan``: heights of the ground around, too; ``history``: that of now
    and of the steps before.
    """

    summary: ClassVar[str] = "quadruped: four legs follow commanded velocities and turns, 12 position drives"
    config_type: ClassVar[type[TaskConfig]] = VelocityConfig
    action_size: int = 12
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 120, "num_envs": 512, "steps_per_iteration": 24, "network.hidden": (64, 64), "ppo.gamma": 0.985,
        "network.init_std": 0.5, "ppo.desired_kl": 0.02, "ppo.entropy": 0.003, "network.symmetric": True,
    }  # fmt: skip
    training_by_obs: ClassVar[Mapping[str, Mapping[str, Any]]] = {"scan": {"network.hidden": (128, 128)}}
    trained_in: ClassVar[Mapping[str, Any]] = {"dt": 0.01, "decimation": 2, "gait.rate": 2.5}
    gait: ClassVar[tuple[float, ...]] = (0.0, 0.5, 0.5, 0.0)  # FL FR RL RR: a trot
    sides: ClassVar[tuple[tuple[str, str], ...]] = (("FL", "FR"), ("RL", "RR"))
    turned: ClassVar[tuple[str, ...]] = ("*_hip_joint",)
    state_buffers: ClassVar[Mapping[str, str]] = {
        name: name for name in ("before", "rates_before", "command", "heading", "errors", "error_sums", "past")
    }
    trunk, feet = "trunk", sw.scenes.QUADRUPED_FEET
    stance, height = sw.scenes.QUADRUPED_STANCE, sw.scenes.QUADRUPED_STANCE_HEIGHT

    def robot(self) -> sw.ModelBuilder:
        """The quadruped of :mod:`simwarp.scenes`."""
        return sw.scenes.quadruped(ground=False)

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show its motors as well."""
        sw.scenes.show_quadruped(visuals)

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """What the class says, component by component."""
        joints, steps = self.action_joints, self.config.history
        sent = {"command": ("ahead", "left", "turn"), "angle": joints, "rate": joints, "action": joints}
        proprioception = mdp.component_names(turning=3, down=3, **sent, **self.clock_names)
        if self.config.obs is VelocityObs.HISTORY:
            return {"policy": [f"{name} {age} steps ago" for age in range(steps) for name in proprioception]}
        around = self.config.scan.names() if self.config.obs is VelocityObs.SCAN else []
        return {"policy": [*mdp.component_names(velocity=3), *proprioception, *around]}

    def setup(self) -> None:
        """Allocate commands, errors, and earlier observations, the newest first."""
        super().setup()
        config, worlds, device = self.config, self.num_worlds, self.device
        self.weights = config.reward_weights()
        self.most = torch.tensor([config.max_speed, config.max_sideways, config.max_turn], device=device)
        self.command, self.heading = torch.zeros(worlds, 3, device=device), torch.zeros(worlds, device=device)
        self.errors, self.error_sums = torch.zeros(worlds, 2, device=device), torch.zeros(worlds, 2, device=device)
        self.past = torch.zeros(worlds, config.history - 1, self.proprioception().shape[1], device=device)

    def begin_step(self) -> None:
        """Add the errors of the step before; remember the proprioception."""
        self.error_sums.add_(self.errors)
        if self.config.history > 1:
            self.past.copy_(torch.cat([self.proprioception().unsqueeze(1), self.past[:, :-1]], dim=1))
        super().begin_step()

    def proprioception(self) -> torch.Tensor:
        """Return (W, 9 + 3 J) what the robot measures of itself, and the command."""
        turning, down = mdp.base_ang_vel(self.views, self.body), mdp.projected_gravity(self.views, self.body)
        return torch.cat([turning, down, self.command, self.angles, self.rates, self.action, *self.clock()], dim=1)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``."""
        return self.observations_of(self.config.obs.value)

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor]:
        """Return ``policy`` of other observations: for teachers."""
        if obs == VelocityObs.HISTORY.value:
            return {"policy": torch.cat([self.proprioception(), self.past.flatten(1)], dim=1)}
        exact = [mdp.base_lin_vel(self.views, self.body), self.proprioception()]
        return {"policy": torch.cat([*exact, self.heights()] if obs == VelocityObs.SCAN.value else exact, dim=1)}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the terms; weights are per second, but for that of a fall."""
        lin_vel, ang_vel = mdp.base_lin_vel(self.views, self.body), mdp.base_ang_vel(self.views, self.body)
        speed_error = mdp.lin_vel_xy_error(lin_vel, self.command)
        turn_error = mdp.ang_vel_z_error(ang_vel, self.command)
        self.errors.copy_(torch.stack((speed_error, turn_error), dim=1))
        self.ground.record(lin_vel[:, :2], self.command[:, :2])
        period, moving = self.config.control_dt, mdp.is_moving(self.command)
        terms = {
            "speed": mdp.track_exp(speed_error, 0.5 * self.config.max_speed),
            "turn": mdp.track_exp(turn_error, 0.5 * self.config.max_turn),
            "lin_vel_z_l2": mdp.lin_vel_z_l2(lin_vel),
            "ang_vel_xy_l2": mdp.ang_vel_xy_l2(ang_vel),
            "flat_orientation_l2": mdp.flat_orientation_l2(mdp.projected_gravity(self.views, self.body)),
            "joint_deviation_l2": mdp.joint_l2(self.angles),
            "joint_acc_l2": mdp.joint_acc_l2(self.rates, self.rates_before, period),
            "action_rate_l2": mdp.action_rate_l2(self.action, self.before),
            "feet_air_time": mdp.feet_air_time(*self.on_feet.phases, moving, least=0.1, longest=0.3),
            "feet_slide": mdp.feet_slide(self.on_feet.velocity(), self.on_feet.touching),
        }
        terms |= self.gait_terms(moving)
        weighted = {name: period * (self.weights[name] * term) for name, term in terms.items()}
        return {**weighted, "fall": self.weights["fall"] * self.terminations()["fell"]}

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
        due = mdp.resample_command(self.command, *draws, every=every, most=self.most, standing=config.standing)
        if config.heading:
            mdp.resample_heading(self.heading, self.random, due)
            rotation = self.views.body_q[:, self.body, 3:]
            self.command[:, 2] = mdp.heading_to_ang_vel(rotation, self.heading, gain=1.0, most=config.max_turn)
        for buffer in (self.errors, self.error_sums):
            buffer.masked_fill_(world_mask.unsqueeze(1), 0.0)
        self.past.copy_(torch.where(world_mask.view(-1, 1, 1), self.proprioception().unsqueeze(1), self.past))

    def commands(self) -> dict[str, Command]:
        """Return speeds ahead and to the left [m/s], and the turn [rad/s]."""
        named = zip(("ahead", "left", "turn"), self.command.unbind(1), self.most.tolist(), strict=True)
        return {name: Command(values, -most, most) for name, values, most in named}
