"""Arrays that a user writes with `array[:, 0] = value`: Warp arrays with item assignment, nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

CONVERSIONS = {
    np.float32: "float", np.float64: "double", np.int32: "int", np.int64: "long", np.uint8: "byte", np.bool_: "bool",
}  # fmt: skip
"""The tensor method that makes each NumPy type."""


class WritableArray(wp.array):
    """A Warp array whose slices can be assigned: a scalar fills, an array, tensor or sequence is copied in.

    It is the same memory and is passed to kernels, `wp.to_torch` and `wp.copy` like any Warp array. Values broadcast as
    in NumPy and are converted to the dtype of the array; vectors are a last axis of their own in values, not in keys.
    Only integers and slices are keys: for masks, index a torch view of the same memory (`interop.to_torch`).
    """

    def __getitem__(self, key: Any) -> Any:
        view = super().__getitem__(key)
        if type(view) is wp.array:
            view.__class__ = WritableArray
        return view

    def __setitem__(self, key: Any, value: Any) -> None:
        view: Any = super().__getitem__(self._slices(key))
        if isinstance(value, (int, float)):
            view.fill_(self._scalar()(value).item())
            return
        if isinstance(value, wp.array):
            source: Any = value
            if source.shape != view.shape or source.dtype != view.dtype:
                raise ValueError(
                    f"cannot assign a Warp array of {source.shape} {source.dtype.__name__} to {view.shape} "
                    f"{view.dtype.__name__}; shapes and dtypes must agree"
                )
        elif hasattr(value, "data_ptr"):
            source = wp.from_torch(self._broadcast_tensor(value, view), dtype=self.dtype)
        else:
            data = np.broadcast_to(np.asarray(value, dtype=self._scalar()), self._value_shape(view))
            source = wp.array(np.ascontiguousarray(data), dtype=self.dtype, device=self.device)
        wp.copy(view, source)

    def _slices(self, key: Any) -> tuple[int | slice, ...]:
        """`key` as what Warp indexes with; a key of integers alone keeps its last axis, of length 1."""
        parts = list(key) if isinstance(key, tuple) else [key]
        if len(parts) == 1 and parts[0] is Ellipsis:
            parts = [slice(None)]
        for axis, part in enumerate(parts):
            if axis >= self.ndim or not isinstance(part, (int, np.integer, slice)) or isinstance(part, bool):
                raise IndexError(
                    f"an array of shape {self.shape} takes up to {self.ndim} integers or slices, got {key!r}; "
                    "for masks and lists index simwarp.interop.to_torch(array)"
                )
            if not isinstance(part, slice):
                if not -self.shape[axis] <= part < self.shape[axis]:
                    raise IndexError(f"index {part} is outside axis {axis} of length {self.shape[axis]}")
                parts[axis] = int(part) % self.shape[axis]
        if len(parts) == self.ndim and not any(isinstance(part, slice) for part in parts):
            parts[-1] = slice(parts[-1], parts[-1] + 1)
        return tuple(parts)

    def _scalar(self) -> Any:
        """NumPy type of one component: float32 mostly, float64 for positions of record and anchors."""
        return wp.dtype_to_numpy(getattr(self.dtype, "_wp_scalar_type_", self.dtype))

    def _value_shape(self, view: wp.array) -> tuple[int, ...]:
        return (*view.shape, *getattr(self.dtype, "_shape_", ()))

    def _broadcast_tensor(self, tensor: Any, view: wp.array) -> Any:
        """A contiguous tensor of the shape and type that `view` wants; no torch import needed for its methods."""
        shape = self._value_shape(view)
        try:
            # methods of the tensor's own: this file does without torch
            numbers = getattr(tensor.detach(), CONVERSIONS[self._scalar()])()
            return numbers.expand(shape).contiguous()
        except RuntimeError as error:
            raise ValueError(f"cannot broadcast a tensor of shape {tuple(tensor.shape)} to {shape}") from error


def writable(shape: tuple[int, ...], dtype: Any, device: Any) -> WritableArray:
    """Zeros of the given shape that support item assignment."""
    zeros: Any = wp.zeros(shape, dtype=dtype, device=device)
    zeros.__class__ = WritableArray
    return zeros


def writable_from(data: Any, dtype: Any, device: Any) -> WritableArray:
    """An array with the given contents that supports item assignment."""
    array: Any = wp.array(data, dtype=dtype, device=device)
    array.__class__ = WritableArray
    return array
