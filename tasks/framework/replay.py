"""Repeats the steps that led to the dump of a broken world, in a simulation of that world alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch

from simwarp.core.files import parse_json
from simwarp.core.types import formatted

from .config_values import config_from_plain
from .errors import InputError
from .guard import FORMAT, DumpAbout
from .npz import Arrays, read_arrays, text_of
from .registry import make, task_class_of
from .saved_state import check_like
from .task import Task
from .task_simulation import pack_snapshot, unpack_snapshot

_LEVEL: Final = "level"
"""Array that older dumps do not have."""


@dataclasses.dataclass(frozen=True)
class ReplayReport:
    """Result of a replay.

    Attributes:
        task: name of the task.
        seed, world, episode: indices of the episode and of the world that broke.
        episode_step: control step of the episode in which it broke, the first is 1.
        steps: control steps repeated.
        from_reset: from the beginning of the episode; else from a snapshot within it.
        value: of the task that was not finite, such as ``reward 'speed'``; empty where the physics broke down.
        reproduced: the physics broke down in the same step again, or the value was not finite.
        broke_at: repeated step after which it broke, the first is 1; None if it did not.
        largest_difference: of joint coordinates and rates from the recorded ones before the break [m, rad, per s].
        largest_rate: largest joint rate that was recorded before the break.
        largest_action: largest size of an action that was recorded; NaN where the policy itself was broken.
        problems: problems that the simulation reports of the world at the end.
    """

    task: str
    seed: int
    world: int
    episode: int
    episode_step: int
    steps: int
    from_reset: bool
    value: str
    reproduced: bool
    broke_at: int | None
    largest_difference: float
    largest_rate: float
    largest_action: float
    problems: list[str]


class Rerun:
    """The recorded steps of a dump, to be taken again in a simulation of its world alone.

    Args:
        path: of the dump.
        device: canonical device name.

    Attributes:
        task: of one world.
        about: facts of the dump.
        actions: (steps, A) recorded.
        joint_q, joint_qd: (steps, dofs) recorded.
        level: (steps,) of the curriculum, recorded; that of the episode where an older dump does not tell.

    Raises:
        FileError: there is no such file, or it is damaged.
        InputError: it is no such dump, or its task is not installed.
    """

    def __init__(self, path: str | Path, *, device: str = "cpu") -> None:
        path = Path(path)
        self._arrays, self.about = _read(path)
        self._where = f"'{path}'"
        self.task = _task_of(self.about, device, self._where)
        _check_columns(self.task, self._arrays, self.about, self._where)
        count = self.about.replay_steps
        columns = (self._arrays[name][-count:] for name in ("actions", "joint_q", "joint_qd"))
        self.actions, self.joint_q, self.joint_qd = columns
        self.level = self._arrays[_LEVEL][-count:] if _LEVEL in self._arrays else np.full(count, self.about.level)
        self._begin()

    def restart(self) -> None:
        """Begin again at the first recorded step."""
        _start_episode(self.task, self.about)
        self._begin()

    def advance(self, step: int) -> bool:
        """Take a recorded step; True if the physics has broken down, or the value is not finite that was not then."""
        # What is drawn in every step opens with the level, which may move within an episode
        self.task.level.fill_(float(self.level[step]))
        self.task.advance(torch.as_tensor(self.actions[step : step + 1], device=self.task.device))
        return bool(self.task.views.broken()[0]) or (self.about.value != "" and self._is_bad())

    def _is_bad(self) -> bool:
        """Whether the value that was not finite then is not finite now."""
        contract = self.task.contract
        kinds = {"reward": contract.rewards(), "observation": contract.observations()}
        named = {f"{kind} '{name}'": value for kind, values in kinds.items() for name, value in values.items()}
        value = named.get(self.about.value)
        return value is not None and not bool(value.isfinite().all())

    def _begin(self) -> None:
        if not self.about.from_reset:
            _restore(self.task, self._arrays, self.about, self._where)


def replay(path: str | Path, *, device: str = "cpu") -> ReplayReport:
    """Repeat the recorded steps of a dump that the guard of a task wrote.

    Raises:
        FileError: there is no such file, or it is damaged.
        InputError: it is no such dump, or its task is not installed.
    """
    rerun = Rerun(path, device=device)
    task, about, count = rerun.task, rerun.about, rerun.about.replay_steps
    difference, broke_at = 0.0, None
    for step in range(count):
        if rerun.advance(step):
            broke_at = step + 1
            break
        if step + 1 < count:
            q, qd = task.views.joint_q[0].cpu().numpy(), task.views.joint_qd[0].cpu().numpy()
            gaps = [
                np.abs(q - rerun.joint_q[step]).max(initial=0.0),
                np.abs(qd - rerun.joint_qd[step]).max(initial=0.0),
            ]
            difference = max(difference, *(float(gap) for gap in gaps))
    return ReplayReport(
        task=about.task,
        seed=about.seed,
        world=about.world,
        episode=about.episode,
        episode_step=about.episode_steps,
        steps=count,
        from_reset=about.from_reset,
        value=about.value,
        reproduced=broke_at == count,
        broke_at=broke_at,
        largest_difference=difference,
        largest_rate=float(np.abs(rerun.joint_qd[:-1]).max(initial=0.0)),
        largest_action=float(np.abs(rerun.actions).max(initial=0.0)),
        problems=task.simulation.problems(),
    )


def _read(path: Path) -> tuple[Arrays, DumpAbout]:
    arrays = read_arrays(path, "dump")
    text = text_of(arrays, "meta")
    plain = parse_json(text, f"dump '{path}': meta") if text else None
    if not isinstance(plain, dict):
        raise InputError(f"'{path}' is no dump of a broken world")
    if plain.get("format") != FORMAT:
        raise InputError(
            f"'{path}' has format {formatted(plain.get('format'))}, this version of simwarp reads {FORMAT}"
        )
    return arrays, config_from_plain(DumpAbout, plain, f"dump '{path}': meta")


def _task_of(about: DumpAbout, device: str, where: str) -> Task[Any]:
    """Return the task with the one world of the dump, at the beginning of the episode that broke."""
    cls = task_class_of({"task": about.task, "task_file": about.task_file or None}, f"dump {where}")
    if not cls.physics:
        raise InputError(f"{where}: task '{about.task}' has no physics that could break down")
    config = config_from_plain(cls.config_type, {**about.config, "guard_steps": 0}, f"dump {where}: config")
    task = make(about.task, 1, device=device, seed=about.seed, config=config, first_world=about.world)
    task.iteration = about.iteration
    _start_episode(task, about)
    return task


def _start_episode(task: Task[Any], about: DumpAbout) -> None:
    task.level.fill_(about.level)
    task.episode_index.fill_(about.episode - 1)
    task.restart()


def _check_columns(task: Task[Any], arrays: Arrays, about: DumpAbout, where: str) -> None:
    """Check the recorded control steps against the task.

    Raises:
        InputError: a column is missing, too short, or of other actions or joints.
    """
    views = task.views
    likes = {"actions": task.action.view(1, -1), "joint_q": views.joint_q, "joint_qd": views.joint_qd}
    if _LEVEL in arrays:
        likes[_LEVEL] = task.level
    for name, like in likes.items():
        rows = len(arrays[name]) if name in arrays and arrays[name].ndim else 0
        if rows < about.replay_steps:
            raise InputError(f"{where} has {rows} rows of '{name}', {about.replay_steps} are to be repeated")
        check_like(like.expand(rows, *like.shape[1:]), _tensor(arrays[name]), f"{where}: {name}")


def _restore(task: Task[Any], arrays: Arrays, about: DumpAbout, where: str) -> None:
    """Put the task into the snapshot of the dump."""
    packed = pack_snapshot(task.simulation.snapshot())
    saved = _nest(packed, arrays, "start/")
    start_action = _tensor(arrays.get("start_action"))
    extra = {name: value.clone() for name, value in task.contract.extra_state().items()}
    found = {name: _tensor(arrays[key]) for name in extra if (key := f"extra/{name}") in arrays}
    check_like(packed, saved, f"{where}: start")
    check_like(task.action[0].flatten(), start_action, f"{where}: start_action")
    check_like({name: extra[name][0] for name in found}, found, f"{where}: extra")
    task.simulation.restore(unpack_snapshot(saved, task.simulation.snapshot()))
    task.action.copy_(start_action.to(task.device).view_as(task.action))
    done = about.episode_steps - about.replay_steps
    task.episode_steps.fill_(done)
    task.episode_clock.fill_(done)
    for name, value in found.items():
        extra[name][0] = value.to(extra[name].device)
    task.load_extra_state(extra)


def _nest(like: dict[str, Any], arrays: Arrays, prefix: str) -> dict[str, Any]:
    """Return arrays with slashes in their names as the nested dictionary of a one-world snapshot."""
    nested: dict[str, Any] = {}
    for name, part in like.items():
        if not isinstance(part, torch.Tensor):
            nested[name] = _nest(part, arrays, f"{prefix}{name}/")
        elif prefix + name in arrays:
            nested[name] = _tensor(arrays[prefix + name][None])
    return nested


def _tensor(array: npt.NDArray[Any] | None) -> Any:
    """Return an array as a tensor; text, which torch does not have, as it is."""
    return array if array is None or array.dtype.kind == "U" else torch.from_numpy(array)
