"""Paths for drivers: polylines and Bezier curves in the plane, made or read from a file, sampled into arrays."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import formatted
from simwarp.vehicle.paths_kernels import PathTables
from simwarp.vehicle.spec.vehicle_files import read_text
from simwarp.vehicle.spec.vehicle_spec import SpecError

Array = npt.NDArray[np.float64]

SPACING: Final = 0.5
"""Between the samples of curves [m]."""
SIDES: Final = 360
"""Of a circle at least, however small: a driver on it steers at every corner of its polygon."""
MOST_POINTS: Final = 10**6
"""Of a curve that is sampled."""
MOST_CORNERS: Final = 5000
"""Points of a file: a smooth curve through them is a system of as many equations."""
FARTHEST: Final = 1.0e9
"""Largest coordinate of a file [m]."""


@dataclasses.dataclass(frozen=True)
class Path(ReadableFields):
    """A polyline seen from above.

    Attributes:
        points: (n, 2) [m]; a closed path has its first point again at the end.
        closed: True if it goes on at its start.

    Raises:
        SpecError: the points are fewer than two, not finite, not (n, 2), or two that follow each other are the same.
    """

    points: Array
    closed: bool = False

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
            raise SpecError(f"path: must be two or more finite points (x, y), got an array of {points.shape}")
        if self.closed and np.linalg.norm(points[-1] - points[0]) > 1e-9:
            points = np.concatenate([points, points[:1]])
        short = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0), axis=1) < 1e-9)
        if short.size:
            raise SpecError(f"path: points {short[0]} and {short[0] + 1} must differ, got {points[short[0]].tolist()}")
        object.__setattr__(self, "points", points)

    @property
    def arc(self) -> Array:
        """(n,) length from the start [m]."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    @property
    def length(self) -> float:
        """Length along the line, from the first point to the last [m]."""
        return float(self.arc[-1])

    def tangents(self) -> Array:
        """(n, 2) unit; at a point the mean of its two segments, weighted by the other one's length as a parabola is."""
        chord = np.diff(self.points, axis=0)
        size = np.linalg.norm(chord, axis=1)
        unit = chord / size[:, None]
        before, after = self._around(unit)
        shorter, longer = self._around(size)
        mean = before * longer[:, None] + after * shorter[:, None]
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        # where a path turns back on itself there is no mean
        return np.where(length > 1e-9, mean / np.maximum(length, 1e-9), after)

    def curvature(self) -> Array:
        """(n,) [1/m], positive to the left: the turn at a point over the mean of its two segments."""
        chord = np.diff(self.points, axis=0)
        before, after = self._around(chord)
        turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
        sizes = self._around(np.linalg.norm(chord, axis=1))
        return np.asarray(2.0 * turn / (sizes[0] + sizes[1]))

    def _around(self, values: Array) -> tuple[Array, Array]:
        """Values of the segments before and after each point; at open ends the only one, twice."""
        first, last = (values[-1:], values[:1]) if self.closed else (values[:1], values[-1:])
        return np.concatenate([first, values]), np.concatenate([values, last])


def circle(radius: float, *, start: tuple[float, float] = (0.0, 0.0), spacing: float = SPACING) -> Path:
    """A circle, closed, that leaves `start` along x.

    Args:
        radius: [m], not zero; positive: to the left, negative: to the right.
        start: x, y of the first point [m].
        spacing: between points, at most [m].

    Raises:
        SpecError: the radius is zero or not finite, or too large for the spacing.
    """
    if not (math.isfinite(radius) and radius != 0.0):
        raise SpecError(f"radius: must be a number of metres other than zero, got {radius!r}")
    if 2.0 * math.pi * abs(radius) > MOST_POINTS * spacing:
        largest = MOST_POINTS * spacing / (2.0 * math.pi)
        raise SpecError(f"radius: must be at most {largest:.3g} m with points every {spacing:g} m, got {radius!r}")
    count = max(SIDES, math.ceil(2.0 * math.pi * abs(radius) / spacing))
    angle = np.linspace(0.0, 2.0 * math.pi, count + 1)
    points = np.stack([abs(radius) * np.sin(angle), radius * (1.0 - np.cos(angle))], axis=1)
    points[-1] = points[0]
    return Path(points + np.array(start), closed=True)


