"""Clocks and counters: speed of a step, launches in it, memory behind it, kernels compiled for it."""

from __future__ import annotations

import contextlib
import dataclasses
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol
from unittest import mock

import warp as wp

from simwarp.simulation.world_launches import WorldProgram

REPEATS = 5
_CHUNK_SECONDS = 0.05


class Steppable(Protocol):
    """Something that is stepped until its horizon and then starts anew."""

    horizon_steps: int

    def step(self) -> None:
        """One step of all worlds."""

    def restart(self) -> None:
        """Back to the start of the motion."""

    def wait(self) -> None:
        """Waits until the device has finished all work."""


@dataclasses.dataclass(frozen=True)
class Speed:
    """World-steps per second, the median of the repeats.

    Attributes:
        steps_per_s: by the clock on the wall.
        steps_per_cpu_s: by the CPU time of this process: what other processes do hardly shows.
        repeats: (wall, CPU) of each repeat.
        steps: of all worlds together, as timed.
    """

    steps_per_s: float
    steps_per_cpu_s: float
    repeats: tuple[tuple[float, float], ...]
    steps: int


def measure_speed(
    run: Steppable, worlds: int, seconds: float, check: Callable[[], object], *, repeats: int = REPEATS
) -> Speed:
    """Steps for `seconds` altogether; `check` is called, untimed, wherever the motion ends. Restarts are not timed."""
    chunk = _chunk_size(run)
    rates: list[tuple[float, float]] = []
    total = 0
    for _ in range(repeats):
        run.restart()
        steps, since_restart, wall, cpu = 0, 0, 0.0, 0.0
        while wall < seconds / repeats:
            if since_restart >= run.horizon_steps:
                check()
                run.restart()
                since_restart = 0
            count = min(chunk, run.horizon_steps - since_restart)
            run.wait()
            wall_start, cpu_start = time.perf_counter(), time.process_time()
            for _ in range(count):
                run.step()
            run.wait()
            wall += time.perf_counter() - wall_start
            cpu += time.process_time() - cpu_start
            steps += count
            since_restart += count
        check()
        rates.append((steps * worlds / wall, steps * worlds / max(cpu, 1e-9)))
        total += steps * worlds
    wall_rates, cpu_rates = zip(*rates, strict=True)
    return Speed(statistics.median(wall_rates), statistics.median(cpu_rates), tuple(rates), total)


def _chunk_size(run: Steppable) -> int:
    """Steps that take long enough for the clock, found by doubling; also warms the caches up."""
    run.restart()
    count = 1
    while True:
        run.wait()
        start = time.perf_counter()
        for _ in range(count):
            run.step()
        run.wait()
        took = time.perf_counter() - start
        if took > 0.2 * _CHUNK_SECONDS or 2 * count > run.horizon_steps:
            return max(1, min(run.horizon_steps, round(count * _CHUNK_SECONDS / max(took, 1e-9))))
        count *= 2


@dataclasses.dataclass
class LaunchCount:
    """Launches seen so far: of kernels, and of recorded graphs (each one call, whatever it holds)."""

    kernels: int = 0
    graphs: int = 0

    @property
    def total(self) -> int:
        """Both."""
        return self.kernels + self.graphs


@contextlib.contextmanager
def counted_launches() -> Iterator[LaunchCount]:
    """Counts what is launched through Warp inside the block, as for one chunk of worlds."""
    count = LaunchCount()
    launch, replay, graph, program = wp.launch, wp.Launch.launch, wp.capture_launch, WorldProgram.run

    def fresh(*args: Any, **kwargs: Any) -> Any:
        count.kernels += not kwargs.get("record_cmd", False)
        return launch(*args, **kwargs)

    def recorded(self: wp.Launch, *args: Any, **kwargs: Any) -> Any:
        count.kernels += 1
        return replay(self, *args, **kwargs)

    def captured(*args: Any, **kwargs: Any) -> Any:
        count.graphs += 1
        return graph(*args, **kwargs)

    def advanced(self: WorldProgram, times: int) -> None:
        before = dataclasses.replace(count)
        program(self, times)
        # on a CPU the kernels of a program are launched by native code
        count.kernels, count.graphs = before.kernels + times * len(self.commands), before.graphs

    with (
        mock.patch.object(WorldProgram, "run", advanced),
        mock.patch.object(wp, "launch", fresh),
        mock.patch.object(wp.Launch, "launch", recorded),
        mock.patch.object(wp, "capture_launch", captured),
    ):
        yield count


def array_bytes(*roots: object) -> int:
    """Bytes of all Warp arrays reachable from objects of simwarp, each allocation once."""
    sizes: dict[int, int] = {}
    seen: set[int] = set()
    pending: list[object] = list(roots)
    while pending:
        thing = pending.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, wp.array):
            if thing.ptr:
                sizes[thing.ptr] = max(sizes.get(thing.ptr, 0), int(thing.capacity))
        elif isinstance(thing, dict):
            pending.extend(thing.values())
        elif isinstance(thing, list | tuple):
            pending.extend(thing)
        elif type(thing).__module__.startswith("simwarp.") or _is_struct(thing):
            pending.extend(vars(thing).values())
    return sum(sizes.values())


def _is_struct(thing: object) -> bool:
    """True if this is an instance of a `wp.struct`; Warp has no public name for their base class."""
    return any(base.__name__ == "StructInstance" for base in type(thing).__mro__)


def compiled_modules(cache: str | Path) -> int:
    """Kernel modules with machine code in a cache folder."""
    return sum(1 for pattern in ("*/*.o", "*/*.cubin", "*/*.ptx") for _ in Path(cache).glob(pattern))
