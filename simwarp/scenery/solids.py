"""Closed solids of triangles with a colour per face: what all scenery is made of.

Triangles are counter-clockwise seen from outside. Solids are put together by
`simwarp.geometry.visual_mesh.joined`; each stays closed in itself.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from simwarp.core.types import Vec3
from simwarp.geometry.visual_mesh import VisualMesh, linear_from_srgb

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Color = Sequence[float] | Array


def stream(thing: str, *seeds: int) -> np.random.Generator:
    """Random numbers of a thing, other than those of another thing with the same seeds."""
    return np.random.default_rng((zlib.crc32(thing.encode()), *(int(seed) for seed in seeds)))


def tone(code: str) -> Array:
    """(3,) linear albedo of an sRGB colour in hexadecimal, such as "c8a070"."""
    return linear_from_srgb([int(code[k : k + 2], 16) / 255.0 for k in (0, 2, 4)])


def solid(vertices: npt.ArrayLike, triangles: npt.ArrayLike, color: npt.ArrayLike) -> VisualMesh:
    """A mesh from (V, 3) vertices, (T, 3) indices and one colour (3,), or one per triangle (T, 3)."""
    corners = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    faces = np.broadcast_to(np.clip(color, 0.0, 1.0), (len(corners), 3))
    colors = np.repeat(faces[:, None], 3, axis=1).astype(np.float32)
    return VisualMesh(vertices=np.asarray(vertices, dtype=np.float64), triangles=corners, color=colors)


def varied(color: npt.ArrayLike, count: int, rng: np.random.Generator, spread: float) -> Array:
    """(count, 3) lighter and darker versions of a colour, or of one per row; `spread` of its brightness."""
    factor = 1.0 + spread * rng.uniform(-1.0, 1.0, (count, 1))
    return np.clip(np.broadcast_to(color, (count, 3)) * factor, 0.0, 1.0)


def between(low: npt.ArrayLike, high: npt.ArrayLike, share: npt.ArrayLike) -> Array:
    """(n, 3) colours from `low` to `high` by shares (n,) of 0 to 1."""
    t = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)[..., None]
    return (1.0 - t) * np.asarray(low) + t * np.asarray(high)


def face_normals(vertices: Array, triangles: Indices) -> Array:
    """(T, 3) unit outward normals."""
    p = vertices[triangles]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))


def moved(
    mesh: VisualMesh, at: Vec3 = (0.0, 0.0, 0.0), *, yaw: float = 0.0, turn: npt.ArrayLike | None = None,
    scale: float | Vec3 = 1.0,
) -> VisualMesh:  # fmt: skip
    """A copy: scaled, turned by the (3, 3) matrix `turn`, turned about z by `yaw` [rad], then moved [m]."""
    points = mesh.vertices * np.broadcast_to(np.asarray(scale, dtype=np.float64), 3)
    if turn is not None:
        points = points @ np.asarray(turn, dtype=np.float64).T
    cosine, sine = math.cos(yaw), math.sin(yaw)
    points = points @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]).T
    return dataclasses.replace(mesh, vertices=points + np.asarray(at, dtype=np.float64))


def mirrored(mesh: VisualMesh) -> VisualMesh:
    """A copy on the other side of the plane y = 0; its outside stays outside."""
    flipped = {
        name: values[:, ::-1].copy()
        for name in ("triangles", "color", "uv")
        if (values := getattr(mesh, name)) is not None
    }
    return dataclasses.replace(mesh, vertices=mesh.vertices * np.array([1.0, -1.0, 1.0]), **flipped)


def icosphere(level: int) -> tuple[Array, Indices]:
    """Unit vertices and triangles of an icosahedron whose edges are halved `level` times: 20 · 4^level triangles."""
    g = 0.5 * (1.0 + math.sqrt(5.0))
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g),
              (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]  # fmt: skip
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
             (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
             (8, 6, 7), (9, 8, 1)]  # fmt: skip
    vertices, triangles = np.array(points, dtype=np.float64), np.array(faces, dtype=np.int64)
    for _ in range(level):
        sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(sides, axis=0, return_inverse=True)
        middle = inverse.reshape(-1, 3) + len(vertices)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c = triangles.T
        ab, bc, ca = middle.T
        triangles = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), triangles


def box(half: Vec3, color: npt.ArrayLike, at: Vec3 = (0.0, 0.0, 0.0)) -> VisualMesh:
    """A box of half lengths `half` about `at`; `color` (3,), or (6, 3) of its sides -x, +x, -y, +y, -z, +z."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    colors = np.repeat(np.broadcast_to(color, (6, 3)), 2, axis=0)
    return solid(signs * np.asarray(half) + np.asarray(at), triangles, colors)


