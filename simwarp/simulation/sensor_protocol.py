"""What a Simulation asks of a sensor. The sensors themselves are in `simwarp.sensors`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import warp as wp

if TYPE_CHECKING:
    from simwarp.simulation.simulation import Simulation


class Sensor(Protocol):
    """Measures every world on a clock of its own, inside the step.

    A sensor may also have `check(simulation, dt)`: it raises a ModelError where the sensor cannot be part of the
    Simulation, and changes nothing. All sensors are asked before the first one is recorded.

    A Simulation calls `record` once, launches what it returned after each sub-step, and calls `begin` at construction
    and whenever somebody sets the state of worlds: `reset`, `set_joint_state` and `measure`.
    """

    @property
    def name(self) -> str:
        """Unique among the sensors of a Simulation."""
        ...

    @property
    def data(self) -> wp.array:
        """(W, ...) the latest frame that is published; the same memory throughout."""
        ...

    @property
    def timestamp(self) -> wp.array:
        """(W,) float64 [s]: the world's time when that frame was complete."""
        ...

    @property
    def valid(self) -> wp.array:
        """(W,) bool: false in worlds that are frozen (`WorldStatus.NON_FINITE`)."""
        ...

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Everything that outlives a sub-step, contiguous arrays: part of snapshots. A reset leaves it to `begin`."""
        ...

    def record(self, simulation: Simulation, dt: float) -> Sequence[Any]:
        """Recorded launches (`wp.launch(..., record_cmd=True)`) that follow each sub-step of `dt` seconds."""
        ...

    def begin(self, simulation: Simulation, mask: wp.array[wp.bool]) -> None:
        """Forgets the worlds of the (W,) mask and publishes a frame of their present state at once."""
        ...
