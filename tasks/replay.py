"""Repeats the steps that led to the dump of a broken world, in a simulation of that world alone."""

from __future__ import annotations

import dataclasses
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from .errors import InputError
from .guard import FORMAT
from .plain import config_from_plain
from .registry import make, task_class
from .simulation_access import pack_snapshot, unpack_snapshot
from .task import Task


@dataclasses.dataclass(frozen=True)
class ReplayReport:
    """What a replay showed.

    Attributes:
        task: name of the task.
        seed, world, episode: which episode of which world broke.
        episode_step: control step of the episode in which it broke, the first is 1.
        steps: control steps repeated.
        from_reset: from the beginning of the episode; else from a snapshot within it.
        reproduced: the physics broke down in the same step again.
        broke_at: repeated step after which it broke, the first is 1; None if it did not.
        largest_difference: of joint coordinates and rates from the recorded ones before the break [m, rad, per s].
        largest_rate: largest joint rate that was recorded before the break.
        largest_action: largest size of an action that was recorded; NaN where the policy itself was broken.
        problems: what the simulation says about the world at the end.
    """

    task: str
    seed: int
    world: int
    episode: int
    episode_step: int
    steps: int
    from_reset: bool
    reproduced: bool
    broke_at: int | None
    largest_difference: float
    largest_rate: float
    largest_action: float
    problems: list[str]


def replay(path: str | Path, *, device: str = "cpu") -> ReplayReport:
    """Repeat the recorded steps of a dump that the guard of a task wrote.

    Raises:
        InputError: the file is no such dump, or its task is not installed.
    """
    path = Path(path)
    arrays = _read(path)
    meta: dict[str, Any] = json.loads(str(arrays["meta"]))
    task = _task_of(meta, device)
    if not meta["from_reset"]:
        _restore(task, arrays, meta)
    count = int(meta["replay_steps"])
    actions, recorded_q, recorded_qd = (arrays[name][-count:] for name in ("actions", "joint_q", "joint_qd"))
    difference, broke_at = 0.0, None
    for step in range(count):
        task.advance(torch.as_tensor(actions[step : step + 1], device=task.device))
        if bool(task.views.broken()[0]):
            broke_at = step + 1
            break
        if step + 1 < count:
            q, qd = task.views.joint_q[0].cpu().numpy(), task.views.joint_qd[0].cpu().numpy()
            gaps = [np.abs(q - recorded_q[step]).max(initial=0.0), np.abs(qd - recorded_qd[step]).max(initial=0.0)]
            difference = max(difference, *(float(gap) for gap in gaps))
    return ReplayReport(
        task=str(meta["task"]),
        seed=int(meta["seed"]),
        world=int(meta["world"]),
        episode=int(meta["episode"]),
        episode_step=int(meta["episode_steps"]),
        steps=count,
        from_reset=bool(meta["from_reset"]),
        reproduced=broke_at == count,
        broke_at=broke_at,
        largest_difference=difference,
        largest_rate=float(np.abs(recorded_qd[:-1]).max(initial=0.0)),
        largest_action=float(np.abs(actions).max(initial=0.0)),
        problems=task.simulation.problems(),
    )


def _read(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot read '{path}': {error}") from None
    if "meta" not in arrays:
        raise InputError(f"'{path}' is no dump of a broken world")
    found = json.loads(str(arrays["meta"])).get("format")
    if found != FORMAT:
        raise InputError(f"'{path}' has format {found}, this version of simwarp reads {FORMAT}")
    return arrays


def _task_of(meta: dict[str, Any], device: str) -> Task[Any]:
    """Return the task with the one world of the dump, at the beginning of the episode that broke."""
    cls = task_class(str(meta["task"]))
    config = config_from_plain(cls.config_type, meta["config"] | {"guard_steps": 0})
    task = make(
        str(meta["task"]), 1, device=device, seed=int(meta["seed"]), config=config, first_world=int(meta["world"])
    )
    task.iteration = int(meta["iteration"])
    task.level.fill_(float(meta["level"]))
    task.episode_index.fill_(int(meta["episode"]) - 1)
    task.restart()
    return task


def _restore(task: Task[Any], arrays: dict[str, np.ndarray[Any, Any]], meta: dict[str, Any]) -> None:
    """Put the task into the snapshot of the dump."""
    packed = pack_snapshot(task.simulation.snapshot())
    saved = _nest(packed, arrays, "start/")
    task.simulation.restore(unpack_snapshot(saved, task.simulation.snapshot()))
    task.action.copy_(torch.as_tensor(arrays["start_action"]).to(task.device))
    done = int(meta["episode_steps"]) - int(meta["replay_steps"])
    task.episode_steps.fill_(done)
    task.episode_clock.fill_(done)
    extra = {name: value.clone() for name, value in task.extra_state().items()}
    for name, value in extra.items():
        if f"extra/{name}" in arrays:
            value[0] = torch.as_tensor(arrays[f"extra/{name}"]).to(value.device)
    task.load_extra_state(extra)


def _nest(like: dict[str, Any], arrays: dict[str, np.ndarray[Any, Any]], prefix: str) -> dict[str, Any]:
    """Return arrays with slashes in their names as the nested dictionary of a one-world snapshot."""
    nested: dict[str, Any] = {}
    for name, part in like.items():
        if not isinstance(part, torch.Tensor):
            nested[name] = _nest(part, arrays, f"{prefix}{name}/")
        elif prefix + name in arrays:
            nested[name] = torch.as_tensor(arrays[prefix + name][None])
    return nested
