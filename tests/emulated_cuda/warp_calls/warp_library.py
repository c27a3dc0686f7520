"""Warp's native library, in which all that needs a driver is the emulated device's."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from typing import Any

from tests.emulated_cuda.device import TOTAL_MEMORY, Device, device
from tests.emulated_cuda.warp_calls.warp_graphs import WarpGraphs
from tests.emulated_cuda.warp_calls.warp_kernels import WarpKernels
from tests.emulated_cuda.warp_calls.warp_memory import WarpMemory
from tests.emulated_cuda.warp_calls.warp_streams import WarpStreams
from tests.emulated_cuda.warp_calls.warp_trees import WarpTrees

REAL = ("cuda_compile_program", "cuda_toolkit_version", "cuda_compile_fft", "cuda_compile_dot", "cuda_compile_solver")
"""Functions about CUDA that need no driver."""
ON_HOST = ("array_", "radix_", "segmented_", "runlength_")
"""Device functions that begin like this run as those of the host."""
ANSWERS = {
    "is_cuda_enabled": 1, "is_cuda_compatibility_enabled": 1, "cuda_driver_is_initialized": True,
    "cuda_driver_version": 13040, "cuda_device_get_count": 1, "cuda_device_get_arch": 90,
    "cuda_device_get_sm_count": 132, "cuda_device_get_max_shared_memory": 232448, "cuda_device_is_uva": 1,
    "cuda_device_get_pageable_memory_access": 0, "cuda_device_get_direct_managed_mem_access_from_host": 0,
    "cuda_device_get_host_native_atomic_supported": 0, "cuda_device_get_managed_memory_supported": 1,
    "cuda_device_get_concurrent_managed_access_supported": 1, "cuda_device_is_mempool_supported": 1,
    "cuda_device_is_ipc_supported": 0, "cuda_device_get_pci_domain_id": 0, "cuda_device_get_pci_bus_id": 1,
    "cuda_device_get_pci_device_id": 0, "cuda_device_set_mempool_release_threshold": 1,
    "cuda_device_get_mempool_release_threshold": 0, "cuda_device_get_mempool_used_mem_current": 0,
    "cuda_device_get_mempool_used_mem_high": 0, "cuda_is_peer_access_supported": 1, "cuda_is_peer_access_enabled": 1,
    "cuda_is_mempool_access_enabled": 1, "cuda_profiler_start": True, "cuda_profiler_stop": True,
    "cuda_timing_begin": None, "cuda_timing_get_result_count": 0, "cuda_timing_end": None,
    "cuda_device_get_graph_mem_current": 0, "cuda_device_graph_mem_trim": None,
}  # fmt: skip
"""What functions without an effect say of the device, an H100."""


class Function:
    """A function of the library; types of arguments and results may be set and are not looked at."""

    def __init__(self, call: Callable[..., Any]) -> None:
        self.call = call
        self.argtypes: Any = None
        self.restype: Any = None

    def __call__(self, *arguments: Any) -> Any:
        return self.call(*arguments)


class DeviceFacts:
    """Functions that say what the device is, and what went wrong on it."""

    def __init__(self, target: Device, real: Any) -> None:
        self.device, self.real = target, real

    def cuda_device_get_name(self, ordinal: int) -> bytes:
        """The device's name."""
        return self.device.settings.name.encode()

    def cuda_device_get_memory_info(self, ordinal: int, free: Any, total: Any) -> None:
        """Free and total memory."""
        if free is not None:
            free._obj.value = TOTAL_MEMORY - self.device.used()
        if total is not None:
            total._obj.value = TOTAL_MEMORY

    def cuda_device_get_uuid(self, ordinal: int, buffer: Any) -> None:
        """The device's identifier."""
        ctypes.memmove(buffer, bytes(range(16)), 16)

    def get_error_string(self) -> bytes:
        """Text of the last error, once."""
        error, self.device.faults.last_error = self.device.faults.last_error, b""
        return error or self.real.wp_get_error_string()

    def set_error_output_enabled(self, on: bool) -> None:
        """Whether errors go to the error stream."""
        self.device.faults.printing = bool(on)
        self.real.wp_set_error_output_enabled(on)


class WarpLibrary:
    """Stands for Warp's library: what the device does not answer goes to the real one."""

    def __init__(self, real: Any, target: Device) -> None:
        self._real = real
        memory = WarpMemory(target, real)
        self._memory = memory
        self._parts = (
            DeviceFacts(target, real), memory, WarpTrees(target, real), WarpKernels(target), WarpStreams(target),
            WarpGraphs(target),
        )  # fmt: skip

    def __getattr__(self, name: str) -> Any:
        value = self._find(name)
        setattr(self, name, value)
        return value

    def _find(self, name: str) -> Any:
        short = name.removeprefix("wp_")
        part = next((each for each in self._parts if hasattr(each, short)), None)
        if part is not None:
            return Function(getattr(part, short))
        if short in ANSWERS:
            return Function(lambda *arguments: ANSWERS[short])
        if short in REAL or not (short.startswith("cuda_") or short.endswith("_device")):
            return getattr(self._real, name)
        host = f"wp_{short.removesuffix('_device')}_host"
        if short.endswith("_device") and short.startswith(ON_HOST) and hasattr(self._real, host):
            return Function(self._memory.on_host(short, getattr(self._real, host)))

        def missing(*arguments: Any) -> None:
            raise NotImplementedError(f"the emulated CUDA device has no {name}")

        return Function(missing)


def install(context: Any) -> None:
    """Make Warp find the emulated device. `context` is warp._src.context, before Warp is initialised."""
    import warp.config as config

    target = device()
    if context.runtime is not None:
        raise RuntimeError("emulated CUDA device: Warp is initialised already")
    load = context.Runtime.load_dll

    def load_dll(self: Any, path: str) -> Any:
        library = load(self, path)
        return WarpLibrary(library, target) if os.path.basename(path) == "warp.so" else library

    context.Runtime.load_dll = load_dll
    config.cuda_output = "ptx"
