"""Small PTX texts and their runs, for tests."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence

import numpy as np

from tests.emulated_cuda.device import DELTA, Device
from tests.emulated_cuda.native.kernel_modules import KernelModules

HEAD = ".version 8.0\n.target sm_90\n.address_size 64\n"
REGISTERS = ".reg .pred %p<10>;\n.reg .b32 %r<30>;\n.reg .b64 %rd<30>;\n.reg .f32 %f<10>;\n.reg .f64 %d<10>;\n"


def kernel(name: str, body: str, arguments: int = 2) -> str:
    """A kernel whose arguments are addresses, which %rd20, %rd21, ... hold."""
    params = ", ".join(f".param .u64 {name}_{k}" for k in range(arguments))
    loads = "".join(f"ld.param.u64 %rd{20 + k}, [{name}_{k}];\n" for k in range(arguments))
    return f".visible .entry {name}({params})\n{{\n{REGISTERS}{loads}{body}\nret;\n}}\n"


THREAD = "mov.u32 %r20, %tid.x;\nmov.u32 %r21, %ctaid.x;\nmov.u32 %r22, %ntid.x;\nmad.lo.s32 %r23, %r21, %r22, %r20;\n"
"""%r20 is the thread in its block, %r21 the block, %r23 the thread in the grid."""


class PtxRunner:
    """Translates PTX and launches its kernels on the device's memory."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.modules = KernelModules(device)

    @functools.cache  # noqa: B019 - lives as long as a test
    def load(self, text: str) -> int:
        """A module of this text."""
        return self.modules.load(HEAD + text)

    def launch(
        self, text: str, name: str, arguments: Sequence[int], *, grid: int = 1, block: int = 1, stream: int = 0
    ) -> int:
        """Launch a kernel; CUDA's code."""
        handle = self.modules.kernel(self.load(text), name)
        assert handle, self.device.faults.last_error
        values = [ctypes.c_uint64(each) for each in arguments]
        return self.modules.launch(handle, (grid, 1, 1), block, 0, [ctypes.addressof(each) for each in values], stream)

    def array(self, values: np.ndarray) -> int:
        """Address of a new block with these values."""
        address = self.device.allocate(values.nbytes, "pool")
        ctypes.memmove(address + DELTA, values.tobytes(), values.nbytes)
        return address

    def read(self, address: int, count: int, dtype: type | str = np.uint32) -> np.ndarray:
        """Values that lie at an address."""
        return np.frombuffer(ctypes.string_at(address + DELTA, count * np.dtype(dtype).itemsize), dtype)

    def run(self, text: str, name: str, values: np.ndarray, count: int, *, grid: int = 1, block: int = 1) -> np.ndarray:
        """Launch a kernel with an array of inputs and one of `count` words that begin as zeros; these words."""
        inputs, out = self.array(values), self.array(np.zeros(count, np.uint32))
        assert self.launch(text, name, [inputs, out], grid=grid, block=block) == 0, self.device.faults.last_error
        return self.read(out, count)
