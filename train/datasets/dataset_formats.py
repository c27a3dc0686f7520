"""Formats of recorded episodes: written by name, read by what is there."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from simwarp.core.files import OutputError
from simwarp.core.stopping import StopRequest
from simwarp.tasks import InputError, Task

from ..networks.policies import Policy
from .dataset_kinds import DatasetFormat, check_dataset, check_source
from .episodes import Episode, episodes_of
from .trajectories import Trajectories, read_npz


class DatasetWriter(Protocol):
    """A dataset that is written.

    Attributes:
        episodes: number of those that can be opened.
        rows: their steps.
    """

    episodes: int
    rows: int

    def add(self, episode: Episode) -> None:
        """Add an episode."""

    def commit(self) -> None:
        """Make all that was added readable."""

    def end(self) -> None:
        """Drop what is not complete, and the folder where nothing is."""


@dataclasses.dataclass(frozen=True)
class Recorded:
    """What was recorded into a dataset.

    Attributes:
        episodes: number of episodes.
        steps: their control steps.
        mean_return: mean of their summed rewards.
    """

    episodes: int
    steps: int
    mean_return: float


def record_dataset(
    task: Task[Any], policy: Policy, episodes: int, seed: int, path: str | Path, kind: DatasetFormat, *,
    about: dict[str, Any] | None = None, instruction: str | None = None, quality: int = 18,
    stop: StopRequest | None = None, report: Callable[[int], None] = lambda ended: None,
) -> Recorded:  # fmt: skip
    """Let a policy act for ``episodes`` whole episodes, the first ones of each world, and write them as they end.

    Args:
        task: the worlds.
        policy: policy that acts.
        episodes: number of episodes.
        seed: seed of the worlds.
        path: folder to be made.
        kind: Minari or LeRobot; ``record`` and ``save_trajectories`` write ``.npz``.
        about: metadata to keep; ``policy`` names the policy.
        instruction: what is to be done, as a sentence; None: the task's own.
        quality: of LeRobot's videos, from 0, without loss, to 51.
        stop: request to leave with the episodes that have ended by then.
        report: called now and then with the number of episodes that have ended, and after each one that is written.

    Raises:
        InputError: the name or the format is wrong, or an extra is missing.
        FileError: the folder exists already.
        OutputError: the disk did not take it; what was complete by then can be read.
        TrainingError: the policy returned NaN or infinity.
        KeyboardInterrupt: it was asked to stop before an episode had ended.
    """
    if kind is DatasetFormat.NPZ:
        raise InputError("kind must be minari or lerobot, got npz; use record() and save_trajectories()")
    path = Path(path)
    check_dataset(kind, path, quality, "path")
    instruction = instruction_of(task, instruction)
    kept = {"policy": "unnamed"} | (about or {})
    returns: list[float] = []
    stop = stop or StopRequest()
    source = episodes_of(
        task, policy, episodes, seed, stop, report, last=kind is DatasetFormat.MINARI,
        kept=f"the episodes before it are in '{path}'",
    )  # fmt: skip
    try:
        writer = _open(kind, path, task, instruction, seed, kept, quality)
    except OutputError:
        shutil.rmtree(path, ignore_errors=True)
        raise
    try:
        for episode in source:
            writer.add(episode)
            returns.append(float(episode.rewards.sum(dtype="float64")))
            report(len(returns))  # many end at once, and writing their images takes a while
    except OutputError:
        raise
    except Exception:
        writer.commit()  # what went wrong was the task or the policy: the episodes before it are sound
        raise
    else:
        with stop.saving():
            writer.commit()
    finally:
        writer.end()
    if not returns:
        raise KeyboardInterrupt
    return Recorded(writer.episodes, writer.rows, sum(returns) / len(returns))


def _open(
    kind: DatasetFormat, path: Path, task: Task[Any], instruction: str, seed: int, about: dict[str, Any],
    quality: int,
) -> DatasetWriter:  # fmt: skip
    if kind is DatasetFormat.MINARI:
        from .minari_dataset import MinariWriter

        return MinariWriter(path, task, instruction, seed, about)
    from .lerobot_writer import LeRobotWriter

    return LeRobotWriter(path, task, instruction, seed, about, quality)


def instruction_of(task: Task[Any] | type[Task[Any]], given: str | None = None) -> str:
    """Return what a task is about, as a sentence: what is given, else its own, else its summary or name.

    Raises:
        InputError: it is empty or has several lines.
    """
    instruction = given if given is not None else task.instruction or task.summary or task.name
    if not instruction.strip() or not instruction.isprintable():
        raise InputError(f"instruction must be a sentence on one line, got {instruction!r}")
    return instruction


def load_trajectories(path: str | Path, task_name: str) -> Trajectories:
    """Read trajectories of a task, in whatever format ``simwarp record`` wrote them; runs no code from them.

    Args:
        path: a ``.npz`` file, or the folder of a dataset.
        task_name: task that they must be of.

    Raises:
        FileError: nothing is there, or it is damaged or of another kind.
        InputError: it is of another task, its columns are not what they should be, or an extra is missing.
    """
    path = Path(path)
    found = check_source(path, task_name)
    if found is DatasetFormat.MINARI:
        from .minari_dataset import read_minari

        return read_minari(path.parent if path.name == "data" and not (path / "data").exists() else path, task_name)
    if found is DatasetFormat.LEROBOT:
        from .lerobot_reader import read_lerobot

        return read_lerobot(path, task_name)
    return read_npz(path, task_name)
