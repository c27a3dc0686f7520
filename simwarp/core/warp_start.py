"""Warp as users meet it: it starts without a banner, and compiling is one line."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final

import warp as wp
from warp._src import context

from simwarp.core.thread_captures import record_per_thread

COMPILING_SHOWS: Final = 0.5
"""Time between two looks for kernels that are compiled [s]."""
COMPILING: Final = "compiling kernels, once per machine: 2 to 5 minutes"

# Warp's native library prints this on every machine without a GPU; `simwarp doctor` says it better
_NO_DRIVER: Final = "Could not find or load the NVIDIA CUDA driver"
_started = threading.Event()
_starting = threading.Lock()
_busy = threading.Lock()


class CacheError(OSError):
    """Warp's folder of compiled kernels cannot be made or written, as in a home that is read-only."""

    def __str__(self) -> str:
        return cache_trouble(self)


def cache_trouble(error: OSError) -> str:
    """What is wrong with the folder of compiled kernels, and the remedy, in one line."""
    place = f"'{error.filename}' " if error.filename else ""
    remedy = "set WARP_CACHE_PATH to a folder of your own"
    return f"the folder {place}of compiled kernels cannot be used: {error.strerror}; {remedy}"


@contextlib.contextmanager
def _cache_errors(folder: str | None = None) -> Iterator[None]:
    """Raise errors of files below a folder, or of all files, as those of the cache."""
    try:
        yield
    except CacheError:
        raise
    except OSError as error:
        if folder is not None and not str(error.filename).startswith(folder):
            raise
        raise CacheError(error.errno, error.strerror, error.filename) from error


def start_warp() -> None:
    """Initialise Warp, once; its warnings still show, but neither its banner nor that there is no GPU.

    Who has set `warp.config.log_level` keeps it: `warp.LOG_DEBUG` before the first model shows all.

    Raises:
        CacheError: there can be no folder for compiled kernels.
    """
    if _started.is_set():
        return
    with _starting:
        if not _started.is_set():
            _initialise()
            record_per_thread(context.runtime)
            _started.set()


def _initialise() -> None:
    """`wp.init()` without what it would print."""
    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_WARNING
    with contextlib.suppress(AttributeError, OSError, ValueError):  # there may be no standard error
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # standard error is closed: nothing to tidy
        with _cache_errors():
            wp.init()
        return
    # The message comes from C, so that only the file descriptor can be redirected
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            with _cache_errors():
                wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        caught.seek(0)
        for line in caught.read().decode(errors="replace").splitlines():
            if _NO_DRIVER not in line:
                print(line, file=sys.stderr)


@contextlib.contextmanager
def report_compiling(say: Callable[[str], None] | None = None) -> Iterator[None]:
    """Tell in one line when kernels are compiled inside the block, which can take minutes in which nothing else shows.

    Inside another such block it does nothing.

    Args:
        say: prints a line; by default standard error, where a terminal also sees how long it has taken, unless Warp
            itself is to be silent (`warp.config.log_level` above `warp.LOG_WARNING`).

    Raises:
        CacheError: a kernel had to be compiled, and cannot be written.
    """
    with _cache_errors(wp.config.kernel_cache_dir or ""), _reporting(say):
        yield


@contextlib.contextmanager
def _reporting(say: Callable[[str], None] | None) -> Iterator[None]:
    if (say is None and wp.config.log_level > wp.LOG_WARNING) or not _busy.acquire(blocking=False):
        yield
        return
    done = threading.Event()
    watcher = threading.Thread(target=_watch, args=(done, say), daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()
        _busy.release()


def _watch(done: threading.Event, say: Callable[[str], None] | None) -> None:
    mark = f"_p{os.getpid()}_t"  # Warp builds a module in a folder of this process and thread
    while not done.wait(COMPILING_SHOWS):
        folder = wp.config.kernel_cache_dir
        with contextlib.suppress(OSError):
            if folder and any(mark in name for name in os.listdir(folder)):
                break
    else:
        return
    if say is not None:
        say(COMPILING)
        return
    with contextlib.suppress(OSError, ValueError, AttributeError):
        _report_time(done)


def _report_time(done: threading.Event) -> None:
    """One line on standard error; a terminal's goes on counting seconds."""
    if not sys.stderr.isatty():
        print(f"simwarp: {COMPILING}", file=sys.stderr, flush=True)
        return
    began = time.monotonic()
    while True:
        print(f"\rsimwarp: {COMPILING}, {time.monotonic() - began:.0f} s", end="", file=sys.stderr, flush=True)
        if done.wait(1.0):
            print(file=sys.stderr, flush=True)
            return
