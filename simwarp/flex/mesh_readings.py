"""What a mesh of a simulation does: places of its nodes, stresses of its elements, computed when they are asked for."""

from __future__ import annotations

from typing import Any

import warp as wp

from simwarp.core.types import ModelError, formatted
from simwarp.flex.mesh_readings_kernels import copy_nodes, measure_solid_stress, measure_triangle_stress
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
    # elements of a kind stand one after the other, mesh by mesh and part by part
    first = dict.fromkeys(("tetrahedra", "hexahedra", "triangles"), 0)
    place = 0
    for other in model.builder.flexible_meshes:
        for part in other.parts:
            here, elements = first[part.kind], len(part.elements)
            first[part.kind] += elements
            if other is not mesh:
                continue
            inputs = [tables, nodes, here, place]
            if part.kind == "triangles":
                kernel: Any = measure_triangle_stress
            else:
                kernel, inputs = measure_solid_stress, [getattr(tables, part.kind), tables, nodes, still, here, place]
            wp.launch(kernel, (worlds, elements), inputs=inputs, outputs=[found], device=model.device)
            place += elements
    return found


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
