"""Time by the clock beside time in the simulation."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

WINDOW: Final = 1.0
"""Time by the clock over which the factor is measured [s]."""
LATE: Final = 0.25
"""A delay that is not made up for [s]: time stretches, steps are never skipped."""


class Pace:
    """Holds steps of `dt` [s] to a speed.

    Attributes:
        factor: simulated time over time by the clock, of the last second.
    """

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self.factor = 0.0
        self._due = time.perf_counter()
        self._past: deque[float] = deque()

    def rest(self) -> None:
        """Nothing is made up for after a pause."""
        self._due = time.perf_counter()
        self._past.clear()
        self.factor = 0.0

    def wait(self, speed: float, meanwhile: Callable[[], None]) -> None:
        """Waits until the next step is due at a speed; 0: not at all."""
        now = time.perf_counter()
        self._past.append(now)
        while self._past[0] < now - WINDOW:
            self._past.popleft()
        if len(self._past) > 1:
            self.factor = self._dt * (len(self._past) - 1) / max(now - self._past[0], 1e-9)
        if speed <= 0.0:
            self._due = now
            return
        self._due = max(self._due + self._dt / speed, now - LATE)
        while now < self._due:
            time.sleep(min(self._due - now, 0.02))
            meanwhile()
            now = time.perf_counter()