def bezier(points: Array, incoming: Array, outgoing: Array, *, closed: bool = False, spacing: float = SPACING) -> Path:
    """Cubic Bezier segments from point to point.

    Args:
        points: (n, 2) on the curve [m].
        incoming: (n, 2) control points before them [m].
        outgoing: (n, 2) control points after them [m].
        closed: add a segment from the last point to the first.
        spacing: between samples [m].

    Raises:
        SpecError: the curve has too many points at that spacing, or fewer than two.
    """
    ends = list(range(1, len(points))) + ([0] if closed else [])
    samples = [points[:1]]
    count = 0.0
    for index, end in enumerate(ends):
        a, b, c, d = points[index], outgoing[index], incoming[end], points[end]
        hull = sum(float(np.linalg.norm(q - p)) for p, q in ((a, b), (b, c), (c, d)))
        count += hull / spacing
        if not count <= MOST_POINTS:
            raise SpecError(f"path: must have at most {MOST_POINTS} points every {spacing:g} m; it is too long")
        t = np.linspace(0.0, 1.0, max(2, math.ceil(hull / spacing)) + 1)[1:, None]
        s = 1.0 - t
        samples.append(s**3 * a + 3.0 * s * s * t * b + 3.0 * s * t * t * c + t**3 * d)
    return Path(np.concatenate(samples), closed=closed)


def smooth(points: Array, *, closed: bool = False, spacing: float = SPACING) -> Path:
    """The Bezier curve of continuous curvature through points; straight at its ends unless it is closed."""
    points = np.asarray(points, dtype=float)
    if closed and len(points) > 2 and np.linalg.norm(points[-1] - points[0]) < 1e-9:
        points = points[:-1]
    n = len(points)
    # slopes of the spline with unit parameter per segment: m[i-1] + 4 m[i] + m[i+1] = 3 (p[i+1] - p[i-1])
    matrix = 4.0 * np.eye(n)
    right = np.zeros((n, 2))
    for i in range(n):
        for j in (i - 1, i + 1):
            if closed or 0 <= j < n:
                matrix[i, j % n] += 1.0
        lower, upper = ((i - 1) % n, (i + 1) % n) if closed else (max(i - 1, 0), min(i + 1, n - 1))
        right[i] = 3.0 * (points[upper] - points[lower])
    if not closed:
        matrix[0, 0] = matrix[-1, -1] = 2.0
    slopes = np.linalg.solve(matrix, right)
    return bezier(points, points - slopes / 3.0, points + slopes / 3.0, closed=closed, spacing=spacing)


def read_path(file: str | FilePath, *, closed: bool = False, spacing: float = SPACING) -> Path:
    """A path from a file whose first line is the number of points and 3 or 9: numbers on each of the lines after it.

    With 3, points x y z to draw a smooth curve through; with 9, a point, the control point before and the one after
    it, each x y z [m]. Heights are left out.

    Args:
        file: its path.
        closed: add a segment from the last point to the first.
        spacing: between the points of the path, at most [m].

    Raises:
        SpecError: the file cannot be read, or does not hold that.
    """
    name = FilePath(file)
    lines = [line.split() for line in read_text(name).splitlines() if line.strip()]
    if not lines or len(lines[0]) != 2 or not re.fullmatch("[0-9]{1,9}", lines[0][0]) or lines[0][1] not in ("3", "9"):
        first = " ".join(lines[0]) if lines else ""
        raise SpecError(f"{name}: line 1 must be the number of points and 3 or 9, got {formatted(first)}")
    count, width = int(lines[0][0]), int(lines[0][1])
    if count < 2 or len(lines) - 1 < count:
        raise SpecError(f"{name}: must hold {count} points (two or more), found {len(lines) - 1}")
    if count > MOST_CORNERS:
        raise SpecError(f"{name}: must hold at most {MOST_CORNERS} points, got {count}")
    rows = np.zeros((count, width))
    for index, words in enumerate(lines[1 : count + 1]):
        try:
            rows[index] = np.array([float(word) for word in words]).reshape(width)
            if not np.abs(rows[index]).max() <= FARTHEST:
                raise ValueError
        except ValueError:
            got = formatted(" ".join(words))
            raise SpecError(f"{name}: point {index + 1} must be {width} numbers [m], got {got}") from None
    if width == 3:
        return smooth(rows[:, :2], closed=closed, spacing=spacing)
    return bezier(rows[:, :2], rows[:, 3:5], rows[:, 6:8], closed=closed, spacing=spacing)


def path_tables(paths: Sequence[Path], device: wp.DeviceLike = None) -> PathTables:
    """The arrays of several paths."""
    if not paths:
        raise SpecError("paths: must be one or more, got none")
    table = PathTables()
    starts = np.cumsum([0] + [len(path.points) for path in paths])
    table.start = wp.array(starts, dtype=int, device=device)
    table.closed = wp.array([int(path.closed) for path in paths], dtype=int, device=device)
    table.x = wp.array(np.concatenate([path.points for path in paths]), dtype=wp.vec2d, device=device)
    table.tangent = wp.array(np.concatenate([path.tangents() for path in paths]), dtype=wp.vec2, device=device)
    table.curvature = wp.array(np.concatenate([path.curvature() for path in paths]), dtype=float, device=device)
    table.arc = wp.array(np.concatenate([path.arc for path in paths]), dtype=float, device=device)
    return table
