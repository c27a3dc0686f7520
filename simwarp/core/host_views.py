"""Warp arrays as NumPy reads them over and over."""

from __future__ import annotations

from typing import Any, Final

import numpy.typing as npt
import warp as wp

MOST_VIEWS: Final = 256
"""That are remembered: arrays that are made anew for each look must not pile up."""


class HostViews:
    """The present values of arrays: of a CPU views of their memory, made once, which go on with it; of a GPU copies."""

    def __init__(self) -> None:
        self._views: dict[int, tuple[wp.array, npt.NDArray[Any]]] = {}

    def of(self, array: wp.array) -> npt.NDArray[Any]:
        """The values of an array; waits for its device."""
        held = self._views.get(id(array))
        if held is not None and held[0] is array:
            return held[1]
        values: npt.NDArray[Any] = array.numpy()
        if wp.get_device(array.device).is_cpu:
            if len(self._views) >= MOST_VIEWS:
                self._views.clear()
            self._views[id(array)] = (array, values)
        return values
