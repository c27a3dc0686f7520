"""Stand-ins for Warp's functions of modules and launches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.emulated_cuda.device import Device
from tests.emulated_cuda.native.kernel_modules import SHARED_MEMORY, KernelModules
from tests.emulated_cuda.warp_calls.warp_arguments import CURRENT_STREAM, number

WIDEST_GRID = 2**31 - 1
GRID_SIDE = 65535
PLANE = 1 << 24
"""Threads in a row of a grid of several dimensions."""


class WarpKernels:
    """Functions of kernels, named as in Warp's library without `wp_`."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.loaded = KernelModules(device)

    def cuda_load_module(self, context: Any, path: bytes) -> int:
        """Load PTX that Warp compiled."""
        file = Path(path.decode())
        if file.suffix != ".ptx":
            raise RuntimeError(
                f"the emulated CUDA device runs PTX, not {file.name}: leave wp.config.cuda_output at 'ptx'"
            )
        return self.loaded.load(file.read_bytes().rstrip(b"\0").decode())

    def cuda_unload_module(self, context: Any, handle: Any) -> None:
        """Forget a module."""
        self.loaded.modules.pop(number(handle), None)

    def cuda_get_kernel(self, context: Any, module: Any, name: bytes) -> int | None:
        """A kernel of a module."""
        return self.loaded.kernel(number(module), name.decode()) or None

    def cuda_get_max_shared_memory(self, kernel: Any) -> int:
        """Bytes that a block may have."""
        return SHARED_MEMORY

    def cuda_configure_kernel_shared_memory(self, kernel: Any, size: int) -> bool:
        """Whether a kernel may have so much dynamic shared memory."""
        if size + self.loaded.kernels[number(kernel)].shared_size > SHARED_MEMORY:
            self.device.faults.fail(1, "cuFuncSetAttribute", f"{size} bytes of shared memory")
            return False
        return True

    def cuda_get_kernel_static_shared_memory(self, context: Any, kernel: Any) -> int:
        """Bytes that a kernel declares."""
        return self.loaded.kernels[number(kernel)].shared_size

    def cuda_set_kernel_cluster_attrs(self, kernel: Any, *size: Any) -> bool:
        """Clusters of blocks have no effect."""
        return True

    def cuda_get_max_cluster_dim(self, *arguments: Any) -> int:
        """Blocks of a cluster."""
        return 8

    def cuda_get_suggested_block_size(self, context: Any, kernel: Any, shared: Any, block: Any, grid: Any) -> bool:
        """What would fill the device."""
        block._obj.value, grid._obj.value = 256, 132
        return True

    def cuda_get_kernel_properties(self, context: Any, kernel: Any, values: Any, count: int) -> bool:
        """Registers and the like, of which there are none."""
        for index in range(count):
            values[index] = 0
        return True

    def cuda_launch_kernel(
        self, context: Any, handle: Any, dim: int, most_blocks: int, block: int, grid_stride: Any, cluster: Any,
        shared: int, arguments: Any, stream: Any, recording: Any,
    ) -> int:  # fmt: skip
        """Launch a kernel over `dim` threads."""
        if not dim:
            return 0
        block = block if block > 0 else 256
        total = (dim + block - 1) // block
        if grid_stride:
            grid = (max(1, min(total, most_blocks if most_blocks > 0 else WIDEST_GRID)), 1, 1)
        else:
            x = max(1, min(total, PLANE // block))
            rest = (total + x - 1) // x
            y = max(1, min(rest, GRID_SIDE))
            grid = (x, y, max(1, min((rest + y - 1) // y, GRID_SIDE)))
        wanted = number(stream)
        wanted = self.device.streams.current if wanted == CURRENT_STREAM else wanted
        return self.loaded.launch(number(handle), grid, block, shared, [number(each) for each in arguments], wanted)
