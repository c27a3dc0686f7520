"""A group of worlds that share a model, and the task that steps them."""

from __future__ import annotations

import dataclasses
from typing import Any


@dataclasses.dataclass(frozen=True, eq=False)
class ModelGroup:
    """Worlds of a task that have one model.

    Attributes:
        name: of the model; empty where it is the only one.
        task: the `Task` of these worlds alone.
        rows: their indices in the whole batch.
    """

    name: str
    task: Any
    rows: slice

    @property
    def count(self) -> int:
        """Number of the worlds."""
        return int(self.task.num_worlds)
