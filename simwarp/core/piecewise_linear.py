"""Piecewise linear functions as the arrays of `simwarp.kernels.core.piecewise_linear`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import warp as wp


def function_arrays(functions: Sequence[Iterable[tuple[float, float]]], dtype: Any, device: wp.DeviceLike) -> Any:
    """Index of the first point of each function and one more, abscissae and values of all points.

    Args:
        functions: points (x, y) of each, in order of x; without any function the arrays have one point.
        dtype: of abscissae and values, wp.float32 or wp.float64.
        device: where the arrays are.
    """
    points = [np.array(list(function), np.float64).reshape(-1, 2) for function in functions]
    starts = np.cumsum([0] + [len(part) for part in points]).astype(np.int32)
    x, y = np.concatenate(points or [np.zeros((1, 2))]).T
    return (
        wp.array(starts, dtype=wp.int32, device=device),
        wp.array(np.ascontiguousarray(x), dtype=dtype, device=device),
        wp.array(np.ascontiguousarray(y), dtype=dtype, device=device),
    )
