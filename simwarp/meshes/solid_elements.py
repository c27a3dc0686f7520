"""Constants of solid elements: gradients of their shape functions, volumes, what holds a hexahedron's hourglass modes.

Both kinds have one strain: tetrahedra with four nodes, and hexahedra with eight, of which it is the mean (Flanagan and
Belytschko 1981, IJNME 17:679). A hexahedron's further twelve shapes, which have no mean strain, get the stiffness of
the element with incompatible modes (Taylor, Beresford and Wilson 1976, IJNME 10:1211). For box-shaped cells both
together are that element.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

CORNERS: Array = np.array(
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], dtype=float
)
"""Natural coordinates of a hexahedron's nodes."""
MODES: Array = np.stack([
    CORNERS[:, 0] * CORNERS[:, 1], CORNERS[:, 1] * CORNERS[:, 2], CORNERS[:, 2] * CORNERS[:, 0],
    CORNERS[:, 0] * CORNERS[:, 1] * CORNERS[:, 2],
])  # fmt: skip
"""(4, 8) shapes of a hexahedron that have no gradient at its centre."""
POINTS: Array = CORNERS / np.sqrt(3.0)
"""Natural coordinates of the points of Gauss's rule for a hexahedron; their weights are one."""


@dataclasses.dataclass(frozen=True)
class SolidConstants:
    """Constants of elements of one kind.

    Attributes:
        gradient: (e, k, 3) of the shape functions in the rest shape, of hexahedra the mean [1/m].
        volume: (e,) [m³], positive.
        hourglass: (e, k, 4) a hexahedron's hourglass vectors; no elements of tetrahedra.
        hourglass_stiffness: (e, 4, 3, 4, 3) between amplitudes of these, for a Young's modulus of one [m].
    """

    gradient: Array
    volume: Array
    hourglass: Array
    hourglass_stiffness: Array


def tetrahedra_constants(points: Array, elements: npt.NDArray[np.int32]) -> SolidConstants:
    """Constants of tetrahedra (e, 4) between points (n, 3) [m]."""
    x = points[elements]
    edges = x[:, 1:] - x[:, :1]
    rest = np.linalg.inv(edges)  # columns: gradients of nodes 1 to 3
    gradient = np.concatenate([-rest.sum(axis=2)[:, None], rest.swapaxes(1, 2)], axis=1)
    none = np.zeros((0, 4, 4))
    return SolidConstants(gradient, np.linalg.det(edges) / 6.0, none, np.zeros((0, 4, 3, 4, 3)))


def hexahedra_constants(points: Array, elements: npt.NDArray[np.int32], poisson: Array) -> SolidConstants:
    """Constants of hexahedra (e, 8) between points (n, 3) [m].

    Args:
        points: nodes.
        elements: nodes of each.
        poisson: (e,) Poisson's ratio of each.
    """
    x = points[elements]
    gradient, volume = np.zeros(x.shape), hexahedra_volumes(x)
    for point in POINTS:
        natural = natural_slopes(point)
        jacobian = natural @ x  # (e, natural, space)
        weight = np.linalg.det(jacobian) / volume
        gradient += (weight[:, None, None] * np.linalg.solve(jacobian, natural[None])).swapaxes(1, 2)
    slopes = MODES @ x  # (e, 4, 3)
    # Fields with constant gradients have none of these shapes
    hourglass = (MODES.T - gradient @ slopes.swapaxes(1, 2)) / 8.0
    stiffness = np.zeros((len(x), 4, 3, 4, 3))
    known: dict[tuple[bytes, float], Array] = {}
    for index, nodes in enumerate(x):
        # Cells of a lattice are all alike
        key = (np.round(nodes - nodes[0], 12).tobytes(), float(poisson[index]))
        if key not in known:
            known[key] = _hourglass_stiffness(nodes, gradient[index], hourglass[index], float(poisson[index]))
        stiffness[index] = known[key]
    return SolidConstants(gradient, volume, hourglass, stiffness)


def hexahedra_volumes(x: Array) -> Array:
    """(e,) volumes of hexahedra with nodes (e, 8, 3)."""
    return np.asarray(sum(np.linalg.det(natural_slopes(point) @ x) for point in POINTS))


def natural_slopes(point: Array) -> Array:
    """(3, 8) slopes of a hexahedron's shape functions over its natural coordinates, at a point."""
    factors = 1.0 + CORNERS * point
    return np.stack([CORNERS[:, i] * np.delete(factors, i, axis=1).prod(axis=1) / 8.0 for i in range(3)])


def _hourglass_stiffness(nodes: Array, gradient: Array, hourglass: Array, poisson: float) -> Array:
    """(4, 3, 4, 3) stiffness of the incompatible element against displacements without a mean gradient."""
    still = np.vstack([gradient.T, np.ones(8)])
    shapes = np.linalg.svd(still)[2][4:].T  # (8, 4) spans what has neither gradient nor mean
    shapes = shapes @ np.linalg.inv(hourglass.T @ shapes)
    full = incompatible_stiffness(nodes, poisson).reshape(8, 3, 8, 3)
    return np.einsum("am,aibj,bn->minj", shapes, full, shapes)


def incompatible_stiffness(nodes: Array, poisson: float) -> Array:
    """(24, 24) stiffness of a hexahedron with nine incompatible modes, condensed, for a Young's modulus of one [m]."""
    shear = 0.5 / (1.0 + poisson)
    lame = poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    law = np.diag([2.0 * shear] * 3 + [shear] * 3)
    law[:3, :3] += lame
    centre = CORNERS.T @ nodes / 8.0
    total = np.zeros((33, 33))
    for xi in POINTS:
        natural = natural_slopes(xi)
        jacobian = natural @ nodes
        weight = np.linalg.det(jacobian)
        inner = np.linalg.solve(centre, np.diag(-2.0 * xi)) * np.linalg.det(centre) / weight
        strain = _strain_rows(np.hstack([np.linalg.solve(jacobian, natural), inner]))
        total += weight * strain.T @ law @ strain
    coupling = np.linalg.solve(total[24:, 24:], total[24:, :24])
    return total[:24, :24] - total[:24, 24:] @ coupling


def _strain_rows(gradient: Array) -> Array:
    """(6, 3 k) strains (xx, yy, zz, xy, yz, zx; shear ones twice) of displacements with gradients (3, k)."""
    rows = np.zeros((6, 3 * gradient.shape[1]))
    for i in range(3):
        rows[i, i::3] = gradient[i]
        rows[3 + i, i::3] = gradient[(i + 1) % 3]
        rows[3 + i, (i + 1) % 3 :: 3] = gradient[i]
    return rows
