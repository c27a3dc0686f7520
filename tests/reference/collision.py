"""Brute-force narrow phase in float64: the signed distance is the largest separation over all directions.

Nothing is shared with the kernels: directions are sampled all over the sphere and the best ones refined.
Overlapping polyhedra need no search: their faces and edge products hold the answer.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.optimize import nnls

from simwarp.core.types import ShapeType

TRIANGLE = 64
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


@dataclasses.dataclass
class Solid:
    """A placed shape. `vertices` (N, 3), `normals`, `edges`: of hulls, unscaled; vertices of triangles: world."""

    kind: int
    x: np.ndarray
    rot: np.ndarray
    size: np.ndarray
    margin: float = 0.0
    asset: int = -1
    vertices: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    normals: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    edges: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def radius(self) -> float:
        """Rough radius [m]."""
        points = corners(self)
        if points is not None:
            return float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
        return {
            ShapeType.SPHERE: self.size[0],
            ShapeType.CAPSULE: self.size[0] + self.size[1],
            ShapeType.ELLIPSOID: self.size.max(),
        }.get(ShapeType(self.kind), float(np.hypot(self.size[0], self.size[1])))


def corners(s: Solid) -> np.ndarray | None:
    """World vertices of a polyhedron."""
    if s.kind == TRIANGLE:
        return s.vertices
    if s.kind == ShapeType.HULL:
        return s.x + (s.vertices * s.size) @ s.rot.T
    if s.kind == ShapeType.BOX:
        signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        return s.x + (signs * s.size) @ s.rot.T
    return None


def farthest(s: Solid, n: np.ndarray) -> np.ndarray:
    """Points of the shape farthest along (K, 3) unit directions."""
    points = corners(s)
    if points is not None:
        return points[(n @ points.T).argmax(axis=1)] + s.margin * n
    d = n @ s.rot
    radial = np.hypot(d[:, 0], d[:, 1])
    rim = d / np.maximum(radial, 1e-300)[:, None] * [s.size[0], s.size[0], 0.0]
    along = np.where(d[:, 2:] < 0.0, -1.0, 1.0) * [0.0, 0.0, s.size[1]]
    if s.kind == ShapeType.SPHERE:
        p = s.size[0] * d
    elif s.kind == ShapeType.CAPSULE:
        p = s.size[0] * d + along
    elif s.kind == ShapeType.CYLINDER:
        p = rim + along
    elif s.kind == ShapeType.CONE:
        tip = s.size[1] * d[:, 2] > s.size[0] * radial - s.size[1] * d[:, 2]
        p = np.where(tip[:, None], [0.0, 0.0, s.size[1]], rim - [0.0, 0.0, s.size[1]])
    else:
        p = d * s.size**2 / np.linalg.norm(d * s.size, axis=1)[:, None]
    return s.x + p @ s.rot.T + s.margin * n


def heights(s: Solid, n: np.ndarray) -> np.ndarray:
    """Support function: largest n.x over the shape for (K, 3) unit directions."""
    return (n * farthest(s, n)).sum(axis=1)


def separation(a: Solid, b: Solid, n: np.ndarray) -> np.ndarray:
    """Gap along (K, 3) unit directions from a to b."""
    return -heights(b, -n) - heights(a, n)


def polyhedron_axes(s: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Face normals and edge directions, world."""
    if s.kind == TRIANGLE:
        edges = np.roll(s.vertices, -1, axis=0) - s.vertices
        return np.cross(edges[0], edges[1])[None], edges
    if s.kind == ShapeType.BOX:
        return s.rot.T, s.rot.T
    return (s.normals / s.size) @ s.rot.T, (s.edges * s.size) @ s.rot.T


def unit(v: np.ndarray) -> np.ndarray:
    """Rows of unit length; rows of no length are dropped."""
    length = np.linalg.norm(v, axis=-1)
    return v[length > 1e-12] / length[length > 1e-12][:, None]


def signed_distance(a: Solid, b: Solid) -> tuple[float, np.ndarray]:
    """Signed distance [m] of two convex shapes (plane first, if any) and its direction from a to b."""
    if a.kind == ShapeType.PLANE:
        n = a.rot[:, 2]
        return float(-heights(b, -n[None])[0] - n @ a.x - a.margin), n
    if corners(a) is not None and corners(b) is not None:
        (faces_a, edges_a), (faces_b, edges_b) = polyhedron_axes(a), polyhedron_axes(b)
        products = np.cross(edges_a[:, None], edges_b[None]).reshape(-1, 3)
        n = unit(np.concatenate([faces_a, faces_b, products]))
        n = np.concatenate([n, -n])
        s = separation(a, b, n)
        if s.max() + a.margin + b.margin <= 0.0:
            return float(s.max()), n[s.argmax()]
    k = np.arange(1500) + 0.5
    z = 1.0 - 2.0 * k / len(k)
    sphere = np.stack([np.sqrt(1 - z * z) * np.cos(GOLDEN * k), np.sqrt(1 - z * z) * np.sin(GOLDEN * k), z], axis=1)
    axes = np.concatenate([sphere, a.rot.T, -a.rot.T, b.rot.T, -b.rot.T, unit((b.x - a.x)[None])])
    for side, sign in ((a, 1.0), (b, -1.0)):
        if corners(side) is not None:
            normals = unit(polyhedron_axes(side)[0])
            axes = np.concatenate([axes, sign * normals, -normals] if side.kind == TRIANGLE else [axes, sign * normals])
    s = separation(a, b, axes)
    starts = axes[np.argsort(-s)[[0, 1, 2, 4, 8, 16, 32, 64]]]
    found = [refined(a, b, start) for start in starts]
    return max(found, key=lambda item: item[0])


def refined(a: Solid, b: Solid, n: np.ndarray) -> tuple[float, np.ndarray]:
    """Ascent of the separation: the nearest points of the shapes moved apart along n give the next n.

    The nearest point of growing sets of corners comes from non-negative least squares: with l >= 0 the direction of
    W l that makes |W l|^2 + (sum l - 1)^2 smallest is that of the point of the hull of W nearest to the origin.
    """
    small = min(a.radius, b.radius)
    best = float(separation(a, b, n[None])[0])
    for _ in range(60):
        move = max(0.0, 0.1 * small - best) * n
        scale = np.linalg.norm(move) + abs(best)
        corner = farthest(b, -n[None])[0] - farthest(a, n[None])[0] + move
        columns = [np.append(corner / scale, 1.0)]
        direction = n
        for _ in range(80):
            try:
                weights, _ = nnls(np.array(columns).T, np.array([0.0, 0.0, 0.0, 1.0]))
            except RuntimeError:  # no progress left within rounding
                break
            v = (np.array(columns)[:, :3].T @ weights) / weights.sum()
            direction = v / np.linalg.norm(v)
            corner = (farthest(b, -direction[None])[0] - farthest(a, direction[None])[0] + move) / scale
            if np.linalg.norm(v) - direction @ corner < 1e-13:
                break
            columns = [c for c, weight in zip(columns, weights, strict=True) if weight > 0.0]
            columns.append(np.append(corner, 1.0))
        value = float(separation(a, b, direction[None])[0])
        gain, n, best = value - best, direction if value > best else n, max(best, value)
        if gain < 1e-11 * small:
            break
    return best, n
