"""Recorded launches whose worlds are shared among the threads of a CPU.

A launch of Warp on a CPU is a loop over worlds on one thread, which releases Python's lock. Here each launch is
recorded once per chunk of worlds, and a thread takes a chunk through all launches of a control step before it takes the
next one: threads meet once per control step, the state of a chunk stays in the cache, and chunks balance worlds that
take longer than others. Worlds never share anything that a launch writes: any number of threads gives the same bits.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, ClassVar, Final, TypeAlias

import warp as wp

from simwarp.core.array_devices import refuse_arguments_elsewhere, refuse_elsewhere
from simwarp.core.threads import Workers, number_from_environment, thread_count
from simwarp.core.types import ModelError
from simwarp.kernels.core.launch_in_turn import launch_in_turn
from simwarp.kernels.core.world_range import WorldRange
from simwarp.simulation.launch_loop import LaunchLoop

CHUNKS_PER_THREAD: Final = 4
"""More balance uneven worlds better; each has scratch of its own and costs its launches."""


def chunk_count(worlds: int, threads: int, device: Any) -> int:
    """Chunks that the worlds are divided into: one on a GPU and for one thread."""
    return 1 if device.is_cuda or threads == 1 else min(worlds, CHUNKS_PER_THREAD * threads)


BLOCK: Final = 32
"""Threads of a block on a GPU: kernels take many registers, so that larger blocks leave multiprocessors idle."""
BLOCK_VARIABLE: Final = "SIMWARP_BLOCK_DIM"
"""Environment variable of another number, to be measured."""
MOST_IN_BLOCK: Final = 1024
"""Most threads that CUDA allows in a block."""
WARP: Final = 32
"""Threads of a warp."""


def block_threads() -> int:
    """Threads of a block on a GPU: of the environment variable, where it is set.

    Raises:
        ModelError: the variable is no whole number from 1 to 1024, or no multiple of 32: lanes that share a world are
            neighbours in one warp.
    """
    number = number_from_environment(BLOCK_VARIABLE, MOST_IN_BLOCK, f"unset it for {BLOCK}") or BLOCK
    if number % WARP:
        raise ModelError(
            f"{BLOCK_VARIABLE} must be a multiple of {WARP}, whole warps, got {number}; unset it for {BLOCK}"
        )
    return number


def has_own_slots(device: Any) -> bool:
    """True if every world has scratch of its own, as on a GPU, where all work at a time."""
    return bool(device.is_cuda)


class WorldLaunch:
    """A launch over all worlds, recorded chunk by chunk.

    Attributes:
        kernel: that is launched.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset({"_used"})
    """Attributes that no launch reads."""

    def __init__(self, kernel: wp.Kernel, make_parts: Callable[[], Sequence[Any]], shares: WorldShares) -> None:
        self.kernel, self._shares = kernel, shares
        self._make_parts: Callable[[], Sequence[Any]] | None = make_parts
        self._parts: tuple[Any, ...] = ()
        self._used: dict[int, tuple[Any, ...]] = {}

    @property
    def parts(self) -> tuple[Any, ...]:
        """One `wp.Launch` per chunk; kernels that were recorded together with this one are compiled side by side."""
        if self._make_parts is not None:
            self._shares.load_recorded()
            self.prepare()
        return self._parts

    def prepare(self) -> None:
        """Record the chunks, once; the kernel is compiled where it is not loaded yet."""
        if self._make_parts is not None:
            self._parts = tuple(self._make_parts())
            self._make_parts = None  # which holds arrays that `use` may replace

    def use(self, index: int, array: wp.array) -> None:
        """From now on it takes this array for input `index`; not for launches that a `WorldProgram` runs.

        Raises:
            ModelError: the array lies on another device than the worlds.
        """
        memory = (array.ptr, array.shape, array.strides)
        if self._used.get(index) != memory:
            label = self.kernel.adj.args[1 + index].label
            refuse_elsewhere(f"{self.kernel.key}: {label} must", array, self._shares.device)
            self._used[index] = memory
            for part in self.parts:
                part.set_param_at_index(1 + index, array)

    def launch(self) -> None:
        """Launches the kernel once for all worlds."""
        self._shares.run([self])


