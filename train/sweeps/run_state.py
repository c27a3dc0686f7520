"""How far a run of a sweep is, by what its folder holds: whoever trained it may be gone."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from simwarp.core.files import FileError, read_json
from simwarp.tasks import InputError

from ..runs.progress_table import read_progress
from ..runs.run_files import write_json
from ..runs.run_folder import RunFolder
from .plan import SweepRun

LOG: Final = "train.log"
"""All that ``simwarp train`` prints, in the run folder."""
FAILED: Final = "failed.json"
"""Why a run ended by an error of its own, which it would meet again; in the run folder."""

LEFT: Final = "left.json"
"""Why a run was left before its last iteration though nothing was wrong; in the run folder."""


class RunState(enum.Enum):
    """State of a run; the values are those of the results."""

    WAITING = "waiting"
    RUNNING = "running"
    STOPPED = "stopped"
    DONE = "done"
    FAILED = "failed"


@dataclasses.dataclass
class RunRecord:
    """A run, and how far it is.

    Attributes:
        run: the run.
        state: its state.
        iteration: last one that was logged.
        reason: why it failed, or why it stopped.
        reward: mean return of its last episodes; NaN before the first one ended.
        seconds_left: that the rest takes, by its latest iterations; NaN where nothing is known.
        kept: it was finished before this sweep began.
    """

    run: SweepRun
    state: RunState = RunState.WAITING
    iteration: int = 0
    reason: str = ""
    reward: float = math.nan
    seconds_left: float = math.nan
    kept: bool = False
    _size: int = dataclasses.field(default=-1, repr=False)

    def look(self) -> None:
        """Read the progress, if there is more of it than at the last look."""
        path = self.run.folder.progress
        try:
            size = path.stat().st_size
        except OSError:
            return
        if size == self._size:
            return
        self._size = size
        rows = read_progress(path)
        if rows:
            self.iteration = int(rows[-1]["iteration"])
            self.reward = _number(rows[-1].get("mean_reward", ""))
            seconds = _seconds_each(rows[-10:])
            self.seconds_left = max(self.run.config.iterations - self.iteration, 0) * seconds


def _number(word: str) -> float:
    return float(word) if word else math.nan


def _seconds_each(rows: Sequence[dict[str, str]]) -> float:
    """Return the mean time of iterations by their rates; NaN where they are not known."""
    steps = [_number(row.get("env_steps", "")) for row in rows]
    rates = [_number(row.get("env_steps_per_s", "")) for row in rows]
    batch = steps[0] / max(1, int(rows[0]["iteration"]))
    seconds = [batch / rate for rate in rates if rate > 0.0]
    return sum(seconds) / len(seconds) if seconds else math.nan


def saved_iteration(folder: RunFolder) -> int:
    """Return the iteration of the newest checkpoint by its name; 0 where there is none."""
    files = folder.checkpoint_files()
    return int(files[-1].stem.rpartition("_")[2]) if files else 0


def is_done(run: SweepRun) -> bool:
    """Return True if a run has all iterations that are asked for."""
    return saved_iteration(run.folder) >= run.config.iterations


def damage(folder: RunFolder) -> str:
    """Return what is wrong with the newest checkpoint of a run; empty where it can be read."""
    try:
        folder.load_latest()
    except InputError as error:
        return str(error)
    return ""


def failure(folder: RunFolder) -> str:
    """Return why a run failed at an earlier time; empty where it did not."""
    path = folder.path / FAILED
    if not path.is_file():
        return ""
    try:
        return str(read_json(path, FAILED)["reason"])
    except (FileError, KeyError, TypeError):
        return f"{path} cannot be read"


def note_failure(folder: RunFolder, reason: str) -> None:
    """Keep the reason of a failure for the next time."""
    write_json(folder.path / FAILED, {"reason": reason})


def forget_failure(folder: RunFolder) -> None:
    """Let a run be tried again."""
    (folder.path / FAILED).unlink(missing_ok=True)


def leaving(folder: RunFolder, rule: str) -> str:
    """Return why a run was left at an earlier time by the same rule; empty where it was not."""
    path = folder.path / LEFT
    if not path.is_file():
        return ""
    try:
        content = read_json(path, LEFT)
        return str(content["reason"]) if content["rule"] == rule else ""
    except (FileError, KeyError, TypeError):
        return ""


def note_leaving(folder: RunFolder, rule: str, reason: str) -> None:
    """Keep the reason why a run was left for the next time."""
    write_json(folder.path / LEFT, {"rule": rule, "reason": reason})


def last_words(log: Path, since: int = 0) -> str:
    """Return the last line of a log, without the name of the program; empty where there is none.

    Args:
        log: the file.
        since: bytes at its beginning that are of earlier times.
    """
    try:
        text = log.read_bytes()[since:].decode("utf-8", errors="replace")
    except OSError:
        return ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    told = [line for line in lines if line.startswith("simwarp: ")]
    return (told or lines or [""])[-1].removeprefix("simwarp: ")


def log_size(folder: RunFolder) -> int:
    """Return the bytes of a run's log."""
    try:
        return (folder.path / LOG).stat().st_size
    except OSError:
        return 0
