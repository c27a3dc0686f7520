"""Recorded trajectories: whole episodes of a policy in one ``.npz`` file.

Rows are control steps, episode after episode: ``observations/GROUP`` (N, ...) in the group's own dtype, ``actions``
(N, A) in [-1, 1], ``rewards`` (N,), ``episode`` (N,) counting from 0, ``terminated`` and ``truncated`` (N,) in the last
row of an episode; ``about`` is JSON: task, its configuration, the policy, mean return.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.files import parse_json
from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import formatted
from simwarp.tasks import InputError
from simwarp.tasks.framework.npz import Arrays, read_arrays, text_of, write_arrays

FORMAT = 1
_PREFIX = "observations/"
_COLUMNS: Final[Mapping[str, tuple[type[np.generic], int]]] = {
    "actions": (np.float32, 2),
    "rewards": (np.float32, 1),
    "episode": (np.int64, 1),
    "terminated": (np.bool_, 1),
    "truncated": (np.bool_, 1),
}
"""Column -> its dtype and number of axes."""


@dataclasses.dataclass(frozen=True)
class Trajectories(ReadableFields):
    """Episodes, one after the other.

    Attributes:
        observations: group -> (N, ...).
        actions: (N, A) float32.
        rewards: (N,) float32.
        episode: (N,) int64, number of the episode of each row.
        terminated: (N,) bool.
        truncated: (N,) bool.
        about: task, configuration, policy, returns.
    """

    observations: dict[str, npt.NDArray[Any]]
    actions: npt.NDArray[np.float32]
    rewards: npt.NDArray[np.float32]
    episode: npt.NDArray[np.int64]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]
    about: dict[str, Any]

    @property
    def steps(self) -> int:
        """Number of rows."""
        return len(self.actions)

    @property
    def episodes(self) -> int:
        """Number of episodes."""
        return int(self.episode[-1]) + 1 if self.steps else 0

    def returns(self) -> npt.NDArray[np.float64]:
        """Return the summed rewards of each episode, (episodes,)."""
        sums = np.bincount(self.episode, weights=self.rewards, minlength=self.episodes)
        return sums.astype(np.float64)

    def add_totals(self) -> None:
        """Write the number of episodes and their mean return into what is known about them."""
        self.about.update(mean_return=float(self.returns().mean()), episodes=self.episodes)


def save_trajectories(path: Path, trajectories: Trajectories) -> None:
    """Write a compressed ``.npz``, all at once.

    Raises:
        FileError: ``path`` cannot be written to.
        OutputError: the disk did not take it.
    """
    arrays: dict[str, Any] = {f"{_PREFIX}{name}": group for name, group in trajectories.observations.items()}
    arrays |= {name: getattr(trajectories, name) for name in _COLUMNS}
    arrays["about"] = np.array(json.dumps(trajectories.about, default=str))
    write_arrays(path, arrays)


def read_npz(path: Path, task_name: str) -> Trajectories:
    """Read trajectories of a task from a file; runs no code from it.

    Raises:
        FileError: the file is missing, damaged, or no file of arrays.
        InputError: it is of another kind or of another task, or its columns are not what they should be.
    """
    where = f"trajectories '{path}'"
    arrays = read_arrays(path, "file of trajectories")
    about = checked_about(parse_json(text_of(arrays, "about") or "null", f"{where}: about"), task_name, where)
    groups = {name.removeprefix(_PREFIX): array for name, array in arrays.items() if name.startswith(_PREFIX)}
    if not groups:
        raise InputError(f"{where} hold no '{_PREFIX}GROUP'")
    return checked(groups, arrays, about, where)


def checked_about(about: Any, task_name: str, where: str) -> dict[str, Any]:
    """Return what is known about trajectories, if they are of a task.

    Args:
        about: any value.
        task_name: the task.
        where: names the file or the folder: the errors begin with it.

    Raises:
        InputError: it is of another kind or of another task.
    """
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise InputError(f"{where}: 'about' names no format {FORMAT}; write some with `simwarp record {task_name}`")
    if about.get("task") != task_name:
        raise InputError(f"{where} are of task {formatted(about.get('task'))}, not '{task_name}'")
    if not isinstance(about.get("task_config"), dict):
        raise InputError(f"{where}: 'about' names no task_config, the configuration of the task")
    return about


def checked(groups: Arrays, arrays: Mapping[str, npt.NDArray[Any]], about: dict[str, Any], where: str) -> Trajectories:
    """Return trajectories, held to their rules.

    Args:
        groups: observations.
        arrays: the columns, among others.
        about: what is known about them.
        where: names the file or the folder: the errors begin with it.

    Raises:
        InputError: columns are missing, or are not what they should be.
    """
    columns = {name: _column(arrays, name, where) for name in _COLUMNS}
    lengths = {name: len(array) if array.ndim else 0 for name, array in (columns | groups).items()}
    if set(lengths.values()) != {len(columns["actions"])} or not len(columns["actions"]):
        raise InputError(f"{where}: all columns must have as many rows, at least one, got {formatted(lengths)}")
    for name, array in (columns | groups).items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InputError(f"{where} hold NaN or infinity in '{name}'; leave such episodes away")
    _check_values(columns, where)
    return Trajectories(observations=groups, about=about, **columns)


def _column(arrays: Mapping[str, npt.NDArray[Any]], name: str, where: str) -> npt.NDArray[Any]:
    """Return a column, held to its number of axes and its dtype."""
    dtype, axes = _COLUMNS[name]
    found = arrays.get(name)
    if found is None:
        raise InputError(f"{where} have no column '{name}'")
    if found.ndim != axes or found.dtype != dtype:
        raise InputError(
            f"{where}: '{name}' must be {np.dtype(dtype)} with {axes} axes, got {found.dtype} of shape {found.shape}"
        )
    return found


def _check_values(columns: dict[str, npt.NDArray[Any]], where: str) -> None:
    """Check the range of actions, and the order of episode numbers."""
    actions, episode = columns["actions"], columns["episode"]
    if actions.size and float(np.abs(actions).max()) > 1.0:
        raise InputError(f"{where}: actions must lie in [-1, 1], got {float(np.abs(actions).max()):g}")
    steps = np.diff(episode, prepend=episode[:1])
    wrong = np.flatnonzero((steps != 0) & (steps != 1)) if episode[0] == 0 else np.zeros(1, np.int64)
    if len(wrong):
        row = int(wrong[0])
        raise InputError(
            f"{where}: episodes must be numbered 0, 1, 2, ... in order, got {int(episode[row])} in row {row}"
        )
