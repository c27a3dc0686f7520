"""One writer per run folder: a lock file that names the process, and what becomes of a lock whose process is gone.

The file is read and changed only under a lock of the operating system (`filelock`), so that two processes that find the
file of a dead one do not both take it over. That lock is held for moments; the file stays while its run is written.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import json
import os
import socket
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Self

from filelock import FileLock, Timeout

from simwarp.core import operating_system
from simwarp.core.files import FileError, OutputError, output_error, parse_json
from simwarp.tasks import InputError, config_from_plain

from ..algorithm.learner import TrainingError

LOCK: Final = "writer.json"
_PATIENCE = 5.0
"""Longest time that another process may be reading or changing the file [s]."""
_LARGEST = 10_000
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
"""Errors of file systems without locks: there, the file itself must do."""
_PROC = Path("/proc")


@dataclasses.dataclass(frozen=True)
class Writer:
    """Identity of a process, to check whether it still runs.

    Attributes:
        host: name of its machine.
        machine: identifier of the machine beside its name; empty where the system has none.
        boot: of the machine since its last start, and of the container within it; numbers of processes mean the same.
        pid: its number.
        started: start time, in whatever unit: numbers of processes are used again.
    """

    host: str
    machine: str
    boot: str
    pid: int
    started: str

    @classmethod
    def this(cls) -> Self:
        """Return the writer that this process is."""
        boot = f"{_line(_PROC / 'sys/kernel/random/boot_id')} {_link(_PROC / 'self/ns/pid')}".strip()
        machine = _line(Path("/etc/machine-id"))
        return cls(socket.gethostname(), machine, boot, os.getpid(), started(os.getpid()) or "")

    def is_alive(self) -> bool | None:
        """Return True if it still runs; None where that cannot be known from here."""
        here = Writer.this()
        if self.host != here.host or self.machine != here.machine:
            return None
        if self.boot != here.boot:
            # The machine was started anew since, unless it is a container of the same name beside this one
            same_machine = bool(self.machine) and self.boot.split()[:1] != here.boot.split()[:1]
            return False if same_machine else None
        now = started(self.pid)
        if now is None:
            return False
        return now == self.started if now and self.started else None

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}"


def started(pid: int) -> str | None:
    """Return when a process was started, as the system counts; empty if it does not say, None if there is none."""
    try:
        if pid < 1:
            return None
        if operating_system.WINDOWS:
            return operating_system.process_started(pid)  # there, os.kill(pid, 0) is Ctrl-C
        os.kill(pid, 0)
    except PermissionError:
        pass  # it is somebody else's
    except (OSError, OverflowError):
        return None
    try:
        # The name, in parentheses, may hold anything; behind it come state and numbers
        fields = (_PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
    except OSError:
        return _started_by_ps(pid)
    return None if fields[0] in ("Z", "X") else fields[19]


def _started_by_ps(pid: int) -> str:
    """Return when a process was started where there is no /proc."""
    try:
        done = subprocess.run(
            ["ps", "-o", "lstart=", "-p", str(pid)],
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=10.0,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()


@contextlib.contextmanager
def writing(folder: Path, take_over: bool = False) -> Iterator[RunLock]:
    """Be the one writer of a run folder inside the block.

    Args:
        folder: the run.
        take_over: also where the lock is of a process that cannot be seen from here, such as one on another machine.

    Raises:
        InputError: another process writes the run, or may do so.
        OutputError: the lock cannot be written.
    """
    lock = RunLock(folder / LOCK, take_over)
    try:
        yield lock
    finally:
        lock.release()


def living_writer(folder: Path) -> Writer | None:
    """Return the process that writes a run, if it is known to live; a moment later it may be gone."""
    with contextlib.suppress(OSError):
        writer = _writer_of((folder / LOCK).read_bytes())
        return writer if writer and writer.is_alive() else None
    return None


def _writer_of(text: bytes) -> Writer | None:
    """Return the writer that a lock file names; None where it cannot be read."""
    try:
        return config_from_plain(Writer, parse_json(text[:_LARGEST].decode(), LOCK))
    except (FileError, InputError, UnicodeDecodeError):
        return None


class RunLock:
    """The lock of a run, held from the beginning; see :func:`writing`.

    Attributes:
        path: the file.
        took_over: description of the lock that was found; empty where there was none.
    """

    def __init__(self, path: Path, take_over: bool = False) -> None:
        self.path = path
        self.took_over = ""
        self._own = Writer.this()
        with _exclusive(path):
            if text := _bytes(path):
                self.took_over = self._judge(_writer_of(text), take_over)
            self._write()

    def _judge(self, found: Writer | None, take_over: bool) -> str:
        """Return the reason why the lock that was found may be taken over; refuse otherwise."""
        run = self.path.parent
        if found is None:
            if take_over:
                return f"run {run}: its lock {LOCK} was unreadable and is taken over"
            raise InputError(
                f"run {run}: its lock {LOCK} is unreadable; if no process writes the run, give --take-over"
            )
        alive = found.is_alive()
        if alive:
            raise InputError(f"run {run} is being written by {found}; wait for it or stop it")
        if alive is None and not take_over:
            raise InputError(
                f"run {run} is locked by {found}, out of sight from here; if it no longer runs, give --take-over"
            )
        return f"run {run}: its lock was of {found}, {'taken over' if alive is None else 'which is dead; taken over'}"

    def _write(self) -> None:
        data = json.dumps(dataclasses.asdict(self._own)).encode()
        try:
            with self.path.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self.path.unlink()
            raise output_error(self.path, error, needed=len(data)) from error

    def is_own(self) -> bool:
        """Return True if the lock is still the one of this process; of a folder that is gone the disk tells."""
        try:
            return _writer_of(self.path.read_bytes()) == self._own
        except FileNotFoundError:  # whoever took the run over has finished it
            return not self.path.parent.is_dir()
        except OSError:
            return True

    def check(self) -> None:
        """Check that this process may still write.

        Raises:
            TrainingError: another one has taken the run over.
        """
        if not self.is_own():
            raise TrainingError(f"run {self.path.parent} was taken over by another process; this one stops here")

    def release(self) -> None:
        """Remove the lock, unless it is another's by now."""
        with contextlib.suppress(OSError, OutputError, InputError), _exclusive(self.path):
            if self.is_own() or not _bytes(self.path):  # locking makes the file where it is gone
                self.path.unlink(missing_ok=True)


