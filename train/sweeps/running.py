"""The running of a sweep: so many trainings at a time, each in a process of its own, until there is no more to do."""

from __future__ import annotations

import contextlib
import dataclasses
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Final, Protocol

from simwarp.core.operating_system import STOPPED_UNHEARD
from simwarp.core.stopping import StopRequest
from simwarp.tasks import InputError

from ..runs.run_lock import living_writer
from .launchers import FoundJob, Job, Launcher
from .leaving import LeaveRule
from .plan import SweepRun
from .run_state import (
    LOG,
    RunRecord,
    RunState,
    damage,
    failure,
    forget_failure,
    is_done,
    last_words,
    leaving,
    log_size,
    note_failure,
    note_leaving,
    saved_iteration,
)

POLL: Final = 0.3
"""Time between two looks at the processes [s]."""
_INTERRUPTED = 130
_PATIENCE: Final = 20.0
"""Time in which a process must end after a request to stop, before the next one [s]."""
_STOPPING: Final = ("each saves its iteration; again: at once", "each saves what it has; again: kills", "killed")
"""What each request to stop has the runs do."""
_KILLS: Final = len(_STOPPING)
"""The request that kills."""


class RunSource(Protocol):
    """Tells which run comes next."""

    def next_run(self) -> SweepRun | None:
        """Return a run to do; None while there is none, because all are done or taken."""

    def settled(self, record: RunRecord) -> None:
        """Learn that a run is done or has failed."""


class RunList:
    """Runs that are all known from the beginning.

    Args:
        runs: in the order in which they are begun.
    """

    def __init__(self, runs: Iterable[SweepRun]) -> None:
        self._left = deque(runs)

    def next_run(self) -> SweepRun | None:
        """Return the next one."""
        return self._left.popleft() if self._left else None

    def settled(self, record: RunRecord) -> None:
        """Nothing follows from what came out."""


class Watcher(Protocol):
    """Shows how far a sweep is."""

    def update(self, records: list[RunRecord]) -> None:
        """Show the runs; called every :data:`POLL` seconds."""

    def changed(self, record: RunRecord) -> None:
        """Show that a run began or ended."""

    def say(self, text: str) -> None:
        """Print a line that stays."""


@dataclasses.dataclass(eq=False)
class _Started:
    """A run under way: its record, its process, the bytes of its log that are older, and why it is being left."""

    record: RunRecord
    job: Job
    logged: int
    left: str = ""


