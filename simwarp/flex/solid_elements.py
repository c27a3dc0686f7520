"""Solid elements at rest: gradients, volumes, hourglass stiffness of tetrahedra and hexahedra, lists that gather them.

A tetrahedron of four nodes has one gradient. A hexahedron of eight nodes has the one of its middle, and stiffness
against its four hourglass shapes: the projection of the element with incompatible modes (Wilson; Taylor, Beresford and
Wilson 1976) on the shapes of Flanagan and Belytschko 1981. For boxes the sum is that element exactly.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from simwarp.core.types import ModelError, formatted
from simwarp.flex.materials import Elastic, Rubber
from simwarp.flex.mesh_factor import FactorPlan
from simwarp.flex.solid_elements_kernels import SolidTables

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

CORNERS = np.array(
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
    dtype=np.float64,
)  # fmt: skip
"""Corners of a hexahedron in its own coordinates, in the order of its nodes."""
HOURGLASS = np.stack(
    [CORNERS[:, 1] * CORNERS[:, 2], CORNERS[:, 2] * CORNERS[:, 0], CORNERS[:, 0] * CORNERS[:, 1], CORNERS.prod(axis=1)]
)
"""The shapes that the gradient in the middle does not see, (4, 8)."""
THINNEST = 1e-6
"""Least volume of an element over that of a cube of its longest edge."""


@dataclasses.dataclass(frozen=True)
class SolidElements:
    """Elements of one kind at rest.

    Attributes:
        elements: (E, n) nodes: n is 4 or 8.
        gradients: (E, n, 3) of the shape functions [1/m].
        volumes: (E,) [m³].
        hourglass: (E, 4, n) shapes that move the nodes by an hourglass amount; zero where n is 4.
        hourglass_stiffness: (E, 12, 12) forces on these amounts [N/m].
        masses: (N,) of the nodes [kg].
    """

    elements: Ints
    gradients: Array
    volumes: Array
    hourglass: Array
    hourglass_stiffness: Array
    masses: Array


def lame(material: Elastic | Rubber) -> tuple[float, float]:
    """Return Lamé's λ and μ [Pa]."""
    young, poisson = material.young, material.poisson
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def solid_elements(vertices: Array, elements: NDArray[np.integer], material: Elastic | Rubber) -> SolidElements:
    """Return the elements of a mesh.

    Args:
        vertices: (N, 3) nodes at rest [m].
        elements: (E, 4) or (E, 8) nodes of each. Seen from the fourth of a tetrahedron, and from the upper face of a
            hexahedron, the first three or four turn anticlockwise; the upper face follows in the same order.
        material: of all of them.

    Raises:
        ModelError: an element has no volume or a negative one, a number is no node, or a node has no element.
    """
    corners = _checked(vertices, elements)
    if elements.shape[1] == 4:
        gradients, volumes = _tetrahedra(corners)
        hourglass, stiffness = np.zeros((0, 4, 4)), np.zeros((0, 12, 12))
    else:
        gradients, volumes, hourglass = _hexahedra(corners)
        stiffness = np.stack([
            _hourglass_stiffness(*each, *lame(material)) for each in zip(corners, gradients, hourglass, strict=True)
        ])  # fmt: skip
    _check_volumes(corners, volumes)
    masses = np.zeros(len(vertices))
    share = material.density * volumes / elements.shape[1]
    np.add.at(masses, elements, np.broadcast_to(share[:, None], elements.shape))
    return SolidElements(elements.astype(np.int32), gradients, volumes, hourglass, stiffness, masses)


def _checked(vertices: Array, elements: NDArray[np.integer]) -> Array:
    """Corners of the elements, (E, n, 3), of a mesh that is one."""
    if elements.ndim != 2 or elements.shape[1] not in (4, 8) or len(elements) == 0:
        raise ModelError(
            f"solid: elements must be of shape (E, 4) or (E, 8), got {formatted(elements.shape)}; pass tetrahedra or "
            "hexahedra"
        )
    if elements.min() < 0 or elements.max() >= len(vertices):
        raise ModelError(
            f"solid: elements must hold numbers of vertices, 0 to {len(vertices) - 1}, got {elements.min()} to "
            f"{elements.max()}; count vertices from 0"
        )
    ordered = np.sort(elements, axis=1)
    doubled = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if len(doubled):
        raise ModelError(
            f"solid: an element must have different vertices, got {elements[doubled[0]].tolist()} at element "
            f"{doubled[0]}; divide it into tetrahedra"
        )
    unused = np.setdiff1d(np.arange(len(vertices)), elements)
    if len(unused):
        raise ModelError(f"solid: each vertex must have an element, got none at vertex {unused[0]}; remove the vertex")
    return vertices[elements]