def loft(rings: npt.ArrayLike, colors: npt.ArrayLike, caps: npt.ArrayLike | None = None) -> VisualMesh:
    """A skin over rings, closed by flat ends that are fans about the mean of their ring.

    Args:
        rings: (n, k, 3) points; seen from the last ring towards the first each runs counter-clockwise.
        colors: (3,), or one per strip (n-1, 3), or one per cell (n-1, k, 3); cell j lies between points j and j + 1.
        caps: colours (2, 3) of the first and the last end; None: those of the nearest cells.
    """
    points = np.asarray(rings, dtype=np.float64)
    n, k = points.shape[:2]
    cells = np.asarray(colors, dtype=np.float64)
    cells = np.broadcast_to(cells[:, None] if cells.ndim == 2 else cells, (n - 1, k, 3))
    ends = np.stack([cells[0, 0], cells[-1, 0]]) if caps is None else np.broadcast_to(caps, (2, 3))
    vertices = np.concatenate([points.reshape(-1, 3), points[0].mean(axis=0)[None], points[-1].mean(axis=0)[None]])
    i, j = (values.reshape(-1) for values in np.meshgrid(np.arange(n - 1), np.arange(k), indexing="ij"))
    a, b = i * k + j, i * k + (j + 1) % k
    c, d = b + k, a + k
    skin = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)
    step = np.arange(k)
    first = np.stack([(step + 1) % k, step, np.full(k, n * k)], axis=1)
    last = np.stack([(n - 1) * k + step, (n - 1) * k + (step + 1) % k, np.full(k, n * k + 1)], axis=1)
    painted = np.concatenate([np.repeat(cells.reshape(-1, 3), 2, axis=0), np.repeat(ends, k, axis=0)])
    return solid(vertices, np.concatenate([skin, first, last]), painted)


def lathe(profile: npt.ArrayLike, colors: npt.ArrayLike, segments: int = 10, twist: float = 0.0) -> VisualMesh:
    """A solid of revolution about z.

    Args:
        profile: (k, 2) radius and height [m], from the foot up; its ends are closed by flat discs.
        colors: (3,), or one per band (k-1, 3), or per cell (k-1, segments, 3).
        segments: corners of its rings.
        twist: turn of the rings [rad].
    """
    radius, height = np.asarray(profile, dtype=np.float64).T
    angle = twist + 2.0 * math.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = np.concatenate([
        np.maximum(radius, 1e-4)[:, None, None] * ring[None],
        np.broadcast_to(height[:, None, None], (len(height), segments, 1)),
    ], axis=2)  # fmt: skip
    return loft(rings, colors)


