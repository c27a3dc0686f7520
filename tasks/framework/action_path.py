"""The path of an action: the policy's output is delayed, and the current action follows it at a limited rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from simwarp.core.interop import TensorLaunch

from ..randomisation.randomness import WorldRandom
from ..randomisation.sensing import DelayLine, WorldRows
from .config import TaskConfig
from .control_step_kernels import move_actions
from .errors import InputError


class ActionPath:
    """Actions of a batch of worlds.

    Args:
        action: (W, N * A) float32, the current actions of N agents; written here.
        config: of the task: rise times, delay and times of the steps.
        owner: name of the task, for errors.
        in_physics: the task has physics, and a rate-limited action moves in every step of it.
        agents: N, in each world.

    Attributes:
        asked: (W, N * A) float32, output of the policy in this control step.
        request: (W, N * A) float32, target of the action; without a delay the same memory as `asked`.
        limited: True if the rate of actions is limited.
        reach: (N * A,) largest change in one physics step; empty if no rate is limited.
    """

    def __init__(
        self, action: torch.Tensor, config: TaskConfig, owner: str, *, in_physics: bool, agents: int = 1
    ) -> None:  # fmt: skip
        self.action = action
        self.reach = self._make_reach(config, owner, agents)
        self.limited = len(self.reach) > 0
        self.asked = torch.zeros_like(action)
        delay = config.uncertainty.action_delay
        delayed = delay[1] > 0
        self._line = DelayLine(action, delay, "delay of actions", agents) if delayed else None
        self.request = torch.zeros_like(action) if delayed else self.asked
        steps = 1 if in_physics else config.decimation
        arguments = [float(steps), self.reach, self.request, action]
        self._move = TensorLaunch(move_actions, tuple(action.shape), arguments, action.device)

    def _make_reach(self, config: TaskConfig, owner: str, agents: int) -> torch.Tensor:
        size, times = self.action.shape[1] // agents, config.action_rise_time
        if isinstance(times, tuple) and len(times) != size:
            raise InputError(f"action-rise-time has {len(times)} values, task '{owner}' {size} actions")
        rise = torch.tensor(times, dtype=torch.float32, device=self.action.device).expand(size).repeat(agents)
        reach = torch.where(rise > 0.0, config.dt / rise, 2.0)
        return reach if bool((rise > 0.0).any()) else reach[:0]

    def delay(self) -> None:
        """Push the policy's output into the delay line, if there is one, and read the request from it."""
        if self._line is not None:
            self._line.push(self.asked.clamp_(-1.0, 1.0))
            self.request.copy_(self._line.read())

    def move(self) -> None:
        """Move the action towards the request for one physics step, or for the control step of a task without physics.

        Without a rate limit it becomes the request at once.
        """
        self._move.launch()

    def begin(self, mask: torch.Tensor, random: WorldRandom) -> None:
        """Begin an episode in the worlds of a mask (W,) bool: the action was at rest all along."""
        if self._line is not None:
            self._line.fill(mask, self.action, random)

    def take(self, other: ActionPath, copied: WorldRows) -> None:
        """Take over what worlds of another path, or of this one, ask for."""
        copied.into(self.asked, other.asked)
        copied.into(self.request, other.request)
        if self._line is not None and other._line is not None:
            self._line.take(other._line, copied)

    def state(self) -> dict[str, torch.Tensor]:
        """Return the state that a checkpoint keeps beside the action."""
        return self._line.state("action") if self._line is not None else {}

    def load(self, state: Mapping[str, Any]) -> None:
        """Take back what :meth:`state` returned."""
        if self._line is not None:
            self._line.load("action", state)
