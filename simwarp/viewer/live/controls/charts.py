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
        viser = view.server.viser
        gui: Any = viser.gui
        self._atomic = viser.atomic
        self._past: deque[tuple[float, tuple[float, ...]]] = deque()
        self._names, series, data = self._empty(names)
        self._handle = gui.add_uplot(
            data, series, title=title or None, height=220, scales={"x": {"time": False}}, legend={"show": True},
            padding=(10, 24, 0, 0), visible=bool(self._names),
        )  # fmt: skip

    def _empty(self, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[Any, ...], tuple[Any, ...]]:
        """Names that are shown, what a page is told of them, and their data before the first point."""
        self._past.clear()
        shown = tuple(names)[:MOST_LINES]
        lines = [{"label": name, "stroke": COLORS[index], "width": 1.5} for index, name in enumerate(shown)]
        # a chart without lines is hidden, and still has to have one
        series = ({"label": "s"}, *(lines or [{"label": ""}]))
        return shown, series, tuple(np.zeros(0) for _ in series)

    def show(self, names: Sequence[str]) -> None:
        """Other lines, which begin anew; none hides the chart."""
        self._names, series, data = self._empty(names)
        with self._atomic():
            self._handle.series, self._handle.data = series, data
            self._handle.visible = bool(self._names)

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
