"""Graphs that each thread records for itself.

Warp's native library keeps the graph that is being recorded on a CPU per thread: a launch of another thread runs as
ever. Its Python half keeps it per process: another thread that copies or allocates at that moment sees a recording that
is not its own, and gets `APIC capture does not yet support wp.copy()`, or leaves its arrays in that graph; a second
thread cannot record at all. A lock of ours would not reach copies that a user's own code makes.
"""

from __future__ import annotations

import threading
from typing import Any, Final

RECORDING: Final = ("_apic_capture", "_apic_graph")
"""Attributes of Warp's runtime that hold the present recording."""


class _OfThread:
    """An attribute with a value of its own in every thread, None at first."""

    def __init__(self, present: Any) -> None:
        self._values = threading.local()
        self._values.present = present

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        return self if instance is None else getattr(self._values, "present", None)

    def __set__(self, instance: object, value: Any) -> None:
        self._values.present = value


def record_per_thread(runtime: Any) -> None:
    """Lets every thread have a recording of its own, or none.

    Args:
        runtime: Warp's, of which there is one. Where it has no such attributes, nothing changes.
    """
    kind = type(runtime)
    for name in RECORDING:
        if name in vars(runtime) and not isinstance(vars(kind).get(name), _OfThread):
            setattr(kind, name, _OfThread(vars(runtime)[name]))
