"""The level of a curriculum: set from outside, or moved by the iterations of a training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from simwarp.core.types import shown

from ..randomisation.uncertainty import Driver
from .errors import InputError


class Levelled:
    """Level of difficulty of a task, in every world; see :class:`~simwarp.tasks.Task` for the attributes."""

    config: Any
    num_worlds: int
    level: torch.Tensor
    iteration: int
    _climbing: bool

    def _climb(self, climbing: bool) -> None:
        raise NotImplementedError

    def on_iteration(self, iteration: int) -> Mapping[str, torch.Tensor] | None:
        """Hook of a curriculum, at the start of a training iteration: call ``super()``, return (W,) to log means of."""
        self.iteration = iteration
        curriculum = self.config.curriculum
        if curriculum.driver is Driver.ITERATION:
            self.level.fill_(curriculum.at_iteration(iteration))
        elif curriculum.driver is Driver.PROGRESS and not self._climbing:
            self._climb(True)
            self.level.zero_()
        return None if curriculum.driver is Driver.NONE else {"level": self.level}

    def set_level(self, level: float | torch.Tensor) -> None:
        """Hold the curriculum's level from here on: episodes that begin draw by it, and no success moves it.

        Args:
            level: dimensionless, in [0, 1], of all worlds; or (W,) of each.

        Raises:
            InputError: it is none.
        """
        values = checked_level("level", level, self.num_worlds)
        self._climb(False)
        self.level.copy_(values)


def checked_level(what: str, level: Any, worlds: int = 0) -> torch.Tensor:
    """Return a level, one number or (W,), as float32.

    Args:
        what: it is called in errors.
        level: as it was given.
        worlds: number that (W,) stands for; 0 where only one number will do.

    Raises:
        InputError: it is no number in [0, 1], or there are too many or too few.
    """
    rule = "a number in [0, 1]" + (f", or {worlds} of them" if worlds else "")
    try:
        values = torch.as_tensor(level).to(torch.float32)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"{what} must be {rule}, got {shown(level)}") from None
    fits = values.dim() == 0 or tuple(values.shape) == (worlds,)
    if not fits or isinstance(level, bool) or not bool(((values >= 0.0) & (values <= 1.0)).all()):
        raise InputError(f"{what} must be {rule}, got {shown(level)}")
    return values
