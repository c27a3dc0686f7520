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

    @property
    def action_joints(self) -> Sequence[str]:
        """Names of the joints, of one coordinate each, that the components of an action move, in their order."""
        return ()

    @property
    def action_scale(self) -> Sequence[float]:
        """What a full action is, component by component [N·m, rad, m, as the task says]; empty where it has no unit."""
        return ()

    @property
    def default_positions(self) -> Sequence[float]:
        """Coordinates of ``action_joints`` at rest, from which actions count [rad or m]; empty: as they are built."""
        return ()
