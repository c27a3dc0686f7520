"""The emulated device of this process: its memory, its streams, its faults and its settings."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import sys
from collections.abc import Callable, Iterator

from tests.emulated_cuda.counts.launch_counts import LaunchCounts
from tests.emulated_cuda.faults import Faults
from tests.emulated_cuda.native.native_library import runtime_library
from tests.emulated_cuda.settings import Check, Settings
from tests.emulated_cuda.streams import Streams

BASE, DELTA = 0x200 << 36, 0x080000000000
"""First address of the device's memory, and where the host's view of it lies, as in device_runtime.h."""
ARENA = 1 << 35
TOTAL_MEMORY = 80 << 30
"""Bytes that the device says to have."""
UNSIGNED = (
    "emu_alloc", "emu_size", "emu_stream", "emu_used", "emu_high", "emu_count", "emu_races", "emu_next_given_up",
)  # fmt: skip
"""Functions of the runtime that return an address or a count."""


def is_device(address: int) -> bool:
    """Whether an address is one of the device."""
    return address >> 36 == BASE >> 36


def host_view(address: int) -> int:
    """Where the host sees an address, which may be one of the device."""
    return address + DELTA if is_device(address) else address


class Device:
    """The emulated device.

    Attributes:
        runtime: library of the runtime of device code.
        kinds: what each block of memory is, by address.
        pinned: bytes of each block of pinned memory of the host, by address.
        recorded_streams: handles of streams besides its own that use a block of a torch tensor, by address.
        is_torch_pinned: whether torch pinned an address of the host.
        seed: order of blocks and threads; 0 is the natural one.
        counts: of launches, where kernels are translated for it (`Check.COUNT`).
        ptx: texts of the modules that were loaded.
        kernel_count: kernels that were loaded.
        compile_seconds: time that gcc took.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.seed = settings.seed
        self.faults = Faults(trace=settings.trace)
        self.streams = Streams(self.faults, settings.streams, settings.seed)
        # Holds Python's lock: the runtime runs one launch at a time
        self.runtime = ctypes.PyDLL(str(runtime_library(settings.cache)), mode=ctypes.RTLD_GLOBAL)
        for name in UNSIGNED:
            getattr(self.runtime, name).restype = ctypes.c_uint64
        self.runtime.emu_message.restype = ctypes.c_char_p
        step = self.runtime.emu_open(ctypes.c_uint64(ARENA))
        if step:
            raise RuntimeError(f"emulated CUDA device: no memory for it (step {step} of emu_open)")
        self.runtime.emu_checks({Check.OFF: 0, Check.MEMORY: 1, Check.RACE: 2, Check.COUNT: 1}[settings.check])
        if settings.check is Check.RACE and self.runtime.emu_open_races():
            raise RuntimeError("emulated CUDA device: no memory for the check of races")
        self.counts = LaunchCounts(self.runtime)
        self.ptx: list[str] = []
        self.kinds: dict[int, str] = {}
        self.pinned: dict[int, int] = {}
        self.recorded_streams: dict[int, set[int]] = {}
        self.is_torch_pinned: Callable[[int], bool] = lambda address: False
        self.kernel_count = 0
        self.compile_seconds = 0.0
        self._launches = 0
        atexit.register(self._at_exit)

    # memory

    def allocate(self, size: int, kind: str, stream: int = 0) -> int:
        """A block filled with ones (NaN); 0 where there is no more."""
        address: int = self.runtime.emu_alloc(ctypes.c_uint64(size), ctypes.c_uint64(stream))
        if address:
            self.kinds[address] = kind
        return address

    def release(self, address: int) -> None:
        """Give a block back; its addresses are faults from now on."""
        if not self.runtime.emu_size(ctypes.c_uint64(address)):
            self.faults.fail(1, "cudaFree", f"0x{address:x} is no block of memory")
            return
        self.kinds.pop(address, None)
        self.runtime.emu_release(ctypes.c_uint64(address))

    def is_valid(self, address: int, size: int) -> bool:
        """Whether all of a range lies in one block."""
        return bool(self.runtime.emu_in_block(ctypes.c_uint64(address), ctypes.c_uint64(size)))

    def is_pinned(self, address: int) -> bool:
        """Whether an address of the host lies in pinned memory."""
        own = any(start <= address < start + size for start, size in self.pinned.items())
        return own or self.is_torch_pinned(address)

    def used(self) -> int:
        """Bytes in use."""
        return int(self.runtime.emu_used())

    @contextlib.contextmanager
    def open_to_host(self) -> Iterator[None]:
        """Let functions of the host work on the device's addresses."""
        self.runtime.emu_open_to_host(1)
        try:
            yield
        finally:
            self.runtime.emu_open_to_host(0)

    def release_given_up(self) -> None:
        """Queue the release of memory that torch's tensors have given up in the streams in which it was allocated."""
        while address := int(self.runtime.emu_next_given_up()):
            handles = {int(self.runtime.emu_stream(ctypes.c_uint64(address))), *self.recorded_streams.pop(address, ())}
            queues = [self.streams.at(handle).queue for handle in handles]
            release = functools.partial(self.runtime.emu_release, ctypes.c_uint64(address))
            self.streams.release_later(release, [queue[-1] for queue in queues if queue])

    # launches

    def next_seed(self) -> int:
        """Seed of the order of threads of the next launch."""
        self._launches += 1
        return self.seed * 1_000_003 + self._launches if self.seed else 0

    def run_kernel(self, launch: Callable[[], int]) -> bool:
        """Run a launch; a failed one makes all later calls fail."""
        code = launch()
        self.faults.counts["launches"] += 1
        if code:
            self.faults.sticky = code
            self.faults.fail(code, "kernel", self.runtime.emu_message().decode())
        return not code

    def races(self) -> tuple[int, str]:
        """Number of races so far and the first one; none where they are not checked."""
        if self.settings.check is not Check.RACE:
            return 0, ""
        text = ctypes.create_string_buffer(1024)
        return int(self.runtime.emu_races(text, ctypes.c_uint64(1024))), text.value.decode()

    def synchronize(self, where: str) -> bool:
        """Wait for all streams; False where that is forbidden, or a launch has failed."""
        if self.streams.is_forbidden(where):
            return False
        self.faults.counts["synchronisations"] += 1
        self.release_given_up()
        self.streams.finish_all()
        return not self.failed(where)

    def failed(self, where: str) -> bool:
        """Whether a launch has failed, which is an error again."""
        if self.faults.sticky:
            self.faults.fail(self.faults.sticky, where)
        return bool(self.faults.sticky)

    def report(self) -> list[str]:
        """Lines about what ran and what went wrong."""
        counts = ", ".join(f"{name} {count}" for name, count in self.faults.counts.items())
        memory = f"{self.runtime.emu_high() / 2**20:.1f} MiB in {self.runtime.emu_count()} blocks"
        lines = [f"{self.kernel_count} kernels, gcc {self.compile_seconds:.1f} s, {memory}; {counts or 'no calls'}"]
        races, first = self.races()
        return lines + self.faults.report() + ([f"races: {races}, the first: {first}"] if races else [])

    def _at_exit(self) -> None:
        if self.settings.report:
            for line in self.report():
                print(f"emulated CUDA: {line}", file=sys.stderr)


@functools.cache
def device() -> Device:
    """The device of this process."""
    return Device(Settings.from_environment())
