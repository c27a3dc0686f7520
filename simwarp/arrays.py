"""Arrays that a user writes with `array[:, 0] = value`: Warp arrays with item assignment, nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp


class WritableArray(wp.array):
    """A Warp array whose slices can be assigned: a scalar fills, an array, tensor or sequence is copied in.

    It is the same memory and is passed to kernels, `wp.to_torch` and `wp.copy` like any Warp array.
    """

    def __setitem__(self, key: Any, value: Any) -> None:
        view = wp.array.__getitem__(self, key)
        if isinstance(value, (int, float)):
            view.fill_(float(value))
            return
        if isinstance(value, wp.array):
            source = value
        elif hasattr(value, "data_ptr"):
            source = wp.from_torch(value.detach().contiguous(), dtype=self.dtype)
        else:
            data = np.asarray(value, dtype=np.float32)
            tail = getattr(self.dtype, "_shape_", ())
            source = wp.array(
                np.ascontiguousarray(np.broadcast_to(data, (*view.shape, *tail))), dtype=self.dtype, device=self.device
            )
        wp.copy(view, source)


def writable(shape: tuple[int, ...], dtype: Any, device: Any) -> WritableArray:
    """Zeros of the given shape that support item assignment."""
    array = wp.zeros(shape, dtype=dtype, device=device)
    array.__class__ = WritableArray
    return array
