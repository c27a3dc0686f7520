"""Warp as users meet it: it starts without a banner, and compiling is told."""

from __future__ import annotations

import contextlib
import math
import os
import re
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
COMPILING: Final = "compiling kernels, once per machine: half a minute to 3 minutes"
LINES_APART: Final = 30.0
"""Time between two lines of kernels that are compiled [s]."""

# Warp's native library prints this on every machine without a GPU; `simwarp doctor` says it better
_NO_DRIVER: Final = "Could not find or load the NVIDIA CUDA driver"
_started = threading.Event()
_starting = threading.Lock()
_busy = threading.Lock()
BUILD_FOLDER: Final = re.compile(r"^wp_(.+?)(?:_[0-9a-f]{7,})?_p\d+_t\d+$")
"""Names of folders in the cache in which a module is being compiled."""


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
def report_compiling(say: Callable[[str], None] | None = None, *, every: float = LINES_APART) -> Iterator[None]:
    """Tell when kernels are compiled inside the block, which can take minutes in which nothing else shows: a line at
    its begin, and then now and then which module it is, how many there were and for how long.

    Inside another such block it does nothing.

    Args:
        say: prints a line; by default standard error, where a terminal sees one line that goes on, unless Warp itself
            is to be silent (`warp.config.log_level` above `warp.LOG_WARNING`).
        every: between two lines to `say` while kernels are compiled [s].

    Raises:
        CacheError: a kernel had to be compiled, and cannot be written.
    """
    with _cache_errors(wp.config.kernel_cache_dir or ""), _reporting(say, every):
        yield


@contextlib.contextmanager
def _reporting(say: Callable[[str], None] | None, every: float) -> Iterator[None]:
    if (say is None and wp.config.log_level > wp.LOG_WARNING) or not _busy.acquire(blocking=False):
        yield
        return
    done = threading.Event()
    watcher = threading.Thread(target=_watch, args=(done, say, every), daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()
        _busy.release()


class _Modules:
    """Modules that this process compiles, as their folders in the cache tell."""

    def __init__(self) -> None:
        self.seen: dict[str, None] = {}
        self._began = 0.0

    def compiling(self) -> bool:
        """Look once; return True if one is being compiled."""
        folder, mark = wp.config.kernel_cache_dir, f"_p{os.getpid()}_t"  # Warp builds a module in a folder of that name
        found: list[str] = []
        with contextlib.suppress(OSError):
            found = [name for name in os.listdir(folder) if mark in name] if folder else []
        if found and not self.seen:
            self._began = time.monotonic()
        self.seen.update(dict.fromkeys(found))
        return bool(found)

    @property
    def text(self) -> str:
        """What is compiled: the last module by its name, how many there were, and the time since the first [s]."""
        name = BUILD_FOLDER.sub(r"\1", next(reversed(self.seen)))
        return f"module {len(self.seen)}, {name}, {time.monotonic() - self._began:.0f} s"


def _watch(done: threading.Event, say: Callable[[str], None] | None, every: float) -> None:
    if say is None:
        with contextlib.suppress(OSError, ValueError, AttributeError):
            _watch_on_stderr(done)
        return
    modules, said = _Modules(), -math.inf
    while not done.wait(COMPILING_SHOWS):
        if modules.compiling() and time.monotonic() - said >= every:
            say(COMPILING if said == -math.inf else f"{COMPILING}; {modules.text}")
            said = time.monotonic()


def _watch_on_stderr(done: threading.Event) -> None:
    """Lines on standard error; a terminal's is one that goes on."""
    if not sys.stderr.isatty():
        _watch(done, lambda text: print(f"simwarp: {text}", file=sys.stderr, flush=True), LINES_APART)
        return
    modules = _Modules()
    while not done.wait(COMPILING_SHOWS):
        if modules.compiling():
            print(f"\r\x1b[Ksimwarp: {COMPILING}; {modules.text}", end="", file=sys.stderr, flush=True)
    if modules.seen:
        print(file=sys.stderr, flush=True)
