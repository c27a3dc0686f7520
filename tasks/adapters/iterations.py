"""Iterations of a training that another library runs: they move the level of a task's curriculum."""

from __future__ import annotations

from typing import Any

from ..framework.argument_checks import whole
from ..framework.errors import InputError
from ..framework.task import Task


class Iterations:
    """Counter of control steps, which begins an iteration of the task every so many of them.

    Args:
        task: whose curriculum it is.
        level: held from the start on; None: not.
        steps: control steps of an iteration; None: none begins.

    Raises:
        InputError: one is wrong, or both are given.
    """

    def __init__(self, task: Task[Any], level: Any, steps: int | None) -> None:
        self._task = task
        self._steps = None if steps is None else whole("steps_per_iteration", steps, 1, 2**31 - 1)
        self._count = 0
        if level is not None:
            if steps is not None:
                raise InputError("level holds the curriculum, and steps_per_iteration moves it: give one of them")
            task.set_level(level)
        self._begin()  # the first episodes are as easy as a curriculum begins

    def _begin(self) -> None:
        if self._steps is not None and self._count % self._steps == 0:
            self._task.contract.on_iteration(self._count // self._steps)

    def advance(self) -> None:
        """Note that a control step follows."""
        if self._count:
            self._begin()
        self._count += 1

    def hold(self, level: Any) -> None:
        """Hold a level; no iteration moves it any more."""
        self._task.set_level(level)
        self._steps = None
