"""Trainings in the queue of a SLURM cluster, through submitit."""

from __future__ import annotations

import contextlib
import importlib
import signal
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from simwarp.core.files import FileError, read_json
from simwarp.tasks import InputError

from ..runs.run_files import append_whole, write_json
from .launchers import Job, train_command
from .plan import SweepRun
from .run_state import LOG

JOB: Final = "job.json"
"""Number of the job that trains a run, in its folder."""
SLURM: Final = "slurm"
CLUSTER: Final = "cluster"
_POLL = 0.5
_OWN_FAULT = frozenset({"FAILED", "FINISHED", "COMPLETED"})
"""States of a job whose work came to its end: an error is the run's own."""


def import_submitit() -> Any:
    """Return the module submitit.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module("submitit")
    except ImportError as error:
        raise InputError("--launcher slurm needs the package submitit: pip install 'simwarp[sweep]'") from error


class TrainingJob:
    """The work of a job: a training in a process of its own, which is saved and goes on in another job at a time limit.

    Args:
        command: of the training, which resumes its run.
        log: takes what it prints.
    """

    def __init__(self, command: list[str], log: str) -> None:
        self.command, self.log = command, log
        self._process: subprocess.Popen[bytes] | None = None

    def __call__(self) -> int:
        """Return the exit code of the training."""
        with open(self.log, "ab") as log:
            self._process = subprocess.Popen(
                self.command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
            )
        try:
            return self._wait()
        except BaseException:
            self._stop()
            raise

    def checkpoint(self) -> Any:
        """Save the training and return what goes on with it; submitit calls it before the time is up."""
        self._stop()
        return import_submitit().helpers.DelayedSubmission(TrainingJob(self.command, self.log))

    def _wait(self) -> int:
        # Popen.wait() holds a lock, which a signal's handler that waits too would never get
        assert self._process is not None
        while (code := self._process.poll()) is None:
            time.sleep(_POLL)
        return code

    def _stop(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            self._wait()


class SlurmLauncher:
    """Jobs of a cluster.

    Args:
        task: the task of all runs, as commands take it.
        folder: of the sweep, on a file system that all machines see.
        parameters: name -> word, for submitit: ``timeout_min``, ``slurm_partition``, ``gpus_per_node``; ``cluster``
            names another one than SLURM.

    Raises:
        InputError: submitit or SLURM is not there, or a parameter is unknown to them.
    """

    def __init__(self, task: str, folder: Path, parameters: Mapping[str, str]) -> None:
        self._task = task
        self._submitit = import_submitit()
        given = {key: _typed(word) for key, word in parameters.items()}
        self._cluster = str(given.pop(CLUSTER, SLURM))
        try:
            self._executor = self._submitit.AutoExecutor(folder=folder / "jobs", cluster=self._cluster)
            self._executor.update_parameters(**given)
        except (RuntimeError, ValueError, NameError, TypeError, AssertionError) as error:
            raise InputError(f"--launcher slurm: {' '.join(str(error).split())}") from error

    def start(self, run: SweepRun) -> Job:
        """Submit a run, or find the job again that an earlier sweep submitted and that is not over."""
        found = self._found(run)
        if found is not None:
            return found
        log = run.folder.path.absolute() / LOG
        # The queue runs a job once at a time: whoever holds the lock of the run is gone
        work = TrainingJob(train_command(run, self._task, take_over=True), str(log))
        self._executor.update_parameters(name=run.name[:60])
        job = self._executor.submit(work)
        write_json(run.folder.path / JOB, {"job": str(job.job_id)})
        return ClusterJob(job, log)

    def _found(self, run: SweepRun) -> ClusterJob | None:
        if self._cluster != SLURM:
            return None
        try:
            number = str(read_json(run.folder.path / JOB, JOB)["job"])
        except (FileError, KeyError, TypeError):
            return None
        job = self._submitit.SlurmJob(folder=self._executor.folder, job_id=number)
        return None if job.done() else ClusterJob(job, run.folder.path / LOG)


def _typed(word: str) -> int | float | str:
    """Return a number where a word is one; `04:00:00` is none."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(word)
    return word


class ClusterJob:
    """A job in a queue.

    Args:
        job: of submitit.
        log: of the run; what the cluster says of a failure is added to it.
    """

    def __init__(self, job: Any, log: Path) -> None:
        self._job, self._log = job, log

    def poll(self) -> int | None:
        """Return the exit code; None while the job waits or runs."""
        if not self._job.done():
            return None
        error = self._job.exception()
        if error is None:
            return int(self._job.result())
        words = (str(error).strip().splitlines() or [type(error).__name__])[-1]
        with contextlib.suppress(OSError, RuntimeError):
            append_whole(self._log, f"simwarp: job {self._job.job_id}: {self._job.state}: {words}\n".encode())
        return 1 if str(self._job.state).split()[0] in _OWN_FAULT else -signal.SIGTERM

    def stop(self, *, at_once: bool = False) -> None:
        """Cancel the job: its training hears SIGTERM, and the cluster kills what is left later."""
        self._job.cancel(check=False)
