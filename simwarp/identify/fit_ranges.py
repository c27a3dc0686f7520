"""The spread that a fit leaves, as ranges that a task can draw from (`randomise`)."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.identify.fit import Fit, FitResult
from simwarp.model.model import Model

SAME: Final = 1e-5
"""Relative difference of factors that count as one."""
OWNERS: Final = {"body": "body_names", "shape": "shape_names"}
"""Beginning of a parameter's name -> names of its entries."""


@dataclasses.dataclass(frozen=True)
class FittedRange:
    """One parameter of a fit as a distribution.

    Attributes:
        name: of the fitted parameter.
        mean, deviation: of it.
        randomise: parameter of the model -> a `Range` as plain values, a factor of the fitted model; empty where no
            range says what the parameter does.
    """

    name: str
    mean: float
    deviation: float
    randomise: dict[str, dict[str, Any]]


def ranges_of(fit: Fit, result: FitResult) -> list[FittedRange]:
    """A distribution for every parameter that the data tell.

    Args:
        fit: that was run.
        result: of it.
    """
    found = []
    names = fit.target.model_names()
    for index, name in enumerate(result.names[: result.count]):
        deviation = float(result.uncertainty.deviation[index])
        if not math.isfinite(deviation):
            continue
        ranges: dict[str, dict[str, Any]] = {}
        if index < fit.parameters.document_count:
            ranges = _ranges(fit, result, index, names)
        found.append(FittedRange(name, float(result.values[index]), deviation, ranges))
    return found


def _ranges(fit: Fit, result: FitResult, index: int, names: Model) -> dict[str, dict[str, Any]]:
    """Factors of model parameters between the ends of the interval."""
    low, high = float(result.uncertainty.low[index]), float(result.uncertainty.high[index])
    unknown = fit.parameters.unknowns[index]
    vectors = []
    for value in (float(result.values[index]), max(low, unknown.low), min(high, unknown.high)):
        vector = result.values[: result.count].copy()
        vector[index] = value
        vectors.append(vector)
    try:
        middle, *ends = (fit.target.numbers(fit.parameters.changed(vector), {}).parameters for vector in vectors)
    except ValueError:
        return {}
    found = {}
    for name, values in middle.items():
        factors = [_factors(values, end[name]) for end in ends]
        entries = sorted(set(factors[0]) | set(factors[1]))
        if not entries:
            continue
        spread = [factor for end in factors for factor in end.values()]
        if not np.isfinite(spread).all() or min(spread) <= 0.0:
            continue
        only = _named(name, entries, names)
        if only is not None:
            found[name] = {"low": min(spread), "high": max(spread), "mode": "scale", "only": only, "shared": True}
    return found


def _factors(before: npt.NDArray[Any], after: npt.NDArray[Any]) -> dict[int, float]:
    """Entries that differ, and the factor of each; nan where there is no one factor."""
    found = {}
    for entry in range(len(before)):
        first, second = np.ravel(before[entry]).astype(float), np.ravel(after[entry]).astype(float)
        if np.array_equal(first, second):
            continue
        largest = int(np.argmax(np.abs(first)))
        factor = second[largest] / first[largest] if first[largest] != 0.0 else math.nan
        found[entry] = float(factor) if np.allclose(second, factor * first, rtol=SAME, atol=0.0) else math.nan
    return found


def _named(name: str, entries: list[int], model: Model) -> list[str] | None:
    """Bodies, joints or shapes that the entries belong to; None where entries have no names."""
    kind = name.partition("_")[0]
    if kind in OWNERS:
        known = getattr(model, OWNERS[kind])
        return [known[entry] for entry in entries]
    if kind not in ("joint", "drive") or name.startswith(("joint_anchor", "joint_frame", "joint_offset")):
        return None
    starts = np.asarray(model.joint_dof_start)
    joints = np.searchsorted(starts, entries, side="right") - 1
    return [model.joint_names[joint] for joint in dict.fromkeys(joints.tolist())]
