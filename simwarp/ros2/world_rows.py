"""Reads one world's row of arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy.typing as npt
import warp as wp

Row: TypeAlias = Callable[[], npt.NDArray[Any]]


def row_of(array: wp.array, world: int) -> Row:
    """What returns the present values of a world, (...) of an array (W, ...): on a CPU the memory itself."""
    own: Any = array[world : world + 1]
    if own.device.is_cpu:
        values: npt.NDArray[Any] = own.numpy()
        return lambda: values[0]
    return lambda: own.numpy()[0]
