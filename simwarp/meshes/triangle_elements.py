"""Constants of rotation-free triangles (enhanced basic shell triangle; Flores and Oñate 2005, CMAME 194:2406).

A triangle bends by the slopes at the middles of its three sides, which the opposite nodes of its neighbours tell.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]

MIDDLES = ((0.5, 0.5), (0.0, 0.5), (0.5, 0.0))
"""Natural coordinates (ξ, η) of the middles of the sides opposite to nodes 0 to 2."""


@dataclasses.dataclass(frozen=True)
class TriangleConstants:
    """Constants of triangles.

    Attributes:
        nodes: (e, 6) the triangle's nodes, and opposite to each of them its neighbour's; -1: none.
        slope: (e, 3, 4, 2) slopes of the shape functions at the middle of each side, of the three nodes and of the
            neighbour's across that side, along two axes that are orthogonal there in the rest shape [1/m].
        plain: (e, 3, 2) slopes of the flat triangle's shape functions [1/m].
        area: (e,) [m²].
        curvature: (e, 3) of the rest shape: along both axes, and twice the mixed one [1/m].
    """

    nodes: Ints
    slope: Array
    plain: Array
    area: Array
    curvature: Array


def triangles_constants(points: Array, triangles: Ints) -> TriangleConstants:
    """Constants of triangles (e, 3) between points (n, 3) [m]."""
    nodes = with_neighbours(triangles)
    count = len(nodes)
    slope, plain = np.zeros((count, 3, 4, 2)), np.zeros((count, 3, 2))
    curvature = np.zeros((count, 3))
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    linear = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    for index, six in enumerate(nodes):
        x = points[np.where(six >= 0, six, six[0])]
        axis = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
        plain[index] = _slopes_along(axis, linear, x[:3])
        for side, (xi, eta) in enumerate(MIDDLES):
            if six[3 + side] < 0:
                slope[index, side, :3] = plain[index]
                continue
            natural = np.vstack([_inner_slopes(xi, eta), _outer_slope(side, xi, eta)])
            slope[index, side] = _slopes_along(axis, natural, x[[0, 1, 2, 3 + side]])
        normal = normals[index] / lengths[index]
        bend = np.zeros((2, 2))
        for side in range(3):
            across = slope[index, side].T @ x[[0, 1, 2, 3 + side]] @ normal
            bend -= np.outer(plain[index, side], across) + np.outer(across, plain[index, side])
        curvature[index] = bend[0, 0], bend[1, 1], 2.0 * bend[0, 1]
    return TriangleConstants(nodes, slope, plain, 0.5 * lengths, curvature)


def with_neighbours(triangles: Ints) -> Ints:
    """(e, 6) nodes of triangles, and opposite to each node that of the neighbour across its side; -1: none."""
    across: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for index, triangle in enumerate(triangles.tolist()):
        for corner in range(3):
            a, b = triangle[(corner + 1) % 3], triangle[(corner + 2) % 3]
            across[min(a, b), max(a, b)].append((index, corner))
    nodes = np.hstack([triangles, np.full_like(triangles, -1)])
    for pair in across.values():
        if len(pair) == 2:
            (one, corner), (other, opposite) = pair
            nodes[one, 3 + corner] = triangles[other, opposite]
            nodes[other, 3 + opposite] = triangles[one, corner]
    return nodes


def crossed_nodes(triangles: Ints) -> tuple[int, int]:
    """Nodes inside a sheet where four triangles meet, and all nodes inside it.

    Where diagonals run the same way six meet; where they alternate, or all cells are crossed, half the nodes have four.
    """
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    sides, uses = np.unique(sides, axis=0, return_counts=True)
    nodes, meeting = np.unique(triangles, return_counts=True)
    inside = ~np.isin(nodes, sides[uses == 1])
    return int((meeting[inside] == 4).sum()), int(inside.sum())


def _inner_slopes(xi: float, eta: float) -> Array:
    """(3, 2) slopes of ζ + ξη, ξ + ηζ, η + ζξ over (ξ, η), with ζ = 1 - ξ - η."""
    zeta = 1.0 - xi - eta
    return np.array([
        [-1.0 + eta, -1.0 + xi], [1.0 - eta, zeta - eta], [zeta - xi, 1.0 - xi],
    ])  # fmt: skip


def _outer_slope(side: int, xi: float, eta: float) -> Array:
    """(2,) slope of the neighbour's shape function s (s - 1) / 2, where s is ζ, ξ or η."""
    zeta = 1.0 - xi - eta
    value, along = ((zeta, (-1.0, -1.0)), (xi, (1.0, 0.0)), (eta, (0.0, 1.0)))[side]
    return (value - 0.5) * np.array(along)


def _slopes_along(axis: Array, natural: Array, x: Array) -> Array:
    """(k, 2) slopes along two axes of the tangent plane, of which the first is `axis` laid into it."""
    tangents = natural.T @ x  # (2, 3)
    normal = np.cross(tangents[0], tangents[1])
    normal /= np.linalg.norm(normal)
    first = axis - (axis @ normal) * normal
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(normal, first)])
    return np.linalg.solve(tangents @ frame.T, natural.T).T
