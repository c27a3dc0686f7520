"""Time of an iteration by phase, from a sample: one control step of each rollout is timed in parts.

Timing every launch of every step would make a GPU wait for the host, so that training would be slower and the shares
would be others. The sampled step moves through the rollout from iteration to iteration.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import torch

from simwarp.simulation.step_program import Phase, timed_phases
from simwarp.tasks import Task

SIMULATE, SENSE, TASK, POLICY, LEARN = "simulate", "sense", "task", "policy", "learn"
"""Physics; cameras and other sensors; actions, rewards, observations and resets; networks that act; the optimiser."""


class UntimedStep:
    """A control step that is not timed."""

    def policy(self) -> contextlib.AbstractContextManager[None]:
        """Context of what networks do, and of what is stored for learning."""
        return contextlib.nullcontext()

    def worlds(self) -> contextlib.AbstractContextManager[None]:
        """Context of the step of the worlds."""
        return contextlib.nullcontext()


class TimedStep(UntimedStep):
    """A control step that is timed in parts.

    Args:
        task: the worlds.
    """

    def __init__(self, task: Task[Any]) -> None:
        self._task = task
        self._seconds = dict.fromkeys((SIMULATE, SENSE, TASK, POLICY), 0.0)

    def _now(self) -> float:
        """Return the time when the device is done [s]."""
        self._wait()
        return time.perf_counter()

    def _wait(self) -> None:
        if self._task.device.type == "cuda":
            torch.cuda.synchronize(self._task.device)

    @contextlib.contextmanager
    def policy(self) -> Iterator[None]:
        """Context of what networks do, and of what is stored for learning."""
        start = self._now()
        yield
        self._seconds[POLICY] += self._now() - start

    @contextlib.contextmanager
    def worlds(self) -> Iterator[None]:
        """Context of the step of the worlds, which must not be replayed from a graph: that has no parts."""
        tasks = [group.task for group in self._task.model_groups]
        captured = [task.capture for task in tasks]
        try:
            for task in tasks:
                task.capture = False
            with timed_phases(self._wait) as times:
                start = self._now()
                yield
                whole = self._now() - start
        finally:
            for task, capture in zip(tasks, captured, strict=True):
                task.capture = capture
        parts = {SIMULATE: times.seconds[Phase.PHYSICS], SENSE: times.seconds[Phase.SENSORS]}
        self._seconds |= {**parts, TASK: max(0.0, whole - sum(parts.values()))}

    def shares(self) -> dict[str, float]:
        """Return the shares of the phases in the time of a rollout; together 1."""
        whole = sum(self._seconds.values())
        return {name: seconds / whole for name, seconds in self._seconds.items()}


UNTIMED = UntimedStep()
