"""Hulls, height fields and meshes as assets of the collision kernels; mass, inertia and bounds of convex shapes.

All on the host, in float64.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import FLOAT32_LEAST, FLOAT32_MAX, ModelError, ShapeType, formatted, numbers
from simwarp.geometry.triangle_tree import tree_tables
from simwarp.kernels.collision.shape import Assets

Array = npt.NDArray[np.float64]

DROPPED: Final = 1e-7
"""Points this close to a hull do not become vertices; times the extent of the points."""
COPLANAR: Final = 2e-6
"""Triangles of a hull that are this flat together become one face; times the extent."""
THINNEST: Final = 2.0 * COPLANAR
"""Points that lie between two planes this close together have no volume; times the extent."""


@dataclasses.dataclass(frozen=True)
class Hull(ReadableFields):
    """A convex polyhedron.

    Attributes:
        vertices: (V, 3) [m].
        faces: vertex indices of every face, counter-clockwise seen from outside.
        normals: (F, 3) outward unit normals.
        edges: (E, 3) unit directions of the edges, parallel ones merged.
    """

    vertices: Array
    faces: tuple[tuple[int, ...], ...]
    normals: Array
    edges: Array


@dataclasses.dataclass(frozen=True)
class HeightField(ReadableFields):
    """Heights on a grid about the origin: row j, column i of `heights` [m] is at x = (i - (columns - 1) / 2) dx,
    y = (j - (rows - 1) / 2) dy; `spacing` is (dx, dy) [m].
    """

    heights: npt.NDArray[np.float32]
    spacing: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class TriangleMesh(ReadableFields):
    """Triangles with one outer side, the one that sees them counter-clockwise.

    Attributes:
        vertices: (V, 3) float32 [m].
        triangles: (T, 3) vertex indices.
    """

    vertices: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True)
class MassProperties:
    """Mass [kg], centre of mass [m] and inertia about it [kg·m²], both in the shape's axes."""

    mass: float
    centre: Array
    inertia: Array


def convex_hull(points: npt.ArrayLike) -> Hull:
    """Convex hull of (N, 3) points [m], where they are; coplanar triangles are merged into polygons.

    Raises:
        ModelError: fewer than four points, a value that is not finite, or all points in one plane.
    """
    p = numbers(points)
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < 4 or not _in_float32(p):
        raise ModelError(
            f"convex hull: points must be (N >= 4, 3) finite numbers, got {_shape_of(points, p)}; pass vertices"
        )
    hull = _hull_of(p.tobytes())
    return Hull(hull.vertices.copy(), hull.faces, hull.normals.copy(), hull.edges.copy())


@functools.lru_cache(maxsize=256)
def _hull_of(points: bytes) -> Hull:
    """The hull of float64 points; scenes add the same rock again and again."""
    p = np.frombuffer(points, np.float64).reshape(-1, 3)
    extent = float(np.ptp(p, axis=0).max())
    triangles = _triangles(p, extent)
    faces, normals = _merged_faces(p, triangles, COPLANAR * extent)
    used = np.unique([i for face in faces for i in face])
    index = {int(old): new for new, old in enumerate(used)}
    vertices = p[used]
    polygons = tuple(tuple(index[i] for i in face) for face in faces)
    return Hull(vertices, polygons, normals, _edge_directions(vertices, polygons))


def _triangles(p: Array, extent: float) -> list[tuple[int, int, int]]:
    """Triangles of the hull, counter-clockwise seen from outside (qhull: Barber, Dobkin and Huhdanpaa 1996)."""
    from scipy.spatial import ConvexHull, QhullError  # takes a while to import

    flat = ModelError("convex hull: the points lie in one plane, got no volume; give the body a thickness")
    if extent < FLOAT32_LEAST:
        raise flat
    # about the origin, an extent of 1: qhull's tolerances are absolute
    q = (p - p.mean(axis=0)) / extent
    try:
        found = ConvexHull(q, qhull_options=f"Qt W{DROPPED}")
    except QhullError as error:
        raise flat from error
    depth = -(q[found.vertices] @ found.equations[:, :3].T + found.equations[:, 3]).min(axis=0)
    if depth.min() < THINNEST:
        raise flat
    return _oriented(q, found.simplices.tolist(), found.neighbors.tolist(), found.equations[:, :3])


