"""Zero-copy bridge between Warp arrays and torch tensors: the only file of the core that imports torch.

Build views once, next to the arrays they look at, and keep them: a view is cheap but not free (some 4 µs), and
one made inside ``torch.inference_mode`` can never be written in place outside it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import torch
import warp as wp


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
    array = wp.from_torch(tensor.detach(), dtype=dtype, requires_grad=False)
    assert isinstance(array, wp.array)  # it can also return a C struct, for callers that ask for one
    return array


@contextlib.contextmanager
def shared_stream(device: str) -> Iterator[None]:
    """Let Warp launch on torch's current stream of ``device``, so that both see each other's results in order.

    Nothing happens on a CPU, where every launch is synchronous.
    """
    if not device.startswith("cuda"):
        yield
        return
    stream = wp.stream_from_torch(torch.cuda.current_stream(torch.device(device)))
    with wp.ScopedStream(stream, sync_enter=False):
        yield
