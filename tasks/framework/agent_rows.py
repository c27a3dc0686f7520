"""Worlds of several agents as rows of one agent each, for runners that know nothing of agents."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch

from .errors import InputError, TaskError
from .step_result import StepResult

if TYPE_CHECKING:
    from .task import Task


def refuse_agents(task: Task[Any], who: str, remedy: str) -> None:
    """Refuse a task with several agents for a runner that knows of one in each world alone.

    Raises:
        InputError: it has several.
    """
    if task.agents > 1:
        raise InputError(f"task '{task.name}' has {task.agents} agents in each world, {who}; {remedy}")


class Rows:
    """A task as a batch of W * N rows of one agent each; of single agents, the task as it is.

    A row whose agent is done before the others of its world is in the batch until the world begins anew: `acting` of
    the results is false there, rewards are 0, and what is asked for is not done.

    Args:
        task: the task.
    """

    def __init__(self, task: Task[Any]) -> None:
        self.task = task
        self.count = task.num_worlds * task.agents

    def flat(self, groups: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Return values (W, N, ...) by name as (W * N, ...)."""
        if self.task.agents == 1:
            return dict(groups)
        return {name: value.flatten(0, 1) for name, value in groups.items()}

    def restart(self, seed: int | None = None) -> dict[str, torch.Tensor]:
        """Begin a new episode everywhere and return the observations, group name -> (W * N, ...)."""
        return self.flat(self.task.restart(seed=seed))

    def step(self, actions: torch.Tensor) -> StepResult:
        """Advance every world by one control step; ``actions`` and all of the result have W * N rows."""
        task = self.task
        if task.agents == 1:
            return task.step(actions)
        if tuple(actions.shape) != (self.count, task.action_size):
            wanted = (self.count, task.action_size)
            raise TaskError(f"task '{task.name}': rows of actions must be {wanted}, got {tuple(actions.shape)}")
        result = task.step(actions.view(task.num_worlds, task.agents, task.action_size))
        return flat_result(result)


def flat_result(result: StepResult) -> StepResult:
    """Return a result (W, N, ...) as one of W * N rows."""

    def flat(value: Any) -> Any:
        if isinstance(value, torch.Tensor):
            return value.flatten(0, 1)
        return None if value is None else {name: one.flatten(0, 1) for name, one in value.items()}

    return StepResult(**{field.name: flat(getattr(result, field.name)) for field in dataclasses.fields(result)})