def _oriented(
    p: Array, triangles: list[list[int]], neighbours: list[list[int]], outwards: Array
) -> list[tuple[int, int, int]]:
    """The triangles counter-clockwise seen from outside. The plane of the largest decides its order, and neighbours
    follow, because the normal of a sliver may point anywhere.
    """
    normals = np.linalg.cross(*(p[triangles][:, k] - p[triangles][:, 0] for k in (1, 2)))
    first = int(np.linalg.norm(normals, axis=1).argmax())
    if normals[first] @ outwards[first] < 0.0:
        triangles[first].reverse()
    seen, stack = {first}, [first]
    while stack:
        index = stack.pop()
        taken = set(_sides(triangles[index]))
        for other in set(neighbours[index]) - seen:
            if taken & set(_sides(triangles[other])):
                triangles[other].reverse()
            seen.add(other)
            stack.append(other)
    return [(a, b, c) for a, b, c in triangles]


def _sides(corners: Sequence[int]) -> list[tuple[int, int]]:
    return [(corners[i], corners[(i + 1) % len(corners)]) for i in range(len(corners))]


def _merged_faces(
    p: Array, triangles: list[tuple[int, int, int]], flatness: float
) -> tuple[list[tuple[int, ...]], Array]:
    """Polygons of adjacent coplanar triangles, the largest triangle of each giving its plane first."""
    corners = np.array(triangles)
    cross = np.cross(p[corners[:, 1]] - p[corners[:, 0]], p[corners[:, 2]] - p[corners[:, 0]])
    area = np.linalg.norm(cross, axis=1)
    unit = cross / np.maximum(area, 1e-300)[:, None]
    owner = {side: index for index, t in enumerate(triangles) for side in _sides(t)}
    free = set(range(len(triangles)))
    faces, normals = [], []
    for first in np.argsort(-area, kind="stable"):
        if first not in free:
            continue
        group, stack = {int(first)}, [int(first)]
        free.discard(int(first))
        while stack:
            for a, b in _sides(triangles[stack.pop()]):
                other = owner[b, a]
                height = (p[corners[other]] - p[corners[first, 0]]) @ unit[first]
                # a sliver may point anywhere: its corners tell
                if other in free and np.abs(height).max() < flatness:
                    free.discard(other)
                    group.add(other)
                    stack.append(other)
        following = {a: b for t in group for a, b in _sides(triangles[t]) if owner[b, a] not in group}
        loop = [min(following)]
        while following[loop[-1]] != loop[0]:
            loop.append(following[loop[-1]])
        normal = cross[sorted(group)].sum(axis=0)
        faces.append(tuple(loop))
        normals.append(normal / np.linalg.norm(normal))
    return faces, np.array(normals)


def _edge_directions(vertices: Array, faces: tuple[tuple[int, ...], ...]) -> Array:
    """Unit directions of all edges, one of each set of parallel ones."""
    edges = sorted({(min(side), max(side)) for face in faces for side in _sides(face)})
    found = np.zeros((len(edges), 3))
    count = 0
    for a, b in edges:
        d = vertices[b] - vertices[a]
        d = d / np.linalg.norm(d)
        if count == 0 or np.abs(found[:count] @ d).max() < 1.0 - 1e-9:
            found[count] = d
            count += 1
    return found[:count]


