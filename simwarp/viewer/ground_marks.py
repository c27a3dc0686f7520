"""What people need of a ground in a picture: marks every metre, and a pattern that does not drown what stands on it."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import minimum_filter, uniform_filter

from simwarp.core.rotation import matrix_of
from simwarp.core.types import WORLD, Pose
from simwarp.scenery.visual import Label
from simwarp.sensors.scene import Scene
from simwarp.viewer.default_visuals import GROUNDS

Picture = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

MARK: Final = (255, 255, 255)
"""sRGB of a mark."""
LARGER: Final = 5
"""Marks at multiples of this many metres, along both axes, are twice as large."""
LEVEL: Final = 0.8
"""Steeper surfaces, by the vertical part of their normal, are no ground."""
CROWDED: Final = (12.0, 40.0)
"""Pixels from mark to mark, along the view, at which marks are invisible, and from which on they are full."""
KEPT: Final = 0.45
"""Share of a ground's pattern that is left where it is made quieter."""
STANDING: Final = (Label.ROCK, Label.BUSH, Label.TREE, Label.CONE, Label.PILLAR, Label.CRATE, Label.VEHICLE)
"""What stands on the ground."""


@dataclasses.dataclass(frozen=True)
class Marks:
    """Crosses on the ground at whole metres of the world's x and y.

    Attributes:
        arm: half length of a cross's lines [m].
        width: of its lines [m].
    """

    arm: float
    width: float


def marks_for(distance: float) -> Marks:
    """Marks that can be seen from a distance [m], and never fill the ground."""
    arm = min(0.015 * distance, 0.15)
    return Marks(arm, arm / 4.0)


class GroundFinder:
    """Tells which pixels show ground: planes, height fields, and what is level in other fixed things.

    Args:
        scene: that a camera sees.
    """

    def __init__(self, scene: Scene) -> None:
        kinds = np.array([instance.kind for instance in scene.visuals.instances], np.int64)
        fixed = scene.body == WORLD
        self._sure = np.append(fixed & np.isin(kinds, [int(kind) for kind in GROUNDS]), False)
        self._level = np.append(fixed & ~np.isin(scene.label, [int(label) for label in STANDING]), False)

    def sure(self, instance: npt.NDArray[np.int32]) -> Mask:
        """(height, width) planes and height fields; `instance` is -1 where there is nothing."""
        found: Mask = self._sure[instance]
        return found

    def find(self, instance: npt.NDArray[np.int32], normals: Floats, rotation: npt.NDArray[np.float64]) -> Mask:
        """(height, width) all ground.

        Args:
            instance: (height, width), -1 where there is nothing.
            normals: (height, width, 3) in the camera's axes.
            rotation: (3, 3) from these to the world's.
        """
        up = normals @ rotation[2].astype(np.float32)
        found: Mask = self._sure[instance] | (self._level[instance] & (up > LEVEL))
        return found


def quieter(picture: Picture, ground: Mask) -> Picture:
    """The picture with less of the ground's pattern; its shades and the large patches stay."""
    size = max(picture.shape[0] // 16, 3)
    # pixels at an edge have the colour of what stands there as well
    inner = minimum_filter(ground, 3)
    weight = uniform_filter(inner.astype(np.float32), size)
    mean = np.empty(picture.shape, np.float32)
    for channel in range(3):
        uniform_filter(np.where(inner, picture[..., channel], np.float32(0.0)), size, mean[..., channel])
    mean *= np.float32(1.0 - KEPT) / np.maximum(weight, 1e-6)[..., None]
    mean += np.float32(KEPT) * picture
    return np.where(inner[..., None], np.rint(mean, mean).astype(np.uint8), picture)


def draw_marks(
    picture: Picture, depth: Floats, normals: Floats, ground: Mask, camera: Pose, fov: float,
    marks: Marks,
) -> Picture:  # fmt: skip
    """The picture with marks on its ground, as if they were painted there; they fade where they get too small.

    Args:
        picture: (height, width, 3) through a pinhole.
        depth: (height, width) along the camera's axis [m].
        normals: (height, width, 3) in the camera's axes.
        ground: (height, width), where marks may be.
        camera: its pose; it looks along X, Z is up.
        fov: horizontal field of view [rad].
        marks: their size.
    """
    height, width = depth.shape
    focal = 0.5 * width / math.tan(0.5 * fov)
    right = ((0.5 * width - 0.5 - np.arange(width)) / focal).astype(np.float32)
    up = ((0.5 * height - 0.5 - np.arange(height)) / focal).astype(np.float32)[:, None]
    rotation = matrix_of(camera.rotation).astype(np.float32)
    # near the camera float32 holds a millimetre; whole metres of its own place are taken off first
    whole = np.floor(np.asarray(camera.position[:2], np.float64))
    start = (np.asarray(camera.position[:2], np.float64) - whole).astype(np.float32)
    seen = ground & (depth < focal / CROWDED[0])
    reach, places = np.float32(2.0 * marks.arm + marks.width), []
    for axis in range(2):
        way = (rotation[axis, 0] + rotation[axis, 2] * up) + rotation[axis, 1] * right
        place = start[axis] + depth * way
        seen &= np.abs(place - np.round(place)) < reach
        places.append(place)
    rows, columns = np.nonzero(seen)
    far = depth[rows, columns]
    ray = np.stack([np.ones_like(far), right[columns], up[rows, 0]], axis=1)
    place = np.stack([each[rows, columns] for each in places], axis=1)
    node = np.round(place)
    away, number = np.abs(place - node), node + whole
    scale = 1.0 + (number % LARGER == 0).all(axis=1)
    slant = np.abs((normals[rows, columns] * ray).sum(axis=1)) / np.linalg.norm(ray, axis=1)
    pixel = far / focal / np.maximum(slant, 0.05)
    arm, line = marks.arm * scale, 0.5 * marks.width * scale
    cover = np.maximum(
        _share(away[:, 0], arm, pixel) * _share(away[:, 1], line, pixel),
        _share(away[:, 0], line, pixel) * _share(away[:, 1], arm, pixel),
    )
    cover = (cover * np.clip((1.0 / pixel - CROWDED[0]) / (CROWDED[1] - CROWDED[0]), 0.0, 1.0))[:, None]
    marked = picture.copy()
    before = picture[rows, columns].astype(np.float32)
    marked[rows, columns] = np.round(before + cover * (np.array(MARK, np.float32) - before)).astype(np.uint8)
    return marked


def _share(away: Any, half: Any, pixel: Any) -> Any:
    """Share of a pixel, `pixel` wide [m] at a distance from the middle of a band, that the band covers."""
    return np.clip((np.minimum(away + 0.5 * pixel, half) - np.maximum(away - 0.5 * pixel, -half)) / pixel, 0.0, 1.0)
