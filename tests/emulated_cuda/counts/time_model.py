"""A kernel's time on an H100 by model, from counts of the emulated device.

A warp that runs alone takes its instructions' latencies and a round trip per round of loads; warps that share a
multiprocessor queue for its schedulers (an instruction per cycle each) and its load-store unit (a sector per cycle).

    t = waves max(throughput of memory, f latency + w max(slots / 4, s sectors)) / clock + launch

with w warps on the busiest multiprocessor. Latencies and rates are published figures. The factor f on latency, which
stands for what the counts do not see (address arithmetic in the way of a load, scheduling, spills), and the cycles s
per sector were fitted once, to times of kernels that an H200 measured (`tests/data/gpu_model.json`, docs/gpu.md), and
stay as they are. `benchmarks/gpu_model_check.py` prints both side by side.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Final

from tests.emulated_cuda.counts.launch_counts import SECTOR, KernelCount

WARP: Final = 32
UNKNOWN_REGISTERS: Final = 168
"""Budget of our kernels: what is assumed where no assembler says how many registers a thread has."""


@dataclasses.dataclass(frozen=True)
class Gpu:
    """Figures of a GPU.

    Attributes:
        multiprocessors: of the device.
        schedulers, registers, warps: of a multiprocessor; so many warps run at a time at most.
        clock: [Hz].
        l1_bytes, l2_bytes: caches of a multiprocessor and of the device.
        l1_latency, l2_latency, memory_latency: cycles of a load that is answered there.
        l2_rate, memory_rate: [bytes/s].
        launch: of a kernel in a graph [s].
        latency_factor, sector_cycles: fitted; see above.
    """

    multiprocessors: int = 132
    schedulers: int = 4
    registers: int = 65536
    warps: int = 64
    clock: float = 1.755e9
    l1_bytes: int = 192 << 10
    l2_bytes: int = 50 << 20
    l1_latency: float = 38.0
    l2_latency: float = 265.0
    memory_latency: float = 600.0
    l2_rate: float = 5.5e12
    memory_rate: float = 3.0e12
    launch: float = 2.0e-6
    latency_factor: float = 1.6
    sector_cycles: float = 1.4


H100: Final = Gpu()


@dataclasses.dataclass(frozen=True)
class Occupancy:
    """Warps of a launch on the busiest multiprocessor: `warps` at a time, `waves` times."""

    warps: int
    waves: int


def occupancy(gpu: Gpu, *, warps: int, block: int, registers: int) -> Occupancy:
    """How a launch of so many warps spreads.

    Args:
        block: threads of a block.
        registers: of a thread.
    """
    of_block = math.ceil(block / WARP)
    per_warp = math.ceil(registers * WARP / 256) * 256
    resident = max(1, min(gpu.registers // (per_warp * of_block), gpu.warps // of_block))
    blocks = math.ceil(math.ceil(warps / of_block) / gpu.multiprocessors)
    return Occupancy(min(blocks, resident) * of_block, math.ceil(blocks / resident))


def kernel_seconds(gpu: Gpu, count: KernelCount, *, warps: int, registers: int, block: int | None = None) -> float:
    """Time of one launch.

    Args:
        count: of some of the warps; the launch is of `warps` like them.
        block: threads of a block; by default as counted.
    """
    spread = occupancy(gpu, warps=warps, block=count.block if block is None else block, registers=registers)
    beyond_l1 = count.l1_misses / max(count.load_sectors, 1)
    beyond_l2 = count.l2_misses / max(count.l1_misses, 1)
    load = gpu.l1_latency + beyond_l1 * (gpu.l2_latency - gpu.l1_latency)
    load += beyond_l1 * beyond_l2 * (gpu.memory_latency - gpu.l2_latency)
    sectors = (count.load_sectors + count.store_sectors) / count.warps
    latency = (count.cycles + count.rounds * load) / count.warps
    issue = count.slots / count.warps / gpu.schedulers
    alone = gpu.latency_factor * latency + spread.warps * max(issue, gpu.sector_cycles * sectors)
    share = warps / count.warps
    from_l2 = SECTOR * (count.l1_misses + count.store_sectors) * share / gpu.l2_rate
    from_memory = count.bytes_of_memory * share / gpu.memory_rate
    return max(spread.waves * alone / gpu.clock, from_l2, from_memory) + gpu.launch
