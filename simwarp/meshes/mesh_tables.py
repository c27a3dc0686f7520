"""Tables of meshes as kernels read them: constants of elements, the structure of the matrix, materials, on a device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.kernels.meshes.block_factor import BLOCK, WIDTH, BlockTables
from simwarp.kernels.meshes.flexible_laws import ELASTIC, RUBBER, FlexibleMaterials
from simwarp.kernels.meshes.solid_loads import SolidTables
from simwarp.kernels.meshes.triangle_loads import TriangleTables
from simwarp.meshes.block_structure import BlockStructure
from simwarp.meshes.materials import Rubber
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.solid_elements import hexahedra_constants, tetrahedra_constants
from simwarp.meshes.triangle_elements import triangles_constants

ORDER = ("tetrahedra", "hexahedra", "triangles")
"""Kinds of elements in the order of their shares and blocks."""


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
