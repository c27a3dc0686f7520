"""What a person may ask of a running task."""

from __future__ import annotations

import dataclasses

import torch


@dataclasses.dataclass(frozen=True)
class Command:
    """A number that a task reads in every step.

    Attributes:
        values: (W,) float32, the task's own tensor: whoever writes into it commands.
        low, high: ends of the range.
    """

    values: torch.Tensor
    low: float
    high: float
