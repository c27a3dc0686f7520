"""Pieces of recorded runs that are simulated at once, each from a start of its own (multiple shooting)."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.identify.fit_config import FitConfig
from simwarp.identify.fit_error import FitError
from simwarp.identify.logs import RunLog, Signal

Array = npt.NDArray[np.float64]

SMOOTHED: Final = 0.1
"""Time before and after a start, of whose samples it is the mean trend [s]."""
LEAST_SAMPLES: Final = 6
"""In that time; with fewer a start is read between two samples."""


@dataclasses.dataclass(frozen=True)
class Segment:
    """A piece of a run.

    Attributes:
        run: index of the run.
        first: time at which its simulation begins [s].
        begin, end: times between which it is compared [s].
    """

    run: int
    first: float
    begin: float
    end: float

    def samples(self, every: float) -> int:
        """Readings that its simulation takes behind the first one."""
        return max(1, math.ceil((self.end - self.first) / every - 1e-6))

    def times(self, every: float, samples: int) -> Array:
        """(samples + 1,) times of the readings [s]."""
        return np.asarray(self.first + every * np.arange(samples + 1), float)


def segments_of(config: FitConfig, runs: Sequence[RunLog], warmup: float) -> list[Segment]:
    """All segments, equally long within a run.

    Raises:
        FitError: a run is shorter than the time that it takes to settle.
    """
    found = []
    for index, run in enumerate(runs):
        length = run.end - run.begin - warmup
        if length < config.sample:
            raise FitError(
                f"runs[{index}] ({run.config.title}): must be longer than warmup = {warmup:g} s, got "
                f"{run.end - run.begin:g} s from begin to end; shorten warmup"
            )
        count = 1 if config.segment is None else max(1, round(length / config.segment))
        edges = run.begin + warmup + length * np.arange(count + 1) / count
        # the last sample of a run belongs to its last segment
        edges[-1] += 1e-6
        found += [
            Segment(index, float(begin) - warmup, float(begin), float(end)) for begin, end in itertools.pairwise(edges)
        ]
    return found


def value_and_slope(signal: Signal, time: float) -> tuple[float, float]:
    """The trend of a signal at a time: its value and its rate there."""
    near = np.abs(signal.time - time) <= SMOOTHED
    if near.sum() >= LEAST_SAMPLES:
        # a parabola: what bends would have another slope and value at the edge of the time that it is seen
        _, slope, value = np.polyfit(signal.time[near] - time, signal.value[near], 2)
        return float(value), float(slope)
    value = float(signal.at(np.array([time]))[0])
    step = 0.5 * float(np.median(np.diff(signal.time)))
    ends = signal.at(np.array([time - step, time + step]))
    return value, float((ends[1] - ends[0]) / (2.0 * step))


def start_values(run: RunLog, segment: Segment, names: Sequence[str], is_first: bool, noisy: bool) -> dict[str, float]:
    """Values of readings at the start of a segment: given ones of the run, else measured ones.

    Args:
        run: that it is of.
        segment: the piece.
        names: of readings that a world can start with.
        is_first: whether the run's own start is that of the segment.
        noisy: smooth the measured values.
    """
    found: dict[str, float] = {}
    for name in names:
        signal = run.readings[name]
        value, slope = value_and_slope(signal, segment.first)
        if not noisy:
            value = float(signal.at(np.array([segment.first]))[0])
        found[name] = value
        kind, _, part = name.partition(":")
        rate = f"joint_velocity:{part}"
        if kind == "joint_position" and rate not in names:
            found[rate] = slope
    given: Mapping[str, float] = run.config.start if is_first else {}
    return found | dict(given)
