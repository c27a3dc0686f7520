"""Reference of a sensor's clock: an event list per world, every frame taken, nothing skipped, exact fractions."""

from __future__ import annotations

import dataclasses
from fractions import Fraction


def nearest(time: str, dt: str) -> int:
    """Whole sub-steps nearest to a time, halves up; both in decimal notation."""
    return int((Fraction(time) / Fraction(dt) + Fraction(1, 2)) // 1)


@dataclasses.dataclass(frozen=True)
class Frame:
    """One frame: its number (0: taken when the state was set), the sub-steps it collects, when it is done and seen."""

    number: int
    substeps: tuple[int, ...]
    complete: int
    published: int


def frames(period: int, window: int, lag: int, phase: int, until: int) -> list[Frame]:
    """All frames published up to a count of sub-steps, the one of the beginning first."""
    found = [Frame(0, (), 0, 0)]
    start = phase
    number = 0
    while start + window + lag <= until:
        number += 1
        collected = tuple(range(start + 1, start + window + 1)) if window else (start,)
        if collected[-1] >= 1:  # the instant 0 is the frame of the beginning
            found.append(Frame(number, collected, start + window, start + window + lag))
        start += period
    return found


def read(taken: list[Frame], count: int) -> Frame:
    """What a reader sees: the latest frame published by then."""
    return [frame for frame in taken if frame.published <= count][-1]
