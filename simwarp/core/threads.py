"""Threads of a CPU: how many a run takes, and the workers that share its work."""

from __future__ import annotations

import concurrent.futures
import contextlib
import contextvars
import operator
import os
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import Any, Final

from simwarp.core.types import ModelError, shown

VARIABLE: Final = "SIMWARP_THREADS"
"""Environment variable of the number of threads that nobody asks for."""
MOST_THREADS: Final = 1024
"""Most threads that can be asked for."""

_DEFAULT: contextvars.ContextVar[int | None] = contextvars.ContextVar("threads", default=None)


def thread_count(threads: int | None = None, *, processes: int = 1) -> int:
    """Number of threads: what was asked for, else `SIMWARP_THREADS`, else the processors this process may use.

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
    told = os.environ.get(VARIABLE, "")
    if told:
        number = int(told) if told.isascii() and told.isdigit() and len(told) <= len(str(MOST_THREADS)) else None
        return _held(VARIABLE, number, told, "unset it for as many as there are processors")
    return max(1, min(usable_processors() // processes, MOST_THREADS))


def usable_processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # another system than Linux


def _held(name: str, number: Any, got: Any, remedy: str) -> int:
    """A number of threads, if it is one."""
    try:
        found = 0 if isinstance(number, bool) else operator.index(number)
    except TypeError:
        found = 0
    if not 1 <= found <= MOST_THREADS:
        raise ModelError(f"{name} must be a whole number from 1 to {MOST_THREADS}, got {shown(got)}; {remedy}")
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
        _POOL.take(count)
        weakref.finalize(self, _POOL.give_back, count)

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
    """The process' threads, made when they are first needed."""

    def __init__(self) -> None:
        self._users: list[int] = []
        self.forget()

    def forget(self) -> None:
        """Starts anew, as in a child process, which has none of its parent's threads."""
        self._lock = threading.Lock()
        self._executor: concurrent.futures.ThreadPoolExecutor | None = None
        self._size = 0

    def take(self, count: int) -> None:
        """One more user."""
        with self._lock:
            self._users.append(count)

    def give_back(self, count: int) -> None:
        """One less; the threads of the last one end."""
        with self._lock:
            self._users.remove(count)
            executor = None
            if not self._users:
                executor, self._executor = self._executor, None
        if executor is not None:
            executor.shutdown(wait=False)

    def submit(self, work: Callable[[], None]) -> concurrent.futures.Future[None]:
        """Runs `work` in one of the threads."""
        with self._lock:
            wanted = max(self._users)
            if self._executor is None or self._size < wanted:
                if self._executor is not None:
                    self._executor.shutdown(wait=False)
                self._executor = concurrent.futures.ThreadPoolExecutor(wanted, "simwarp")
                self._size = wanted
            return self._executor.submit(work)


_POOL = _Pool()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_POOL.forget)
