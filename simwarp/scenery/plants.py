"""Trees and bushes: trunks of tapered tubes, crowns of dented balls and stacked skirts."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Final

import numpy as np

from simwarp.core.types import ShapeType, pose
from simwarp.geometry.visual_mesh import VisualMesh, joined
from simwarp.model.rules import RULES, Metres, word_of
from simwarp.scenery.solids import (
    Array,
    between,
    hull_corners,
    icosphere,
    lathe,
    moved,
    solid,
    stream,
    tone,
    tube,
    varied,
)
from simwarp.scenery.visual import Label, Proxy, Visual


def leaves(
    radii: Array, at: Array, colors: tuple[Array, Array], rng: np.random.Generator, *, level: int = 1,
    rough: float = 0.18,
) -> VisualMesh:  # fmt: skip
    """A dented ellipsoid of half axes `radii` about `at` [m], darker below."""
    directions, triangles = icosphere(level)
    points = directions * (1.0 + rough * rng.uniform(-1.0, 1.0, (len(directions), 1)))
    height = 0.5 + 0.5 * points[triangles].mean(axis=1)[:, 2]
    color = varied(between(*colors, height), len(triangles), rng, 0.16)
    return solid(points * radii + at, triangles, color)


def trunk(height: float, radius: float, color: Array, rng: np.random.Generator, *, top: float = 0.55) -> VisualMesh:
    """A tapered trunk of seven sides that leans a little."""
    lean = 0.03 * height * rng.uniform(-1.0, 1.0, 2)
    share = np.array([0.0, 0.06, 0.5, 1.0])
    line = np.stack([lean[0] * share**2, lean[1] * share**2, height * share], axis=1)
    return tube(line, radius * np.array([1.35, 1.0, 0.85, top]), varied(color, 3, rng, 0.12), segments=7)


def _post(radius: float, height: float) -> Proxy:
    return Proxy(
        kind=ShapeType.CYLINDER, size=(radius, 0.5 * height, radius), pose=pose((0.0, 0.0, 0.5 * height))
    )  # fmt: skip


def _ball(radii: Array, at: Array) -> Proxy:
    return Proxy(kind=ShapeType.ELLIPSOID, size=(float(radii[0]), float(radii[1]), float(radii[2])), pose=pose(at))


def _spruce(height: float, rng: np.random.Generator) -> tuple[VisualMesh, tuple[Proxy, ...]]:
    """Skirts of needles, one above the other."""
    stem, radius = 0.1 * height, 0.22 * height
    dark, light = tone("25482b"), tone("4f7f48")
    parts = [trunk(0.4 * height, 0.022 * height, tone("4a3728"), rng)]
    tiers, sides = 5, 9
    for tier in range(tiers):
        foot = stem + (height - stem) * tier / (tiers + 0.6)
        top = stem + (height - stem) * min(1.0, (tier + 2.0) / (tiers + 0.6))
        if tier == tiers - 1:
            top = height
        wide = radius * (1.0 - tier / (tiers + 0.3))
        shade = between(dark, light, np.full(sides, tier / tiers))
        color = np.stack([varied(0.6 * dark, sides, rng, 0.1), varied(shade, sides, rng, 0.25)])
        profile = [(0.3 * wide, foot + 0.12 * wide), (wide, foot), (0.02 * wide, top)]
        skirt = lathe(profile, color, sides, twist=rng.uniform(0.0, 2.0 * math.pi))
        # branches: the rim is uneven
        rim = skirt.vertices[sides : 2 * sides]
        rim[:, :2] *= rng.uniform(0.82, 1.08, (sides, 1))
        rim[:, 2] += 0.15 * wide * rng.uniform(-1.0, 0.5, sides)
        parts.append(skirt)
    crown = Proxy(
        kind=ShapeType.CONE, size=(0.95 * radius, 0.5 * (height - stem), 0.95 * radius),
        pose=pose((0.0, 0.0, 0.5 * (height + stem))),
    )  # fmt: skip
    return joined(parts), (crown, _post(0.03 * height, stem))


def _oak(height: float, rng: np.random.Generator) -> tuple[VisualMesh, tuple[Proxy, ...]]:
    """A short trunk under a broad crown of several balls."""
    stem = 0.42 * height
    colors = (tone("2f4a1c"), tone("7d9a45"))
    parts = [trunk(1.15 * stem, 0.045 * height, tone("5b4632"), rng)]
    for angle in rng.uniform(0.0, 2.0 * math.pi) + 2.0 * math.pi * np.arange(3) / 3.0:
        reach = np.array([math.cos(angle), math.sin(angle)]) * 0.2 * height
        parts.append(tube([(0.0, 0.0, 0.8 * stem), (*reach, 1.35 * stem)], [0.025 * height, 0.012 * height],
                          tone("5b4632"), segments=4))  # fmt: skip
    middle = np.array([0.0, 0.0, 0.7 * height])
    parts.append(leaves(np.array([0.3, 0.3, 0.28]) * height, middle, colors, rng))
    for angle in rng.uniform(0.0, 2.0 * math.pi) + 2.0 * math.pi * np.arange(4) / 4.0:
        away = np.array([math.cos(angle) * 0.2, math.sin(angle) * 0.2, rng.uniform(-0.16, 0.0)]) * height
        parts.append(leaves(np.array([0.2, 0.2, 0.17]) * height * rng.uniform(0.85, 1.1), middle + away, colors, rng))
    crown = _ball(np.array([0.37, 0.37, 0.29]) * height, middle - np.array([0.0, 0.0, 0.02 * height]))
    return joined(parts), (_post(0.05 * height, stem), crown)


def _birch(height: float, rng: np.random.Generator) -> tuple[VisualMesh, tuple[Proxy, ...]]:
    """A slim white trunk with black marks under a tall light crown."""
    share = np.linspace(0.0, 1.0, 9)
    bark = np.where(rng.random((8, 7)) < 0.22, 0.12, 1.0)[..., None] * tone("e6e2d8")
    bend = 0.02 * height * rng.uniform(-1.0, 1.0, 2)
    line = np.stack([bend[0] * share**2, bend[1] * share**2, 0.8 * height * share], axis=1)
    parts = [tube(line, 0.02 * height * (1.25 - 0.8 * share), bark, segments=7)]
    colors = (tone("4f7128"), tone("a8c05a"))
    for level, wide in ((0.46, 0.13), (0.6, 0.17), (0.75, 0.15), (0.89, 0.1)):
        at = np.array([*(0.035 * height * rng.uniform(-1.0, 1.0, 2)), level * height])
        parts.append(leaves(np.array([wide, wide, 0.14]) * height, at, colors, rng))
    top = max(float(part.vertices[:, 2].max()) for part in parts)
    crown = _ball(np.array([0.18, 0.18, 0.34]) * height, np.array([0.0, 0.0, 0.66 * height]))
    grown = moved(joined(parts), scale=(1.0, 1.0, height / top))
    return grown, (_post(0.024 * height, 0.4 * height), crown)


def _dead(height: float, rng: np.random.Generator) -> tuple[VisualMesh, tuple[Proxy, ...]]:
    """A bare trunk with a few branches."""
    grey = tone("8a8075")
    parts = [trunk(height, 0.045 * height, grey, rng, top=0.15)]
    for level in (0.35, 0.5, 0.62, 0.74, 0.84):
        angle, length = rng.uniform(0.0, 2.0 * math.pi), (1.15 - level) * 0.5 * height
        way = np.array([math.cos(angle), math.sin(angle), 0.0])
        start = np.array([0.0, 0.0, level * height])
        knee = start + 0.5 * length * way + np.array([0.0, 0.0, 0.2 * length])
        tip = knee + 0.5 * length * (0.7 * way + np.array([0.0, 0.0, 0.9]))
        thick = 0.02 * height * (1.2 - level)
        parts.append(
            tube([start, knee, tip], [1.4 * thick, thick, 0.3 * thick], varied(grey, 2, rng, 0.15), segments=5)
        )
    return joined(parts), (_post(0.05 * height, 0.7 * height),)


def _poplar(height: float, rng: np.random.Generator) -> tuple[VisualMesh, tuple[Proxy, ...]]:
    """A narrow column of leaves from near the ground."""
    stem, wide = 0.14 * height, 0.11 * height
    parts = [trunk(0.3 * height, 0.022 * height, tone("6a5a45"), rng)]
    colors = (tone("274a20"), tone("6f9440"))
    half = 0.5 * (height - stem)
    middle = np.array([0.0, 0.0, height - half])
    parts.append(leaves(np.array([wide, wide, half / 1.05]), middle, colors, rng, level=2, rough=0.12))
    return joined(parts), (_post(0.026 * height, stem), _ball(np.array([wide, wide, half]), middle))


_TREES: Final[dict[str, tuple[float, Callable[[float, np.random.Generator], tuple[VisualMesh, tuple[Proxy, ...]]]]]] = {
    "spruce": (6.5, _spruce),
    "oak": (6.0, _oak),
    "birch": (6.5, _birch),
    "poplar": (7.5, _poplar),
    "dead": (4.5, _dead),
}
TREES: Final = tuple(_TREES)
"""Kinds of trees."""


@RULES.arguments("tree")
def tree(kind: Annotated[str, word_of(*TREES)] = "oak", seed: int = 0, *, height: Metres | None = None) -> Visual:
    """A tree whose trunk stands at the origin; every seed gives another one.

    Args:
        kind: one of `TREES`.
        seed: of its form and colours.
        height: about [m]; None: 4.5 to 7.5, as the kind is.

    Returns:
        A visual with 200 to 600 triangles. What is in a vehicle's way comes first among the proxies: the trunk, or the
        lowest branches of a spruce.

    Raises:
        ModelError: there is no such kind, or the height is not positive.
    """
    usual, grow = _TREES[kind]
    tall = height or usual
    mesh, proxies = grow(tall, stream(f"tree {kind}", seed))
    return Visual(name=kind, mesh=mesh, proxies=proxies, label=Label.TREE, reflectance=0.45)


_BUSHES: Final = {
    "round": (("2c4a1d", "84a04a"), 1.0, 1.35),
    "dry": (("6b5a33", "c4b06c"), 0.8, 1.6),
    "juniper": (("274734", "648a64"), 1.2, 3.3),
}
TWIGS: Final = 40
"""That stick out of a bush."""
BUSHES: Final = tuple(_BUSHES)
"""Kinds of bushes."""


def twigs(
    radii: Array, at: Array, colors: tuple[Array, Array], rng: np.random.Generator, *, count: int = TWIGS
) -> VisualMesh:  # fmt: skip
    """Thin pyramids of three sides that stand out of an ellipsoid of half axes `radii` about `at` [m], upwards."""
    way = rng.normal(size=(count, 3))
    way[:, 2] = np.abs(way[:, 2])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    side = np.cross(way, rng.normal(size=(count, 3)))
    side *= 0.22 / np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(way, side)
    foot = 0.7 * way
    corners = [foot + math.cos(a) * side + math.sin(a) * other for a in (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)]
    tip = way * rng.uniform(1.02, 1.25, (count, 1))
    points = np.stack([*corners, tip], axis=1)
    faces = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
    triangles = (4 * np.arange(count)[:, None, None] + faces).reshape(-1, 3)
    color = np.repeat(varied(between(*colors, rng.random(count)), count, rng, 0.2), 4, axis=0)
    return solid(points.reshape(-1, 3) * radii + at, triangles, color)


@RULES.arguments("bush")
def bush(kind: Annotated[str, word_of(*BUSHES)] = "round", seed: int = 0, *, width: Metres | None = None) -> Visual:
    """A bush: four dented balls of leaves on the ground and twigs that stick out, 480 triangles; its foot is flat.

    Args:
        kind: one of `BUSHES`.
        seed: of its form and colours.
        width: of the larger side of the box around it [m]; None: 1.35 to 3.3, as the kind is.

    Returns:
        A visual with one HULL.

    Raises:
        ModelError: there is no such kind, or the width is not positive.
    """
    codes, tall, usual = _BUSHES[kind]
    wide = width or usual
    colors = (tone(codes[0]), tone(codes[1]))
    rng = stream(f"bush {kind}", seed)
    parts = [leaves(np.array([0.36, 0.36, 0.38 * tall]), np.array([0.0, 0.0, 0.3 * tall]), colors, rng, rough=0.25)]
    for angle in rng.uniform(0.0, 2.0 * math.pi) + 2.0 * math.pi * np.arange(3) / 3.0:
        at = np.array([0.24 * math.cos(angle), 0.24 * math.sin(angle), 0.2 * tall])
        size = np.array([0.25, 0.25, 0.26 * tall]) * rng.uniform(0.8, 1.15)
        parts.append(leaves(size, at, colors, rng, rough=0.25))
    parts.append(twigs(np.array([0.42, 0.42, 0.45 * tall]), np.array([0.0, 0.0, 0.25 * tall]), colors, rng))
    mesh = joined(parts)
    points = mesh.vertices.copy()
    low, high = points.min(axis=0), points.max(axis=0)
    points -= np.array([*(0.5 * (low + high)[:2]), 0.0])
    points *= wide / float((high - low)[:2].max())
    points[:, 2] = np.maximum(points[:, 2], 0.02 * points[:, 2])
    points[:, 2] -= points[:, 2].min()
    grown = VisualMesh(vertices=points, triangles=mesh.triangles, color=mesh.color)
    hull = Proxy(kind=ShapeType.HULL, points=hull_corners(points, 24))
    return Visual(name=kind, mesh=grown, proxies=(hull,), label=Label.BUSH, reflectance=0.4)
