"""What went wrong on the emulated device, with CUDA's codes, and what was counted."""

from __future__ import annotations

import sys
import traceback
from collections import Counter
from types import FrameType

ERRORS = {
    1: "invalid argument", 2: "out of memory", 500: "named symbol not found",
    700: "an illegal memory access was encountered", 716: "misaligned address", 719: "unspecified launch failure",
    900: "operation not permitted when stream is capturing",
    901: "operation failed due to a previous error during capture",
    902: "operation would result in a merge of separate capture sequences",
    904: "capturing stream has unjoined work",
    905: "dependency created on uncaptured work in another stream",
    906: "operation would make the legacy stream depend on a capturing blocking stream",
    907: "operation not permitted on an event last recorded in a capturing stream",
}  # fmt: skip
"""Texts of cudaGetErrorString."""
INNER = ("warp.", "torch.", "tests.emulated_cuda.", "contextlib")
"""Beginnings of the names of modules that are not a user's."""
SHOWN = 20
"""Faults that a report has at most."""


def caller() -> str:
    """File and line outside Warp, torch and the emulated device from which a call came."""
    frame: FrameType | None = sys._getframe(1)
    while frame and str(frame.f_globals.get("__name__")).startswith(INNER):
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}" if frame else "?"


class Faults:
    """Errors of the device's calls.

    Attributes:
        sticky: code of a failed launch, after which all calls fail; 0 where none has failed.
        last_error: text of the last error, for Warp to fetch.
        violations: text and Python's stack of each error.
        hazards: what a GPU would do and a user hardly means, by place.
        waits: places in which the host waited for torch's operators, by line.
        counts: calls, by kind.
        printing: whether errors go to the error stream.
    """

    def __init__(self, *, trace: bool) -> None:
        self.sticky = 0
        self.last_error = b""
        self.violations: list[tuple[str, str]] = []
        self.hazards: Counter[str] = Counter()
        self.waits: Counter[str] = Counter()
        self.counts: Counter[str] = Counter()
        self.printing = True
        self._trace = trace

    def fail(self, code: int, where: str, detail: str = "") -> None:
        """Note an error of CUDA."""
        text = f"Warp CUDA error {code}: {ERRORS.get(code, 'unknown error')} (in function {where})"
        text += f": {detail}" if detail else ""
        self.last_error = text.encode()
        stack = "".join(traceback.format_stack(limit=16)[:-1])
        self.violations.append((text, stack))
        if self.printing:
            print(text, file=sys.stderr)
        if self._trace:
            print(stack, file=sys.stderr)

    def hazard(self, what: str) -> None:
        """Note what a GPU would do and a user hardly means."""
        self.hazards[f"{what} at {caller()}"] += 1

    def clear(self) -> None:
        """Forget a failed launch, as if the process had begun anew."""
        self.sticky = 0
        self.last_error = b""

    def report(self) -> list[str]:
        """Lines about hazards and errors."""
        lines = [f"hazard ({count}): {text}" for text, count in self.hazards.items()]
        return lines + [f"fault: {text}\n{stack}" for text, stack in self.violations[:SHOWN]]
