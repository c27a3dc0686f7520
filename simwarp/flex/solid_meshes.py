"""Meshes of solids that need no file: boxes divided evenly."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simwarp.core.types import ModelError, formatted

HEXAHEDRON = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
"""Corners of a cell in the order of a hexahedron's nodes."""
FIVE = (
    ((0, 1, 3, 4), (1, 2, 3, 6), (1, 6, 4, 5), (3, 4, 6, 7), (1, 3, 4, 6)),
    ((0, 1, 2, 5), (0, 2, 3, 7), (0, 5, 7, 4), (2, 5, 6, 7), (0, 2, 7, 5)),
)
"""Corners of the five tetrahedra of a cell; neighbours have the other pattern, so that their diagonals meet."""


def box_mesh(
    size: ArrayLike, cells: tuple[int, int, int], *, tetrahedra: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices (N, 3) and elements (E, 8), or (E, 4), of a box with its middle at the origin.

    Tetrahedra are stiff in bending: a plate of them needs six or more through its thickness, of hexahedra one or two.

    Args:
        size: along x, y and z [m].
        cells: how many along x, y and z.
        tetrahedra: five in each cell in place of one hexahedron.

    Raises:
        ModelError: a length or a number of cells is not positive.
    """
    lengths = np.asarray(size, dtype=np.float64)
    if lengths.shape != (3,) or not np.all(np.isfinite(lengths) & (lengths > 0.0)):
        raise ModelError(f"box_mesh: size must be three positive lengths [m], got {formatted(size)}; pass (x, y, z)")
    if len(cells) != 3 or not all(isinstance(count, int | np.integer) and count > 0 for count in cells):
        raise ModelError(
            f"box_mesh: cells must be three positive numbers, got {formatted(cells)}; pass (1, 1, 1) or more"
        )
    counts = tuple(int(count) + 1 for count in cells)
    grid = np.indices(counts).reshape(3, -1).T
    elements = []
    for cell in itertools.product(*map(range, cells)):
        nodes = np.ravel_multi_index(tuple((HEXAHEDRON + cell).T), counts)
        elements.extend([nodes[list(each)] for each in FIVE[sum(cell) % 2]] if tetrahedra else [nodes])
    return (grid / np.array(cells) - 0.5) * lengths, np.array(elements, dtype=np.int32)
