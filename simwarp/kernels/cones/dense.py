"""Dense Cholesky with guarded pivots, in place, and its solves: rows contiguous, one thread."""

import warp as wp

from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})

PIVOT = wp.constant(3.0e-6)
"""A pivot below this part of its own diagonal is rounding, of a redundant row for instance."""


@wp.func_native(
    """
#pragma clang fp reassociate(on)
"""
    + VIEWS
    + """
    const Floats x = row(a, i), y = row(b, j);
    float total = 0.0f;
#pragma clang loop vectorize_width(8) interleave_count(2)
    for (int k = 0; k < n; ++k) total += x[k] * y[k];
    return total;
"""
)
def dot_rows(n: int, a: wp.array2d[float], i: int, b: wp.array2d[float], j: int) -> float:
    """Product of the first n entries of row i of a and row j of b."""
    ...


@wp.func_native(
    """
#pragma clang fp reassociate(on)
"""
    + VIEWS
    + """
    const Floats x = row(a, i), y = row(b, j);
    double total = start;
#pragma clang loop vectorize_width(4) interleave_count(2)
    for (int k = 0; k < n; ++k) total += (double)x[k] * (double)y[k];
    return (float)total;
"""
)
def dot_rows_wide(start: float, n: int, a: wp.array2d[float], i: int, b: wp.array2d[float], j: int) -> float:
    """Product `dot_rows` plus start, summed in double precision: for residuals, where large terms cancel."""
    ...


@wp.func_native(
    """
"""
    + VIEWS
    + """
    const Floats x = row(a, i), y = row(b, j);
#pragma clang loop vectorize_width(8) interleave_count(2)
    for (int k = 0; k < n; ++k) y[k] += factor * x[k];
"""
)
def add_to_row(n: int, factor: float, a: wp.array2d[float], i: int, b: wp.array2d[float], j: int):
    """Row j of b <- with `factor` times row i of a more (different rows)."""
    ...


@wp.func
def cholesky(n: int, a: wp.array2d[float], least: float):
    """Lower triangle of a symmetric a <- L with a = L L^T; the diagonal holds 1 / L_ii, or 0 where a row is redundant.

    Only the lower triangle of a is read. Pivots below PIVOT of their diagonal are left out if `least` is zero, else
    those below `least` of it are raised to that.
    """
    for i in range(n):
        own = a[i, i]
        for j in range(i):
            a[i, j] = (a[i, j] - dot_rows(j, a, i, a, j)) * a[j, j]
        pivot = own - dot_rows(i, a, i, a, i)
        inverse = float(0.0)
        if least > 0.0:
            pivot = wp.max(pivot, least * own)
        elif pivot <= PIVOT * own:
            pivot = float(0.0)
        if pivot > 0.0:
            inverse = 1.0 / wp.sqrt(pivot)
        a[i, i] = inverse


@wp.func
def cholesky_solve(n: int, a: wp.array2d[float], b: wp.array2d[float], row: int):
    """Row `row` of b <- (L L^T)^-1 times it, redundant rows zero; `a` is what `cholesky` left."""
    for i in range(n):
        b[row, i] = (b[row, i] - dot_rows(i, a, i, b, row)) * a[i, i]
    for back in range(n):
        i = n - 1 - back
        value = b[row, i] * a[i, i]
        b[row, i] = value
        add_to_row(i, -value, a, i, b, row)
