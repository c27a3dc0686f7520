"""Operations on the vectors of a problem, which its lanes share (core/lanes.py)."""

import warp as wp

from simwarp.kernels.core.lanes import LANES
from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})


@wp.func_native(
    VIEWS
    + LANES
    + """
    const Floats a = row(vectors, source), b = row(vectors, target);
#pragma clang loop vectorize_width(4) interleave_count(1)
    ROLLED for (int i = lane; i < n; i += stride) b[i] = a[i];
    meet_lanes();
"""
)
def copy(n: int, vectors: wp.array2d[float], source: int, target: int, lanes: int):
    """vectors[target] <- vectors[source]."""
    ...


@wp.func_native(
    VIEWS
    + LANES
    + """
    const Floats x = elements(values);
    ROLLED for (int i = lane; i < n; i += stride) x[i] = 0.0f;
    meet_lanes();
"""
)
def clear(n: int, values: wp.array[float], lanes: int):
    """Sets the first n values to zero."""
    ...


@wp.func_native(
    """
#pragma clang fp reassociate(on)
"""
    + VIEWS
    + """
    const Floats x = row(a, i), y = row(vectors, source);
    float total = 0.0f;
#pragma clang loop vectorize_width(4) interleave_count(2)
    for (int k = 0; k < n; ++k) total += x[k] * y[k];
    return total;
"""
)
def dot_row_vector(n: int, a: wp.array2d[float], i: int, vectors: wp.array2d[float], source: int) -> float:
    """Row i of a times vectors[source]."""
    ...
