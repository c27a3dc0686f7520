"""Operations on the rows of an array of vectors."""

import warp as wp

from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})


@wp.func_native(
    VIEWS
    + """
    const Floats a = row(vectors, source), b = row(vectors, target);
#pragma clang loop vectorize_width(4) interleave_count(1)
    for (int i = 0; i < n; ++i) b[i] = a[i];
"""
)
def copy(n: int, vectors: wp.array2d[float], source: int, target: int):
    """vectors[target] <- vectors[source]."""
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
