"""Threads of a CPU: how many a run takes, and the workers that share its work."""

from __future__ import annotations

import collections
import concurrent.futures
import contextlib
import contextvars
import operator
import os
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import Any, Final

from simwarp.core.types import ModelError, formatted

VARIABLE: Final = "SIMWARP_THREADS"
"""Environment variable of the number of threads that nobody asks for."""
MOST_THREADS: Final = 1024
"""Most threads that can be asked for."""

_DEFAULT: contextvars.ContextVar[int | None] = contextvars.ContextVar("threads", default=None)


def thread_count(threads: int | None = None, *, processes: int = 1) -> int:
    """Number of threads: the given one, else `SIMWARP_THREADS`, else the processors this process may use.

    Inside `default_threads` its number comes before both of these.

    Args:
        threads: number that was asked for, from 1 to 1024; None where nobody did.
        processes: processes that do the same work on this machine, and share its processors.

    Raises:
        ModelError: it, or the variable, is no whole number from 1 to 1024.
    """
    if threads is not None:
        return _held("threads", threads, threads, "leave it away for as many as there are processors")
    default = _DEFAULT.get()
    if default is not None:
        return default
    told = number_from_environment(VARIABLE, MOST_THREADS, "unset it for as many as there are processors")
    return max(1, min(usable_processors() // processes, MOST_THREADS)) if told is None else told


def number_from_environment(variable: str, most: int, remedy: str) -> int | None:
    """Number in an environment variable; None where it is unset or empty.

    Args:
        variable: its name.
        most: largest number that is allowed, at least 1.
        remedy: last words of the error.

    Raises:
        ModelError: it is no whole number from 1 to `most`.
    """
    told = os.environ.get(variable, "")
    if not told:
        return None
    number = int(told) if told.isascii() and told.isdigit() and len(told) <= len(str(most)) else None
    return _held(variable, number, told, remedy, most)


def usable_processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # another system than Linux


def _held(name: str, number: Any, got: Any, remedy: str, most: int = MOST_THREADS) -> int:
    """A whole number from 1 to `most`, if it is one."""
    try:
        found = 0 if isinstance(number, bool) else operator.index(number)
    except TypeError:
        found = 0
    if not 1 <= found <= most:
        raise ModelError(f"{name} must be a whole number from 1 to {most}, got {formatted(got)}; {remedy}")
    return found


@contextlib.contextmanager
def default_threads(threads: int | None) -> Iterator[None]:
    """Inside, a run that does not say how many threads it takes has this number; None changes nothing."""
    token = _DEFAULT.set(_DEFAULT.get() if threads is None else thread_count(threads))
    try:
        yield
    finally:
        _DEFAULT.reset(token)


class Workers:
    """Threads that run one piece of work together. They end with the last object that uses them.

    All `Workers` of a process share one pool, as large as the largest of them asks for. A child process that was forked
    off starts threads of its own.

    Args:
        count: threads.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        _POOL.acquire(count)
        weakref.finalize(self, _POOL.release, count)

    def run(self, work: Callable[[], None], count: int | None = None) -> None:
        """Calls `work` in `count` threads at a time and waits until all have returned.

        An interrupt (Ctrl-C) is raised once they have. What a call raises is raised here.
        """
        futures = [_POOL.submit(work) for _ in range(self.count if count is None else min(count, self.count))]
        try:
            concurrent.futures.wait(futures)
        except BaseException:
            # the work is done to its end, so that no world is left behind the others
            concurrent.futures.wait(futures)
            raise
        for future in futures:
            future.result()


class _Pool:
    """The process' threads, made when they are first needed.

    Users end wherever Python collects garbage: in any thread, and also inside of `submit`, whose locks that thread
    holds then. So `release` waits for no lock. It leaves a note, which the holder of the lock reads after release.
    """

    def __init__(self) -> None:
        self._users: list[int] = []
        self._gone: collections.deque[int] = collections.deque()
        self.forget()

    def forget(self) -> None:
        """Starts anew, as in a child process, which has none of its parent's threads."""
        self._lock = threading.Lock()
        self._executor: concurrent.futures.ThreadPoolExecutor | None = None
        self._size = 0

    def acquire(self, count: int) -> None:
        """One more user."""
        with self._lock:
            self._users.append(count)
        self._settle()

    def release(self, count: int) -> None:
        """One less; the threads of the last one end."""
        self._gone.append(count)
        self._settle()

    def submit(self, work: Callable[[], None]) -> concurrent.futures.Future[None]:
        """Runs `work` in one of the threads."""
        with self._lock:
            wanted = max(self._users)
            if self._executor is None or self._size < wanted:
                if self._executor is not None:
                    self._executor.shutdown(wait=False)
                self._executor = concurrent.futures.ThreadPoolExecutor(wanted, "simwarp")
                self._size = wanted
            future = self._executor.submit(work)
        self._settle()
        return future

    def _settle(self) -> None:
        """Releases users that are gone; if the lock is held, its holder does that instead."""
        while self._gone and self._lock.acquire(blocking=False):
            executor = None
            try:
                while self._gone:
                    self._users.remove(self._gone.popleft())
                if not self._users:
                    executor, self._executor = self._executor, None
            finally:
                self._lock.release()
            if executor is not None:
                executor.shutdown(wait=False)


_POOL = _Pool()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_POOL.forget)
