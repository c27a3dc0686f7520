"""The matrix of a model's meshes: its columns and blocks, and the tables of kernels."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import WORLD, ModelError, formatted
from simwarp.kernels.meshes.mesh_loads import GlueTables, MeshTables
from simwarp.meshes.block_structure import BlockStructure, analyse, element_blocks
from simwarp.meshes.mesh_costs import MeshCost, cost_of
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.meshes.mesh_tables import ORDER, element_tables, factor_sizes, material_tables, structure_tables

MATERIAL_PARAMETERS = ("flexible_young", "flexible_damping_time", "flexible_thickness", "flexible_pressure")
"""Parameters of a model that belong to parts of its meshes."""

Array: TypeAlias = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class MeshColumns:
    """The matrix of all meshes of a model: which nodes its columns are, and its structure.

    Attributes:
        structure: nodes first, then two columns for each body that a mesh is glued to.
        bodies: (N,) body of each node that moves by itself; the structure names nodes by their place here.
        owners: body of each pair of columns after them.
        elements: (E, n) nodes of all elements, in the order of their shares and blocks.
        pairs: rows and columns of the blocks that glue adds.
        sources: of each of these: (place of an element's block, 1 if transposed, node of the left lever, of the right).
    """

    structure: BlockStructure
    bodies: tuple[int, ...]
    owners: tuple[int, ...]
    elements: tuple[tuple[int, ...], ...]
    pairs: tuple[tuple[int, int], ...]
    sources: tuple[tuple[tuple[int, int, int, int], ...], ...]

    @property
    def node_count(self) -> int:
        """Nodes that move by themselves."""
        return len(self.bodies)

    def link_bodies(self) -> list[int]:
        """Bodies of links, in the reverse of the order of elimination."""
        order = self.structure.order[: self.node_count].tolist()
        return [self.bodies[node] for node in reversed(order)]

    def parents(self, first: int, owner_links: Mapping[int, int]) -> list[int]:
        """Parent of each of these links, of which the first has the number `first`."""
        n = self.node_count
        found = []
        for column in reversed(range(n)):
            above = int(self.structure.parent[column])
            if above >= n:
                found.append(owner_links[self.owners[(above - n) // 2]])
            else:
                found.append(-1 if above < 0 else first + n - 1 - above)
        return found


def joined_meshes(meshes: Sequence[FlexibleMesh]) -> tuple[Array, list[MeshPart], list[int], list[bool], Array]:
    """Points, parts, bodies, whether glued, and places of all meshes of a model, their nodes numbered on."""
    parts, offset = [], 0
    for mesh in meshes:
        parts += [dataclasses.replace(part, elements=part.elements + np.int32(offset)) for part in mesh.parts]
        offset += len(mesh.points)
    return (
        np.concatenate([mesh.points for mesh in meshes]), parts, [body for mesh in meshes for body in mesh.bodies],
        [glued for mesh in meshes for glued in mesh.glued], np.concatenate([mesh.places for mesh in meshes]),
    )  # fmt: skip


def mesh_columns(meshes: Sequence[FlexibleMesh]) -> MeshColumns | None:
    """The columns of a model's meshes; None: it has none."""
    if not meshes:
        return None
    points, parts, bodies, glued, _ = joined_meshes(meshes)
    own = [node for node, body in enumerate(bodies) if body != WORLD and not glued[node]]
    unknown = np.full(len(points), -1)
    unknown[own] = np.arange(len(own))
    owners = list(dict.fromkeys(body for body, is_glued in zip(bodies, glued, strict=True) if is_glued))
    first_owner = {body: len(own) + 2 * index for index, body in enumerate(owners)}
    elements: list[tuple[int, ...]] = []
    for kind in ORDER:
        place = [index for index, part in enumerate(parts) if part.kind == kind]
        elements += [tuple(nodes) for nodes in element_tables(kind, points, parts, place, "cpu")[1].tolist()]
    pairs: list[tuple[int, int]] = []
    sources: list[tuple[tuple[int, int, int, int], ...]] = []
    block = 0
    for element in elements:
        if any(node >= 0 and glued[node] for node in element):
            lin = first_owner[next(bodies[node] for node in element if node >= 0 and glued[node])]
            added = _glued_blocks(element, block, unknown, glued, lin)
            pairs += added
            sources += [tuple(each) for each in added.values()]
        block += len(element) * (len(element) + 1) // 2
    named = [[int(unknown[node]) if node >= 0 else -1 for node in element] for element in elements]
    last = range(len(own), len(own) + 2 * len(owners))
    structure = analyse(len(own) + 2 * len(owners), named, last, pairs)
    return MeshColumns(
        structure, tuple(bodies[node] for node in own), tuple(owners), tuple(elements), tuple(pairs), tuple(sources)
    )


def _glued_blocks(
    element: Sequence[int], first: int, unknown: npt.NDArray[np.int64], glued: Sequence[bool], lin: int
) -> dict[tuple[int, int], list[tuple[int, int, int, int]]]:
    """Blocks that an element with glued nodes adds, by row and column; those of the body are `lin` and `lin` + 1."""
    found: dict[tuple[int, int], list[tuple[int, int, int, int]]] = {}

    def add(row: int, column: int, *source: int) -> None:
        found.setdefault((row, column), []).append((source[0], source[1], source[2], source[3]))

    for index, (a, b) in enumerate(element_blocks(len(element))):
        row, column, place = element[a], element[b], first + index
        if row < 0 or column < 0:
            continue
        if glued[row] and unknown[column] >= 0:
            add(lin, int(unknown[column]), place, 0, -1, -1)
            add(lin + 1, int(unknown[column]), place, 0, row, -1)
        elif unknown[row] >= 0 and glued[column]:
            add(lin, int(unknown[row]), place, 1, -1, -1)
            add(lin + 1, int(unknown[row]), place, 1, column, -1)
        elif glued[row] and glued[column]:
            for transposed, left, right in ((0, row, column), (1, column, row))[: 1 + (a != b)]:
                add(lin, lin, place, transposed, -1, -1)
                add(lin + 1, lin, place, transposed, left, -1)
                add(lin + 1, lin + 1, place, transposed, left, right)
    return found


def device_meshes(meshes: Sequence[FlexibleMesh], columns: MeshColumns | None, device: Any) -> Any:
    """The tables of kernels; empty without meshes."""
    tables: Any = MeshTables()
    if columns is None:
        return tables
    points, parts, bodies, glued, places = joined_meshes(meshes)
    blocks = shares = 0
    for kind in ORDER:
        place = [index for index, part in enumerate(parts) if part.kind == kind]
        table, nodes = element_tables(kind, points, parts, place, device)
        table.first_share, table.first_block = shares, blocks
        setattr(tables, kind, table)
        shares += nodes.size
        blocks += len(nodes) * nodes.shape[1] * (nodes.shape[1] + 1) // 2
    structure = columns.structure
    tables.column_count, tables.block_count = structure.node_count, structure.block_count
    tables.is_double = int(any(mesh.double for mesh in meshes))
    tables.structure = structure_tables(structure, structure.order, device)
    tables.materials = material_tables(parts, device)

    def array(values: Any, dtype: Any = int) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

    glue: Any = GlueTables()
    glue.body, glue.is_glued = array(bodies), array(np.asarray(glued, np.int32))
    glue.place = array(places, wp.vec3d)
    glue.first_block = blocks
    glue.source_start = array(np.cumsum([0, *map(len, columns.sources)]))
    sources = np.array([each for group in columns.sources for each in group], np.int32).reshape(-1, 4)
    sources = sources if len(sources) else np.full((1, 4), -1, np.int32)
    glue.source = array(2 * sources[:, 0] + sources[:, 1])
    glue.left, glue.right = array(sources[:, 2]), array(sources[:, 3])
    held: list[list[tuple[int, int]]] = [[] for _ in columns.owners]
    share = 0
    for element in columns.elements:
        for node in element:
            if node >= 0 and glued[node]:
                held[columns.owners.index(bodies[node])].append((share, node))
            share += 1
    glue.share_start = array(np.cumsum([0, *map(len, held)]))
    pushed = np.array([each for group in held for each in group] or [(0, 0)], np.int32)
    glue.share, glue.share_node = array(pushed[:, 0]), array(pushed[:, 1])
    tables.glue = glue
    return tables


def mesh_topology(
    topology: Any, meshes: Sequence[FlexibleMesh], columns: MeshColumns | None, link_bodies: Sequence[int],
    ints: Callable[[Any], Any],
) -> None:  # fmt: skip
    """The matrix of meshes as the tree's passes read it (`Topology`).

    Args:
        topology: to fill in.
        meshes: of the model.
        columns: of them.
        link_bodies: body of each link.
        ints: makes an array of the device.
    """
    t = topology
    if columns is None:
        t.mesh_column_start, t.mesh_block_row, t.mesh_owner = ints([0]), ints([]), ints([])
        return
    links = {body: index for index, body in enumerate(link_bodies)}
    t.mesh_nodes, t.mesh_columns = columns.node_count, columns.structure.node_count
    t.mesh_link0 = len(link_bodies) - columns.node_count
    t.mesh_double = int(any(mesh.double for mesh in meshes))
    t.mesh_column_start, t.mesh_block_row = ints(columns.structure.column_start), ints(columns.structure.block_row)
    t.mesh_owner = ints([links[body] for body in columns.owners])


def use_parameters(tables: Any, arrays: Mapping[str, Any]) -> None:
    """Lets kernels read the model's parameters of materials, by the names of `MATERIAL_PARAMETERS`."""
    materials, triangles = tables.materials, tables.triangles
    materials.young, materials.damping_time = arrays["flexible_young"], arrays["flexible_damping_time"]
    triangles.thickness, triangles.pressure = arrays["flexible_thickness"], arrays["flexible_pressure"]
    tables.materials, tables.triangles = materials, triangles


def mesh_sizes(meshes: Sequence[FlexibleMesh], columns: MeshColumns | None) -> dict[str, int]:
    """Lengths of the scratch of a world that meshes need, by the names of `ScratchSizes`."""
    if columns is None:
        return {}
    shares = sum(len(element) for element in columns.elements)
    blocks = sum(len(element) * (len(element) + 1) // 2 for element in columns.elements)
    double = any(mesh.double for mesh in meshes)
    factor, vector = factor_sizes(columns.structure)
    return {
        "mesh_columns": columns.structure.node_count, "mesh_factor": 0 if double else factor,
        "mesh_vector": 0 if double else vector, "mesh_factor_double": factor if double else 0,
        "mesh_vector_double": vector if double else 0, "mesh_shares": shares,
        "mesh_element_blocks": blocks + len(columns.pairs), "mesh_points": sum(len(mesh.points) for mesh in meshes),
    }  # fmt: skip


def mesh_cost(mesh: FlexibleMesh) -> MeshCost:
    """What a mesh of a builder costs in each world: it is counted, nothing is made.

    Args:
        mesh: that `add_solid_mesh` or `add_shell` gave.

    Raises:
        ModelError: it is none.
    """
    if not isinstance(mesh, FlexibleMesh):
        raise ModelError(
            f"mesh_cost: mesh must be a FlexibleMesh, got {formatted(mesh)}; pass what add_shell or add_solid_mesh "
            "returned"
        )
    return costs_of([mesh], mesh_columns([mesh]))


def costs_of(meshes: Sequence[FlexibleMesh], columns: MeshColumns | None) -> MeshCost:
    """What all meshes of a model cost in each world; `columns` are those of their matrix."""
    parts = [part for mesh in meshes for part in mesh.parts]
    if columns is None:
        return MeshCost(nodes=0, elements={}, factor_numbers=0, multiplications=0, scratch_bytes=0)
    return cost_of(columns.structure, columns.node_count, parts, mesh_sizes(meshes, columns))
