"""Lidar once more: slow, float64, one beam at a time, in closed scenes of planes, spheres and boxes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

PULSE = 0.05
FAINT = 1e-6
Cast = Callable[[np.ndarray, np.ndarray], tuple[float, float]]
"""(start, unit direction) -> (range, intensity); (inf, 0): nothing."""


def direction(azimuth, elevation):
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def rays_of_beam(axis, offsets):
    """Unit directions of the rays that leave a beam's axis by (left, up) angles."""
    left = np.cross([0.0, 0.0, 1.0], axis)
    left = left / np.linalg.norm(left)
    up = np.cross(axis, left)
    rays = [axis + np.tan(h) * left + np.tan(v) * up for h, v in offsets]
    return [ray / np.linalg.norm(ray) for ray in rays]


def together(ray, ranges, intensities):
    """What arrives with a ray within the pulse."""
    return sum(
        max(0.0, 1.0 - abs(r - ranges[ray]) / PULSE) * i for r, i in zip(ranges, intensities, strict=True)
    ) / len(ranges)  # fmt: skip


def reduce_beam(mode, ranges, intensities):
    """[(range, intensity)], two of them for dual; (0, 0): no return."""
    seen = [ray for ray, intensity in enumerate(intensities) if intensity > FAINT]
    if mode == "dual":
        return reduce_beam("strongest", ranges, intensities) + reduce_beam("first", ranges, intensities)
    if not seen:
        return [(0.0, 0.0)]
    if mode == "mean":
        return [(np.mean([ranges[ray] for ray in seen]), sum(intensities) / len(ranges))]
    key = {
        "strongest": lambda ray: -together(ray, ranges, intensities),
        "first": lambda ray: ranges[ray],
        "last": lambda ray: -ranges[ray],
    }[mode]
    chosen = min(seen, key=key)  # the first of equals
    return [(ranges[chosen], together(chosen, ranges, intensities))]


# ---- scenes with a closed form: distance along the ray and |n . d| -------------------------------------------------


def plane(point, normal):
    n = np.asarray(normal, float) / np.linalg.norm(normal)

    def cast(start, d):
        slope = n @ d
        t = (n @ (np.asarray(point) - start)) / slope if slope < 0.0 else np.inf
        return (t, abs(slope)) if t > 0.0 else (np.inf, 0.0)

    return cast


def sphere(centre, radius):
    def cast(start, d):
        m = start - np.asarray(centre)
        half = m @ d
        root = half**2 - (m @ m - radius**2)
        t = -half - np.sqrt(root) if root >= 0.0 else np.inf
        if not 0.0 < t < np.inf:
            return np.inf, 0.0
        return t, abs((m + t * d) @ d) / radius

    return cast


def room(half):
    """The inside of a box about the origin."""
    half = np.asarray(half, float)

    def cast(start, d):
        with np.errstate(divide="ignore"):
            times = np.where(d != 0.0, (np.sign(d) * half - start) / np.where(d == 0.0, 1.0, d), np.inf)
        axis = int(times.argmin())
        return times[axis], abs(d[axis])

    return cast


def nearest(*parts):
    """The union of (cast, reflectance) pairs."""

    def cast(start, d):
        hits = [(t, reflectance * slope) for part, reflectance in parts for t, slope in [part(start, d)]]
        return min(hits, key=lambda hit: hit[0])

    return cast


def scan(directions, offsets, start, axes, cast, mode="strongest", near=1e-3, far=100.0):
    """(rows, columns, 2 or 4) ranges and intensities of a still sensor; `axes` turns its axes into the world's."""
    rows, columns, _ = directions.shape
    out = np.zeros((rows, columns, 4 if mode == "dual" else 2))
    for row in range(rows):
        for column in range(columns):
            hits = [cast(start, axes @ d) for d in rays_of_beam(directions[row, column], offsets)]
            hits = [hit if near < hit[0] <= far else (0.0, 0.0) for hit in hits]
            found = reduce_beam(mode, [r for r, _ in hits], [i for _, i in hits])
            out[row, column] = np.ravel(found)
    return out