def hull_assets(hulls: Sequence[Hull], device: wp.DeviceLike = None) -> Assets:
    """All hulls as arrays on a device; their order gives the asset indices."""

    def starts(counts: list[int]) -> npt.NDArray[np.int32]:
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)

    def rows(blocks: list[Array]) -> Array:
        return np.concatenate(blocks) if blocks else np.zeros((0, 3))

    centres = [hull_mass(hull, 1.0).centre for hull in hulls]
    radii = [float(np.linalg.norm(h.vertices - c, axis=1).max()) for h, c in zip(hulls, centres, strict=True)]
    faces = [face for hull in hulls for face in hull.faces]
    integers = {
        "hull_vertex_start": starts([len(hull.vertices) for hull in hulls]),
        "hull_face": np.array([i for face in faces for i in face], np.int32),
        "hull_face_vertex_start": starts([len(face) for face in faces]),
        "hull_face_start": starts([len(hull.faces) for hull in hulls]),
        "hull_edge_start": starts([len(hull.edges) for hull in hulls]),
    }
    vectors = {
        "hull_vertex": rows([hull.vertices for hull in hulls]),
        "hull_normal": rows([hull.normals for hull in hulls]),
        "hull_edge": rows([hull.edges for hull in hulls]),
        "hull_centre": np.array(centres).reshape(-1, 3),
    }
    assets = Assets()
    for name, values in integers.items():
        setattr(assets, name, wp.array(values, dtype=wp.int32, device=device))
    for name, points in vectors.items():
        setattr(assets, name, wp.array(points.astype(np.float32), dtype=wp.vec3, device=device))
    assets.hull_radius = wp.array(np.array(radii, np.float32), dtype=wp.float32, device=device)
    return assets


def height_field(heights: npt.ArrayLike, size: Sequence[float]) -> HeightField:
    """A height field from (rows, columns) heights [m] that spans size (x, y) [m].

    Raises:
        ModelError: fewer than two rows or columns, a value that is not finite, or a size that is not positive.
    """
    values = numbers(heights)
    if values.ndim != 2 or min(values.shape) < 2 or not _in_float32(values):
        raise ModelError(
            "height field: heights must be (rows >= 2, columns >= 2) finite numbers, got "
            f"{_shape_of(heights, values)}; columns run along x"
        )
    rows, columns = values.shape
    span = numbers(size).reshape(-1)
    least = FLOAT32_LEAST * max(rows, columns)
    if span.shape != (2,) or not _in_float32(span) or span.min() < least:
        raise ModelError(
            f"height field: size must be two lengths > 0 m, got {formatted(size)}; pass its extents along x and y"
        )
    return HeightField(values.astype(np.float32), (float(span[0]) / (columns - 1), float(span[1]) / (rows - 1)))


