"""Lines over the last ten seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

WINDOW: Final = 10.0
"""Of time that is shown [s]."""
MOST_LINES: Final = 8
COLORS: Final = ("#d05c20", "#2f6fd0", "#2c9a56", "#a23cb4", "#c0a010", "#1aa0a8", "#c03060", "#707070")


class Chart:
    """A chart on a page, in the folder that is open when it is made.

    Args:
        view: whose page.
        names: of its lines, at most eight.
        title: above it.
    """

    def __init__(self, view: LiveView, names: Sequence[str], title: str = "") -> None:
        gui: Any = view.server.viser.gui
        self._names = tuple(names)[:MOST_LINES]
        self._past: deque[tuple[float, tuple[float, ...]]] = deque()
        lines = [
            {"label": name, "stroke": COLORS[index], "width": 1.5} for index, name in enumerate(self._names)
        ]  # fmt: skip
        empty = tuple(np.zeros(0) for _ in range(1 + len(lines)))
        self._handle = gui.add_uplot(
            empty, ({"label": "s"}, *lines), title=title or None, height=220, scales={"x": {"time": False}},
            legend={"show": True}, padding=(10, 24, 0, 0),
        )  # fmt: skip

    def add(self, time: float, values: Sequence[float]) -> None:
        """Adds a point at a time of the world [s]; one before the last begins anew, the same is none."""
        if self._past and time <= self._past[-1][0]:
            if time == self._past[-1][0]:
                return
            self._past.clear()
        self._past.append((time, tuple(float(value) for value in values[: len(self._names)])))
        while self._past[0][0] < time - WINDOW:
            self._past.popleft()
        numbers = np.array([values for _, values in self._past], np.float64)
        self._handle.data = (np.array([when for when, _ in self._past]), *np.ascontiguousarray(numbers.T))

    def clear(self) -> None:
        """Begins anew."""
        self._past.clear()

    def remove(self) -> None:
        """Takes it off the page."""
        self._handle.remove()
