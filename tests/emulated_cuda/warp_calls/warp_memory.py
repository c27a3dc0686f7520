"""Stand-ins for Warp's functions of memory: blocks, copies, fills."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from typing import Any

from tests.emulated_cuda.device import Device, host_view, is_device
from tests.emulated_cuda.streams import LEGACY
from tests.emulated_cuda.warp_calls.warp_arguments import CURRENT_STREAM, number

DESCRIPTOR_BYTES = {0: 56, 1: 104}
"""Bytes of Warp's array descriptors: regular and indexed arrays."""
MANAGED_POOL, DEVICE_MEMORY = 4, 3
"""Kinds of memory that Warp asks for."""


class WarpMemory:
    """Functions of memory, named as in Warp's library without `wp_`."""

    def __init__(self, device: Device, real: Any) -> None:
        self.device, self.real = device, real
        self.streams, self.faults = device.streams, device.faults

    def _stream(self, handle: Any) -> int:
        handle = number(handle)
        return self.streams.current if handle == CURRENT_STREAM else handle

    # blocks

    def alloc_device(self, context: Any, size: Any, tag: Any = None) -> int | None:
        """A block of the current stream."""
        return self.alloc_device_async(context, size, CURRENT_STREAM, tag)

    def alloc_device_default(self, context: Any, size: Any, tag: Any = None) -> int | None:
        """cudaMalloc."""
        if self.streams.is_forbidden("wp_alloc_device_default"):
            return None
        return self.device.allocate(int(size), "device")

    def alloc_device_managed(self, context: Any, size: Any, tag: Any = None) -> int | None:
        """cudaMallocManaged."""
        return self.alloc_device_default(context, size, tag)

    def alloc_device_async(self, context: Any, size: Any, stream: Any, tag: Any = None) -> int | None:
        """cudaMallocAsync; in a capture the memory is the graph's."""
        handle = self._stream(stream)
        capture = self.streams.capture_of(handle)
        if capture is None and handle == LEGACY and self.streams.legacy_is_barred():
            self.streams.invalidate()
            self.faults.fail(906, "wp_alloc_device_async")
            return None
        address = self.device.allocate(int(size), "pool" if capture is None else "graph", handle)
        if capture is not None:
            self.faults.hazard("allocation recorded into a graph")
            poison = functools.partial(_fill, address, 0xFF, int(size))
            self.streams.submit(handle, poison, "wp_alloc_device_async")
            capture.blocks.append(address)
        return address

    def free_device(self, context: Any, address: Any) -> None:
        """A block of any kind."""
        self.free_device_async(context, address)

    def free_device_default(self, context: Any, address: Any) -> None:
        """cudaFree, which waits for the device."""
        if not self.streams.captures:
            self.streams.finish_all()
        self.free_device_async(context, address)

    def free_device_async(self, context: Any, address: Any, node: Any = None) -> None:
        """cudaFreeAsync on the legacy stream. Memory of a graph lives as long as the graph."""
        block = number(address)
        if block and self.device.kinds.get(block) != "graph":
            self.streams.release_later(functools.partial(self.device.release, block))

    def cuda_pointer_get_memory_kind(self, context: Any, address: Any) -> int:
        """Whether memory comes from a pool."""
        return DEVICE_MEMORY if self.device.kinds.get(number(address)) == "device" else MANAGED_POOL

    def alloc_pinned(self, size: Any, tag: Any = None) -> int:
        """Memory of the host of which copies are asynchronous."""
        address: int = self.real.wp_alloc_host(size, tag)
        self.device.pinned[address] = int(size)
        return address

    def free_pinned(self, address: Any) -> None:
        """cudaFreeHost, which waits for the device."""
        if not self.streams.captures:
            self.streams.finish_all()
        self.device.pinned.pop(number(address), None)
        self.real.wp_free_host(address)

    # copies

    def _is_memory(self, address: int, size: int, *, of_device: bool, where: str) -> bool:
        if size and is_device(address) != of_device:
            self.faults.fail(1, where, f"0x{address:x} is not memory of the {'device' if of_device else 'host'}")
            return False
        if of_device and size and not self.device.is_valid(address, size):
            self.faults.fail(700, where, f"{size} bytes at 0x{address:x} lie in no block of memory")
            return False
        return True

    def _copy(self, where: str, to: Any, source: Any, size: Any, stream: Any, on_device: tuple[bool, bool]) -> bool:
        to, source, size, handle = number(to), number(source), int(size), self._stream(stream)
        ends = zip((to, source), on_device, strict=True)
        if not all(self._is_memory(each, size, of_device=on, where=where) for each, on in ends):
            return False
        self.faults.counts[where] += 1
        host_end = to if not on_device[0] else source if not on_device[1] else None
        pageable = host_end is not None and not self.device.is_pinned(host_end)
        captured = self.streams.capture_of(handle) is not None
        if pageable and captured:
            self.faults.hazard(f"{where} of pageable host memory recorded into a graph: replays use this address again")
        if host_end == source and (pageable or captured):
            # CUDA stages pageable memory: what lies there now. In a capture it would be gone at a replay.
            staged = ctypes.create_string_buffer(ctypes.string_at(source, size), size)
            return self.streams.submit(handle, lambda: _move(to, staged, size), where, keep=(staged,))
        operation = self.streams.queue(handle, lambda: _move(to, host_view(source), size), where)
        if operation is not None and host_end == to and pageable and not captured:
            self.streams.finish(operation)  # the host waits
        return operation is not None and not operation.failed

    def memcpy_h2d(self, context: Any, to: Any, source: Any, size: Any, stream: Any) -> bool:
        """From the host to the device."""
        return self._copy("wp_memcpy_h2d", to, source, size, stream, (True, False))

    def memcpy_d2h(self, context: Any, to: Any, source: Any, size: Any, stream: Any) -> bool:
        """From the device to the host."""
        return self._copy("wp_memcpy_d2h", to, source, size, stream, (False, True))

    def memcpy_d2d(self, context: Any, to: Any, source: Any, size: Any, stream: Any) -> bool:
        """On the device."""
        return self._copy("wp_memcpy_d2d", to, source, size, stream, (True, True))

    # fills

    def memset_device(self, context: Any, to: Any, value: int, size: Any, stream: Any) -> bool:
        """All bytes of a range."""
        to, size, where = number(to), int(size), "wp_memset_device"
        if not self._is_memory(to, size, of_device=True, where=where):
            return False
        self.faults.counts["memset"] += 1
        return self.streams.submit(self._stream(stream), functools.partial(_fill, to, value, size), where)

    def memtile_device(self, context: Any, to: Any, source: Any, size: Any, count: Any) -> None:
        """A value, several times."""
        to, size, count, where = number(to), int(size), int(count), "wp_memtile_device"
        if self._is_memory(to, size * count, of_device=True, where=where):
            tiles = ctypes.string_at(number(source), size) * count
            self.faults.counts["memtile"] += 1
            self.streams.submit(self.streams.current, lambda: _move(to, tiles, len(tiles)), where, keep=(tiles,))

    def _descriptor(self, pointer: Any, kind: Any) -> Any:
        size = DESCRIPTOR_BYTES.get(int(kind))
        if size is None:
            raise NotImplementedError("the emulated CUDA device has no fabric arrays")
        return ctypes.create_string_buffer(ctypes.string_at(number(pointer), size), size)

    def array_fill_device(self, context: Any, array: Any, kind: Any, value: Any, size: Any) -> None:
        """An array, with steps and indices."""
        array = self._descriptor(array, kind)
        copied = ctypes.create_string_buffer(ctypes.string_at(number(value), int(size)), int(size))

        def run() -> None:
            with self.device.open_to_host():
                self.real.wp_array_fill_host(array, kind, copied, size)

        self.faults.counts["fill"] += 1
        self.streams.submit(self.streams.current, run, "wp_array_fill_device", keep=(array, copied))

    def array_copy_device(self, context: Any, to: Any, source: Any, to_kind: Any, source_kind: Any, size: Any) -> bool:
        """An array to another, with steps and indices."""
        to, source = self._descriptor(to, to_kind), self._descriptor(source, source_kind)

        def run() -> bool:
            with self.device.open_to_host():
                return bool(self.real.wp_array_copy_host(to, source, to_kind, source_kind, size))

        self.faults.counts["array_copy"] += 1
        return self.streams.submit(self.streams.current, run, "wp_array_copy_device", keep=(to, source))

    def on_host(self, name: str, function: Callable[..., Any]) -> Callable[..., bool]:
        """A function of the device as that of the host, in the current stream."""

        def call(*arguments: Any) -> bool:
            def run() -> None:
                with self.device.open_to_host():
                    function(*arguments)

            self.faults.counts[name] += 1
            return self.streams.submit(self.streams.current, run, f"wp_{name}", keep=arguments)

        return call


def _fill(address: int, value: int, size: int) -> None:
    ctypes.memset(host_view(address), value, size)


def _move(to: int, source: Any, size: int) -> None:
    ctypes.memmove(host_view(to), source, size)
