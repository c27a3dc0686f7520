"""Force elements: rooms such as tires and engines that act on bodies and joints every step, with states of their own.

A Simulation launches them before its step. They read the state and write `Control.element_force`, `element_torque` and
`element_joint_force`, each its own entries; their states are part of resets and snapshots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import warp as wp

from simwarp.core.types import ModelError

if TYPE_CHECKING:
    from simwarp.simulation.simulation import Simulation


class ForceElement(Protocol):
    """What a Simulation asks of a room that applies forces. One that also measures has `record_after`, like `record`,
    for launches that follow each sub-step.
    """

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that outlives a step: arrays of leading dimension W, of four or eight bytes per number. At
        construction they hold the values that a reset brings back.
        """
        ...

    def record(self, simulation: Simulation, dt: float) -> Sequence[Any]:
        """Recorded launches (`wp.launch(..., record_cmd=True)`) that come before each sub-step of `dt` seconds."""
        ...


def words(array: wp.array, world_count: int) -> wp.array:
    """The array's memory as (W, n) int32.

    Raises:
        ModelError: its rows are not those of worlds, or hold no whole words.
    """
    size = array.size * wp.types.type_size_in_bytes(array.dtype)
    if array.shape[0] != world_count or not array.is_contiguous or size % (4 * world_count):
        raise ModelError(
            f"force element: memory must be contiguous with leading dimension {world_count} and whole words, "
            f"got {array.dtype.__name__}{tuple(array.shape)}"
        )
    return wp.array(
        ptr=array.ptr, dtype=wp.int32, shape=(world_count, size // (4 * world_count)), device=array.device, copy=False
    )