class SweepRunner:
    """Runs what a source tells.

    Args:
        task: the registered name of the task.
        source: tells the runs.
        launcher: starts them.
        jobs: runs at a time.
        watcher: shows them.
        retry: try runs again that failed by an error of their own.
        after: called when a run is done or has failed.
        rule: by which runs are left before their last iteration; None: by none.

    Attributes:
        records: of all runs that were taken, in their order.
    """

    def __init__(
        self, task: str, source: RunSource, launcher: Launcher, *, jobs: int, watcher: Watcher, retry: bool = False,
        after: Callable[[RunRecord], None] = lambda record: None, rule: LeaveRule | None = None,
    ) -> None:  # fmt: skip
        self.records: list[RunRecord] = []
        self._task, self._source, self._launcher = task, source, launcher
        self._jobs, self._watcher, self._retry, self._after = jobs, watcher, retry, after
        self._rule = rule or LeaveRule((), (), 1.0, 0)
        self._started: list[_Started] = []
        self._leaving = False

    def run(self, stop: StopRequest) -> None:
        """Do all runs; after a request to stop, save those under way and leave.

        Each request is handed on: the first one has a run save its iteration, the second one leave it and save what
        there is. The third one kills.

        Raises:
            InputError: a folder holds a run of another configuration.
            OutputError: the disk did not take a file.
        """
        with stop.saving():
            try:
                while not stop.requested and self._go_on():
                    time.sleep(POLL)
                if stop.requested:
                    self._leave(stop)
            except BaseException:
                self._stop_all()
                raise

    def _go_on(self) -> bool:
        """Settle what has ended and begin what there is room for; False if there is nothing more to do."""
        self._settle_ended()
        while len(self._started) < self._jobs and (run := self._source.next_run()) is not None:
            self._begin(run)
        self._watcher.update(self.records)
        return bool(self._started)

    def _begin(self, run: SweepRun) -> None:
        """Start a run, unless it is done, failed before, or still runs since an earlier sweep."""
        record = RunRecord(run)
        self.records.append(record)
        run.prepare(self._task)
        record.look()
        failed = failure(run.folder)
        writer = living_writer(run.folder.path)
        left = "" if writer else self._rule.reason(record) or leaving(run.folder, self._rule.name)
        if writer is None and (is_done(run) or left):
            broken = damage(run.folder) if is_done(run) or run.folder.checkpoint_files() else ""
            if not is_done(run):
                note_leaving(run.folder, self._rule.name, left)
            record.state = RunState.FAILED if broken else RunState.DONE
            record.reason, record.kept = broken or left, True
        elif writer is None and failed and not self._retry:
            record.state, record.reason, record.kept = RunState.FAILED, failed, True
        else:
            forget_failure(run.folder)
            record.state = RunState.RUNNING
            record.reason = f"goes on as {writer}" if writer else _resumed(run)
            logged = log_size(run.folder)
            job = FoundJob(writer) if writer else self._launcher.start(run)
            self._started.append(_Started(record, job, logged))
            self._watcher.changed(record)
            return
        self._settled(record)

    def _settle_ended(self) -> None:
        for started in list(self._started):
            record = started.record
            record.look()
            code = started.job.poll()
            if code is None:
                self._leave_early(started)
                continue
            writer = living_writer(record.run.folder.path)
            if writer is not None:  # one that an earlier sweep had started just before it was killed
                started.job = FoundJob(writer)
                continue
            if isinstance(started.job, FoundJob) and not (is_done(record.run) or self._leaving or started.left):
                # Whatever ended it is not known: it goes on as a process of this sweep, which will know
                started.logged, started.job = log_size(record.run.folder), self._launcher.start(record.run)
                continue
            self._started.remove(started)
            self._judge(started, code)
            self._settled(record)

    def _leave_early(self, started: _Started) -> None:
        """Have a run that needs no more training save its iteration and end."""
        if not (started.left or self._leaving):
            started.left = self._rule.reason(started.record)
            if started.left:
                with contextlib.suppress(OSError):
                    started.job.stop()

    def _judge(self, started: _Started, code: int) -> None:
        """Tell by its folder and its exit code what became of a run."""
        record, run = started.record, started.record.run
        left = started.left if code in {0, _INTERRUPTED, *STOPPED_UNHEARD} else ""
        if code == 0 and run.config.minutes is not None and not is_done(run):
            left = left or f"its {run.config.minutes:g} min are used up"
        record.reason = left
        if is_done(run):
            record.state = RunState.DONE
        elif left:
            record.state = RunState.DONE
            note_leaving(run.folder, self._rule.name, left)
        elif code in (0, _INTERRUPTED) or (self._leaving and code in STOPPED_UNHEARD):  # Python had not yet begun
            record.state = RunState.STOPPED
            record.reason = f"stopped after iteration {saved_iteration(run.folder)}"
        elif code < 0:
            # Nothing that it would meet again: memory ran out, or somebody ended it
            record.state = RunState.FAILED
            record.reason = f"ended by {_signal(-code)} after iteration {saved_iteration(run.folder)}"
        else:
            words = last_words(run.folder.path / LOG, started.logged)
            record.state, record.reason = RunState.FAILED, words or f"exit code {code}"
            note_failure(run.folder, record.reason)

    def _settled(self, record: RunRecord) -> None:
        self._watcher.changed(record)
        if record.state in (RunState.DONE, RunState.FAILED):
            self._source.settled(record)
            self._after(record)

    def _leave(self, stop: StopRequest) -> None:
        """Hand on each request to stop, and wait until the runs have saved what they learnt."""
        self._leaving = True
        told = 0
        while self._started:
            if stop.times > told:
                told += 1
                self._watcher.say(f"stopping {_counted(len(self._started))}: {_STOPPING[min(told, _KILLS) - 1]}")
                self._ask(at_once=told >= _KILLS)
            self._settle_ended()
            self._watcher.update(self.records)
            time.sleep(POLL)

    def _ask(self, *, at_once: bool) -> None:
        for started in self._started:
            with contextlib.suppress(OSError):
                started.job.stop(at_once=at_once)

    def _stop_all(self) -> None:
        """Have all runs save their iterations; those that take long leave them, and the last ones are killed."""
        for asked in range(1, _KILLS + 1):
            self._ask(at_once=asked == _KILLS)
            deadline = time.monotonic() + _PATIENCE
            while any(started.job.poll() is None for started in self._started):
                if time.monotonic() > deadline:
                    break
                time.sleep(POLL)
            else:
                return


def _counted(runs: int) -> str:
    return f"{runs} run{'s' if runs > 1 else ''}"


def _resumed(run: SweepRun) -> str:
    iteration = saved_iteration(run.folder)
    return f"resumed after iteration {iteration}" if iteration else ""


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def check_runs(task: str, runs: Iterable[SweepRun]) -> None:
    """Hold the runs that are there to the configurations that are asked for, before any work is done.

    Raises:
        InputError: one is of another configuration.
    """
    for run in runs:
        if run.folder.path.exists():
            if not run.folder.path.is_dir():
                raise InputError(f"'{run.folder.path}' is no folder: give another --out")
            run.prepare(task)
