"""Triangles of primitives for pictures: a cube, and surfaces of revolution about z."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

SIDES: Final = 32
COARSE: Final = 20
"""Sides of a circle: of one, and in pictures of many."""
_CUBE: Final = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def primitive_mesh(kind: str, sizes: Mapping[str, float], *, coarse: bool = False) -> tuple[Array, Faces]:
    """Vertices (V, 3) and triangles (T, 3), counter-clockwise seen from outside, about the origin.

    Args:
        kind: "cube" (`size`), "sphere" (`radius`), "capsule", "cylinder" or "cone" (`radius`, `height`; that of a
            capsule without its caps).
        sizes: [m], by name.
        coarse: circles of `COARSE` sides instead of `SIDES`.
    """
    sides = COARSE if coarse else SIDES
    if kind == "cube":
        half = 0.5 * sizes["size"]
        corners = half * np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        faces = [(a, b, c) for quad in _CUBE for a, b, c in ((quad[0], quad[1], quad[2]), (quad[0], quad[2], quad[3]))]
        return corners, np.array(faces, np.int64)
    radius, half = sizes["radius"], 0.5 * sizes.get("height", 0.0)
    if kind in ("sphere", "capsule"):
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, sides // 2 + 1)
        outline = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        outline[[0, -1], 0] = 0.0
        if half > 0.0:  # the middle ring stands twice, at both ends of the tube
            lift = np.array([0.0, half])
            outline = np.concatenate([outline[: sides // 4 + 1] - lift, outline[sides // 4 :] + lift])
    elif kind == "cylinder":
        outline = np.array([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])
    else:
        outline = np.array([(0.0, -half), (radius, -half), (0.0, half)])
    return revolved(outline, sides)


def revolved(outline: Any, sides: int) -> tuple[Array, Faces]:
    """Surface of revolution about z.

    Args:
        outline: (N, 2) distances from z and heights, from the lowest point on z to the highest one on z [m].
        sides: of its circles.

    Returns:
        Vertices (2 + (N - 2) * sides, 3) and triangles.
    """
    points = np.asarray(outline, np.float64)
    turn = 2.0 * np.pi * np.arange(sides) / sides
    rings = points[1:-1]
    x, y = rings[:, :1] * np.cos(turn), rings[:, :1] * np.sin(turn)
    around = np.stack([x, y, np.broadcast_to(rings[:, 1:], x.shape)], axis=-1).reshape(-1, 3)
    vertices = np.concatenate([around, [[0.0, 0.0, points[0, 1]], [0.0, 0.0, points[-1, 1]]]])
    place = np.arange(sides)
    after = (place + 1) % sides
    bottom, top, last = len(around), len(around) + 1, (len(rings) - 1) * sides
    parts = [np.stack([np.full(sides, bottom), after, place], 1), np.stack([np.full(sides, top), place, after], 1)]
    parts[1][:, 1:] += last
    for ring in range(len(rings) - 1):
        low, high = ring * sides, (ring + 1) * sides
        parts.append(np.stack([low + place, low + after, high + after], 1))
        parts.append(np.stack([low + place, high + after, high + place], 1))
    return vertices, np.concatenate(parts).astype(np.int64)
