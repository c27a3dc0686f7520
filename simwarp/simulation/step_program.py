"""The program of a control step: launches of the physics and the sensors that are run many times over."""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextvars import ContextVar
from typing import Any

from simwarp.simulation.read_interval import ReadInterval
from simwarp.simulation.world_launches import Block, WorldLaunch, WorldProgram, WorldShares


class Phase(enum.Enum):
    """Part of a step that launches belong to."""

    PHYSICS = "physics"
    SENSORS = "sensors"


@dataclasses.dataclass
class PhaseTimes:
    """Time by phase of the steps in a context [s]; see :func:`timed_phases`.

    Attributes:
        wait: returns when the device is done.
        seconds: so far.
    """

    wait: Callable[[], None]
    seconds: dict[Phase, float] = dataclasses.field(default_factory=lambda: dict.fromkeys(Phase, 0.0))

    def launch(self, phase: Phase | None, commands: Iterable[Any]) -> None:
        """Launch commands, and add their time to that of the phase; None: they belong to none."""
        self.wait()
        start = time.perf_counter()
        for command in commands:
            command.launch()
        if phase is not None:
            self.wait()
            self.seconds[phase] += time.perf_counter() - start


_TIMES: ContextVar[PhaseTimes | None] = ContextVar("_TIMES", default=None)


@contextlib.contextmanager
def timed_phases(wait: Callable[[], None]) -> Iterator[PhaseTimes]:
    """Context in which steps launch one command after the other and are timed by phase; their results stay the same.

    Steps that are replayed from a graph run no program, and are not timed.

    Args:
        wait: returns when the device is done.
    """
    times = PhaseTimes(wait)
    token = _TIMES.set(times)
    try:
        yield times
    finally:
        _TIMES.reset(token)


class StepProgram:
    """Steps with launches before each, to be run many times over without Python in between.

    Args:
        interval: between two reads of the sensors' data.
        shares: of the worlds.
        before: launches before each step.
        physics: launches of a sub-step.
        shown: those that publish what only sensors and whoever reads between steps see.
        sensors: those that follow a sub-step, of each sensor in turn.
        substeps: of a step.

    Attributes:
        every: a step in which all sensors are launched in every sub-step.
        shown: what comes once behind the last sub-step of a run.
    """

    def __init__(
        self, interval: ReadInterval, shares: WorldShares, before: Sequence[WorldLaunch], physics: Sequence[Any],
        shown: Sequence[Any], sensors: Sequence[Sequence[Any]], substeps: int,
    ) -> None:  # fmt: skip
        self._interval, self._substeps = interval, substeps
        self._phases: dict[Any, Phase] = dict.fromkeys(physics, Phase.PHYSICS)
        due_sometimes = (launches for each in interval.sensors if each is not None for launches in each.launches)
        self._phases |= dict.fromkeys(itertools.chain(*sensors, *due_sometimes), Phase.SENSORS)

        def substep(measuring: Iterable[Sequence[Any]]) -> list[Any]:
            due = list(itertools.chain.from_iterable(measuring))
            return [*physics, *(shown if due else ()), *due]

        every = substep(sensors)
        self.shown = WorldProgram(shares, [(tuple(shown), 1)])
        self.every = WorldProgram(shares, step_blocks(before, [every] * substeps))
        self._whole = self.every
        if any(interval.sensors):
            due = [
                substep(
                    launches if each is None else each.launches[k]
                    for each, launches in zip(interval.sensors, sensors, strict=True)
                )
                for k in range(interval.length)
            ]  # fmt: skip
            steps = [due[first : first + substeps] for first in range(0, interval.length, substeps)]
            self._whole = WorldProgram(shares, merged([block for step in steps for block in step_blocks(before, step)]))

    def run(self, steps: int) -> None:
        """Runs `steps` steps."""
        timed = _TIMES.get()
        if timed is not None:
            for phase, commands in itertools.groupby(self._launches(steps), self._phases.get):
                timed.launch(phase, commands)
            return
        for program, times in self._programs(steps):
            program.run(times)

    def _launches(self, steps: int) -> Iterator[Any]:
        """What `run` launches, in turn."""
        for program, times in self._programs(steps):
            yield from program.commands * times

    def _programs(self, steps: int) -> Iterator[tuple[WorldProgram, int]]:
        """Whole read intervals, the steps that are left, and what is shown, each with how often it runs."""
        substeps = steps * self._substeps
        intervals = 0 if self._whole is self.every else self._interval.whole(substeps)
        if intervals:
            yield self._whole, intervals
        rest = substeps - intervals * self._interval.length
        if rest:
            self._interval.advance(rest)
            yield self.every, rest // self._substeps
        if steps and self.shown.commands:
            yield self.shown, 1


def step_blocks(before: Sequence[Any], parts: Sequence[Sequence[Any]]) -> list[Block]:
    """A step of these sub-steps as blocks, the fewer the better: each is launched as a whole."""
    if not before:
        return merged([(tuple(part), 1) for part in parts])
    return [((*before, *itertools.chain.from_iterable(parts)), 1)]


def merged(blocks: Sequence[Block]) -> list[Block]:
    """Blocks, of which equal neighbours are one that is repeated."""
    found: list[Block] = []
    for commands, times in blocks:
        if found and found[-1][0] == commands:
            found[-1] = (commands, found[-1][1] + times)
        else:
            found.append((commands, times))
    return found
