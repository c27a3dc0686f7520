"""Recordings of a task for tools of ROS 2 while a policy acts: `--record` of `simwarp play` and `simwarp eval`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from simwarp.cli import UsageError
from simwarp.mcap import Writer
from simwarp.tasks import Task
from simwarp.train.networks.policies import Policy


class TaskRecord:
    """Records a world of a task once per control step, with the actions of a policy as commands.

    Args:
        path: of the file.
        world: which one.

    Attributes:
        path: of the file.
    """

    def __init__(self, path: Path, world: int = 0) -> None:
        self.path = path
        self._world = world
        self._writer: Writer | None = None
        self._closed = False

    def beside(self, task: Task[Any], policy: Policy) -> Policy:
        """The policy, which is recorded with the state that it acts in.

        Raises:
            UsageError: the task has no bodies.
        """
        group = task.model_groups[0]
        if group.task.simulation is None:
            raise UsageError(f"--record: task '{task.name}' has no bodies to record; make a --video of it")
        return _RecordedPolicy(policy, task, self._record)

    def recorded(self, make: Callable[[Task[Any]], Policy]) -> Callable[[Task[Any]], Policy]:
        """What makes a policy, which is recorded."""
        return lambda task: self.beside(task, make(task))

    def render(self, index: int, count: int, time: float) -> None:
        """Frames of a film: there is nothing more in them."""

    def write(self) -> None:
        """Ends the file with the present state."""
        if self._writer is not None and not self._closed:
            self._writer.add()
        self.close()

    def close(self) -> None:
        """Ends the file as it is; a second call does nothing."""
        self._closed = True
        if self._writer is not None:
            self._writer.close()

    def _record(self, task: Task[Any], actions: torch.Tensor) -> None:
        """Records the present state, and what is done in it."""
        if self._closed:
            return
        if self._writer is None:
            # Not before: worlds are reset when episodes begin
            simulation: Any = task.model_groups[0].task.simulation
            self._writer = Writer(self.path, simulation, world=self._world)
        values = actions[self._world * task.agents].tolist()
        names = getattr(task, "action_names", None) or [f"action_{number}" for number in range(len(values))]
        self._writer.add(dict(zip(names, values, strict=True)))


class _RecordedPolicy:
    """A policy, its memory included, that tells what it does."""

    def __init__(self, policy: Policy, task: Task[Any], record: Callable[[Task[Any], torch.Tensor], None]) -> None:
        self._policy, self._task, self._record = policy, task, record

    def __call__(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        actions = self._policy(observations)
        self._record(self._task, actions)
        return actions

    def __getattr__(self, name: str) -> Any:
        return getattr(self._policy, name)
