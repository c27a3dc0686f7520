"""Sensors are launched only in those sub-steps of a round in which one may have work.

A round is the `substeps * read_every` sub-steps between two looks at the sensors' data. Clocks count per world, on the
device. Where all of them began at a look, the host knows in which sub-steps of a round a frame is collected or
published, whatever was reset since. Otherwise, and for sensors that do not tell, all are launched in every sub-step.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from simwarp.simulation.world_launches import Block, WorldLaunch, WorldProgram, WorldShares


class SensorRound(Protocol):
    """What a sensor tells about a round."""

    @property
    def launches(self) -> Sequence[Sequence[Any]]:
        """Recorded launches of each sub-step of a round that begins with a look. Together they leave behind what those
        of every sub-step do, if the clocks of all worlds began at a look.
        """
        ...

    def in_phase(self) -> bool:
        """Whether frames of all worlds begin at whole periods of their clocks, as `launches` takes for granted."""
        ...

    def counts(self) -> npt.NDArray[np.int32]:
        """(W,) sub-steps since the clocks began. Waits for the device, and looks anew whether they are in phase."""
        ...


class SensorRounds:
    """Where the sensors' clocks stand between two looks.

    Args:
        length: sub-steps of a round.
        shares: of the worlds.

    Attributes:
        told: what the sensors tell, in their order; None from one that does not.
        watched: who captures steps asks for `in_step` before every replay, and captures whole rounds.
    """

    def __init__(self, length: int, shares: WorldShares) -> None:
        self.length = length
        self.told: list[SensorRound | None] = []
        self.watched = False
        self._shares = shares
        self._position = 0  # sub-steps since the last look
        self._began_apart = False  # a clock began elsewhere than at a look
        self._begin_captured = False  # replays of it are not seen here
        self._lost = False  # steps may be taken that are not seen here: for good

    @property
    def in_step(self) -> bool:
        """Whether the next sub-step is the first of a round, in all worlds."""
        at_look = self._position == 0 and not self._began_apart and not self._lost
        return at_look and all(one is None or one.in_phase() for one in self.told)

    def whole(self, substeps: int) -> int:
        """Number of rounds among the next sub-steps in which sensors may be launched only where they are due."""
        if not self.told or substeps < self.length or not self.in_step:
            return 0
        if self._shares.device.is_capturing and not self.watched:
            return 0  # the replay may come at another time
        return substeps // self.length

    def pass_by(self, substeps: int) -> None:
        """Counts sub-steps that are taken."""
        rest = substeps % self.length
        if rest and (self._begin_captured or self._shares.device.is_capturing):
            self._lost = True
        self._position = (self._position + rest) % self.length

    def begin_all(self) -> None:
        """The clocks of all worlds begin: this is a look."""
        if self._position and self._shares.device.is_capturing:
            self._lost = True
        self._position, self._began_apart = 0, False

    def begin_some(self) -> None:
        """Clocks of some worlds begin."""
        if self._shares.device.is_capturing:
            self._begin_captured = True
            self._lost = self._lost or self._position != 0
        if self._position:
            self._began_apart = True

    def begin_as_counted(self) -> None:
        """The clocks are others, of a snapshot: takes the position from them. Waits for the device."""
        clocks = [one for one in self.told if one is not None]
        if not clocks:
            return
        if self._shares.device.is_capturing:
            self._lost = True
            return
        positions = np.unique(np.concatenate([one.counts() for one in clocks]) % self.length)
        self._began_apart = len(positions) > 1
        self._position = int(positions[0])


class StepProgram:
    """Steps with launches before each, to be run many times over without Python in between.

    Args:
        rounds: of the sensors.
        shares: of the worlds.
        before: launches before each step.
        physics: launches of a sub-step.
        sensors: those that follow it, of each sensor in turn.
        substeps: of a step.
    """

    def __init__(
        self, rounds: SensorRounds, shares: WorldShares, before: Sequence[WorldLaunch], physics: Sequence[Any],
        sensors: Sequence[Sequence[Any]], substeps: int,
    ) -> None:  # fmt: skip
        self._rounds, self._substeps = rounds, substeps
        every = [*physics, *itertools.chain.from_iterable(sensors)]
        self.everywhere = WorldProgram(shares, step_blocks(before, [every] * substeps))
        self._round = self.everywhere
        if any(one is not None for one in rounds.told):
            due = [
                [*physics, *itertools.chain.from_iterable(
                    launches if one is None else one.launches[k]
                    for one, launches in zip(rounds.told, sensors, strict=True)
                )]
                for k in range(rounds.length)
            ]  # fmt: skip
            steps = [due[first : first + substeps] for first in range(0, rounds.length, substeps)]
            blocks = [block for step in steps for block in step_blocks(before, step)]
            self._round = WorldProgram(shares, merged(blocks))

    def run(self, steps: int) -> None:
        """Takes `steps` steps."""
        for program, times in self._turns(steps):
            program.run(times)

    def launches(self, steps: int) -> Iterator[Any]:
        """What `run` launches, in turn, for whoever launches and times each."""
        for program, times in self._turns(steps):
            yield from program.commands * times

    def _turns(self, steps: int) -> Iterator[tuple[WorldProgram, int]]:
        substeps = steps * self._substeps
        rounds = 0 if self._round is self.everywhere else self._rounds.whole(substeps)
        if rounds:
            yield self._round, rounds
        rest = substeps - rounds * self._rounds.length
        if rest:
            self._rounds.pass_by(rest)
            yield self.everywhere, rest // self._substeps


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
