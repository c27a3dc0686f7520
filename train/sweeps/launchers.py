"""Ways to start a training in a process of its own: here, or in the queue of a cluster (:mod:`.slurm`)."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from typing import Protocol

from simwarp.core.operating_system import KILL, STOP, own_session

from ..runs.run_lock import Writer
from .plan import SweepRun
from .run_state import LOG


class Job(Protocol):
    """A training that was started."""

    def poll(self) -> int | None:
        """Return the exit code, negative the number of a signal that ended it; None while it runs."""

    def stop(self, *, at_once: bool = False) -> None:
        """Ask it to stop: after its iteration, which it saves; `at_once`, as it is."""


class Launcher(Protocol):
    """Starts trainings."""

    def start(self, run: SweepRun) -> Job:
        """Start a run whose folder is there, or go on with it."""


def train_command(run: SweepRun, task: str, *, take_over: bool = False) -> list[str]:
    """Return the command that begins a prepared run or goes on with it.

    Args:
        run: the run.
        task: its task, as commands take it.
        take_over: its writer, if it has one, is known to be gone.
    """
    command = [sys.executable, "-m", "simwarp", "train", task, "--resume", str(run.folder.path)]
    command += ["--iterations", str(run.config.iterations)]
    return [*command, "--take-over"] if take_over else command


class LocalLauncher:
    """Processes of this machine.

    Args:
        task: the task of all runs, as commands take it.
    """

    def __init__(self, task: str) -> None:
        self._task = task

    def start(self, run: SweepRun) -> Job:
        """Start a process; what it prints is added to the log in the run folder."""
        with (run.folder.path / LOG).open("ab") as log:
            # A session of its own: Ctrl-C in the terminal is heard by the sweep alone, which asks each run once
            return LocalJob(
                subprocess.Popen(
                    train_command(run, self._task),
                    stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, **own_session(),
                )
            )  # fmt: skip


class LocalJob:
    """A process of this one."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def poll(self) -> int | None:
        """Return the exit code; None while it runs."""
        return self._process.poll()

    def stop(self, *, at_once: bool = False) -> None:
        """Send a signal that a training hears even where Ctrl-C is ignored; or one that ends it."""
        if self._process.poll() is None:
            self._process.send_signal(KILL if at_once else STOP)


class FoundJob:
    """A training that an earlier sweep started and that still runs, though the sweep is gone."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer

    def poll(self) -> int | None:
        """Return 0 when the process is gone: its exit code is nobody's to know, its folder tells the rest."""
        return 0 if self._writer.is_alive() is False else None

    def stop(self, *, at_once: bool = False) -> None:
        """Send it a signal, unless its number is another's by now."""
        if self._writer.is_alive():
            with contextlib.suppress(ProcessLookupError):  # it ended just now
                os.kill(self._writer.pid, KILL if at_once else STOP)
