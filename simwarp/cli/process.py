"""The process around a command: signals that end it, standard streams that are closed or full."""

from __future__ import annotations

import _thread
import atexit
import contextlib
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, Final, NoReturn

ENDING: Final = (signal.SIGTERM, signal.SIGHUP)
"""Signals that end a command as Ctrl-C does: what it began is tidied up."""

LAST_WORDS: Final = 2.0
"""Time that threads, such as writers of logs, are given after an interruption [s]."""

REPEAT_AFTER: Final = 0.05
"""Time after which an interrupt that was lost comes again [s]."""


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let the signals that end a process raise KeyboardInterrupt inside the block.

    A handler that somebody has set stays, as does a signal that is ignored (`nohup`); threads cannot set handlers.
    """
    changed: list[signal.Signals] = []
    before, sys.unraisablehook = sys.unraisablehook, _repeat_interrupt
    if threading.current_thread() is threading.main_thread():
        changed = [number for number in ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in changed:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        sys.unraisablehook = before
        for number in changed:
            if signal.getsignal(number) is _interrupt:
                signal.signal(number, signal.SIG_DFL)


def end_at_signals(code: int) -> None:
    """Let signals end the process with the code of its command, which has done its work: Python only tidies up.

    While threads end, a signal ends the process at once; later, when Python has no handlers any more, it is ignored.
    """
    heard = (_interrupt, signal.default_int_handler)
    numbers = [number for number in (signal.SIGINT, *ENDING) if signal.getsignal(number) in heard]
    for number in numbers:
        signal.signal(number, lambda *_: os._exit(code))
    atexit.register(lambda: [signal.signal(number, signal.SIG_IGN) for number in numbers])


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _repeat_interrupt(lost: sys.UnraisableHookArgs) -> None:
    """Interrupt once more where the first one came inside a `__del__` or a callback, in which exceptions are lost."""
    if isinstance(lost.exc_value, KeyboardInterrupt):
        number = signal.SIGTERM if signal.getsignal(signal.SIGTERM) is _interrupt else signal.SIGINT
        threading.Timer(REPEAT_AFTER, _thread.interrupt_main, (number,)).start()
    else:
        sys.__unraisablehook__(lost)


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
