"""Statistics of features by which learning libraries normalise: of one episode, and of many.

As LeRobot makes them: of images a sample of the frames counts, per channel in [0, 1]; quantiles of many episodes are
the mean of theirs, weighted by their rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Statistics = dict[str, npt.NDArray[Any]]

QUANTILES: Final[Mapping[str, float]] = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_FEWEST, _MOST, _POWER = 100, 10_000, 0.75
"""Frames of an episode that count: all of a short one."""
_LARGE, _KEPT = 300, 150
"""Side of an image from which on pixels are left out, and the side that is then aimed at [pixels]."""


def of_rows(values: npt.NDArray[Any]) -> Statistics:
    """Return the statistics of numbers (N, ...), for each component of the last axis."""
    sampled = values if values.ndim <= 2 else values[_sampled(len(values))]
    flat = sampled.reshape(len(sampled), -1) if values.ndim <= 2 else sampled.reshape(-1, values.shape[-1])
    flat = flat.astype(np.float64)
    quantiles = np.quantile(flat, list(QUANTILES.values()), axis=0)
    return {
        "min": flat.min(axis=0), "max": flat.max(axis=0), "mean": flat.mean(axis=0), "std": flat.std(axis=0),
        "count": np.array([len(sampled)]), **dict(zip(QUANTILES, quantiles, strict=True)),
    }  # fmt: skip


def of_images(images: npt.NDArray[np.uint8]) -> Statistics:
    """Return the statistics (C, 1, 1) of images (N, height, width, C), in [0, 1]."""
    sampled = images[_sampled(len(images))]
    height, width = images.shape[1:3]
    if max(height, width) >= _LARGE:
        stride = max(height, width) // _KEPT
        sampled = sampled[:, ::stride, ::stride]
    channels = sampled.shape[-1]
    counts = np.stack([np.bincount(sampled[..., channel].ravel(), minlength=256) for channel in range(channels)])
    found = _of_histograms(counts.astype(np.float64))
    return {name: value.reshape(channels, 1, 1) for name, value in found.items()} | {"count": np.array([len(sampled)])}


def _of_histograms(counts: npt.NDArray[np.float64]) -> Statistics:
    """Return the statistics (C,) of how often each of 256 values was there, (C, 256)."""
    values, total = np.arange(256) / 255.0, counts.sum(axis=1, keepdims=True)
    share = counts / total
    mean = share @ values
    below = np.cumsum(counts, axis=1)
    quantiles = {name: values[(below < level * total).sum(axis=1)] for name, level in QUANTILES.items()}
    seen = counts > 0
    return {
        "min": values[seen.argmax(axis=1)], "max": values[255 - seen[:, ::-1].argmax(axis=1)], "mean": mean,
        "std": np.sqrt(np.maximum(share @ values**2 - mean**2, 0.0)), **quantiles,
    }  # fmt: skip


def _sampled(rows: int) -> npt.NDArray[np.int64]:
    count = max(min(_FEWEST, rows), min(int(rows**_POWER), _MOST))
    return np.round(np.linspace(0, rows - 1, count)).astype(np.int64)


def merged(first: Statistics, second: Statistics) -> Statistics:
    """Return the statistics of both."""
    counts = float(first["count"][0]), float(second["count"][0])
    total = sum(counts)

    def weighted(one: npt.NDArray[Any], other: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return (counts[0] * one + counts[1] * other) / total

    mean = weighted(first["mean"], second["mean"])
    spread = [part["std"] ** 2 + (part["mean"] - mean) ** 2 for part in (first, second)]
    return {
        "min": np.minimum(first["min"], second["min"]), "max": np.maximum(first["max"], second["max"]), "mean": mean,
        "std": np.sqrt(weighted(*spread)), "count": first["count"] + second["count"],
        **{name: weighted(first[name], second[name]) for name in QUANTILES},
    }  # fmt: skip
