"""A mesh as kernels read it: constants of its elements, the structure of its matrix, its materials, on a device."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import ModelError, formatted
from simwarp.kernels.meshes.block_factor import BLOCK, WIDTH, BlockTables
from simwarp.kernels.meshes.flexible_laws import ELASTIC, RUBBER, FlexibleMaterials
from simwarp.kernels.meshes.mesh_loads import MeshTables
from simwarp.kernels.meshes.solid_loads import SolidTables
from simwarp.kernels.meshes.triangle_loads import TriangleTables
from simwarp.meshes.block_structure import BlockStructure, analyse
from simwarp.meshes.materials import Rubber
from simwarp.meshes.mesh_costs import check_cost
from simwarp.meshes.mesh_parts import MeshPart, checked_part, checked_points, lumped_masses
from simwarp.meshes.solid_elements import hexahedra_constants, tetrahedra_constants
from simwarp.meshes.triangle_elements import triangles_constants

ORDER = ("tetrahedra", "hexahedra", "triangles")
"""Kinds of elements in the order of their shares and blocks."""


@dataclasses.dataclass(frozen=True)
class MeshSizes:
    """Lengths of the scratch of a world (`MeshScratch`)."""

    columns: int
    shares: int
    element_blocks: int
    factor: int
    vector: int
    factor_double: int
    vector_double: int


@dataclasses.dataclass(frozen=True)
class MeshModel:
    """A mesh on a device.

    Attributes:
        points: (n, 3) nodes of the rest shape [m].
        parts: its elements.
        structure: of its matrix.
        sizes: of the scratch.
        tables: for kernels.
    """

    points: npt.NDArray[np.float64]
    parts: tuple[MeshPart, ...]
    structure: BlockStructure
    sizes: MeshSizes
    tables: Any


def make_mesh(
    label: str, points: Any, parts: Sequence[MeshPart], *, fixed: Sequence[int] = (), double: bool = False, device: Any
) -> MeshModel:  # fmt: skip
    """A mesh on a device.

    Args:
        label: what errors call it.
        points: (n, 3) nodes of the rest shape [m].
        parts: its elements.
        fixed: nodes that do not move.
        double: whether the factor is in double precision.
        device: where it lies.

    Raises:
        ModelError: the mesh is none.
    """
    points = checked_points(label, points)
    parts = tuple(checked_part(label, points, part) for part in parts)
    masses = lumped_masses(points, parts)
    _check_nodes(label, masses, fixed)
    unknown = np.full(len(points), -1, dtype=np.int64)
    free = np.setdiff1d(np.arange(len(points)), np.asarray(fixed, dtype=np.int64))
    check_cost(label, len(free), parts)
    unknown[free] = np.arange(len(free))
    tables: Any = MeshTables()
    elements: list[list[int]] = []
    blocks = shares = 0
    for kind in ORDER:
        place = [index for index, part in enumerate(parts) if part.kind == kind]
        table, nodes = element_tables(kind, points, parts, place, device)
        table.first_share, table.first_block = shares, blocks
        setattr(tables, kind, table)
        elements.extend(np.where(nodes >= 0, unknown[nodes], -1).tolist())
        shares += nodes.size
        blocks += len(nodes) * nodes.shape[1] * (nodes.shape[1] + 1) // 2
    structure = analyse(len(free), elements)
    tables.column_count, tables.block_count = structure.node_count, structure.block_count
    tables.is_double = int(double)
    tables.structure = structure_tables(structure, free[structure.order], device)
    tables.materials = material_tables(parts, device)
    tables.node_mass = wp.array(masses[None], dtype=float, device=device)
    numbers = factor_sizes(structure)
    sizes = MeshSizes(
        structure.node_count, shares, blocks,
        *(number if not double else 0 for number in numbers), *(number if double else 0 for number in numbers),
    )  # fmt: skip
    return MeshModel(points, parts, structure, sizes, tables)


def _check_nodes(label: str, masses: npt.NDArray[np.float64], fixed: Sequence[int]) -> None:
    """Every node is one of an element, and what is fixed is a node."""
    unused = np.flatnonzero(masses == 0.0)
    if len(unused):
        raise ModelError(
            f"{label}: every node must be one of an element, got {len(unused)} that are not, the first {unused[0]}; "
            "leave them out"
        )
    for node in fixed:
        if not 0 <= node < len(masses):
            raise ModelError(
                f"{label}: fixed nodes must be 0 to {len(masses) - 1}, got {formatted(node)}; number them as the points"
            )
    if len(set(fixed)) == len(masses):
        raise ModelError(f"{label}: some node must not be fixed, got all {len(masses)}; use a static shape")


def element_tables(
    kind: str, points: npt.NDArray[np.float64], parts: Sequence[MeshPart], place: list[int], device: Any
) -> tuple[Any, npt.NDArray[np.int32]]:
    """Tables of all elements of a kind, and their nodes; of triangles with neighbours, -1: none."""
    size = {"tetrahedra": 4, "hexahedra": 8, "triangles": 3}[kind]
    nodes = np.concatenate([np.zeros((0, size), np.int32), *(parts[index].elements for index in place)])
    part = np.repeat(place, [len(parts[index].elements) for index in place]).astype(np.int32)

    def array(values: Any, dtype: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

    if kind == "triangles":
        flat = triangles_constants(points, nodes)
        sheet: Any = TriangleTables()
        sheet.node = array(np.where(flat.nodes >= 0, flat.nodes, flat.nodes[:, :1]), int)
        sheet.slope, sheet.plain = array(flat.slope, wp.vec2d), array(flat.plain, wp.vec2d)
        sheet.area, sheet.curvature = array(flat.area, float), array(flat.curvature, wp.vec3d)
        sheet.part = array(part, int)
        sheet.thickness = array([[each.thickness or 0.0 for each in parts]], float)
        sheet.pressure = array([[each.pressure for each in parts]], float)
        return sheet, flat.nodes
    solid: Any = SolidTables()
    if kind == "tetrahedra":
        found = tetrahedra_constants(points, nodes)
    else:
        found = hexahedra_constants(points, nodes, np.array([parts[index].material.poisson for index in part.tolist()]))
    solid.node, solid.part = array(nodes, int), array(part, int)
    fill = np.concatenate([np.zeros(0), *(_fill(parts[index]) for index in place)])
    solid.gradient, solid.volume = array(found.gradient, wp.vec3d), array(fill * found.volume, float)
    solid.hourglass = array(found.hourglass, wp.vec4d)
    stiffness = found.hourglass_stiffness.transpose(0, 1, 3, 2, 4)
    if len(stiffness):
        stiffness = fill[:, None, None, None, None] * stiffness
    solid.hourglass_stiffness = array(stiffness, wp.mat33)
    weights, (rows, columns) = found.hourglass, np.tril_indices(size)
    pairs = np.einsum("eam,emnij,ebn->eabij", weights, stiffness, weights, optimize=True)
    solid.hourglass_blocks = array(pairs[:, rows, columns], wp.mat33)
    return solid, nodes


def _fill(part: MeshPart) -> npt.NDArray[np.float64]:
    """(e,) share of each element's volume that is material."""
    return np.ones(len(part.elements)) if part.fill is None else part.fill


