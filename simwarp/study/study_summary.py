"""What many runs say together: means, quantiles, a share of passes, and how strongly each key bears on a figure."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata

from simwarp.study.study_figures import Figure

Array = npt.NDArray[np.float64]

QUANTILES: Final = (5, 50, 95)
"""[%]."""
LEAST_RUNS: Final = 3
"""Below which there is no rank correlation."""
BY_CHANCE: Final = 1.96
"""Standard deviations that a rank correlation of independent numbers stays within in 95 of 100 cases."""


@dataclasses.dataclass(frozen=True)
class FigureSummary:
    """One figure of many runs.

    Attributes:
        figure: which.
        nominal: of the vehicle as built.
        count: runs that have it.
        missing: runs that did not come to it.
        mean, deviation: of those that have it.
        quantiles: by per cent.
        correlations: Spearman's rank correlation with every key; NaN where either does not differ.
    """

    figure: Figure
    nominal: float
    count: int
    missing: int
    mean: float
    deviation: float
    quantiles: dict[int, float]
    correlations: tuple[float, ...]

    @property
    def chance(self) -> float:
        """Size below which the rank correlation of independent numbers stays in 95 of 100 cases."""
        return BY_CHANCE / math.sqrt(self.count - 1) if self.count > 1 else math.nan

    def plain(self, keys: Sequence[str]) -> dict[str, Any]:
        """For JSON."""
        return {
            "key": self.figure.key, "label": self.figure.label, "unit": self.figure.unit, "nominal": self.nominal,
            "count": self.count, "missing": self.missing, "mean": self.mean, "deviation": self.deviation,
            "correlations": dict(zip(keys, self.correlations, strict=True)), "chance": self.chance,
        }  # fmt: skip


def summary_of(figure: Figure, nominal: float, values: Array, keys: Array) -> FigureSummary:
    """A figure of some runs.

    Args:
        figure: which.
        nominal: of the vehicle as built.
        values: (N,) of the runs, NaN where a run did not come to it.
        keys: (N, K) values of the keys in these runs.
    """
    known = np.isfinite(values)
    found = values[known]
    nothing = not found.size
    quantiles = {part: math.nan if nothing else float(np.percentile(found, part)) for part in QUANTILES}
    correlations = tuple(rank_correlation(column, found) for column in keys[known].T)
    return FigureSummary(
        figure=figure, nominal=nominal, count=len(found), missing=int(len(values) - len(found)),
        mean=math.nan if nothing else float(found.mean()),
        deviation=float(found.std(ddof=1)) if len(found) > 1 else math.nan,
        quantiles=quantiles, correlations=correlations,
    )  # fmt: skip


def rank_correlation(one: Array, other: Array) -> float:
    """Spearman's, ties sharing the mean of their ranks; NaN of fewer than three runs, or where one does not differ."""
    if len(one) < LEAST_RUNS:
        return math.nan
    ranks = [rankdata(values) - 0.5 * (len(values) + 1) for values in (one, other)]
    size = math.sqrt(float(ranks[0] @ ranks[0]) * float(ranks[1] @ ranks[1]))
    return float(ranks[0] @ ranks[1]) / size if size > 0.0 else math.nan
