"""Makes a CPU build of torch find the emulated device."""

from __future__ import annotations

import contextlib
import ctypes
from pathlib import Path
from typing import Any

import torch
from torch.utils._pytree import tree_map

from tests.emulated_cuda.device import TOTAL_MEMORY, device
from tests.emulated_cuda.torch_calls import torch_hooks, torch_streams
from tests.emulated_cuda.torch_calls.torch_dispatch import Mode, capturing, dispatch, on_host
from tests.emulated_cuda.torch_calls.torch_tensor import CUDA, CudaTensor, allocator, over_memory


class Properties:
    """What torch.cuda.get_device_properties gives."""

    major, minor, multi_processor_count, total_memory = 9, 0, 132, TOTAL_MEMORY

    def __init__(self) -> None:
        self.name = device().settings.name


class Generator(torch.Generator):
    """A generator of random numbers of the device; its numbers are those of the CPU's."""

    def __new__(cls, device: Any = "cpu") -> Generator:
        return super().__new__(cls, "cpu")  # type: ignore[call-arg]

    def __init__(self, device: Any = "cpu") -> None:
        self._asked_for = torch.device(device)

    @property
    def device(self) -> torch.device:  # type: ignore[override]
        """The device that it was made for."""
        return CUDA if self._asked_for.type == "cuda" else self._asked_for


def _replace_functions(cuda: Any) -> None:
    used = lambda of=None: device().used()  # noqa: E731
    replaced = {
        "_lazy_init": lambda: None, "is_available": lambda: True, "is_initialized": lambda: True,
        "device_count": lambda: 1, "current_device": lambda: 0, "set_device": lambda to: None,
        "synchronize": torch_streams.synchronize, "Stream": torch_streams.Stream, "Event": torch_streams.Event,
        "CUDAGraph": torch_streams.CUDAGraph, "graph": torch_streams.graph, "stream": torch_streams.stream_context,
        "ExternalStream": torch_streams.external_stream, "current_stream": torch_streams.current_stream,
        "set_stream": torch_streams.set_stream, "default_stream": torch_streams.default_stream,
        "is_current_stream_capturing": capturing, "get_device_name": lambda of=None: device().settings.name,
        "get_device_capability": lambda of=None: (9, 0), "get_device_properties": lambda of=None: Properties(),
        "mem_get_info": lambda of=None: (TOTAL_MEMORY - device().used(), TOTAL_MEMORY), "memory_allocated": used,
        "max_memory_allocated": used, "memory_reserved": used, "empty_cache": lambda: None,
        "reset_peak_memory_stats": lambda of=None: None, "manual_seed": lambda seed: None,
        "manual_seed_all": lambda seed: None, "get_rng_state": lambda of=None: torch.get_rng_state(),
        "set_rng_state": lambda state, of=None: torch.set_rng_state(state),
        "get_rng_state_all": lambda: [torch.get_rng_state()], "device": contextlib.nullcontext,
    }  # fmt: skip
    for name, value in replaced.items():
        setattr(cuda, name, value)


def _replace_makers() -> None:
    as_tensor, load = torch.as_tensor, torch.load

    def as_tensor_of(data: Any, *args: Any, **kwargs: Any) -> torch.Tensor:
        interface = None if isinstance(data, torch.Tensor) else getattr(data, "__cuda_array_interface__", None)
        if interface is None:
            return as_tensor(data, *args, **kwargs)
        with on_host():
            return CudaTensor(over_memory(data, interface))

    def load_there(file: Any, map_location: Any = None, **kwargs: Any) -> Any:
        there = isinstance(map_location, (str, torch.device)) and torch.device(map_location).type == "cuda"
        found = load(file, map_location="cpu" if there else map_location, **kwargs)
        move = lambda value: value.to(CUDA) if isinstance(value, torch.Tensor) else value  # noqa: E731
        return tree_map(move, found) if there else found

    torch.as_tensor = as_tensor_of
    torch.load = load_there  # type: ignore[assignment]
    torch.Generator = Generator  # type: ignore[misc]


def install() -> None:
    """Make torch find the emulated device, once."""
    allocator()
    CudaTensor.dispatch = staticmethod(dispatch)
    hooks = ctypes.PyDLL(str(torch_hooks.load(Path(torch.__file__).parent)))
    device().is_torch_pinned = lambda address: bool(hooks.emulated_is_pinned(ctypes.c_uint64(address)))
    _replace_functions(torch.cuda)
    _replace_makers()
    torch.version.cuda = "13.0"
    torch.__future__.set_overwrite_module_params_on_conversion(True)
    torch._C._set_only_lift_cpu_tensors(True)
    Mode().__enter__()
