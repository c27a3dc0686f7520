"""Zero-copy bridge between Warp arrays and torch tensors: the only file of the core that imports torch.

Build views once, next to the arrays they look at, and keep them: a view is cheap but not free (some 4 µs), and
one made inside ``torch.inference_mode`` can never be written in place outside it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Final

import torch
import warp as wp

from simwarp.core.array_devices import refuse_arguments_elsewhere, refuse_elsewhere
from simwarp.core.warp_start import start_warp

THREADS: Final = 32
"""Threads of a block on a GPU: a batch of worlds is small, and is to reach all of its processors."""
_STREAMS: Final[dict[tuple[int | None, int], wp.Stream]] = {}
"""Warp's streams over those of torch, by device and address: each is made once."""


def to_torch(array: wp.array) -> torch.Tensor:
    """Return a tensor over the memory of ``array``: no copy, no gradient.

    A vec3 array (W, B) becomes (W, B, 3), a transform array (W, B, 7) in the order x y z, qx qy qz qw.

    Raises:
        TypeError: the dtype does not exist in torch (unsigned integers wider than 8 bits, structs).
    """
    with torch.inference_mode(False):
        return wp.to_torch(array, requires_grad=False)


def from_torch(tensor: torch.Tensor, dtype: Any = None) -> wp.array:
    """Return a Warp array over the memory of a contiguous ``tensor``; bool becomes ``wp.bool``.

    Args:
        tensor: contiguous, on the CPU or a CUDA device.
        dtype: Warp dtype, such as ``wp.vec3`` for (..., 3) float32; by default the scalar of the tensor.
    """
    if not tensor.is_contiguous():
        raise ValueError(f"from_torch needs a contiguous tensor, got strides {tensor.stride()}; call .contiguous()")
    return array_over(tensor, dtype)


def array_over(tensor: torch.Tensor, dtype: Any = None) -> wp.array:
    """Return a Warp array over a tensor's memory, with its strides."""
    start_warp()  # where this is the first that is asked of it
    array = wp.from_torch(tensor.detach(), dtype=dtype, requires_grad=False)
    assert isinstance(array, wp.array)  # it can also return a C struct, for callers that ask for one
    return array


def missing_in_torch(device: wp.Device) -> str:
    """Why torch has no tensors on a GPU of Warp's; empty where it has."""
    if device.ordinal < torch.cuda.device_count():
        return ""
    build = "a CPU build" if torch.version.cuda is None else f"for CUDA {torch.version.cuda}"
    return f"torch {torch.__version__}, {build}, does not see"


class TensorLaunch:
    """A recorded launch of a kernel whose arguments may be torch tensors, of any strides.

    Args:
        kernel: to launch.
        dim: of the launch.
        arguments: of the kernel: numbers, structs, Warp arrays, and tensors; one of vectors has their components last.
            They are kept alive.
        device: name of the device.

    Raises:
        ModelError: an array or tensor lies on another device.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset({"_shown"})
    """Attributes that a launch itself does not read."""

    def __init__(self, kernel: wp.Kernel, dim: int | Sequence[int], arguments: Sequence[Any], device: Any) -> None:
        start_warp()  # where this is the first that is asked of it
        self._kernel, self._device = kernel, wp.get_device(str(device))
        refuse_arguments_elsewhere(kernel, arguments, self._device)
        self._shown: dict[int, tuple[Any, ...]] = {}
        self._dtypes: dict[int, Any] = {}
        values = []
        for index, value in enumerate(arguments):
            if isinstance(value, torch.Tensor):
                self._shown[index] = _memory(value)
                kind: Any = kernel.adj.args[index].type
                self._dtypes[index] = kind.dtype
                value = array_over(value, self._dtypes[index])
            values.append(value)
        self._command: Any = wp.launch(
            kernel, dim=dim, inputs=values, device=self._device, block_dim=THREADS, record_cmd=True
        )  # fmt: skip

    def launch(self) -> None:
        """Launch on the arguments as they are."""
        self._command.launch()

    def on(self, *tensors: torch.Tensor) -> None:
        """Launch with other tensors in place of the first tensors among the arguments, of the same dtypes and shapes.

        The launch keeps them until it gets others; they are looked at anew only where their memory is another one.

        Raises:
            ModelError: a tensor lies on another device.
        """
        for index, tensor in zip(self._shown, tensors, strict=False):
            memory = _memory(tensor)
            if memory != self._shown[index]:
                label = self._kernel.adj.args[index].label
                refuse_elsewhere(f"{self._kernel.key}: {label} must", tensor, self._device)
                self._command.set_param_at_index(index, array_over(tensor, self._dtypes[index]))
                self._shown[index] = memory
        self._command.launch()


def _memory(tensor: torch.Tensor) -> tuple[Any, ...]:
    return (tensor.data_ptr(), tensor.shape, tensor.stride())


@contextlib.contextmanager
def shared_stream(device: str) -> Iterator[wp.Stream | None]:
    """Let Warp launch on torch's current stream of ``device``, so that both see each other's results in order.

    Gives Warp's view of the stream. Nothing happens on a CPU, where every launch is synchronous.
    """
    if not device.startswith("cuda"):
        yield None
        return
    current = torch.cuda.current_stream(torch.device(device))
    key = (current.device_index, current.cuda_stream)
    if key not in _STREAMS:
        start_warp()  # where this is the first that is asked of it
        _STREAMS[key] = wp.stream_from_torch(current)
    with wp.ScopedStream(_STREAMS[key], sync_enter=False):
        yield _STREAMS[key]