def _check_volumes(corners: Array, volumes: Array) -> None:
    """Refuse elements that are flat or inverted."""
    edges = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=-1).max(axis=(1, 2))
    bad = np.flatnonzero(volumes <= THINNEST * edges**3)
    if len(bad):
        raise ModelError(
            f"solid: each element must have a positive volume, got {formatted(volumes[bad[0]])} m³ at element "
            f"{bad[0]}; give its nodes the other orientation, or remove it if it is flat"
        )


def _tetrahedra(corners: Array) -> tuple[Array, Array]:
    """Gradients and volumes."""
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.linalg.det(edges) / 6.0
    flat = volumes == 0.0
    inverse = np.linalg.inv(np.where(flat[:, None, None], np.eye(3), edges))
    others = np.swapaxes(inverse, 1, 2)
    return np.concatenate([-others.sum(axis=1, keepdims=True), others], axis=1), volumes


def _shape_gradients(corners: Array, point: Array) -> tuple[Array, Array, Array]:
    """Gradients (E, 8, 3), Jacobians dx/dξ (E, 3, 3) and their determinants at a point of hexahedra."""
    factors = 1.0 + CORNERS * point
    local = np.stack([
        CORNERS[:, axis] * np.delete(factors, axis, axis=1).prod(axis=1) / 8.0 for axis in range(3)
    ], axis=1)  # fmt: skip
    jacobian = np.einsum("eai,aj->eij", corners, local)
    determinant = np.linalg.det(jacobian)
    regular = np.where((determinant == 0.0)[:, None, None], np.eye(3), jacobian)
    return np.einsum("aj,eji->eai", local, np.linalg.inv(regular)), jacobian, determinant


def _hexahedra(corners: Array) -> tuple[Array, Array, Array]:
    """Gradients in the middle, volumes, hourglass shapes γ (orthogonal to all linear fields)."""
    gradients, _, determinant = _shape_gradients(corners, np.zeros(3))
    moments = np.einsum("ha,eai->ehi", HOURGLASS, corners)
    shapes = (HOURGLASS - np.einsum("ehi,eai->eha", moments, gradients)) / 8.0
    return gradients, 8.0 * determinant, shapes


def _strain_matrix(gradients: Array) -> Array:
    """(6, 3 n) strains xx yy zz, then doubled yz zx xy, by displacements of n functions with gradients (n, 3)."""
    matrix = np.zeros((6, 3 * len(gradients)))
    for axis in range(3):
        matrix[axis, axis::3] = gradients[:, axis]
        second, third = (axis + 1) % 3, (axis + 2) % 3
        matrix[3 + axis, second::3], matrix[3 + axis, third::3] = gradients[:, third], gradients[:, second]
    return matrix


def incompatible_stiffness(corners: Array, first: float, second: float) -> Array:
    """(24, 24) stiffness of a hexahedron with nine incompatible modes, which are condensed.

    Args:
        corners: (8, 3).
        first: Lamé's λ [Pa].
        second: Lamé's μ [Pa].
    """
    law = np.diag([2 * second] * 3 + [second] * 3)
    law[:3, :3] += first
    middle, centre = _shape_gradients(corners[None], np.zeros(3))[1:]
    inverse = np.linalg.inv(middle[0])
    whole = np.zeros((33, 33))
    for signs in itertools.product((-1.0, 1.0), repeat=3):
        point = np.array(signs) / np.sqrt(3.0)
        gradients, _, determinant = _shape_gradients(corners[None], point)
        inner = -2.0 * point[:, None] * inverse * (centre[0] / determinant[0])
        matrix = np.hstack([_strain_matrix(gradients[0]), _strain_matrix(inner)])
        whole += determinant[0] * matrix.T @ law @ matrix
    condensed: Array = whole[:24, :24] - whole[:24, 24:] @ np.linalg.solve(whole[24:, 24:], whole[24:, :24])
    return condensed


