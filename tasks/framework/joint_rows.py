"""Tensors of all worlds of a mixed batch, of which the task of each model has its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch


class JointRows:
    """The rows of one model in tensors of all worlds: views, so that nothing is copied to join them.

    Args:
        tensors: of all worlds, name -> (W, ...); those that are missing are made.
        rows: of the model.
        worlds: number of all worlds W.
    """

    def __init__(self, tensors: dict[str, torch.Tensor], rows: slice, worlds: int) -> None:
        self._tensors, self._rows, self._worlds = tensors, rows, worlds

    def like(self, name: str, made: torch.Tensor) -> torch.Tensor:
        """Return the model's rows of a tensor, with the values of ``made``.

        Args:
            name: of the tensor.
            made: (count, ...), the model's alone.
        """
        whole = self._tensors.setdefault(name, made.new_zeros(self._worlds, *made.shape[1:]))
        return whole[self._rows].copy_(made)


def joined(parts: Sequence[Any]) -> Any:
    """Return values of the models, (count, ...) each, as one of all worlds (W, ...): tensors, and mappings of them.

    None of all is None.
    """
    first = parts[0]
    if first is None:
        return None
    if isinstance(first, Mapping):
        return {name: joined([part[name] for part in parts]) for name in first}
    return torch.cat(list(parts))
