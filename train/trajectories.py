"""Recorded trajectories: whole episodes of a policy in one ``.npz`` file.

Rows are control steps, episode after episode: ``observations/GROUP`` (N, ...) in the group's own dtype, ``actions``
(N, A) in [-1, 1], ``rewards`` (N,), ``episode`` (N,) counting from 0, ``terminated`` and ``truncated`` (N,) in the last
row of an episode; ``about`` is JSON: task, its configuration, the policy, mean return.
"""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from simwarp.tasks import InputError, Task, config_to_plain

from .checkpoint import write_atomically
from .policies import Policy, forget

FORMAT = 1
_PREFIX = "observations/"
_COLUMNS = ("actions", "rewards", "episode", "terminated", "truncated")
_CHECK_INTERVAL = 25


@dataclasses.dataclass(frozen=True)
class Trajectories:
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
        """Return the summed rewards of each episode."""
        sums = np.bincount(self.episode, weights=self.rewards, minlength=self.episodes)
        return sums.astype(np.float64)


def record(task: Task[Any], policy: Policy, episodes: int, seed: int, about: dict[str, Any]) -> Trajectories:
    """Let a policy act for exactly ``episodes`` whole episodes: the first ones of each world.

    Args:
        task: the worlds.
        policy: who acts.
        episodes: how many episodes.
        seed: seed of the worlds.
        about: what to remember beside the task and the returns.
    """
    if episodes < 1:
        raise InputError(f"episodes must be at least 1, got {episodes}")
    task.keep_final_observations = False
    worlds = task.num_worlds
    quota = torch.full((worlds,), episodes // worlds, device=task.device)
    quota[: episodes % worlds] += 1
    done = torch.zeros_like(quota)
    observations = task.restart(seed=seed)
    forget(policy)
    rows: list[dict[str, torch.Tensor]] = []
    while len(rows) % _CHECK_INTERVAL or not bool((done >= quota).all()):
        actions = policy(observations).clamp(-1.0, 1.0)
        # A task may hand out its own buffers, which the step overwrites
        row = {f"{_PREFIX}{name}": group.to("cpu", copy=True) for name, group in observations.items()}
        row |= {"actions": actions.to("cpu", copy=True), "episode": done.to("cpu", copy=True)}
        result = task.step(actions)
        observations = result.observations
        ended = result.terminated | result.truncated
        forget(policy, ended)
        done += ended
        row |= {"rewards": result.rewards.cpu(), "terminated": result.terminated.cpu()}
        rows.append(row | {"truncated": result.truncated.cpu()})
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
    """Write a compressed ``.npz``, all at once."""
    arrays: dict[str, Any] = {f"{_PREFIX}{name}": group for name, group in trajectories.observations.items()}
    arrays |= {name: getattr(trajectories, name) for name in _COLUMNS}
    arrays["about"] = np.array(json.dumps(trajectories.about, default=str))
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    try:
        write_atomically(path, buffer.getvalue())
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}") from error


def load_trajectories(path: Path, task_name: str) -> Trajectories:
    """Read trajectories of a task; runs no code from the file.

    Raises:
        InputError: the file is missing, damaged, of another kind or of another task.
    """
    if not path.is_file():
        raise InputError(f"trajectories {path} do not exist: write some with `simwarp record {task_name}`")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about = json.loads(str(arrays["about"]))
        columns: dict[str, Any] = {name: arrays[name] for name in _COLUMNS}
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is no file of trajectories, or a damaged one") from error
    groups = {name.removeprefix(_PREFIX): array for name, array in arrays.items() if name.startswith(_PREFIX)}
    if not isinstance(about, dict) or about.get("format") != FORMAT or not groups:
        raise InputError(f"{path} holds no trajectories that this simwarp reads")
    if about.get("task") != task_name:
        raise InputError(f"trajectories {path} are of task '{about.get('task')}', not '{task_name}'")
    lengths = {len(array) for array in (*groups.values(), *columns.values())}
    if len(lengths) != 1 or lengths == {0}:
        raise InputError(f"{path} is damaged: its columns have {sorted(lengths)} rows")
    return Trajectories(observations=groups, about=about, **columns)
