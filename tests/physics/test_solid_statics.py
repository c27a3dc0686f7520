"""Solids at rest: cantilevers over beam theory, Cook's membrane."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from simwarp.flex.materials import Elastic
from simwarp.flex.solid_meshes import box_mesh
from tests.reference.solids import Array, timoshenko
from tests.unit.flex.measured_solids import Measured

Flags = npt.NDArray[np.bool_]


def corner_shares(vertices: Array, face: Flags, axis: int) -> Array:
    """Shares of a face's nodes in an even load, (N,); one on an edge has half, at a corner a quarter."""
    shares = face.astype(np.float64)
    for other in {0, 1, 2} - {axis}:
        column = vertices[:, other]
        shares *= np.where(np.isclose(column, column.min()) | np.isclose(column, column.max()), 0.5, 1.0)
    return shares / shares.sum()


def deflected(mesh: Measured, vertices: Array, load: Array, free: Flags) -> Array:
    """Displacements (N, 3) per load, of a load so small that the problem is linear.

    Forces come of float64 strains and decide the result; the tangent, which has the digits of float32, leads there.
    """
    small = 1e-6 * np.ptp(vertices)
    _, tangent = mesh.measure(vertices)
    dofs = np.repeat(free, 3)
    inverse = np.linalg.inv(tangent[np.ix_(dofs, dofs)])
    scale = small / np.abs(inverse @ load.ravel()[dofs]).max()
    x = vertices.copy()
    for _ in range(8):
        x[free] += (inverse @ (scale * load + mesh.measure(x)[0])[free].ravel()).reshape(-1, 3)
    return (x - vertices) / scale


@pytest.mark.parametrize(
    ("cells", "tetrahedra", "poisson", "low", "high"),
    [
        ((8, 1, 1), False, 0.3, 0.95, 1.0), ((8, 1, 1), False, 0.49, 0.90, 1.0), ((16, 4, 4), False, 0.3, 0.95, 1.0),
        ((16, 4, 4), False, 0.49, 0.93, 1.0), ((8, 1, 1), True, 0.3, 0.33, 0.37), ((8, 1, 1), True, 0.49, 0.28, 0.32),
        ((16, 4, 4), True, 0.3, 0.72, 0.76), ((16, 4, 4), True, 0.49, 0.63, 0.67),
    ],
)  # fmt: skip
def test_a_cantilever_over_beam_theory(
    cells: tuple[int, int, int], tetrahedra: bool, poisson: float, low: float, high: float
) -> None:
    """Hexahedra need one cell through the height; tetrahedra lock: what the page on solids says of both."""
    vertices, elements = box_mesh((8.0, 1.0, 1.0), cells, tetrahedra=tetrahedra)
    mesh = Measured.of(vertices, elements, Elastic(young=1e6, poisson=poisson, density=1.0))
    tip = np.isclose(vertices[:, 0], 4.0)
    load = corner_shares(vertices, tip, 0)[:, None] * np.array((0.0, 0.0, 1.0))
    moved = deflected(mesh, vertices, load, ~np.isclose(vertices[:, 0], -4.0))
    ratio = np.mean(moved[tip, 2]) / timoshenko(1.0, 8.0, 1.0, 1.0, 1e6, poisson)
    assert low < ratio < high


def test_cooks_membrane() -> None:
    """Tapered panel 48 by 44 to 16, E 1, Poisson's ratio 1/3, shear load 1: tip 23.96 (plane stress)."""
    vertices, elements = box_mesh((48.0, 1.0, 1.0), (16, 16, 1))
    x, y = vertices[:, 0] + 24.0, vertices[:, 1] + 0.5
    bottom, top = x / 48.0 * 44.0, 44.0 + x / 48.0 * 16.0
    vertices = np.column_stack([x, bottom + y * (top - bottom), vertices[:, 2]])
    mesh = Measured.of(vertices, elements, Elastic(young=1.0, poisson=1.0 / 3.0, density=1.0))
    tip = np.isclose(x, 48.0)
    load = corner_shares(vertices, tip, 0)[:, None] * np.array((0.0, 1.0, 0.0))
    moved = deflected(mesh, vertices, load, x > 1e-9)
    middle = tip & np.isclose(vertices[:, 1], 52.0)
    assert abs(np.mean(moved[middle, 1]) / 23.96 - 1.0) < 0.02
