"""Height fields and meshes by brute force in float64: every question goes through all triangles.

Nothing is shared with the kernels but the statement of how a cell is cut: from node (i, j) to node (i + 1, j + 1).
"""

from __future__ import annotations

import numpy as np


def field_triangles(heights: np.ndarray, size: tuple[float, float], scale: tuple[float, ...] = (1, 1, 1)) -> np.ndarray:
    """(T, 3, 3) corners of all triangles, in the order of the kernels."""
    rows, columns = heights.shape
    x = np.linspace(-0.5, 0.5, columns) * size[0] * scale[0]
    y = np.linspace(-0.5, 0.5, rows) * size[1] * scale[1]
    nodes = np.empty((rows, columns, 3))
    nodes[..., 0], nodes[..., 1] = x[None, :], y[:, None]
    nodes[..., 2] = np.asarray(heights, dtype=np.float32).astype(np.float64) * scale[2]
    a, b = nodes[:-1, :-1], nodes[:-1, 1:]
    c, d = nodes[1:, 1:], nodes[1:, :-1]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)


def normals(triangles: np.ndarray) -> np.ndarray:
    """(T, 3) unit normals."""
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def nearest_points(triangles: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(T, 3) the point of every triangle nearest to c."""
    n = normals(triangles)
    foot = c - np.einsum("ti,ti->t", c - triangles[:, 0], n)[:, None] * n
    inside = np.ones(len(triangles), dtype=bool)
    best = np.full(len(triangles), np.inf)
    point = foot.copy()
    for k in range(3):
        a, e = triangles[:, k], triangles[:, (k + 1) % 3] - triangles[:, k]
        inside &= np.einsum("ti,ti->t", np.cross(e, foot - a), n) >= 0.0
        s = np.clip(np.einsum("ti,ti->t", e, c - a) / np.einsum("ti,ti->t", e, e), 0.0, 1.0)
        q = a + s[:, None] * e
        d = np.linalg.norm(c - q, axis=1)
        point[d < best] = q[d < best]
        best = np.minimum(best, d)
    point[inside] = foot[inside]
    return point


def touching_points(triangles: np.ndarray, c: np.ndarray, reach: float) -> np.ndarray:
    """(K, 3) points of the surface within `reach` of c that are nearer to c than all others around them, on its outer
    side. A triangle is convex: q is such a point if it is the nearest one of every triangle that it lies on.
    """
    points = nearest_points(triangles, c)
    distance = np.linalg.norm(points - c, axis=1)
    facing = normals(triangles)
    found: list[np.ndarray] = []
    for q, d in zip(points, distance, strict=True):
        if d > reach or any(np.linalg.norm(q - other) < 1e-6 for other in found):
            continue
        around = np.linalg.norm(nearest_points(triangles, q) - q, axis=1) < 1e-7
        outer = (facing[around] @ (c - q)).max() > 0.0
        if outer and (distance[around] > d - 1e-9).all():
            found.append(q)
    return np.array(found).reshape(-1, 3)


def ray_hit(triangles: np.ndarray, start: np.ndarray, direction: np.ndarray) -> tuple[float, int]:
    """Smallest t >= 0 at which a ray hits, and the triangle; (inf, -1) if none."""
    e, f = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    h = np.cross(direction, f)
    det = np.einsum("ti,ti->t", e, h)
    det = np.where(np.abs(det) < 1e-300, np.nan, det)
    s = start - triangles[:, 0]
    u = np.einsum("ti,ti->t", s, h) / det
    q = np.cross(s, e)
    v = (q @ direction) / det
    t = np.einsum("ti,ti->t", f, q) / det
    t = np.where((u >= -1e-12) & (v >= -1e-12) & (u + v <= 1.0 + 1e-12) & (t >= 0.0), t, np.inf)
    best = int(t.argmin())
    return (float(t[best]), best) if np.isfinite(t[best]) else (np.inf, -1)


def surface_height(triangles: np.ndarray, x: float, y: float) -> tuple[float, np.ndarray]:
    """Height and normal where the vertical line at (x, y) meets the triangles, the highest of several."""
    top = float(triangles[..., 2].max()) + 1.0
    t, index = ray_hit(triangles, np.array([x, y, top]), np.array([0.0, 0.0, -1.0]))
    return top - t, normals(triangles)[index]
