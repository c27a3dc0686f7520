"""The process around a command: its end, and standard streams that are closed or full."""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import sys
import threading
from typing import Any, Final, NoReturn

LAST_WORDS: Final = 2.0
"""Time that threads, such as writers of logs, are given after an interruption [s]."""


def prepare_streams() -> None:
    """Take the numbers of closed standard streams, and let the others print any text.

    Otherwise the next file that is opened would become the standard output, and get all that is printed.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
    if sys.stderr is None:
        # print() would send to standard output what is meant for it
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def silence_output() -> None:
    """Send what is still to be printed nowhere: Python would complain about it while it exits."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except OSError:
            _redirect(stream)


def leave(code: int) -> NoReturn:
    """End the process after its command has done its work: threads end, exit functions run.

    Python does not take its modules apart, which takes a second with torch and Warp and serves nobody.
    """
    vars(threading)["_shutdown"]()  # waits for all threads, those of executors too, as Python does at its end
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(code)


def leave_at_once(code: int) -> NoReturn:
    """End the process after an interruption: threads end, exit functions run, but Python does not take modules apart.

    An interruption may have come while a library with threads of its own was half loaded: taking it apart ends the
    process by SIGABRT instead of with its exit code.
    """
    for thread in threading.enumerate():
        if not thread.daemon and thread is not threading.current_thread():
            thread.join(LAST_WORDS)
    atexit._run_exitfuncs()
    silence_output()
    os._exit(code)


def _redirect(stream: Any) -> None:
    """Point a stream at the null device; one that only looks like a file has none to point."""
    with contextlib.suppress(OSError):
        number = stream.fileno()
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, number)
        os.close(null)
        stream.flush()