def tube(points: npt.ArrayLike, radii: npt.ArrayLike, color: npt.ArrayLike, segments: int = 6) -> VisualMesh:
    """A round bar along (n, 3) points with radii (n,) or one for all; `color` as `loft`'s."""
    line = np.asarray(points, dtype=np.float64)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    helper = np.eye(3)[np.argmin(np.abs(along).max(axis=0))]
    first = np.cross(along, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    angle = 2.0 * math.pi * np.arange(segments) / segments
    radius = np.broadcast_to(radii, len(line))[:, None, None]
    ring = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    return loft(line[:, None] + radius * ring, color)


def closed_loft(rings: npt.ArrayLike, colors: npt.ArrayLike) -> VisualMesh:
    """A skin over rings of which the last one is joined to the first.

    Args:
        rings: (n, k, 3) points; seen against the way from ring to ring each runs counter-clockwise.
        colors: (3,), or one per line of cells (k, 3), or one per cell (n, k, 3).
    """
    points = np.asarray(rings, dtype=np.float64)
    n, k = points.shape[:2]
    i, j = (values.reshape(-1) for values in np.meshgrid(np.arange(n), np.arange(k), indexing="ij"))
    a, b = i * k + j, i * k + (j + 1) % k
    c, d = ((i + 1) % n) * k + (j + 1) % k, ((i + 1) % n) * k + j
    skin = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)
    painted = np.broadcast_to(colors, (n, k, 3)).reshape(-1, 3)
    return solid(points.reshape(-1, 3), skin, np.repeat(painted, 2, axis=0))


def turned_about_y(outline: npt.ArrayLike, colors: npt.ArrayLike, segments: int) -> VisualMesh:
    """A closed outline turned about y: a tire, which has a hole.

    Args:
        outline: (k, 2) radius and y [m], clockwise with y to the right and the radius upwards.
        colors: as of `closed_loft`, with a ring per step of the turn.
        segments: steps of the turn.
    """
    radius, y = np.asarray(outline, dtype=np.float64).T
    angle = -2.0 * math.pi * np.arange(segments) / segments
    rings = np.stack([
        np.sin(angle)[:, None] * radius, np.broadcast_to(y, (segments, len(y))), np.cos(angle)[:, None] * radius,
    ], axis=2)  # fmt: skip
    return closed_loft(rings, colors)


def ribbon(lines: npt.ArrayLike, colors: npt.ArrayLike, height: float = 0.0, *, upwards: bool = True) -> VisualMesh:
    """A flat strip between lines that run side by side; it has one side, the upper one or the lower one.

    Args:
        lines: (m, n, 2) points of m lines, from right to left seen along them [m].
        colors: (3,), or one per cell (m-1, n-1, 3).
        height: of the strip [m].
        upwards: side that is outside.
    """
    points = np.asarray(lines, dtype=np.float64)
    m, n = points.shape[:2]
    vertices = np.concatenate([points.reshape(-1, 2), np.full((m * n, 1), height)], axis=1)
    i, j = (values.reshape(-1) for values in np.meshgrid(np.arange(m - 1), np.arange(n - 1), indexing="ij"))
    a, b = i * n + j, i * n + j + 1
    c, d = b + n, a + n
    skin = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)
    painted = np.repeat(np.broadcast_to(colors, (m - 1, n - 1, 3)).reshape(-1, 3), 2, axis=0)
    return solid(vertices, skin if upwards else skin[:, ::-1], painted)


def hull_corners(points: Array, count: int = 32) -> Array:
    """(n, 3) at most `count` of the points, whose hull comes near to that of all of them: one by one the point that is
    farthest outside, as seen along 642 directions.
    """
    directions = icosphere(3)[0]
    reach = directions @ points.T
    chosen = [int(points[:, 2].argmin())]
    while len(chosen) < count:
        gap = reach.max(axis=1) - reach[:, chosen].max(axis=1)
        if gap.max() < 1e-9 * np.abs(reach).max():
            break
        chosen.append(int(reach[gap.argmax()].argmax()))
    return np.asarray(points[chosen])


def volume(mesh: VisualMesh) -> float:
    """Volume that the triangles enclose [m³]; negative where they are inside out."""
    p = mesh.vertices[mesh.triangles]
    return float(np.linalg.det(p).sum() / 6.0)
