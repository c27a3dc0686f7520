"""Arrays of another device than the one that works on them: where they are moved, and where they are refused.

A kernel takes the addresses of its arrays as they are: one of another device is a segmentation fault on a CPU and ends
all work on a GPU. So what a user hands in passes through here. Calls between steps move it, as they move NumPy's.
Functions of every step refuse such arrays: a move allocates and waits, and would slow the step down unnoticed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy.typing as npt
import warp as wp

from simwarp.core.types import ModelError, formatted


def is_on(device: Any, array: Any) -> bool:
    """True if a Warp array or tensor lies on a device, of Warp or by name; both libraries call them the same."""
    return str(array.device) == str(device)


def array_on(thing: str, value: Any, device: Any, dtype: Any = None) -> wp.array:
    """A Warp array or tensor as a Warp array on a device: over the same memory where it lies there, else a copy.

    Args:
        thing: that errors begin with: call, argument, "must".
        value: Warp's or torch's array.
        device: Warp's.
        dtype: of Warp, for the last axes of a tensor; by default its scalar.

    Raises:
        ModelError: it lies elsewhere while a graph is captured.
    """
    elsewhere = not is_on(device, value)
    if elsewhere:
        refuse_in_capture(thing, device, f"one on {value.device}")
    if not isinstance(value, wp.array):
        if elsewhere and value.device.type != "cpu":
            value = value.to(str(device))  # by torch, which knows on which of its streams it was written
        # what lies on the CPU is moved by Warp below: torch may be a build without the device
        value = wp.from_torch(value.detach().contiguous(), dtype=dtype, requires_grad=False)
    array: wp.array = value if value.device == device else value.to(device)
    return array


def array_from_host(thing: str, values: npt.NDArray[Any], device: Any, dtype: Any) -> wp.array:
    """NumPy's values as a Warp array on a device.

    Raises:
        ModelError: the device is a GPU that captures a graph.
    """
    if device.is_cuda:
        refuse_in_capture(thing, device, "values of the host")
    array: wp.array = wp.array(values, dtype=dtype, ndim=values.ndim - len(_vector(dtype)), device=device)
    return array


def refuse_in_capture(thing: str, device: Any, given: str) -> None:
    """Refuses to copy values to a device that captures a graph, which would read the copy when it is long gone.

    Raises:
        ModelError: a graph is being captured.
    """
    if device.is_capturing:
        raise ModelError(
            f"{thing} be an array on {device} while a graph is captured, got {given}; make it before the capture"
        )


def refuse_elsewhere(thing: str, value: Any, device: Any) -> None:
    """Refuses a Warp array or tensor that does not lie on a Warp device.

    Args:
        thing: that the error begins with: call, argument, "must".
        value: the array.
        device: where it has to be.

    Raises:
        ModelError: it lies elsewhere.
    """
    if not is_on(device, value):
        raise ModelError(f"{thing} be on {device}, got an array on {value.device}; make it there, or move it once")


def refuse_arguments_elsewhere(kernel: wp.Kernel, arguments: Sequence[Any], device: Any) -> None:
    """Refuses a launch whose arrays and tensors, those in structs included, do not lie on its Warp device.

    For launches that are recorded once: it costs nothing where they run.

    Args:
        kernel: to be launched.
        arguments: the first ones of it.
        device: of the launch.

    Raises:
        ModelError: one lies elsewhere; names the kernel's argument.
    """
    for parameter, argument in zip(kernel.adj.args, arguments, strict=False):
        for name, array in _arrays(parameter.label, argument):
            refuse_elsewhere(f"{kernel.key}: {name} must", array, device)


def refuse_strided_arguments(kernel: wp.Kernel, arguments: Sequence[Any]) -> None:
    """Refuses a launch of which an array's innermost axis is not contiguous: its kernel does not multiply by its step.

    Args:
        kernel: to be launched.
        arguments: the first ones of it.

    Raises:
        ModelError: an array has steps; names the kernel's argument.
    """
    for parameter, argument in zip(kernel.adj.args, arguments, strict=False):
        for name, array in _arrays(parameter.label, argument):
            if array.shape[-1] > 1 and array.strides[-1] != wp.types.type_size_in_bytes(array.dtype):
                raise ModelError(
                    f"{kernel.key}: {name} must be contiguous along its last axis, got strides "
                    f"{formatted(array.strides)}; pass a copy of it"
                )


def _arrays(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The arrays that a kernel would find in an argument, and their names; those without memory are nowhere."""
    if isinstance(value, wp.array):
        if value.size:
            yield name, value
    elif hasattr(value, "data_ptr"):
        yield name, value
    elif hasattr(value, "_ctype"):  # of a `wp.struct`, for which Warp has no public base class
        for member, held in vars(value).items():
            if isinstance(held, wp.array) or hasattr(held, "_ctype"):
                yield from _arrays(f"{name}.{member}", held)


def _vector(dtype: Any) -> tuple[int, ...]:
    """Axes of one value of a Warp type: none of a scalar."""
    return tuple(getattr(dtype, "_shape_", ()))
