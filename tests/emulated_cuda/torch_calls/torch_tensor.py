"""Tensors that say they lie on `cuda:0`: wrappers around tensors of the host's view of the device's memory."""

from __future__ import annotations

import contextlib
import ctypes
import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tests.emulated_cuda.device import ARENA, BASE, DELTA, device
from tests.emulated_cuda.native.native_library import torch_library

CUDA = torch.device("cuda", 0)
HOST = -1
"""Memory of the host, in place of a stream's handle."""
NOT_TO_NUMPY = (
    "can't convert cuda:0 device type tensor to numpy. Use Tensor.cpu() to copy the tensor to host memory first."
)
Dispatch = Callable[[Any, Sequence[Any], dict[str, Any]], Any]


@functools.cache
def allocator() -> ctypes.PyDLL:
    """The library with torch's allocator."""
    library = torch_library(
        Path(__file__).with_name("torch_allocator.cpp"), Path(torch.__file__).parent, device().settings.cache, ("c10",)
    )
    loaded = ctypes.PyDLL(str(library))
    loaded.emulated_allocate_in.restype = ctypes.c_int64
    loaded.emulated_install()
    return loaded


@contextlib.contextmanager
def allocating_in(stream: int) -> Iterator[None]:
    """Tensors of this thread are made in a stream of the device, or on the host."""
    before = allocator().emulated_allocate_in(ctypes.c_int64(stream))
    try:
        yield
    finally:
        allocator().emulated_allocate_in(ctypes.c_int64(before))


def device_address(host_address: int) -> int:
    """The device's address of what the host sees at one; other addresses stay."""
    return host_address - DELTA if BASE + DELTA <= host_address < BASE + DELTA + ARENA else host_address


class CudaStorage:
    """What `untyped_storage()` gives of a tensor of the device."""

    def __init__(self, host_tensor: torch.Tensor) -> None:
        self._storage = host_tensor.untyped_storage()

    def data_ptr(self) -> int:
        """Address on the device."""
        return device_address(self._storage.data_ptr())

    def nbytes(self) -> int:
        """Size."""
        return self._storage.nbytes()


class CudaTensor(torch.Tensor):
    """A tensor of the device; `host_tensor` is the host's view of its memory."""

    host_tensor: torch.Tensor
    dispatch: Dispatch
    """Runs an operator; set when the device is installed."""

    @staticmethod
    def __new__(cls: type[CudaTensor], host_tensor: torch.Tensor) -> CudaTensor:
        made: CudaTensor = torch.Tensor._make_wrapper_subclass(
            cls, host_tensor.size(), strides=host_tensor.stride(), storage_offset=host_tensor.storage_offset(),
            dtype=host_tensor.dtype, layout=host_tensor.layout, device=CUDA, requires_grad=False,
        )  # fmt: skip
        return made

    def __init__(self, host_tensor: torch.Tensor) -> None:
        self.host_tensor = host_tensor

    __torch_function__ = torch._C._disabled_torch_function_impl  # type: ignore[assignment]

    @classmethod
    def __torch_dispatch__(  # type: ignore[override]
        cls, func: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        return CudaTensor.dispatch(func, args, kwargs or {})

    def data_ptr(self) -> int:
        """Address on the device."""
        return device_address(self.host_tensor.data_ptr())

    def untyped_storage(self) -> Any:
        """Memory that views share."""
        return CudaStorage(self.host_tensor)

    def numpy(self, *, force: bool = False) -> np.ndarray:
        """An array of the host, if `force` allows the copy."""
        if force:
            return self.detach().cpu().numpy()
        raise TypeError(NOT_TO_NUMPY)

    def __array__(self, *args: Any, **kwargs: Any) -> np.ndarray:
        raise TypeError(NOT_TO_NUMPY)

    def tolist(self) -> Any:
        """Numbers, for which the host waits."""
        return self.detach().cpu().tolist()

    def is_pinned(self, *args: Any) -> bool:
        """Only memory of the host is pinned."""
        return False

    def record_stream(self, stream: Any) -> None:
        """The memory is not given back before what another stream has to do now is done."""
        address = device_address(self.host_tensor.untyped_storage().data_ptr())
        device().recorded_streams.setdefault(address, set()).add(stream.cuda_stream)

    def __repr__(self, *, tensor_contents: Any = None) -> str:  # type: ignore[override]
        return f"{self.cpu()!r}@cuda:0"

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.detach().cpu().requires_grad_(self.requires_grad).__reduce_ex__(protocol)

    def __deepcopy__(self, memo: dict[int, Any]) -> torch.Tensor:
        made = self.detach().clone().requires_grad_(self.requires_grad)
        memo[id(self)] = made
        return made


class HostView:
    """An array interface of the host to memory of the device, whose owner it keeps."""

    def __init__(self, owner: Any, interface: dict[str, Any]) -> None:
        self.owner = owner
        self.__array_interface__ = interface


def over_memory(owner: Any, interface: dict[str, Any]) -> torch.Tensor:
    """The host's view of memory that something with `__cuda_array_interface__` owns."""
    shape, kind = tuple(interface["shape"]), np.dtype(interface["typestr"])
    address = interface["data"][0] or 0
    if address == 0 or 0 in shape:
        return torch.from_numpy(np.zeros(shape, kind))

    there = {"shape": shape, "strides": interface.get("strides"), "typestr": interface["typestr"], "version": 3}
    return torch.from_numpy(np.asarray(HostView(owner, {**there, "data": (address + DELTA, False)})))


def borrowed(tensor: torch.Tensor) -> torch.Tensor:
    """The same memory without owning it, if it is the device's: an operation that waits keeps nothing alive."""
    storage = tensor.untyped_storage()
    address, size = storage.data_ptr(), storage.nbytes()
    if device_address(address) == address or not size:
        return tensor
    count = size // tensor.element_size()
    memory = (ctypes.c_char * (count * tensor.element_size())).from_address(address)
    flat = torch.frombuffer(memory, dtype=tensor.dtype, count=count)
    return flat.as_strided(tensor.size(), tensor.stride(), tensor.storage_offset())
