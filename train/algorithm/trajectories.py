"""Recorded trajectories: whole episodes of a policy in one ``.npz`` file.

Rows are control steps, episode after episode: ``observations/GROUP`` (N, ...) in the group's own dtype, ``actions``
(N, A) in [-1, 1], ``rewards`` (N,), ``episode`` (N,) counting from 0, ``terminated`` and ``truncated`` (N,) in the last
row of an episode; ``about`` is JSON: task, its configuration, the policy, mean return.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch

from simwarp.core.files import parse_json
from simwarp.core.object_repr import ReadableFields
from simwarp.core.stopping import StopRequest
from simwarp.core.types import formatted
from simwarp.tasks import InputError, Task, config_to_plain
from simwarp.tasks.framework.agent_rows import refuse_agents
from simwarp.tasks.framework.npz import Arrays, read_arrays, text_of, write_arrays

from ..networks.policies import Policy, bad_actions, refuse_bad_actions, reset_memory

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
_CHECK_INTERVAL = 25


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


def record(
    task: Task[Any], policy: Policy, episodes: int, seed: int, about: dict[str, Any],
    stop: StopRequest | None = None, report: Callable[[int], None] = lambda ended: None,
) -> Trajectories:  # fmt: skip
    """Let a policy act for exactly ``episodes`` whole episodes: the first ones of each world.

    Args:
        task: the worlds.
        policy: policy that acts.
        episodes: number of episodes.
        seed: seed of the worlds.
        about: metadata to keep beside the task and the returns.
        stop: request to leave with the episodes that have ended by then.
        report: called now and then with the number of episodes that have ended.

    Raises:
        TrainingError: the policy returned NaN or infinity.
        KeyboardInterrupt: it was asked to stop before an episode had ended.
    """
    stop = stop or StopRequest()
    if episodes < 1:
        raise InputError(f"episodes must be at least 1, got {episodes}")
    refuse_agents(task, "and trajectories are of one", "record a task of single agents")
    task.keep_final_observations = False
    worlds = task.num_worlds
    quota = torch.full((worlds,), episodes // worlds, device=task.device)
    quota[: episodes % worlds] += 1
    done = torch.zeros_like(quota)
    observations = task.restart(seed=seed)
    reset_memory(policy)
    rows: list[dict[str, torch.Tensor]] = []
    bad = torch.zeros((), dtype=torch.int64, device=task.device)
    while not stop.requested:
        if len(rows) % _CHECK_INTERVAL == 0:
            ended = int(torch.minimum(done, quota).sum())
            report(ended)
            if ended == episodes:
                break
        actions = policy(observations)
        bad += bad_actions(actions)
        actions = actions.clamp(-1.0, 1.0)
        # A task may hand out its own buffers, which the step overwrites
        row = {f"{_PREFIX}{name}": group.to("cpu", copy=True) for name, group in observations.items()}
        row |= {"actions": actions.to("cpu", copy=True), "episode": done.to("cpu", copy=True)}
        result = task.step(actions)
        observations = result.observations
        over = result.terminated | result.truncated
        reset_memory(policy, over)
        done += over
        row |= {"rewards": result.rewards.cpu(), "terminated": result.terminated.cpu()}
        rows.append(row | {"truncated": result.truncated.cpu()})
    quota = torch.minimum(quota, done)
    if not bool(quota.any()):
        raise KeyboardInterrupt
    refuse_bad_actions(bad, len(rows) * worlds)
    task.drain_statistics()
    return _in_order(task, rows, quota.cpu(), about)


def _in_order(
    task: Task[Any], rows: list[dict[str, torch.Tensor]], quota: torch.Tensor, about: dict[str, Any]
) -> Trajectories:
    """Return the rows world by world, without what came after a world's last episode."""
    table = {name: torch.stack([row[name] for row in rows], dim=1) for name in rows[0]}  # (W, T, ...)
    kept = table["episode"] < quota.unsqueeze(1)
    # Numbers within a world become numbers over all: those of the worlds before it come first
    table["episode"] += (quota.cumsum(0) - quota).unsqueeze(1)
    flat = {name: column[kept].numpy() for name, column in table.items()}
    trajectories = Trajectories(
        observations={name.removeprefix(_PREFIX): flat[name] for name in flat if name.startswith(_PREFIX)},
        about={"format": FORMAT, "task": task.name, "task_config": config_to_plain(task.config), **about},
        **{name: flat[name] for name in _COLUMNS},
    )
    returns = trajectories.returns()
    trajectories.about.update(mean_return=float(returns.mean()), episodes=trajectories.episodes)
    return trajectories


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


def load_trajectories(path: Path, task_name: str) -> Trajectories:
    """Read trajectories of a task; runs no code from the file.

    Raises:
        FileError: the file is missing, damaged, or no file of arrays.
        InputError: it is of another kind or of another task, or its columns are not what they should be.
    """
    where = f"trajectories '{path}'"
    arrays = read_arrays(path, "file of trajectories")
    about = parse_json(text_of(arrays, "about") or "null", f"{where}: about")
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise InputError(f"{where}: 'about' names no format {FORMAT}; write some with `simwarp record {task_name}`")
    if about.get("task") != task_name:
        raise InputError(f"{where} are of task {formatted(about.get('task'))}, not '{task_name}'")
    if not isinstance(about.get("task_config"), dict):
        raise InputError(f"{where}: 'about' names no task_config, the configuration of the task")
    groups = {name.removeprefix(_PREFIX): array for name, array in arrays.items() if name.startswith(_PREFIX)}
    if not groups:
        raise InputError(f"{where} hold no '{_PREFIX}GROUP'")
    columns = {name: _column(arrays, name, where) for name in _COLUMNS}
    lengths = {name: len(array) if array.ndim else 0 for name, array in (columns | groups).items()}
    if set(lengths.values()) != {len(columns["actions"])} or not len(columns["actions"]):
        raise InputError(f"{where}: all columns must have as many rows, at least one, got {formatted(lengths)}")
    for name, array in (columns | groups).items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InputError(f"{where} hold NaN or infinity in '{name}'; leave such episodes away")
    _check_values(columns, where)
    return Trajectories(observations=groups, about=about, **columns)


def _column(arrays: Arrays, name: str, where: str) -> npt.NDArray[Any]:
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
