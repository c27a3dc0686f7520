"""A policy that follows its training: newer checkpoints of a run folder act as soon as they are there."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.cli.view.task_subject import TaskLoop
from simwarp.core.types import ModelError, formatted
from simwarp.tasks import InputError
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import RunFolder

INTERVAL: Final = 2.0
"""Seconds from look to look."""
Array = npt.NDArray[np.float64]


class PolicyReload:
    """Looks for newer checkpoints of a run in a thread, and has the loop use them.

    Args:
        folder: the run.
        loop: of the task.
        using: checkpoint that the loop began with; None: another policy.
        on: whether newer ones are taken.
        interval: seconds from look to look.

    Attributes:
        on: may be switched at any time.
        name: of the run, for people.
        iteration: of the policy that acts; None: it is not of this run.
        trouble: why the newest checkpoint does not act; empty where it does.
    """

    def __init__(
        self, folder: RunFolder, loop: TaskLoop, *, using: Path | None = None, iteration: int | None = None,
        on: bool = True, interval: float = INTERVAL,
    ) -> None:  # fmt: skip
        self.name, self.on, self.iteration, self.trouble = str(folder.path), on, iteration, ""
        self._folder, self._loop, self._interval = folder, loop, interval
        self._post: Callable[[Callable[[], None]], None] = _at_once
        self._seen = None if using is None else _mark(using)
        self._read: tuple[int, int] | None = None
        self._curve = (np.zeros(0), np.zeros(0))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="policy reload", daemon=True)
        self._read_curve()

    def start(self, post: Callable[[Callable[[], None]], None]) -> None:
        """Starts the thread; `post` has a command run between two steps of the loop."""
        self._post = post
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)

    def curve(self) -> tuple[Array, Array]:
        """Iterations, and mean returns in them."""
        return self._curve

    def look(self) -> None:
        """Reads the table, and the newest checkpoint if it was not yet read and the reload is on."""
        self._read_curve()
        files = self._folder.checkpoint_files()
        if not self.on or not files:
            return
        try:
            mark = _mark(files[-1])
        except OSError:  # dropped just now in favour of a newer one
            return
        if mark == self._seen:
            return
        try:
            content = load_checkpoint(files[-1])
            policy = self._policy(content)
        except (InputError, ModelError) as error:
            self.trouble = str(error)
        else:
            self.trouble = ""
            self._post(lambda: self._use(policy, content["iteration"]))
        self._seen = mark

    def _policy(self, content: dict[str, Any]) -> Any:
        """The policy of a checkpoint, if it is one for the task that is shown."""
        task = self._loop.task
        if content["task"] != task.name:
            raise InputError(f"the checkpoint is of task {formatted(content['task'])}, not '{task.name}'")
        trained, own = content["task_config"].get("obs"), getattr(task.config, "obs", None)
        if own is not None and trained not in (None, own.value):
            raise InputError(f"the checkpoint was trained on {formatted(trained)} observations, not {own.value}")
        return network_policy(content, task)

    def _use(self, policy: Any, iteration: int) -> None:
        self._loop.use(policy)
        self.iteration = iteration

    def _read_curve(self) -> None:
        try:
            status = self._folder.progress.stat()
        except OSError:
            return
        if (status.st_mtime_ns, status.st_size) == self._read:
            return
        self._read = (status.st_mtime_ns, status.st_size)
        rows = [(row["iteration"], row.get("mean_reward") or "nan") for row in read_progress(self._folder.progress)]
        points = np.array([(int(index), float(value)) for index, value in rows], np.float64).reshape(-1, 2)
        points = points[[math.isfinite(value) for value in points[:, 1]]] if len(points) else points
        self._curve = (points[:, 0], points[:, 1])

    def _watch(self) -> None:
        while not self._stop.wait(self._interval):
            try:
                self.look()
            except Exception as error:  # noqa: BLE001  the page shows it, and the old policy goes on
                self.trouble = f"{type(error).__name__}: {error}"


def _at_once(command: Callable[[], None]) -> None:
    command()


def _mark(path: Path) -> tuple[str, int, int]:
    """What changes when a checkpoint is written again."""
    status = path.stat()
    return str(path), status.st_mtime_ns, status.st_size
