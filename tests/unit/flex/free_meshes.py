"""Meshes that move by themselves: a linearly implicit step of all worlds, without contacts and other bodies."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.kernels.core.scratch import make_memory, memory_layouts
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.meshes.flexible_laws import FlexibleStep
from simwarp.kernels.meshes.mesh_loads import MeshTables
from simwarp.meshes.block_structure import BlockStructure, analyse
from simwarp.meshes.mesh_costs import check_cost
from simwarp.meshes.mesh_parts import MeshPart, checked_part, checked_points, lumped_masses
from simwarp.meshes.mesh_tables import ORDER, element_tables, factor_sizes, material_tables, structure_tables
from tests.unit.flex.free_mesh_steps import MeshMemory, MeshScratch, step_meshes

LANES = 32
"""Threads of a GPU that share a world."""


@dataclasses.dataclass(frozen=True)
class MeshSizes:
    """Lengths of the arrays of a world that a step of a mesh needs."""

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


class FreeMeshes:
    """A mesh in some worlds.

    Args:
        mesh: the mesh.
        worlds: how many.
        step: h [s].
        numerical_damping: ζ, 0 to 1: a vibration of ω decays with ζ h ω² / 2 [1/s].
        gravity: [m/s²].
        device: that of the mesh.

    Attributes:
        node_x: (W, n) vec3d positions, world [m].
        node_v: (W, n) vec3 velocities, half a step earlier [m/s].
        node_force: (W, n) vec3 forces on nodes, which stay until they are changed [N].
        inverted: (W,) solid elements that were inside out in the last step.
        raised: (W,) pivots that the last factor raised.
    """

    def __init__(
        self, mesh: MeshModel, worlds: int, step: float, *, numerical_damping: float = 0.1,
        gravity: Sequence[float] = (0.0, 0.0, -9.81), device: Any,
    ) -> None:  # fmt: skip
        self._mesh, self._device, self._worlds = mesh, wp.get_device(device), worlds
        self._step = FlexibleStep()
        self._step.h, self._step.numerical_damping, self._step.gravity = step, numerical_damping, wp.vec3(*gravity)
        shape = (worlds, len(mesh.points))
        self.node_x: Any = wp.array(np.tile(mesh.points, (worlds, 1, 1)), dtype=wp.vec3d, device=device)
        self.node_v: Any = wp.zeros(shape, dtype=wp.vec3, device=device)
        self.node_force: Any = wp.zeros(shape, dtype=wp.vec3, device=device)
        self.inverted: Any = wp.zeros(worlds, dtype=int, device=device)
        self.raised: Any = wp.zeros(worlds, dtype=int, device=device)
        self._range = WorldRange()
        self._range.count = worlds
        self._range.own_slots = int(self._device.is_cuda)
        slots = worlds if self._device.is_cuda else 1
        layouts = memory_layouts([MeshScratch], slots, mesh.sizes)
        self._memory: Any = make_memory(MeshMemory, layouts, device, of_lanes=set(layouts))

    def step(self, count: int = 1) -> None:
        """Makes some steps of all worlds."""
        lanes = LANES if self._device.is_cuda else 1
        for _ in range(count):
            wp.launch(
                step_meshes, self._worlds * lanes,
                inputs=[
                    self._range, lanes, self._mesh.tables, self._step, self.node_force, self._memory, self.node_x,
                    self.node_v, self.inverted, self.raised,
                ],
                device=self._device, block_dim=LANES,
            )  # fmt: skip