def _indices(triangles: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Whole numbers, or a ModelError."""
    given = numbers(triangles)
    whole = np.abs(given) < 2.0**31
    if not whole.all() or (given != np.rint(given)).any():
        raise ModelError(
            f"mesh: triangles must be (T >= 1, 3) whole numbers, got {formatted(triangles)}; pass indices of vertices"
        )
    return given.astype(np.int64)


def _in_float32(values: Array) -> bool:
    """True if all numbers are finite, and stay so in float32."""
    return bool((np.abs(values) <= FLOAT32_MAX).all())


def _shape_of(given: Any, values: Array) -> str:
    """Description of a value given in place of an array of numbers, for errors."""
    return f"shape {values.shape}" if values.ndim else formatted(given)


def triangle_mesh(vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> TriangleMesh:
    """A mesh from (V, 3) vertices [m] and (T, 3) indices. Equal vertices become one, so that triangles have
    neighbours; triangles without area go.

    Raises:
        ModelError: wrong shapes, values that are not finite, indices without vertices, or no triangle left.
    """
    given = numbers(vertices)
    corners = _indices(triangles)
    if given.ndim != 2 or given.shape[1] != 3 or not _in_float32(given):
        raise ModelError(f"mesh: vertices must be (V, 3) finite numbers, got {_shape_of(vertices, given)}; pass metres")
    points = given.astype(np.float32)
    if corners.ndim != 2 or corners.shape[1] != 3 or corners.size == 0:
        raise ModelError(f"mesh: triangles must be (T >= 1, 3) indices, got shape {corners.shape}; split polygons")
    if corners.min() < 0 or corners.max() >= len(points):
        raise ModelError(
            f"mesh: triangle indices must be in 0..{len(points) - 1}, got {corners.min()}..{corners.max()}; "
            "count vertices from 0"
        )
    unique, inverse = np.unique(points + np.float32(0.0), axis=0, return_inverse=True)
    corners = inverse.reshape(-1)[corners]
    p = unique[corners].astype(np.float64)
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    longest = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).max(axis=1)
    corners = corners[area > 1e-7 * longest**2]
    if not len(corners):
        raise ModelError("mesh: triangles must have an area, got none that has; check the unit of the vertices")
    return TriangleMesh(unique, corners.astype(np.int32))


def neighbour_normals(mesh: TriangleMesh) -> Array:
    """(T, 3, 3) unit normal of the triangle across edge k (corner k to k + 1) of each triangle; zero at borders and
    where more than two triangles meet or the other one faces the other way.
    """
    p = mesh.vertices.astype(np.float64)[mesh.triangles]
    normals = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    count = len(mesh.vertices)
    start = mesh.triangles.astype(np.int64)
    end = np.roll(start, -1, axis=1)
    codes, back = (start * count + end).reshape(-1), (end * count + start).reshape(-1)
    order = np.argsort(codes, kind="stable")
    first = np.searchsorted(codes[order], back)
    found = np.searchsorted(codes[order], back, side="right") - first
    mine = np.searchsorted(codes[order], codes, side="right") - np.searchsorted(codes[order], codes)
    other = order[np.minimum(first, len(codes) - 1)] // 3
    result = np.where(((found == 1) & (mine == 1))[:, None], normals[other], 0.0)
    return result.reshape(-1, 3, 3)


def add_ground_assets(
    assets: Assets, fields: Sequence[HeightField], meshes: Sequence[TriangleMesh], device: wp.DeviceLike = None
) -> list[wp.Mesh]:
    """Puts height fields and meshes into `assets`; their order gives the asset indices.

    Returns the meshes on the device, which `assets` only refers to: keep them as long as it is used.
    """

    def starts(counts: list[int]) -> wp.array:
        return wp.array(np.cumsum([0, *counts]).astype(np.int32), dtype=wp.int32, device=device)

    def floats(rows: list[npt.NDArray[Any]], dtype: Any, width: int = 3) -> wp.array:
        data = np.concatenate([np.zeros((0, width)), *rows]) if width else np.concatenate([np.zeros(0), *rows])
        return wp.array(data, dtype=dtype, device=device)

    assets.field_height = floats([field.heights.reshape(-1) for field in fields], wp.float32, 0)
    assets.field_start = starts([field.heights.size for field in fields])
    nodes = np.array([field.heights.shape[::-1] for field in fields], np.int32).reshape(-1, 2)
    assets.field_nodes = wp.array(nodes, dtype=wp.vec2i, device=device)
    assets.field_spacing = floats([np.array([field.spacing]) for field in fields], wp.vec2d, 2)
    assets.field_range = floats([np.array([[f.heights.min(), f.heights.max()]]) for f in fields], wp.vec2, 2)
    built = [
        wp.Mesh(
            points=wp.array(mesh.vertices, dtype=wp.vec3, device=device),
            indices=wp.array(mesh.triangles.reshape(-1), dtype=wp.int32, device=device),
            bvh_constructor="sah",  # built on the host, slower, once: queries are what counts
        )
        for mesh in meshes
    ]
    assets.mesh = wp.array(np.array([mesh.id for mesh in built], np.uint64), dtype=wp.uint64, device=device)
    assets.trees = tree_tables(((mesh.vertices, mesh.triangles) for mesh in meshes), device)
    assets.mesh_neighbour = floats([neighbour_normals(mesh).reshape(-1, 3) for mesh in meshes], wp.vec3)
    assets.mesh_neighbour_start = starts([len(mesh.triangles) for mesh in meshes])
    assets.mesh_lower = floats([mesh.vertices.min(axis=0)[None] for mesh in meshes], wp.vec3)
    assets.mesh_upper = floats([mesh.vertices.max(axis=0)[None] for mesh in meshes], wp.vec3)
    return built


def hull_mass(hull: Hull, density: float, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> MassProperties:
    """Of a solid hull of given density [kg/m³], scaled by `scale`."""
    vertices = hull.vertices * np.asarray(scale, dtype=np.float64)
    triangles = [(face[0], face[k], face[k + 1]) for face in hull.faces for k in range(1, len(face) - 1)]
    return solid_mass(vertices, np.array(triangles), density)


def solid_mass(vertices: Array, triangles: npt.NDArray[np.integer], density: float) -> MassProperties:
    """Of the solid inside a closed surface of triangles (T, 3) over vertices (V, 3) [m], which face outwards."""
    origin = vertices.mean(axis=0)
    corners = vertices[triangles] - origin
    # tetrahedra from the origin: volume, first and second moments (the latter exact for a linear field)
    volume = np.linalg.det(corners) / 6.0
    total = float(volume.sum())
    first = np.einsum("t,tki->i", volume, corners) / 4.0
    sums = corners.sum(axis=1)
    second = np.einsum("t,tki,tkj->ij", volume, corners, corners) + np.einsum("t,ti,tj->ij", volume, sums, sums)
    second = second / 20.0
    centre = first / total
    second -= total * np.outer(centre, centre)
    inertia = np.trace(second) * np.eye(3) - second
    return MassProperties(density * total, centre + origin, density * inertia)


def shape_mass(kind: ShapeType, size: Sequence[float], density: float, hull: Hull | None = None) -> MassProperties:
    """Of a solid convex shape of given density [kg/m³]; `size` as in `ShapeType`, a hull's scale otherwise.

    Raises:
        ModelError: the shape encloses no finite volume, or a hull is missing.
    """
    a, b, c = (float(value) for value in size)
    centre = np.zeros(3)
    if kind == ShapeType.HULL:
        if hull is None:
            raise ModelError("shape mass: a HULL needs its hull, got None; pass convex_hull(points)")
        return hull_mass(hull, density, size)
    if kind in (ShapeType.SPHERE, ShapeType.ELLIPSOID):
        half = np.array([a, a, a] if kind == ShapeType.SPHERE else [a, b, c])
        mass = density * 4.0 / 3.0 * np.pi * float(half.prod())
        second = mass / 5.0 * half**2
    elif kind == ShapeType.BOX:
        mass = density * 8.0 * a * b * c
        second = mass / 3.0 * np.array([a, b, c]) ** 2
    elif kind == ShapeType.CYLINDER:
        mass = density * 2.0 * np.pi * a**2 * b
        second = mass * np.array([a**2 / 4.0, a**2 / 4.0, b**2 / 3.0])
    elif kind == ShapeType.CONE:
        mass = density * 2.0 / 3.0 * np.pi * a**2 * b
        centre = np.array([0.0, 0.0, -b / 2.0])
        second = mass * np.array([3.0 / 20.0 * a**2, 3.0 / 20.0 * a**2, 3.0 / 20.0 * b**2])
    elif kind == ShapeType.CAPSULE:
        tube, caps = density * 2.0 * np.pi * a**2 * b, density * 4.0 / 3.0 * np.pi * a**3
        mass = tube + caps
        side = tube * a**2 / 4.0 + caps * a**2 / 5.0
        second = np.array([side, side, tube * b**2 / 3.0 + caps * (a**2 / 5.0 + b**2 + 0.75 * a * b)])
    else:
        raise ModelError(f"shape mass: {kind.name} encloses no volume of its own; give the body its mass and inertia")
    return MassProperties(mass, centre, np.diag(second.sum() - second))
