"""What torch must find when it is imported: hooks that let its autograd know of a device `cuda`."""

from __future__ import annotations

import ctypes
from pathlib import Path

from tests.emulated_cuda.native.native_library import torch_library
from tests.emulated_cuda.settings import cache_folder


def load(torch_folder: Path) -> Path:
    """Load the hooks for the torch of a folder; the library's path."""
    library = torch_library(Path(__file__).with_suffix(".cpp"), torch_folder, cache_folder(), ("c10", "torch_cpu"))
    ctypes.CDLL(str(torch_folder / "lib" / "libtorch_cpu.so"), mode=ctypes.RTLD_GLOBAL)
    ctypes.CDLL(str(library))
    return library
