"""Lines in rendered pictures for things without bodies, such as paths, goals and limits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from simwarp.core.types import Pose

Array = npt.NDArray[np.float64]

NEAR: Final = 1e-2
"""Nearer than this in front of the camera nothing is drawn [m]."""
SLACK: Final = 0.01
"""A line on a surface is seen although rounding puts it below; share of the depth."""
HIDDEN: Final = 0.2
"""Opacity of hidden parts of a line."""


@dataclasses.dataclass(frozen=True)
class Polyline:
    """A connected line of one world.

    Attributes:
        points: (P, 3) vertices in the world frame [m].
        color: sRGB red, green and blue, each 0 to 1.
        width: [pixels].
    """

    points: npt.NDArray[np.float64]
    color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    width: float = 1.5


def draw_lines(
    picture: npt.NDArray[np.uint8], depth: npt.NDArray[np.float32], camera: Pose, fov: float, lines: Sequence[Polyline]
) -> npt.NDArray[np.uint8]:
    """The picture with lines in it; their hidden parts are faint.

    Args:
        picture: (height, width, 3) through a pinhole.
        depth: (height, width) along the camera's axis [m].
        camera: its pose; it looks along X, Z is up.
        fov: horizontal field of view [rad].
        lines: drawn in order.
    """
    result = picture.copy()
    covers = [_coverage(_projected(line.points, camera, fov, depth.shape), depth, line.width) for line in lines]
    touched = np.nonzero(np.any([np.zeros(depth.shape), *covers], axis=0))
    mixed = picture[touched].astype(np.float64)
    for line, cover in zip(lines, covers, strict=True):
        mixed += cover[touched][:, None] * (255.0 * np.array(line.color) - mixed)
    result[touched] = np.rint(mixed).astype(np.uint8)
    return result


def _projected(points: Array, camera: Pose, fov: float, shape: tuple[int, ...]) -> Array:
    """(S, 2, 3) ends of segments in front of the camera: column, row [pixels], 1 / depth [1/m], each linear between."""
    height, width = shape
    p = (np.asarray(points, np.float64) - camera.position) @ matrix_of(camera.rotation)
    ends = np.stack([p[:-1], p[1:]], axis=1)
    ends = ends[np.isfinite(ends).all(axis=(1, 2)) & (ends[..., 0].max(axis=1) > NEAR)]
    way = ends[:, ::-1] - ends
    share = np.clip((NEAR - ends[..., 0]) / np.where(way[..., 0] == 0.0, 1.0, way[..., 0]), 0.0, 1.0)
    ends = ends + np.where(ends[..., 0] < NEAR, share, 0.0)[..., None] * way
    focal = 0.5 * width / math.tan(0.5 * fov)
    x, y, z = np.moveaxis(ends, -1, 0)
    return np.stack([0.5 * width - focal * y / x, 0.5 * height - focal * z / x, 1.0 / x], axis=-1)


def _coverage(ends: Array, depth: npt.NDArray[np.float32], thickness: float) -> Array:
    """(height, width) opacity of a line of projected segments (S, 2, 3)."""
    height, width = depth.shape
    cover = np.zeros(depth.shape)
    start, way = ends[:, 0], ends[:, 1] - ends[:, 0]
    # the part of each segment that is on the picture
    flow = np.where(np.abs(way[:, :2]) < 1e-9, 1e-9, way[:, :2])
    bounds = np.sort(np.stack([-start[:, :2] / flow, ([width, height] - start[:, :2]) / flow]), axis=0)
    first, last = np.maximum(bounds[0].max(axis=1), 0.0), np.minimum(bounds[1].min(axis=1), 1.0)
    seen = last >= first
    start, way, first, last = start[seen], way[seen], first[seen], last[seen]
    # two points for each pixel along the segment
    count = np.ceil(2.0 * (last - first) * np.hypot(way[:, 0], way[:, 1])).astype(int) + 2
    owner = np.repeat(np.arange(len(count)), count)
    place = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) / (count - 1)[owner]
    u, v, inverse = (start[owner] + (first[owner] + place * (last - first)[owner])[:, None] * way[owner]).T
    column, row = np.clip(u, 0, width - 1).astype(int), np.clip(v, 0, height - 1).astype(int)
    opacity = np.where(inverse * depth[row, column] * (1.0 + SLACK) >= 1.0, 1.0, HIDDEN)
    reach = math.ceil(0.5 * thickness)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            r, c = row + down, column + right
            value = opacity * np.clip(0.5 * thickness + 0.5 - np.hypot(u - c - 0.5, v - r - 0.5), 0.0, 1.0)
            inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
            np.maximum.at(cover, (r[inside], c[inside]), value[inside])
    return cover
