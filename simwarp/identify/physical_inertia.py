"""Inertias that a body can have, as six numbers without bounds.

The moments of a body's mass about its centre, S = ½ tr(J) 1 - J, are the second moments of a density that is nowhere
negative exactly where S is positive definite. Its Cholesky factor with the logarithm of the diagonal (Rucker and
Wensing 2022, "Smooth parameterization of rigid-body inertia") has no bounds, so that a fit cannot leave what is
physical: moments stay above zero and obey the triangle inequality.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simwarp.core.types import formatted
from simwarp.identify.fit_error import FitError

Array = npt.NDArray[np.float64]

LOWER = ((1, 0), (2, 0), (2, 1))
"""Entries below the diagonal in the order of the last three numbers."""


def second_moments(inertia: Array) -> Array:
    """(3, 3) of the mass about its centre [kg·m²], for an inertia matrix."""
    return np.asarray(0.5 * np.trace(inertia) * np.eye(3) - inertia)


def numbers_of(inertia: Array, place: str) -> Array:
    """(6,) numbers of an inertia: logarithms of the factor's diagonal, then what is below it over its row's diagonal.

    Raises:
        FitError: no body has this inertia.
    """
    try:
        factor = np.linalg.cholesky(second_moments(inertia))
    except np.linalg.LinAlgError:
        rule = "must be one that a body can have: each principal moment less than the sum of the others"
        raise FitError(f"{place}: {rule}, got {formatted(inertia.tolist())}; raise the least moment") from None
    diagonal = np.diag(factor)
    return np.array([*np.log(diagonal), *(factor[row, column] / diagonal[row] for row, column in LOWER)])


def inertia_of(numbers: Array) -> Array:
    """(3, 3) inertia of six numbers [kg·m²]."""
    diagonal = np.exp(numbers[:3])
    factor = np.diag(diagonal)
    for (row, column), share in zip(LOWER, numbers[3:], strict=True):
        factor[row, column] = share * diagonal[row]
    moments = factor @ factor.T
    return np.asarray(np.trace(moments) * np.eye(3) - moments)
