"""Counts of what kernels would do on a GPU: issue slots, sectors, misses of the caches. See warp_counts.c."""

from __future__ import annotations

import ctypes
import dataclasses
from typing import Any, Final

import numpy as np

from tests.emulated_cuda.ptx.control_flow import CLASSES

SUMS: Final = (
    "warps", "slots", "lane_slots", "longest_lane", "rounds", "cycles", "loads", "load_sectors", "stores",
    "store_sectors", "l1_misses", "l2_misses", "written_back",
)  # fmt: skip
"""As in warp_counts.c, where the instructions by class follow."""
SECTOR: Final = 32
"""Bytes."""


class FlowTables:
    """Control flow of a module as arrays (`ControlFlow.facts`)."""

    def __init__(self, facts: dict[str, Any]) -> None:
        self.meeting = np.array(facts["meeting"], np.int32)
        self.after_call = np.array(facts["after_call"], np.int32)
        self.weights = np.array(facts["weights"], np.uint32).reshape(-1, len(CLASSES) + 2)


@dataclasses.dataclass(frozen=True)
class KernelCount:
    """What the launches of a kernel did, summed over their warps.

    Attributes:
        kernel: its name.
        launches, block: how often it ran, with so many threads in a block.
        warps: of all launches.
        slots: instructions that warps issued; lanes that parted at a branch issue theirs one group after the other.
        lane_slots: the same times the lanes that took part. A warp has 32.
        longest_lane: instructions of the lane with the most, of each warp.
        rounds: loads from global memory that had to wait for one another.
        cycles: of warps that run alone, where loads from global memory would come at once.
        loads, load_sectors: requests of warps to global memory, and sectors of 32 bytes that they touch.
        stores, store_sectors: the same of stores and atomics.
        l1_misses, l2_misses: sectors of loads that were not in the first and in the second cache.
        written_back: sectors that the second cache had to write to memory.
        instructions: issued, by class.
    """

    kernel: str
    launches: int
    block: int
    warps: int
    slots: int
    lane_slots: int
    longest_lane: int
    rounds: int
    cycles: int
    loads: int
    load_sectors: int
    stores: int
    store_sectors: int
    l1_misses: int
    l2_misses: int
    written_back: int
    instructions: dict[str, int]

    @property
    def bytes_of_memory(self) -> int:
        """Bytes that go beyond the second cache, in both directions."""
        return SECTOR * (self.l2_misses + self.written_back)


@dataclasses.dataclass
class _Sums:
    launches: int
    block: int
    values: np.ndarray[Any, np.dtype[np.uint64]]


class LaunchCounts:
    """Counts launches between `start` and `stop` by kernel.

    Those in which several warps of a block wait for each other are left out.

    Args:
        runtime: library of the runtime of device code.
    """

    def __init__(self, runtime: ctypes.PyDLL) -> None:
        self._runtime = runtime
        self._on = False
        self._sums: dict[str, _Sums] = {}

    def start(self, *, l1_bytes: int, l2_bytes: int) -> None:
        """Count from now on, from nothing.

        Args:
            l1_bytes: a warp's share of the first cache.
            l2_bytes: of the second cache. Where few worlds stand for many, their share of it.
        """
        self._runtime.emu_count_caches(ctypes.c_uint64(l1_bytes), ctypes.c_uint64(l2_bytes))
        self._sums, self._on = {}, True

    def clear(self) -> None:
        """Forget the counts; the caches keep what they hold."""
        self._sums = {}

    def stop(self) -> list[KernelCount]:
        """Count no more; a row per kernel, in the order of their first launches."""
        self._on = False
        rows = []
        for name, sums in self._sums.items():
            values = [int(value) for value in sums.values]
            by_class = dict(zip(CLASSES, values[len(SUMS) :], strict=True))
            known = dict(zip(SUMS, values[: len(SUMS)], strict=True))
            rows.append(KernelCount(name, sums.launches, sums.block, **known, instructions=by_class))
        return rows

    def prepare(self, kernel: str, tables: FlowTables | None, block: int) -> None:
        """Before a launch: say into which sums it is counted, or that it is not (`tables` is None)."""
        if not self._on or tables is None:
            self._runtime.emu_count_into(None, None, None, None, 0)
            return
        sums = self._sums.setdefault(kernel, _Sums(0, block, np.zeros(len(SUMS) + len(CLASSES), np.uint64)))
        sums.launches += 1
        arrays = (sums.values, tables.meeting, tables.after_call, tables.weights)
        self._runtime.emu_count_into(*(ctypes.c_void_p(each.ctypes.data) for each in arrays), len(CLASSES))
