"""Long work that is asked to stop: by Ctrl-C, or by whoever runs the machine."""

from __future__ import annotations

import contextlib
import dataclasses
import signal
import threading
from collections.abc import Iterator
from typing import Final

HEARD: Final = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@dataclasses.dataclass
class StopRequest:
    """Request to stop at the next good moment."""

    requested: bool = False


@contextlib.contextmanager
def stop_on_signals() -> Iterator[StopRequest]:
    """Turn the first Ctrl-C, SIGTERM or closed terminal (SIGHUP) into a request to stop; a second one stops at once.

    So nothing is torn in the middle: the iteration of a training is left whole, a picture is drawn to its end. A signal
    that the process was started to ignore, as shells do for work in the background, stays ignored.
    """
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def ask(number: int, frame: object) -> None:
        if request.requested:
            raise KeyboardInterrupt
        request.requested = True

    heard = [number for number in HEARD if signal.getsignal(number) is not signal.SIG_IGN]
    previous = {number: signal.signal(number, ask) for number in heard}
    try:
        yield request
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