def _hourglass_stiffness(corners: Array, gradients: Array, shapes: Array, first: float, second: float) -> Array:
    """(12, 12) of one hexahedron: its incompatible stiffness on the motions that its middle does not strain."""
    motions = HOURGLASS.T - corners @ (gradients.T @ HOURGLASS.T)
    basis = np.kron(motions @ np.linalg.inv(shapes @ motions), np.eye(3))
    stiffness: Array = basis.T @ incompatible_stiffness(corners, first, second) @ basis
    return 0.5 * (stiffness + stiffness.T)


@dataclasses.dataclass(frozen=True)
class GatherLists:
    """Where nodes and blocks of a factor find what elements have computed, in the order of elements.

    Attributes:
        node_start: (N + 1,) corners of each node, which is a place in the order of elimination.
        node_corner: (E n,) element times n plus corner.
        block_start: (B + 1,) pairs of corners of each block.
        block_pair: (E n (n + 1) / 2,) twice the pair's number, plus 1 if it is the block's transposed.
    """

    node_start: Ints
    node_corner: Ints
    block_start: Ints
    block_pair: Ints


def gather_lists(elements: Ints, plan: FactorPlan) -> GatherLists:
    """Return the lists of a mesh. Pairs of corners (a, b), b ≤ a, count a (a + 1) / 2 + b."""
    places = plan.place[elements].astype(np.int64)
    count, corners = places.shape
    first, second = np.tril_indices(corners)
    high, low = places[:, first], places[:, second]
    keys = np.maximum(high, low) * plan.node_count + np.minimum(high, low)
    block_keys = plan.blocks[:, 0].astype(np.int64) * plan.node_count + plan.blocks[:, 1]
    ranks = np.argsort(block_keys)
    block = ranks[np.searchsorted(block_keys[ranks], keys.ravel())]
    pair = 2 * np.arange(count * len(first)) + (high < low).ravel()
    by_block, by_node = np.argsort(block, kind="stable"), np.argsort(places.ravel(), kind="stable")
    return GatherLists(
        node_start=_starts(places.ravel(), plan.node_count), node_corner=by_node.astype(np.int32),
        block_start=_starts(block, len(plan.blocks)), block_pair=pair[by_block].astype(np.int32),
    )  # fmt: skip


def _starts(owners: NDArray[np.integer], count: int) -> Ints:
    """CSR starts of lists sorted by owner."""
    return np.concatenate([[0], np.cumsum(np.bincount(owners, minlength=count))]).astype(np.int32)


def make_solid_tables(
    solid: SolidElements, lists: GatherLists, plan: FactorPlan, held: Any, material: Elastic | Rubber, device: Any
) -> Any:
    """Copy the elements of a mesh to a device.

    Args:
        solid: the elements.
        lists: their gather lists.
        plan: of the factor.
        held: (N,) 1 for each node that does not move.
        material: of the elements.
        device: of Warp.
    """
    tables: Any = SolidTables()
    corners = solid.elements.shape[1]
    tables.corners = corners
    tables.law = int(isinstance(material, Rubber))
    tables.first, tables.second = lame(material)
    tables.damping_time = material.damping_time
    first, second = np.tril_indices(8)
    stiffness = solid.hourglass_stiffness.reshape(-1, 4, 3, 4, 3).transpose(0, 1, 3, 2, 4)
    pairs = np.einsum("eha,ekb,ehkij->eabij", solid.hourglass, solid.hourglass, stiffness)
    arrays = {
        "elements": (solid.elements, int), "gradients": (solid.gradients, wp.vec3d), "volumes": (solid.volumes, float),
        "hourglass": (solid.hourglass, wp.float64), "hourglass_stiffness": (stiffness, wp.mat33),
        "hourglass_blocks": (pairs[:, first, second] if corners == 8 else np.zeros((0, 36, 3, 3)), wp.mat33),
        "masses": (solid.masses[plan.order], float), "held": (np.asarray(held)[plan.order], int),
        "node_of": (plan.order, int), "block_nodes": (plan.blocks, int),
        **{name: (table, int) for name, table in vars(lists).items()},
    }  # fmt: skip
    for name, (values, dtype) in arrays.items():
        setattr(tables, name, wp.array(np.ascontiguousarray(values), dtype=dtype, device=device))
    return tables