@contextlib.contextmanager
def _exclusive(path: Path) -> Iterator[None]:
    """Keep other processes from reading or changing the file inside the block.

    The file is locked, and made if it is not there. On Windows nobody can read a locked file, not even who locked it:
    there, a file beside it is locked.
    """
    locked = path.with_suffix(".lock") if operating_system.WINDOWS else path
    lock = FileLock(locked, timeout=_PATIENCE, poll_interval=0.01, fallback_to_soft=False)
    try:
        os.stat(path.parent)  # filelock would make the folder
        if not _is_file_or_absent(path):
            raise InputError(f"run {path.parent}: its lock {path.name} is no regular file; remove it")
        lock.acquire()
    except Timeout:
        raise InputError(f"run {path.parent}: another process holds {path.name}; repeat when it is done") from None
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise output_error(path, error, needed=_LARGEST) from error
        path.touch()
    try:
        yield
    finally:
        lock.release()


def _bytes(path: Path) -> bytes:
    """Return what is in a file; nothing where it is not there."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return b""


def _is_file_or_absent(path: Path) -> bool:
    """One look: a lock that another process removes meanwhile is no other kind of file."""
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except FileNotFoundError:
        return True


def _line(path: Path) -> str:
    """Return the one line of a file of the system; empty where there is none."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def _link(path: Path) -> str:
    try:
        return os.readlink(path)
    except OSError:
        return ""
