"""Paths in float64, slowly: every question goes through all segments of a polyline."""

from __future__ import annotations

import numpy as np


def nearest_on_path(points: np.ndarray, places: np.ndarray, every: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (M,) along a polyline (n, 2) of its points nearest to places (M, 2), and how far to the left of it the
    places are. `every`: only each of so many corners of the polyline is taken.
    """
    line = points if every == 1 else np.concatenate([points[:-1:every], points[-1:]])
    chord = np.diff(line, axis=0)
    size = np.linalg.norm(chord, axis=1)
    unit = chord / size[:, None]
    start = np.concatenate([[0.0], np.cumsum(size)[:-1]])
    arc, aside = np.empty(len(places)), np.empty(len(places))
    for first in range(0, len(places), 4096):
        away = places[first : first + 4096, None] - line[None, :-1]
        along = np.clip((away * unit).sum(axis=2), 0.0, size)
        foot = away - along[..., None] * unit
        best = (foot**2).sum(axis=2).argmin(axis=1)
        row = np.arange(len(best))
        left = unit[best, 0] * away[row, best, 1] - unit[best, 1] * away[row, best, 0]
        arc[first : first + 4096] = start[best] + along[row, best]
        aside[first : first + 4096] = np.sign(left) * np.linalg.norm(foot[row, best], axis=1)
    return arc, aside