class WorldShares:
    """The worlds of a simulation, divided among threads.

    Args:
        worlds: how many there are.
        threads: of a CPU that work on them.
        device: of the worlds.

    Attributes:
        ranges: the chunks.
        own_slots: every world has scratch of its own; otherwise those of a chunk take it in turn.
        launches: so far, of kernels over all worlds.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset({"launches"})
    """Attributes that no launch reads."""

    def __init__(self, worlds: int, threads: int, device: Any) -> None:
        self.worlds, self.device = worlds, device
        chunks = chunk_count(worlds, threads, device)
        ends = [worlds * k // chunks for k in range(chunks + 1)]
        self.own_slots = has_own_slots(device)
        self.ranges = [
            _world_range(first, end - first, k, self.own_slots)
            for k, (first, end) in enumerate(itertools.pairwise(ends))
        ]
        self.threads = min(threads, chunks)
        self.launches = 0
        self._workers = Workers(self.threads) if self.threads > 1 else None
        self._waiting: list[WorldLaunch] | None = None

    @contextlib.contextmanager
    def recording_together(self) -> Iterator[None]:
        """Inside, kernels are not compiled when they are recorded, but side by side when the first of them is used."""
        self._waiting = []
        try:
            yield
            self.load_recorded()
        finally:
            self._waiting = None

    def load_recorded(self) -> None:
        """Compile and load the kernels that were recorded together and not used yet, on all processors."""
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        modules = list(dict.fromkeys(each.kernel.module for each in waiting))
        if not self.device.is_cuda:
            modules.append(launch_in_turn.module)
        block = block_threads() if self.device.is_cuda else None
        wp.force_load(self.device, modules, block_dim=block, max_workers=thread_count(None))
        for each in waiting:
            each.prepare()

    def record(
        self, kernel: wp.Kernel, threads_per_world: int | None = None, *, inputs: Sequence[Any],
        outputs: Sequence[Any] = (), in_turn: bool = False,
    ) -> WorldLaunch:  # fmt: skip
        """Record a launch over all worlds.

        Args:
            kernel: its first parameter is a `WorldRange`; `wp.tid()` counts from the first world of that.
            threads_per_world: second axis of the launch; None: it has but one.
            inputs: its parameters after the `WorldRange`.
            outputs: and those that it writes.
            in_turn: one thread of the kernel goes through all worlds of its `WorldRange`.

        Raises:
            ModelError: an array lies on another device than the worlds.
        """
        refuse_arguments_elsewhere(kernel, [None, *inputs, *outputs], self.device)
        block = block_threads()
        each = () if threads_per_world is None else (threads_per_world,)

        def make_parts() -> list[Any]:
            return [
                wp.launch(
                    kernel, dim=(1 if in_turn else worlds.count, *each), device=self.device, record_cmd=True,
                    block_dim=block, inputs=[worlds, *inputs], outputs=list(outputs),
                )
                for worlds in self.ranges
            ]  # fmt: skip

        launch = WorldLaunch(kernel, make_parts, self)
        if self._waiting is None:
            launch.prepare()
        else:
            self._waiting.append(launch)
        return launch

    def run(self, commands: Sequence[Any], times: int = 1) -> None:
        """Launches recorded commands in turn, `times` over.

        A plain `wp.Launch` among them runs on the calling thread, between the others.
        """
        self.launches += times * len(commands)
        for_all = [command for command in commands if _is_shared(command)]
        if len(for_all) == len(commands):
            self.share([_launching(parts) for parts in zip(*(each.parts for each in for_all), strict=True)], times)
            return
        for _ in range(times):
            for command in commands:
                if _is_shared(command):
                    self.share([_launching([part]) for part in command.parts], 1)
                else:
                    command.launch()

    def share(self, chunks: Sequence[Callable[[], None]], times: int) -> None:
        """Calls each of `chunks` `times` over, different ones side by side; a thread that records a graph does all."""
        if self._workers is None or len(chunks) == 1 or self.device.is_capturing:
            for chunk in chunks:
                for _ in range(times):
                    chunk()
            return
        turn = itertools.count()  # its next() is atomic

        def work() -> None:
            while (mine := next(turn)) < len(chunks):
                for _ in range(times):
                    chunks[mine]()

        self._workers.run(work)


Block: TypeAlias = tuple[tuple[Any, ...], int]
"""Recorded launches, in turn, and how many times over."""


class WorldProgram:
    """Commands that run over and over: on a CPU native code makes them, without Python in between.

    Args:
        shares: of the worlds.
        blocks: recorded launches.

    Attributes:
        commands: all of them, in turn.
    """

    def __init__(self, shares: WorldShares, blocks: Sequence[Block]) -> None:
        self.shares, self.blocks = shares, tuple(blocks)
        self.commands = tuple(command for commands, times in blocks for _ in range(times) for command in commands)
        self._loops: list[LaunchLoop] = []
        # others may launch in between, and a GPU has graphs of whole control steps
        self._plain = shares.device.is_cuda or not all(_is_shared(command) for command in self.commands)

    def run(self, times: int) -> None:
        """Launches the commands in turn, `times` over."""
        if self._plain or not self.commands or self.shares.device.is_capturing:
            self._run_plainly(times)
            return
        commands, repeated = self.blocks[0] if len(self.blocks) == 1 else (self.commands, 1)
        if not self._loops:
            self._loops = [
                LaunchLoop([command.parts[chunk] for command in commands], worlds.count)
                for chunk, worlds in enumerate(self.shares.ranges)
            ]
        self.shares.launches += times * len(self.commands)
        self.shares.share([functools.partial(loop.run, times * repeated) for loop in self._loops], 1)

    def _run_plainly(self, times: int) -> None:
        if len(self.blocks) == 1:
            commands, repeated = self.blocks[0]
            self.shares.run(commands, times * repeated)
            return
        for _ in range(times):
            for commands, repeated in self.blocks:
                self.shares.run(commands, repeated)


def unshared(commands: Iterable[Any]) -> list[str]:
    """Names of the kernels whose worlds cannot be shared: they were recorded by `wp.launch`."""
    return [str(command.kernel.key) for command in commands if not _is_shared(command)]


def _launching(parts: Sequence[Any]) -> Callable[[], None]:
    def launch() -> None:
        for part in parts:
            part.launch()

    return launch


def _is_shared(command: Any) -> bool:
    return isinstance(command, WorldLaunch)


def _world_range(first: int, count: int, chunk: int, own_slots: bool) -> Any:
    worlds = WorldRange()
    worlds.first, worlds.count, worlds.slot, worlds.own_slots = first, count, chunk, int(own_slots)
    return worlds
