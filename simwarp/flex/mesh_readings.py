"""What a mesh of a simulation does, computed when it is asked for: places of its nodes, stresses of its elements, how
many of them are inside out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import warp as wp

from simwarp.core.types import ModelError, formatted
from simwarp.flex.mesh_readings_kernels import (
    copy_nodes,
    count_inverted,
    measure_solid_stress,
    measure_triangle_stress,
)
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.simulation.simulation import Simulation


def mesh_positions(simulation: Simulation, mesh: FlexibleMesh) -> wp.array:
    """(W, n) vec3d places of the nodes of a mesh, glued and fixed ones too, world [m].

    Raises:
        ModelError: the mesh is none of the simulation's model.
    """
    first = _first_node("mesh_positions", simulation, mesh)
    model = simulation.model
    found: Any = wp.empty((model.world_count, len(mesh.points)), dtype=wp.vec3d, device=model.device)
    everything = simulation.mesh_places.positions()
    wp.launch(copy_nodes, found.shape, inputs=[everything, first], outputs=[found], device=model.device)
    return found


def mesh_stress(simulation: Simulation, mesh: FlexibleMesh) -> wp.array:
    """(W, E) von Mises's stress of each element of a mesh, of sheets the larger one of both sides [Pa], at the present
    places of nodes: damping is left out. Elements come part by part.

    Raises:
        ModelError: the mesh is none of the simulation's model.
    """
    _first_node("mesh_stress", simulation, mesh)
    model, tables = simulation.model, simulation.model.mesh_tables
    worlds, count = model.world_count, sum(len(part.elements) for part in mesh.parts)
    found = wp.empty((worlds, count), dtype=float, device=model.device)
    nodes = simulation.mesh_places.positions()
    still = wp.zeros(nodes.shape[1], dtype=wp.vec3, device=model.device)
    place = 0
    for part, first in _parts_of(simulation, mesh):
        inputs = [tables, nodes, first, place]
        if part.kind == "triangles":
            kernel: Any = measure_triangle_stress
        else:
            kernel, inputs = measure_solid_stress, [getattr(tables, part.kind), tables, nodes, still, first, place]
        wp.launch(kernel, (worlds, len(part.elements)), inputs=inputs, outputs=[found], device=model.device)
        place += len(part.elements)
    return found


def mesh_inverted(simulation: Simulation, mesh: FlexibleMesh) -> wp.array:
    """(W,) int32 number of a solid's elements that are inside out at present: pressed through themselves, by strains
    far beyond what the step resolves. 0 of sheets, which have no inside.

    Raises:
        ModelError: the mesh is none of the simulation's model.
    """
    _first_node("mesh_inverted", simulation, mesh)
    model = simulation.model
    found = wp.zeros(model.world_count, dtype=int, device=model.device)
    nodes = simulation.mesh_places.positions()
    still = wp.zeros(nodes.shape[1], dtype=wp.vec3, device=model.device)
    for part, first in _parts_of(simulation, mesh):
        if part.kind != "triangles":
            inputs = [getattr(model.mesh_tables, part.kind), nodes, still, first]
            shape = (model.world_count, len(part.elements))
            wp.launch(count_inverted, shape, inputs=inputs, outputs=[found], device=model.device)
    return found


def _parts_of(simulation: Simulation, mesh: FlexibleMesh) -> Iterator[tuple[MeshPart, int]]:
    """Parts of a mesh, and the number of each one's first element among those of its kind."""
    first = dict.fromkeys(("tetrahedra", "hexahedra", "triangles"), 0)
    # elements of a kind stand one after the other, mesh by mesh and part by part
    for other in simulation.model.builder.flexible_meshes:
        for part in other.parts:
            if other is mesh:
                yield part, first[part.kind]
            first[part.kind] += len(part.elements)


def _first_node(what: str, simulation: Simulation, mesh: FlexibleMesh) -> int:
    """The number of a mesh's first node among those of all."""
    first = 0
    for other in simulation.model.builder.flexible_meshes:
        if other is mesh:
            return first
        first += len(other.points)
    raise ModelError(
        f"{what}: mesh must be one of the simulation's model, got {formatted(mesh)}; pass what add_solid_mesh or "
        "add_shell gave"
    )
