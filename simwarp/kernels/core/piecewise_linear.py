"""Piecewise linear functions of one variable: several in one array of points, each with the index of its first."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def segment_of(x: wp.array[Any], start: int, count: int, stride: int, value: Any) -> int:
    """Number of the segment that holds `value`, from 0 on; the first and the last one go on beyond the ends.

    Abscissa k of the function's `count` >= 2 is x[start + stride k]. A point belongs to the segment that begins there.
    """
    low = int(0)
    high = int(count - 1)
    while high - low > 1:
        middle = (low + high) // 2
        if x[start + stride * middle] <= value:
            low = middle
        else:
            high = middle
    return low


@wp.func
def bounded_value(
    function: int, value: float, start: wp.array[int], x: wp.array[float], y: wp.array[float]
) -> float:  # fmt: skip
    """Value of a function, whose points are those from start[function] up to start[function + 1]; constant beyond its
    ends. Of two points at one abscissa the later one counts from there on.
    """
    first = start[function]
    last = start[function + 1] - 1
    if value < x[first]:
        return y[first]
    if value >= x[last]:
        return y[last]
    at = first + segment_of(x, first, last + 1 - first, 1, value)
    part = (value - x[at]) / (x[at + 1] - x[at])
    return y[at] + part * (y[at + 1] - y[at])