def factor_sizes(structure: BlockStructure) -> tuple[int, int]:
    """Numbers of a factor, and of a vector."""
    return BLOCK * structure.block_count, WIDTH * structure.node_count


def structure_tables(structure: BlockStructure, names: npt.NDArray[Any], device: Any) -> Any:
    """The structure on a device; `names` are nodes of the columns."""
    tables: Any = BlockTables()
    for field in ("column_start", "block_row", "target_start", "target", "term_start", "term", "share_start", "share"):
        setattr(tables, field, wp.array(getattr(structure, field), dtype=int, device=device))
    tables.order = wp.array(names, dtype=int, device=device)
    return tables


def material_tables(parts: Sequence[MeshPart], device: Any) -> Any:
    """Materials of parts, shared by all worlds."""
    tables: Any = FlexibleMaterials()
    kinds = [int(RUBBER) if isinstance(part.material, Rubber) else int(ELASTIC) for part in parts]
    tables.kind = wp.array(kinds, dtype=int, device=device)
    tables.poisson = wp.array([part.material.poisson for part in parts], dtype=float, device=device)
    tables.young = wp.array([[part.material.young for part in parts]], dtype=float, device=device)
    tables.damping_time = wp.array([[part.material.damping_time for part in parts]], dtype=float, device=device)
    return tables
