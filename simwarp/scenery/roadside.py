"""Cones, pillars, crates and barriers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ShapeType, Vec3, pose
from simwarp.geometry.visual_mesh import VisualMesh, joined
from simwarp.model.rules import POINTS, RULES, Lengths, Metres, Vector3, word_of
from simwarp.scenery.solids import Array, box, lathe, loft, solid, stream, tone, varied
from simwarp.scenery.visual import Label, Proxy, Visual

_ORANGE, _WHITE, _RED, _GREEN = tone("ff5a10"), tone("f2f2f2"), tone("d81f1f"), tone("18a03c")
_CONES: Final = {"orange": (_ORANGE, _WHITE), "red": (_RED, _RED), "green": (_GREEN, _GREEN)}
CONES: Final = tuple(_CONES)
"""Colours of cones; the orange one has white bands."""


@RULES.arguments("cone")
def cone(color: Annotated[str, word_of(*CONES)] = "orange", *, height: Metres = 0.75) -> Visual:
    """A traffic cone on its square plate, 120 triangles; half as wide as it is high.

    Args:
        color: one of `CONES`.
        height: [m].

    Returns:
        A visual with a HULL of the cone and its plate.

    Raises:
        ModelError: there is no such colour, or the height is not positive.
    """
    main, band = _CONES[color]
    plate = 0.05 * height
    levels = np.array([plate, 0.3 * height, 0.47 * height, 0.62 * height, 0.77 * height, height])
    radii = np.interp(levels, [plate, height], [0.2 * height, 0.045 * height])
    bands = np.array([main, band, main, band, main])
    parts = [
        box((0.25 * height, 0.25 * height, 0.5 * plate), 0.8 * main, (0.0, 0.0, 0.5 * plate)),
        lathe(np.stack([radii, levels], axis=1), bands, 9),
    ]
    hull = Proxy(kind=ShapeType.HULL, points=np.concatenate([part.vertices for part in parts]))
    return Visual(name=f"{color} cone", mesh=joined(parts), proxies=(hull,), label=Label.CONE, reflectance=0.7)


@RULES.arguments("pillar")
def pillar(*, width: Metres = 2.0, height: Metres = 10.0, color: Vector3 | None = None) -> Visual:
    """A square pillar with light bands, the obstacle of obstacle avoidance: 48 triangles.

    Args:
        width: of its sides [m].
        height: [m].
        color: linear; None: blue.

    Returns:
        A visual with one BOX, which it fills.
    """
    main = np.array([0.06, 0.06, 0.75] if color is None else color)
    levels = np.array([0.0, 0.06, 0.5 * 0.16, 0.28, 0.31, 1.0]) * height
    bands = np.array([0.55 * main, _WHITE, main, _WHITE, main])
    half = 0.5 * width
    square = np.array([[half, half], [-half, half], [-half, -half], [half, -half]])
    rings = np.concatenate([
        np.broadcast_to(square, (len(levels), 4, 2)), np.broadcast_to(levels[:, None, None], (len(levels), 4, 1)),
    ], axis=2)  # fmt: skip
    proxy = Proxy(kind=ShapeType.BOX, size=(half, half, 0.5 * height), pose=pose((0.0, 0.0, 0.5 * height)))
    return Visual(name="pillar", mesh=loft(rings, bands), proxies=(proxy,), label=Label.PILLAR)


@RULES.arguments("crate")
def crate(*, size: Lengths = (1.0, 1.0, 1.0), seed: int = 0) -> Visual:
    """A wooden crate: six frames of boards about sunk panels, 108 triangles.

    Args:
        size: along x, y and z [m].
        seed: of the colours of its boards.

    Returns:
        A visual with one BOX.
    """
    extent = np.array(size, np.float64)
    rng = stream("crate", seed)
    vertices: list[Array] = []
    triangles: list[list[int]] = []
    colors: list[Array] = []
    light, dark = tone("c29a62"), tone("8f6a3c")
    for axis in range(3):
        for side in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            frame, panel = np.zeros((4, 3)), np.zeros((4, 3))
            corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
            frame[:, axis] = side
            frame[:, [u, v]] = corner
            panel[:, axis] = side * 0.9
            panel[:, [u, v]] = 0.78 * corner
            lip = panel.copy()
            lip[:, axis] = side
            start = sum(len(block) for block in vertices)
            vertices.append(np.concatenate([frame, lip, panel]))
            quads = [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
            quads += [(4 + k, 4 + (k + 1) % 4, 8 + (k + 1) % 4, 8 + k) for k in range(4)]
            quads.append((8, 9, 10, 11))
            for index, (a, b, c, d) in enumerate(quads):
                face = [(a, b, c), (a, c, d)]
                triangles += [[start + n for n in (t if side > 0.0 else t[::-1])] for t in face]
                shade = light if index < 4 else (0.6 * dark if index < 8 else dark)
                colors += list(varied(shade, 1, rng, 0.15)) * 2
    points = np.concatenate(vertices)
    unique, inverse = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    points = unique * (0.5 * extent)
    points[:, 2] += 0.5 * extent[2]
    mesh = solid(points, inverse.reshape(-1)[np.array(triangles)], np.array(colors))
    half = (float(0.5 * extent[0]), float(0.5 * extent[1]), float(0.5 * extent[2]))
    proxy = Proxy(kind=ShapeType.BOX, size=half, pose=pose((0.0, 0.0, half[2])))
    return Visual(name="crate", mesh=mesh, proxies=(proxy,), label=Label.CRATE)


def _jersey(height: float) -> Array:
    """(8, 2) outline of a barrier, y and z, counter-clockwise seen from the front: a plain foot, a slope, a neck."""
    half = np.array([(0.375, 0.0), (0.375, 0.1), (0.19, 0.41), (0.11, 1.0)]) * height
    return np.concatenate([half, half[::-1] * np.array([-1.0, 1.0])])


@RULES.arguments("barrier")
def barrier(*, length: Metres = 2.0, height: Metres = 0.8, color: Vector3 | None = None) -> Visual:
    """A jersey barrier along X: three quarters as wide as high at its foot; 32 triangles.

    Args:
        length: [m].
        height: [m].
        color: linear; None: concrete.

    Returns:
        A visual with one HULL, a little fuller than the barrier's hollow sides.
    """
    main = tone("b5b2aa") if color is None else np.array(color)
    mesh = _block(np.array([-0.5 * length, 0.0]), np.array([0.5 * length, 0.0]), _jersey(height), main)
    hull = Proxy(kind=ShapeType.HULL, points=mesh.vertices[:16])
    return Visual(name="barrier", mesh=mesh, proxies=(hull,), label=Label.BARRIER)


def _block(start: Array, end: Array, outline: Array, color: Array) -> VisualMesh:
    """A barrier from one point of the plane to another."""
    along = (end - start) / np.linalg.norm(end - start)
    across = np.array([-along[1], along[0]])
    plane = outline[:, :1] * across
    rings = np.stack([
        np.concatenate([point + plane, outline[:, 1:]], axis=1) for point in (start, end)
    ])  # fmt: skip
    shades = np.array([0.75, 0.9, 1.0, 1.0, 1.0, 0.9, 0.75, 0.6])[None, :, None] * color
    return loft(rings, shades, caps=np.stack([0.8 * color, 0.8 * color]))


def _blocks(points: Array, outline: Array, colors: Sequence[Array]) -> VisualMesh:
    """The blocks between points (n, 2) of the plane, each in its colour: `_block` of all of them at once."""
    first = {key: _block(points[0], points[1], outline, np.array(key)) for key in {tuple(color) for color in colors}}
    way = np.diff(points, axis=0)
    # one by one, as `_block` has them: norms of many at once round otherwise
    along = way / np.array([np.linalg.norm(each) for each in way])[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    plane = outline[:, :1] * across[:, None]
    upright = np.broadcast_to(outline[:, 1:], (len(way), len(outline), 1))
    rings = [np.concatenate([ends[:, None] + plane, upright], axis=2) for ends in (points[:-1], points[1:])]
    vertices = np.concatenate([*rings, *(ring.mean(axis=1)[:, None] for ring in rings)], axis=1)
    alike = [first[tuple(color)] for color in colors]
    triangles = np.concatenate([mesh.triangles + k * vertices.shape[1] for k, mesh in enumerate(alike)])
    painted = [mesh.color for mesh in alike if mesh.color is not None]
    return VisualMesh(vertices=vertices.reshape(-1, 3), triangles=triangles, color=np.concatenate(painted))


@RULES.arguments("barrier_chain")
def barrier_chain(
    points: Annotated[npt.ArrayLike, POINTS], *, closed: bool = False, length: Metres = 2.0, height: Metres = 0.8,
    colors: tuple[Vec3, ...] | None = None,
) -> Visual:  # fmt: skip
    """Barriers end to end along a line, in the frame of the line: 32 triangles each.

    Args:
        points: (n, 2) [m].
        closed: from the last point back to the first.
        length: of a barrier, about: all are equally long along the line [m].
        height: [m].
        colors: linear, in turn; None: red and white.

    Returns:
        A visual with one MESH: one shape, however many barriers. Its origin is that of the points.

    Raises:
        ModelError: the points are not (n >= 2, 2) finite numbers, or a length is not positive.
    """
    line = np.asarray(points, dtype=np.float64)
    if closed:
        line = np.concatenate([line, line[:1]])
    outline = _jersey(height)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    tones = (_RED, _WHITE) if colors is None else tuple(np.asarray(c, dtype=np.float64) for c in colors)
    count = max(
        1 + 2 * int(closed), len(tones) * round(arc[-1] / length / len(tones)) if closed else round(arc[-1] / length)
    )
    at = np.linspace(0.0, arc[-1], count + 1)
    ends = np.stack([np.interp(at, arc, line[:, k]) for k in range(2)], axis=1)
    mesh = _blocks(ends, outline, [tones[k % len(tones)] for k in range(count)])
    proxy = Proxy(kind=ShapeType.MESH, points=mesh.vertices, triangles=mesh.triangles)
    return Visual(name="barriers", mesh=mesh, proxies=(proxy,), label=Label.BARRIER, reflectance=0.6)
