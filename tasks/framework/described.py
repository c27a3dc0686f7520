"""What a task may tell of itself beside what it does: names that plots, panels and exported policies show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from simwarp.core.types import shown

from .command import Command
from .errors import TaskError
from .mirror import Mirror
from .statistics import EpisodeStatistics


class Described:
    """Names of a task's observations, actions, rewards and ends, and where the task comes from."""

    _statistics: EpisodeStatistics

    name: ClassVar[str] = ""
    """Set by ``@register``; until then that of the class."""
    task_file: ClassVar[str] = ""
    """Absolute ``path/to/file.py:TaskClass`` of a task that is not installed; set when it is loaded."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "name" not in vars(cls):
            cls.name = cls.__name__

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

    @property
    def reward_terms(self) -> list[str]:
        """Names of the reward terms."""
        return self._statistics.terms

    @property
    def end_reasons(self) -> list[str]:
        """Names of the reasons an episode ends for; ``StepResult.end_reason`` indexes them."""
        return self._statistics.reasons

    def mirror(self) -> Mirror | None:
        """Return what left-right reflection makes of observations and actions; None where there is no such symmetry.

        Asked for by ``--ppo.symmetry``. Optional.
        """
        return None


def check_described(task: Any) -> None:
    """Hold what a task tells of itself to its form.

    Raises:
        TaskError: names are not lists of words, as many as there are components, or commands are not `Command`.
    """
    if task.action_size < 1:
        raise _wrong(task, "action_size", "at least 1; one that nothing reads, where nothing is done", task.action_size)
    groups: Mapping[str, tuple[int, ...]] = task.observation_shapes
    told = _mapping(task, "observation_names", task.observation_names, "of groups to lists of names")
    for group, names in told.items():
        shape = groups.get(group)
        if shape is None or len(shape) != 1:
            rows = sorted(name for name, own in groups.items() if len(own) == 1)
            raise _wrong(task, "observation_names", f"of groups that are rows of numbers ({', '.join(rows)})", group)
        _words(task, f"observation_names of '{group}'", names, shape[0])
    _words(task, "action_names", task.action_names, task.action_size)
    _words(task, "action_joints", task.action_joints, task.action_size)
    for name in ("action_scale", "default_positions"):
        scales = getattr(task, name)
        if len(scales) not in (0, task.action_size):
            raise _wrong(task, name, f"{task.action_size} numbers, one per component of an action", scales)
    for name, command in _mapping(task, "commands()", task.commands(), "of names to Command").items():
        if not isinstance(command, Command):
            raise _wrong(task, f"commands() of '{name}'", "a Command(values, low, high)", command)


def _mapping(task: Any, name: str, value: Any, rule: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _wrong(task, name, f"a dict {rule}", value)
    return value


def _words(task: Any, name: str, words: Any, count: int) -> None:
    if isinstance(words, str) or not all(isinstance(word, str) for word in words):
        raise _wrong(task, name, "a list of names", words)
    if len(words) not in (0, count):
        raise TaskError(f"task '{task.name}': {name} must be {count} names, one per component, got {len(words)}")


def _wrong(task: Any, name: str, rule: str, value: Any) -> TaskError:
    return TaskError(f"task '{task.name}': {name} must be {rule}, got {shown(value)}")
