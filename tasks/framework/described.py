"""What a task may tell of itself beside what it does: names that plots, panels and exported policies show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar


class Described:
    """Names of a task's observations and actions, and where the task comes from. All of it is optional."""

    task_file: ClassVar[str] = ""
    """Absolute ``path/to/file.py:TaskClass`` of a task that is not installed; set when it is loaded."""

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """Names of the components of observation groups that are rows of numbers: group -> names, in their order."""
        return {}

    @property
    def action_names(self) -> Sequence[str]:
        """Names of the components of an action, in their order; empty where it has none."""
        return ()
