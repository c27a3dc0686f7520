"""Pace of a simulation by the clock: how long the next step has to wait, and how far it lags."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

MOST_FACTOR: Final = 1000.0
"""Of real time, that may be asked for."""
TOLERANCE: Final = 0.1
"""By which steps may be late and are still made up for [s]: afterwards the time is lost."""
WINDOW: Final = 5.0
"""By the clock, over which a lag is looked at [s]."""
BEHIND: Final = 0.95
"""Share of the factor that was asked for below which it lags."""


class Pace:
    """Keeps simulated time at a factor of the clock's. A step that is late by more than 0.1 s is not made up for: the
    steps after it do not come in a rush.

    Args:
        factor: simulated over clock time; 0: as fast as it goes.
        clock: returns the time [s].

    Attributes:
        factor: may be changed at any time, followed by `begin`.
        lost: by the clock, that was not made up for since the beginning [s].
    """

    def __init__(self, factor: float, clock: Callable[[], float]) -> None:
        self.factor, self.lost = factor, 0.0
        self._clock = clock
        self.begin()

    def begin(self) -> None:
        """From now on: at the beginning, and after a pause."""
        self._due = self._since = self._clock()
        self._done = 0.0

    def wait(self) -> float:
        """Time until the next step may be taken [s]; 0: now."""
        return 0.0 if self.factor == 0.0 else max(self._due - self._clock(), 0.0)

    def step(self, dt: float) -> None:
        """A step of `dt` [s] was taken."""
        self._done += dt
        if self.factor == 0.0:
            return
        self._due += dt / self.factor
        late = self._clock() - self._due
        if late > TOLERANCE:
            self._due += late
            self.lost += late

    def lag(self) -> float | None:
        """After 5 s by the clock, once: the factor that was reached, where it is below the one asked for; else None."""
        now = self._clock()
        gone = now - self._since
        if gone < WINDOW:
            return None
        reached = self._done / gone
        self._since, self._done = now, 0.0
        return reached if reached < BEHIND * self.factor else None
