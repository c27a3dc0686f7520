"""The deformed ground once more: all its triangles, and rays through all of them, in float64.

Nothing is shared with the kernels but the statement of the surface: nodes of a regular grid lie below the undeformed
ground by their plastic sinkage over the vertical part of its normal; a cell with a touched node is cut from (i, j) to
(i + 1, j + 1); all other ground is undeformed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
Nodes: TypeAlias = dict[tuple[int, int], float]
Undeformed: TypeAlias = Callable[[float, float], tuple[float, float]]
"""(x, y) -> height, vertical part of the normal."""


def touched_nodes(memory: dict[str, Any], world: int) -> Nodes:
    """Plastic sinkage of the touched nodes, by column and row, from the arrays of `Soil.memory`."""
    node, count = memory["node"].numpy()[world], int(memory["count"].numpy()[world])
    place_x, place_y = (memory[name].numpy()[world] for name in ("place_x", "place_y"))
    found: Nodes = {}
    for page in range(count):
        for index in range(64):
            sinkage = float(node[64 * page + index, 0])
            if sinkage != 0.0:
                found[8 * int(place_x[page]) + index % 8, 8 * int(place_y[page]) + index // 8] = sinkage
    return found


def touched_cells(nodes: Nodes) -> set[tuple[int, int]]:
    """Column and row of the cells with a touched corner."""
    return {(i - a, j - b) for i, j in nodes for a in (0, 1) for b in (0, 1)}


def cell_triangles(cells: Iterable[tuple[int, int]], nodes: Nodes, spacing: float, undeformed: Undeformed) -> Array:
    """(T, 3, 3) triangles of cells."""

    def corner(i: int, j: int) -> tuple[float, float, float]:
        height, up = undeformed(i * spacing, j * spacing)
        return i * spacing, j * spacing, height - nodes.get((i, j), 0.0) / up

    return np.array([
        [corner(i, j), *(corner(i + a, j + b) for a, b in rest)]
        for i, j in sorted(cells) for rest in (((1, 0), (1, 1)), ((1, 1), (0, 1)))
    ])  # fmt: skip


def crossings(triangles: Array, start: Array, direction: Array) -> Array:
    """(R, T) parameters at which rays meet triangles, from either side; infinity where they do not."""
    p, e = triangles[:, 0], triangles[:, 1] - triangles[:, 0]
    f = triangles[:, 2] - p
    t = np.full((len(start), len(triangles)), np.inf)
    for ray, (s, d) in enumerate(zip(start, direction, strict=True)):
        h = np.cross(d, f)
        determinant = (e * h).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((s - p) * h).sum(axis=1) / determinant
            q = np.cross(s - p, e)
            v = (q @ d) / determinant
            at = (f * q).sum(axis=1) / determinant
        # a ray on an edge belongs to both neighbours
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (at >= 0.0)
        t[ray, inside] = at[inside]
    return t


def in_cells(points: Array, cells: set[tuple[int, int]], spacing: float) -> npt.NDArray[np.bool_]:
    """Whether points lie over cells."""
    numbers = np.floor(points[..., :2] / spacing).astype(int).reshape(-1, 2)
    found = np.array([(int(i), int(j)) in cells for i, j in numbers])
    return found.reshape(points.shape[:-1])


def first_hits(
    nodes: Nodes, spacing: float, undeformed: Undeformed, base: Array, start: Array, direction: Array
) -> tuple[Array, Array]:  # fmt: skip
    """First hits (R,), infinity without, and normals (R, 3) of rays with the ground; `base`: undeformed triangles."""
    cells = touched_cells(nodes)
    triangles = np.concatenate([base, cell_triangles(cells, nodes, spacing, undeformed)])
    t = crossings(triangles, start, direction)
    for ray, index in np.argwhere(np.isfinite(t[:, : len(base)])):
        if in_cells(start[ray] + t[ray, index] * direction[ray], cells, spacing):
            t[ray, index] = np.inf
    first = t.argmin(axis=1)
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return t.min(axis=1), n[first]
