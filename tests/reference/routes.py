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


def place_at(points: np.ndarray, closed: bool, arc: float) -> np.ndarray:
    """(2,) the place at a length along a polyline; closed ones go on with the next lap, open ones straight on."""
    chord = np.diff(points, axis=0)
    size = np.linalg.norm(chord, axis=1)
    total = size.sum()
    if closed:
        arc = arc % total
    elif arc < 0.0:
        return np.asarray(points[0] + arc * chord[0] / size[0])
    elif arc > total:
        return np.asarray(points[-1] + (arc - total) * chord[-1] / size[-1])
    for start, way, length in zip(points, chord, size, strict=False):
        if arc <= length:
            return np.asarray(start + arc * way / length)
        arc -= length
    return np.asarray(points[-1])


def first_hit(
    places: np.ndarray, radii: np.ndarray, direction: np.ndarray, reach: float, step: float = 2e-3
) -> float:  # fmt: skip
    """Length of a ray from the origin to the first of its points that lies in a disc, by trying one after the other."""
    length = np.arange(0.0, reach, step)
    points = length[:, None] * direction
    inside = (np.linalg.norm(points[:, None] - places, axis=2) < radii).any(axis=1)
    return float(length[inside.argmax()]) if inside.any() else reach
