"""What the data tell of the unknowns of a fit: standard deviations, correlations, and what cannot be told.

Near the least cost the residuals are linear in the unknowns. With residuals in standard deviations of the noise the
covariance is the inverse of JᵀJ; where the noise is not known, what is left over of each reading stands for it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

Array = npt.NDArray[np.float64]

TELLS: Final = 2.0
"""Standard deviation of a direction, in scales of the unknowns, up to which the data tell it."""
ROUNDING: Final = 1e-4
"""Singular value over the largest, below which a direction is only the noise of single precision and differences."""
NAMED: Final = 0.3
"""Share in a direction from which an unknown is named."""
LEVEL: Final = 0.95
"""Of the intervals."""


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """Of the unknowns at the end of a fit.

    Attributes:
        deviation: (P,) standard deviations; infinite where the data tell nothing.
        low, high: (P,) ends of the intervals.
        correlation: (P, P); zero beside unknowns that cannot be told.
        identifiable: (P,) whether the data tell it.
        without_influence: (P,) whether no reading changes with it at all.
        directions: groups of unknowns (indices and shares) of which the data do not tell one combination.
    """

    deviation: Array
    low: Array
    high: Array
    correlation: Array
    identifiable: npt.NDArray[np.bool_]
    without_influence: npt.NDArray[np.bool_]
    directions: tuple[tuple[tuple[int, float], ...], ...]


def uncertainty_of(
    value: Array, scale: Array, jacobian: Array, residuals: Array, groups: Sequence[slice], known: Sequence[bool]
) -> Uncertainty:
    """What a fit tells.

    Args:
        value: (P,) of the unknowns.
        scale: (P,) changes that are large.
        jacobian: (M, P) of the residuals.
        residuals: (M,) left over.
        groups: rows of each reading; the rest are priors.
        known: whether the noise of a group is known, so that its residuals should be 1 in the mean square.
    """
    count = len(value)
    scaled = jacobian * scale
    freedom = max(1, len(residuals) - count)
    spread = np.ones(len(residuals))
    share = len(residuals) / freedom
    for rows, is_known in zip(groups, known, strict=True):
        mean_square = float(np.mean(residuals[rows] ** 2)) * share if residuals[rows].size else 1.0
        # a model that does not fit makes more of the noise than was said, never less
        spread[rows] = max(1.0, mean_square) if is_known else mean_square
    without = np.linalg.norm(scaled, axis=0) == 0.0
    weights = 1.0 / np.maximum(spread, 1e-300)
    _, sizes, directions = np.linalg.svd(scaled * np.sqrt(weights)[:, None], full_matrices=True)
    sizes = np.pad(sizes, (0, count - len(sizes)))
    lost = (sizes < ROUNDING * max(float(sizes.max(initial=0.0)), 1e-300)) | (sizes * TELLS < 1.0)
    told = directions[~lost]
    covariance = (told.T / sizes[~lost] ** 2) @ told
    shares = np.square(directions[lost]).sum(axis=0) if lost.any() else np.zeros(count)
    identifiable = (shares < NAMED**2) & ~without
    deviation = np.where(identifiable, np.sqrt(np.diag(covariance)) * scale, np.inf)
    factor = float(student.ppf(0.5 + 0.5 * LEVEL, freedom))
    root = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = np.where(np.outer(identifiable, identifiable), covariance / np.outer(root, root), 0.0)
    np.fill_diagonal(correlation, 1.0)
    return Uncertainty(
        deviation, value - factor * deviation, value + factor * deviation, correlation, identifiable, without,
        tuple(_named(row) for row in directions[lost]),
    )  # fmt: skip


def _named(direction: Array) -> tuple[tuple[int, float], ...]:
    """Unknowns with a share in a direction, the largest first."""
    order = np.argsort(-np.abs(direction))
    return tuple((int(index), float(direction[index])) for index in order if abs(direction[index]) >= NAMED)
