"""Sensors are launched only in those sub-steps of a read interval in which they may have work.

A read interval is the `substeps * read_every` sub-steps between two reads of the sensors' data. Each world has clocks
of its own, on the device. Where all clocks began at a read, the host knows in which sub-steps of an interval a frame is
collected or published. A reset of some worlds at a read does not change that. Where a clock began elsewhere, all
sensors are launched in every sub-step. A sensor without `Sensor.record_interval` always is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from simwarp.simulation.world_launches import WorldShares


class IntervalLaunches(Protocol):
    """The launches of a sensor in a read interval, each only in the sub-steps in which it is due."""

    @property
    def launches(self) -> Sequence[Sequence[Any]]:
        """Recorded launches of each sub-step. Together they leave behind what those of every sub-step do, if the clocks
        of all worlds began at a read.
        """
        ...

    def in_phase(self) -> bool:
        """Whether frames of all worlds begin at whole periods of their clocks. `launches` are right only then."""
        ...

    def counts(self) -> npt.NDArray[np.int32]:
        """(W,) sub-steps since the clocks began. Waits for the device, and updates `in_phase`."""
        ...


class ReadInterval:
    """Where the sensors' clocks stand between two reads of their data.

    Args:
        length: of the interval [sub-steps].
        shares: of the worlds.

    Attributes:
        sensors: launches of each sensor that are due in an interval, in their order; None: all in every sub-step.
        asked_before_replay: True if whoever captures steps reads `at_start` before every replay, and captures whole
            intervals.
    """

    def __init__(self, length: int, shares: WorldShares) -> None:
        self.length = length
        self.sensors: list[IntervalLaunches | None] = []
        self.asked_before_replay = False
        self._shares = shares
        self._position = 0  # sub-steps since the last read
        self._began_apart = False  # a clock began elsewhere than at a read
        self._begin_captured = False  # replays of it are not seen here
        self._lost = False  # a replayed graph may have advanced the clocks unseen: for good

    @property
    def at_start(self) -> bool:
        """Whether the next sub-step is the first of an interval, in all worlds."""
        return self._position == 0 and self.in_step

    def whole(self, substeps: int) -> int:
        """Number of intervals among the next sub-steps in which sensors may be launched only where they are due."""
        if not self.sensors or substeps < self.length or not self.at_start:
            return 0
        if self._shares.device.is_capturing and not self.asked_before_replay:
            return 0  # the replay may come at another time
        return substeps // self.length

    def advance(self, substeps: int) -> None:
        """Counts sub-steps in which all sensors are launched."""
        rest = substeps % self.length
        if rest and (self._begin_captured or self._shares.device.is_capturing):
            self._lost = True
        self._position = (self._position + rest) % self.length

    def begin_all(self) -> None:
        """The clocks of all worlds begin: this is a read."""
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

    def begin_like(self, other: ReadInterval) -> None:
        """Clocks of some worlds become those of another simulation, or of one's own. The host knows where these stand,
        and need not wait: where they stand elsewhere, all sensors are launched in every sub-step.
        """
        if other is self or not any(self.sensors):
            return
        if self._shares.device.is_capturing:
            self._lost = True  # the replay may find the clocks of the other elsewhere
        elif not other.in_step or not self.in_step or other._position != self._position:
            self._began_apart = True

    @property
    def in_step(self) -> bool:
        """Whether the clocks of all worlds began at a read, without a phase."""
        together = not self._began_apart and not self._lost
        return together and all(each is None or each.in_phase() for each in self.sensors)

    def begin_from_clocks(self) -> None:
        """Reads the position from the clocks, which a snapshot has set. Waits for the device."""
        clocks = [each for each in self.sensors if each is not None]
        if not clocks:
            return
        if self._shares.device.is_capturing:
            self._lost = True
            return
        positions = np.unique(np.concatenate([each.counts() for each in clocks]) % self.length)
        self._began_apart = len(positions) > 1
        self._position = int(positions[0])
