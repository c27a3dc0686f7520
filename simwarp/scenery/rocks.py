"""Rocks: round bodies from which planes have cut pieces."""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Final

import numpy as np

from simwarp.core.constraints import Ge, Le, Meaning
from simwarp.core.types import ShapeType
from simwarp.model.rules import RULES, Lengths, word_of
from simwarp.scenery.solids import Array, between, face_normals, hull_corners, icosphere, solid, stream, tone, varied
from simwarp.scenery.visual import Label, Proxy, Visual


@dataclasses.dataclass(frozen=True)
class _Style:
    """Size [m], planes that cut, how deep at most, bumps (share of the radius), dark and light colour, moss."""

    size: tuple[float, float, float]
    cuts: int
    depth: float
    bumps: float
    colors: tuple[str, str]
    moss: float = 0.0


_STYLES: Final = {
    "boulder": _Style((3.183, 3.628, 2.3), 12, 0.36, 0.06, ("776d60", "b0a696")),
    "slab": _Style((4.012, 2.649, 1.2), 12, 0.3, 0.05, ("686560", "a39e94")),
    "shard": _Style((2.531, 2.489, 3.2), 9, 0.75, 0.02, ("665f5a", "9c938a")),
    "cobble": _Style((3.802, 2.57, 1.7), 5, 0.12, 0.04, ("877b6b", "c0b49f")),
    "mossy": _Style((2.418, 4.473, 2.0), 11, 0.3, 0.07, ("655f54", "968d7f"), 0.8),
}
ROCKS: Final = tuple(_STYLES)
"""Kinds of rocks. As they come they are as long and wide as the five rocks of the original off-road task."""


@RULES.arguments("rock")
def rock(
    kind: Annotated[str, word_of(*ROCKS)] = "boulder",
    seed: int = 0,
    *,
    size: Lengths | None = None,
    detail: Annotated[int, Ge(1), Le(3), Meaning("1, 2 or 3; 2 has 320 triangles")] = 2,
) -> Visual:
    """A rock that lies on the ground, its foot flat; every seed gives another one.

    Args:
        kind: one of `ROCKS`.
        seed: of its form and colours.
        size: of the box around it [m]; None: as the kind is.
        detail: 1: 80 triangles, 2: 320, 3: 1280.

    Returns:
        A visual with one HULL of at most 32 corners, all of them on the rock.

    Raises:
        ModelError: there is no such kind or detail, or a length of `size` is not positive.
    """
    style = _STYLES[kind]
    extent = np.array(style.size if size is None else size, np.float64)
    rng = stream(f"rock {kind}", seed)
    directions, triangles = icosphere(detail)
    points = _cut(_bumpy(directions, style.bumps, rng), style, rng)
    low, high = points.min(axis=0), points.max(axis=0)
    points = (points - 0.5 * (low + high)) * (extent / (high - low))
    points[:, 2] += 0.5 * extent[2]
    normals = face_normals(points, triangles)
    height = points[triangles].mean(axis=1)[:, 2] / extent[2]
    dark, light = (tone(code) for code in style.colors)
    color = between(dark, light, 0.25 + 0.4 * height + 0.3 * normals[:, 2])
    color = between(color, tone("55702f"), style.moss * np.clip(2.0 * normals[:, 2] - 0.7, 0.0, 1.0))
    color = varied(color, len(triangles), rng, 0.1)
    hull = Proxy(kind=ShapeType.HULL, points=hull_corners(points))
    return Visual(name=kind, mesh=solid(points, triangles, color), proxies=(hull,), label=Label.ROCK, reflectance=0.35)


def _bumpy(directions: Array, bumps: float, rng: np.random.Generator) -> Array:
    """A ball with a few smooth waves on it."""
    radius = np.ones(len(directions))
    for _ in range(6):
        wave = rng.normal(size=3) * 2.2
        radius += bumps * np.cos(directions @ wave + rng.uniform(0.0, 2.0 * math.pi))
    return np.asarray(directions * radius[:, None])


def _cut(points: Array, style: _Style, rng: np.random.Generator) -> Array:
    """Moves points beyond random planes onto them; the first plane is the foot."""
    normals = rng.normal(size=(style.cuts, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    depths = rng.uniform(0.25, 1.0, style.cuts) * style.depth
    normals[0], depths[0] = (0.0, 0.0, -1.0), 0.8
    for normal, depth in zip(normals, depths, strict=True):
        beyond = np.maximum(points @ normal - (1.0 - depth), 0.0)
        # a last 3 % stays, so that triangles on the plane keep an outside
        points = points - 0.97 * beyond[:, None] * normal
    return points
