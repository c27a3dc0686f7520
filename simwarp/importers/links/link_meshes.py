"""Meshes of collision geometry as convex hulls of few corners."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError, formatted
from simwarp.geometry.assets import convex_hull
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.model.builder import ModelBuilder

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

HULL_CORNERS: Final = 64
"""Most corners of an imported hull: contacts of two hulls cost about the product of their faces and edges."""


def scaled_mesh(vertices: npt.ArrayLike, triangles: npt.ArrayLike, scale: npt.ArrayLike) -> tuple[Array, Triangles]:
    """Vertices (V, 3) times the factors of x, y, z; triangles (T, 3) keep their outer side where these mirror it."""
    factors = np.broadcast_to(np.asarray(scale, np.float64), (3,))
    corners = np.asarray(triangles, np.int64)
    if factors.prod() < 0.0:
        corners = corners[:, ::-1]
    return np.asarray(vertices, np.float64) * factors, corners


def scaled_visual(mesh: VisualMesh, scale: npt.ArrayLike) -> VisualMesh:
    """A visible mesh times the factors of x, y, z; see `scaled_mesh`."""
    factors = np.broadcast_to(np.asarray(scale, np.float64), (3,))
    vertices, triangles = scaled_mesh(mesh.vertices, mesh.triangles, factors)
    turn = slice(None, None, -1 if factors.prod() < 0.0 else 1)
    return dataclasses.replace(
        mesh, vertices=vertices, triangles=triangles,
        color=None if mesh.color is None else mesh.color[:, turn],
        uv=None if mesh.uv is None else mesh.uv[:, turn],
    )  # fmt: skip


def reduced_hull(points: npt.ArrayLike, corners: int = HULL_CORNERS) -> tuple[Array, float]:
    """Corners of the convex hull of points (N, 3), at most `corners` of them, and how far those that were left out
    stand off the hull of these [m].

    Corners are taken one after the other, the one farthest out first.

    Raises:
        ModelError: the points have no hull.
    """
    given = np.asarray(points, np.float64)
    if given.ndim != 2 or len(given) <= corners:
        return convex_hull(points).vertices, 0.0
    from scipy.spatial import ConvexHull, QhullError  # takes a while to import

    try:
        hull = given[ConvexHull(given).vertices]
    except (QhullError, ValueError):
        return convex_hull(points).vertices, 0.0  # for its error
    if len(hull) <= corners:
        return convex_hull(hull).vertices, 0.0
    centre = hull.mean(axis=0)
    extent = float(np.ptp(hull, axis=0).max())
    unit = (hull - centre) / extent
    chosen = _first_corners(unit)
    growing = ConvexHull(unit[chosen], incremental=True)
    while True:
        off = (unit @ growing.equations[:, :3].T + growing.equations[:, 3]).max(axis=1)
        farthest = int(off.argmax())
        if len(chosen) == corners or off[farthest] <= 0.0 or farthest in chosen:
            growing.close()
            return hull[sorted(chosen)], max(float(off[farthest]), 0.0) * extent
        chosen.append(farthest)
        growing.add_points(unit[farthest : farthest + 1])


def _first_corners(points: Array) -> list[int]:
    """Four corners that enclose a volume: the ends of the longest axis, the one farthest from their line, and the one
    farthest from the plane of these.
    """
    axis = int(np.ptp(points, axis=0).argmax())
    a, b = int(points[:, axis].argmin()), int(points[:, axis].argmax())
    along = points[b] - points[a]
    across = np.cross(points - points[a], along)
    c = int(np.linalg.norm(across, axis=1).argmax())
    normal = np.cross(along, points[c] - points[a])
    d = int(np.abs((points - points[a]) @ normal).argmax())
    return [a, b, c, d]


def collision_hulls(
    thing: str, vertices: Array, triangles: Triangles, decompose: bool | Mapping[str, Any]
) -> tuple[list[Array], float]:
    """Corners of the hulls that stand for a mesh, and how far their reduction moves the surface at most [m].

    Args:
        thing: name for errors.
        vertices: (V, 3) [m].
        triangles: (T, 3) vertex indices.
        decompose: False: one hull; True, or options of `coacd.run_coacd`: convex parts.

    Raises:
        ModelError: the mesh encloses nothing, or no library for decomposition is installed.
    """
    if not isinstance(decompose, (bool, Mapping)):
        raise ModelError(
            f"{thing}: decompose must be True, False or a dict of options, got {formatted(decompose)}; choose"
        )
    parts: list[Array] = [vertices]
    if decompose is not False:
        from simwarp.geometry.mesh_files import convex_parts  # trimesh takes a while to import

        try:
            parts = convex_parts(vertices, triangles, **(decompose if isinstance(decompose, Mapping) else {}))
        except TypeError as error:
            raise ModelError(f"{thing}: decompose has options that there are not: {error}; drop them") from None
    hulls, moved = [], 0.0
    for part in parts:
        try:
            corners, off = reduced_hull(part)
        except ModelError as error:
            raise ModelError(f"{thing}: {error}") from None
        hulls.append(corners)
        moved = max(moved, off)
    return hulls, moved


def add_hulls(
    builder: ModelBuilder, body: int, parts: Sequence[Array], *, name: str, **options: Any
) -> tuple[int, ...]:
    """The hulls of corners (N, 3) each [m], called `name` where it is one, else name_0, name_1 and so on."""
    names = [name] if len(parts) == 1 else [f"{name}_{index}" for index in range(len(parts))]
    return tuple(
        builder.add_shape_hull(body, corners, name=own, **options) for corners, own in zip(parts, names, strict=True)
    )
