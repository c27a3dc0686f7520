"""Regular meshes: boxes of hexahedra or tetrahedra, rectangles of triangles."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int32]

FIVE = (
    ((0, 1, 3, 4), (1, 2, 3, 6), (1, 4, 5, 6), (3, 4, 6, 7), (1, 3, 4, 6)),
    ((1, 2, 0, 5), (2, 3, 0, 7), (0, 5, 7, 4), (2, 7, 5, 6), (0, 2, 7, 5)),
)
"""Tetrahedra of a hexahedron's nodes, for cells that alternate: diagonals of neighbours meet."""


def box_of_hexahedra(cells: tuple[int, int, int], size: tuple[float, float, float]) -> tuple[Points, Cells]:
    """Nodes (n, 3) [m] and hexahedra (e, 8) of a box with one corner at the origin.

    Nodes of a hexahedron: counter-clockwise around its lower face, then around its upper one.
    """
    sides = [np.linspace(0.0, length, count + 1) for length, count in zip(size, cells, strict=True)]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points), dtype=np.int32).reshape([count + 1 for count in cells])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    nodes = [
        number[tuple(slice(at, at + count) for at, count in zip(corner, cells, strict=True))] for corner in corners
    ]
    return points, np.stack(nodes, axis=-1).reshape(-1, 8)


def box_of_tetrahedra(cells: tuple[int, int, int], size: tuple[float, float, float]) -> tuple[Points, Cells]:
    """Nodes (n, 3) [m] and tetrahedra (e, 4) of a box with one corner at the origin, five in each cell."""
    points, hexahedra = box_of_hexahedra(cells, size)
    parities = [sum(cell) % 2 for cell in itertools.product(*(range(count) for count in cells))]
    found = [
        hexahedron[list(four)] for hexahedron, parity in zip(hexahedra, parities, strict=True) for four in FIVE[parity]
    ]
    return points, np.array(found, dtype=np.int32)


def rectangle_of_triangles(cells: tuple[int, int], size: tuple[float, float]) -> tuple[Points, Cells]:
    """Nodes (n, 3) [m] and triangles (e, 3) of a rectangle in the plane z = 0 with one corner at the origin.

    All diagonals run the same way: the triangle's bending is then right, with alternating ones it is not.
    """
    sides = [np.linspace(0.0, length, count + 1) for length, count in zip(size, cells, strict=True)]
    flat = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.column_stack([flat, np.zeros(len(flat))])
    number = np.arange(len(points), dtype=np.int32).reshape(cells[0] + 1, cells[1] + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    lower, upper = np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)
    return points, np.stack([lower, upper], axis=2).reshape(-1, 3)


def revolved_triangles(profile: Points, around: int) -> tuple[Points, Cells]:
    """Nodes (n, 3) [m] and triangles (e, 3) of a profile that turns about the y axis, such as a tire.

    Nodes are numbered along the profile, then around; triangles show their outside where the profile goes towards
    positive y with the axis on its left, and all diagonals run the same way.

    Args:
        profile: (rows, 2) distance from the axis and place along it [m].
        around: how many times it stands around the axis, 3 or more.
    """
    angle = 2.0 * np.pi * np.arange(around) / around
    radius, along = np.asarray(profile, np.float64).T
    x, y, z = np.outer(np.sin(angle), radius), np.tile(along, (around, 1)), np.outer(np.cos(angle), radius)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    number = np.arange(len(points), dtype=np.int32).reshape(around, len(along))
    following = np.roll(number, -1, axis=0)
    a, b, c, d = number[:, :-1], number[:, 1:], following[:, 1:], following[:, :-1]
    lower, upper = np.stack([a, d, c], axis=-1), np.stack([a, c, b], axis=-1)
    return points, np.stack([lower, upper], axis=2).reshape(-1, 3)
