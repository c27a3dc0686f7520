"""Signals that request a process to stop: Ctrl-C, SIGTERM, SIGHUP of a closed terminal, Ctrl-Break of Windows.

One request often comes several times: batch systems signal every process of a job, ``timeout`` a command and then its
whole group, ``torchrun`` forwards signals that its processes have already received. So copies within a second count as
one request. What it does depends on what the process is at:

==================================  ==========================  ==============================
inside                              the first request           a later one
==================================  ==========================  ==============================
:func:`interrupted_by_signals`      raises KeyboardInterrupt    raises KeyboardInterrupt
:func:`stop_on_signals`             is noted                    raises KeyboardInterrupt
its :meth:`StopRequest.saving`      is noted                    is noted
:func:`exit_at_signals` was called  ends the process at once    --
==================================  ==========================  ==============================

All of them share one handler, so that a copy is known as one whatever the process has gone on to since.
"""

from __future__ import annotations

import _thread
import contextlib
import dataclasses
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final

HEARD: Final = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)]
COPIES_WITHIN: Final = 1.0
"""Time after a request in which further signals are copies of it [s]."""
REPEAT_AFTER: Final = 0.05
"""Time after which an interrupt that was lost comes again [s]."""


@dataclasses.dataclass
class StopRequest:
    """Request to stop at the next good moment.

    Attributes:
        times: how often it was made; copies do not count.
        first: when it was made first, by the monotonic clock [s].
    """

    times: int = 0
    first: float = math.nan
    _saving: bool = dataclasses.field(default=False, repr=False)

    @property
    def requested(self) -> bool:
        """True from the first request on."""
        return self.times > 0

    @property
    def at_once(self) -> bool:
        """True from the second request on: save unsaved work, and do nothing else."""
        return self.times > 1

    @property
    def age(self) -> float:
        """Time since the first request [s]; 0 before it."""
        return time.monotonic() - self.first if self.requested else 0.0

    def ask(self) -> None:
        """Make the request.

        Raises:
            KeyboardInterrupt: it was made before, and nothing is being saved.
        """
        self.times += 1
        if self.times == 1:
            self.first = time.monotonic()
        elif not self._saving:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def saving(self) -> Iterator[None]:
        """Let no request raise anything inside the block, which must look at :attr:`requested` and :attr:`at_once`."""
        before, self._saving = self._saving, True
        try:
            yield
        finally:
            self._saving = before


class _Listener:
    """The one handler of all signals; ``reactions`` is what a request does, the last one counts."""

    def __init__(self) -> None:
        self.reactions: list[Callable[[], None]] = []
        self._counted = -math.inf

    @property
    def requested(self) -> bool:
        """True from the first request on."""
        return self._counted > -math.inf

    def __call__(self, number: int, frame: object) -> None:
        now = time.monotonic()
        if self.reactions and now - self._counted >= COPIES_WITHIN:
            self._counted = now
            self.reactions[-1]()

    def repeat(self) -> None:
        """Make the last request once more: what it raised was lost."""
        self._counted = -math.inf
        number = next((number for number in HEARD if signal.getsignal(number) is self), None)
        if number is not None:
            threading.Timer(REPEAT_AFTER, _thread.interrupt_main, (number,)).start()

    def outlast_copies(self) -> None:
        """Wait until no more copies of the last request are to come: others would take them for requests."""
        time.sleep(max(0.0, self._counted + COPIES_WITHIN - time.monotonic()))


_listener: _Listener | None = None


@contextlib.contextmanager
def _listening(reaction: Callable[[], None], *, also_instead_of: bool) -> Iterator[_Listener | None]:
    """Let signals do something inside the block; None outside the main thread, where that is impossible.

    Args:
        reaction: what a request does.
        also_instead_of: also where somebody has set a handler. A signal that is ignored, as by `nohup` and for work in
            the background of a shell, stays ignored.
    """
    global _listener
    if threading.current_thread() is not threading.main_thread():
        yield None
        return
    outer, listener = _listener, _listener or _Listener()
    usual = (signal.SIG_DFL, signal.default_int_handler)
    handlers = {number: signal.getsignal(number) for number in HEARD}
    kept = (None, signal.SIG_IGN, listener)  # None: a handler of a C library, which Python cannot put back
    taken = {
        number: handler
        for number, handler in handlers.items()
        if handler not in kept and (also_instead_of or handler in usual)
    }
    listener.reactions.append(reaction)
    _listener = listener
    for number in taken:
        signal.signal(number, listener)
    try:
        yield listener
    finally:
        if outer is None:
            listener.outlast_copies()
        for number, handler in taken.items():
            if signal.getsignal(number) is listener:
                signal.signal(number, handler)
        listener.reactions.remove(reaction)
        _listener = outer


@contextlib.contextmanager
def stop_on_signals() -> Iterator[StopRequest]:
    """Turn the first request into one to stop at the next good moment; a later one raises KeyboardInterrupt.

    So nothing is torn in the middle: an episode is evaluated to its end, a picture drawn to its end. Work that loses
    something by an interrupt puts it into :meth:`StopRequest.saving`.
    """
    request = StopRequest()
    with _listening(request.ask, also_instead_of=True):
        yield request


@contextlib.contextmanager
def interrupted_by_signals() -> Iterator[Callable[[], bool]]:
    """Let requests raise KeyboardInterrupt inside the block, also where Python drops what is raised.

    A handler that somebody has set stays. The block gets a function that is true once there was a request: libraries
    make other errors of what interrupts them.
    """
    with _listening(_interrupt, also_instead_of=False) as listener:
        before, sys.unraisablehook = sys.unraisablehook, _repeating(listener)
        try:
            yield lambda: listener is not None and listener.requested
        finally:
            sys.unraisablehook = before


def exit_at_signals(code: int) -> None:
    """Let requests end the process from now on, with an exit code: all that is left for it to do is to tidy up."""
    if _listener is not None:
        _listener.reactions.append(lambda: os._exit(code))


def _interrupt() -> None:
    raise KeyboardInterrupt


def _repeating(listener: _Listener | None) -> Callable[[sys.UnraisableHookArgs], object]:
    """Return a hook that interrupts once more where the first one came inside a `__del__` or a callback."""

    def hook(lost: sys.UnraisableHookArgs) -> None:
        if isinstance(lost.exc_value, KeyboardInterrupt) and listener is not None:
            listener.repeat()
        else:
            sys.__unraisablehook__(lost)

    return hook
