"""The program of a control step: launches of the physics and the sensors that are run many times over."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from simwarp.simulation.read_interval import ReadInterval
from simwarp.simulation.world_launches import Block, WorldLaunch, WorldProgram, WorldShares


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
        for program, times in self._programs(steps):
            program.run(times)

    def launches(self, steps: int) -> Iterator[Any]:
        """What `run` launches, in turn, for whoever launches and times each."""
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
