"""A column of sliders that show numbers and report which of them a person moves."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

HELD: Final = 0.6
"""After a move a slider shows what it was moved to, for so long [s]."""


class Sliders:
    """Sliders in a folder.

    Args:
        view: whose page they are on.
        names: of the sliders.
        low, high: their ends.
        moved: called in the stepping thread with the index and the new value.
    """

    def __init__(
        self, view: LiveView, names: Sequence[str], low: Any, high: Any, moved: Callable[[int, float], None]
    ) -> None:
        self._view, self._moved = view, moved
        self._touched = [-HELD] * len(names)
        self._steps = [step_of(float(high[k]) - float(low[k])) for k in range(len(names))]
        self._handles = [self._made(k, name, float(low[k]), float(high[k])) for k, name in enumerate(names)]

    def __len__(self) -> int:
        return len(self._handles)

    def show(self, values: Any) -> None:
        """Puts them to values, but for those that are just being moved."""
        now = time.perf_counter()
        for k, handle in enumerate(self._handles):
            step = self._steps[k]
            value = float(np.clip(values[k], handle.min, handle.max))
            if not math.isfinite(value) or now < self._touched[k] + HELD or abs(value - handle.value) < 0.5 * step:
                continue
            handle.value = round(value / step) * step

    def remove(self) -> None:
        """Takes them off the page."""
        for handle in self._handles:
            handle.remove()
        self._handles = []

    def _made(self, index: int, name: str, low: float, high: float) -> Any:
        gui: Any = self._view.server.viser.gui
        low, high = (float(f"{end:.4g}") for end in (low, high))
        start = min(max(0.0, low), high)
        handle = gui.add_slider(name, min=low, max=high, step=self._steps[index], initial_value=start)

        # a coroutine: it reads the value before `show` may write another, which one in a pool of threads would not
        @handle.on_update
        async def _(event: Any) -> None:
            if event.client is None:
                return  # set by `show`
            self._touched[index] = time.perf_counter()
            value = float(handle.value)
            self._view.post(lambda: self._moved(index, value))

        return handle


def step_of(span: float) -> float:
    """A round number, some hundredth of a span."""
    return float(10.0 ** math.floor(math.log10(max(span, 1e-6)) - 1.7))
