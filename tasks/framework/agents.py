"""Several agents in a world: who is done, and rests until the others are.

A task of N agents says (W, N, ...) where one of a single agent says (W, ...).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch

from simwarp.core.interop import TensorLaunch

from .argument_checks import whole
from .control_step_kernels import rest_agents, wake_agents
from .errors import InputError

MOST_AGENTS = 256
"""Agents of a world, at most."""


class Worlds(Protocol):
    """Interface of a batch of worlds, with agents: see `Task`."""

    @property
    def name(self) -> str:
        """Of the task."""
        ...

    @property
    def num_worlds(self) -> int:
        """W."""
        ...

    @property
    def device(self) -> torch.device:
        """Of its tensors."""
        ...

    @property
    def agents(self) -> int:
        """N, agents of a world."""
        ...

    @property
    def action_size(self) -> int:
        """Numbers of an agent's action."""
        ...

    @property
    def resting_action(self) -> float | Sequence[float]:
        """What an agent that is done asks for."""
        ...


def lead_of(task: Any) -> tuple[int, ...]:
    """Return the first dimensions of a task's tensors: (W,), and (W, N) where a world has several agents."""
    return (task.num_worlds,) if task.agents == 1 else (task.num_worlds, task.agents)


def beside(parts: Sequence[torch.Tensor], out: torch.Tensor | None) -> torch.Tensor:
    """Return what each of N agents has, (W, ...), as (W, N, ...) in ``out``; of a single agent what it has."""
    return parts[0] if out is None else torch.stack(list(parts), dim=1, out=out)


class Agents:
    """Agents of a batch of worlds: which are done.

    Args:
        task: the task.
        device: of the tensors.

    Attributes:
        count: N.
        several: there are more than one.
        done: (W, N) bool, agents whose episode is over while that of others in their world goes on.
        acting: (W, N) bool, agents that were not done when the last step began; a learner looks at these alone.

    Raises:
        InputError: their number, or what they do at rest, is wrong.
    """

    def __init__(self, task: Worlds, device: torch.device) -> None:
        self.count = whole(f"task '{task.name}': agents", task.agents, 1, MOST_AGENTS)
        self.several = self.count > 1
        shape = (task.num_worlds, self.count)
        self.done = torch.zeros(shape, dtype=torch.bool, device=device)
        self.acting = torch.ones(shape, dtype=torch.bool, device=device)
        self._resting = self._make_resting(task, device)
        every = torch.ones(task.num_worlds, dtype=torch.bool, device=device)
        self._wake = TensorLaunch(wake_agents, shape, [every, self.done], device)

    def bind(self, asked: torch.Tensor) -> None:
        """Say where the actions asked for are, (W, N * A)."""
        arguments = [self._resting, self.done, asked]
        self._rest = TensorLaunch(rest_agents, tuple(self.done.shape), arguments, asked.device)

    @staticmethod
    def _make_resting(task: Worlds, device: torch.device) -> torch.Tensor:
        action, size = task.resting_action, task.action_size
        values = list(action) if isinstance(action, Sequence) else [action] * size
        if len(values) != size or not all(-1.0 <= float(value) <= 1.0 for value in values):
            raise InputError(
                f"task '{task.name}': resting_action must be {size} numbers in [-1, 1], one per component, got {action}"
            )
        return torch.tensor(values, dtype=torch.float32, device=device)

    def rest(self) -> None:
        """Write what those that are done do into the actions asked for."""
        if self.several:
            self._rest.launch()

    def begin(self, mask: torch.Tensor) -> None:
        """Begin an episode in the worlds of a mask (W,) bool: nobody is done."""
        if self.several:
            self._wake.on(mask)

    def state(self) -> dict[str, torch.Tensor]:
        """Return what a checkpoint keeps: nothing of single agents."""
        return {"agents done": self.done.clone()} if self.several else {}

    def load(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take back what `state` returned.

        Raises:
            InputError: it was saved with another number of agents.
        """
        if not self.several:
            return
        saved = state.get("agents done")
        if saved is None or saved.shape != self.done.shape:
            told = "one agent" if saved is None else f"{saved.shape[-1]} agents"
            raise InputError(f"saved state has {told} in each world, the task has {self.count}")
        self.done.copy_(saved)
