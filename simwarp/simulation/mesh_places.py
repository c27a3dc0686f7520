"""What a simulation measures of its meshes: places of nodes, strain energy."""

from __future__ import annotations

from typing import Any

import warp as wp

from simwarp.kernels.meshes.mesh_energy import add_strain_energy, measure_nodes
from simwarp.model.model import Model
from simwarp.simulation.world_launches import WorldLaunch, WorldShares


class MeshPlaces:
    """Places and energy of the meshes of a simulation, found when they are asked for.

    Args:
        model: with its meshes.
        shares: the worlds.
        state: of the simulation, as kernels have it.
    """

    def __init__(self, model: Model, shares: WorldShares, state: Any) -> None:
        self._model, self._shares = model, shares
        count = sum(len(mesh.points) for mesh in model.builder.flexible_meshes)
        self._nodes: Any = wp.zeros((model.world_count, count), dtype=wp.vec3d, device=model.device)
        self._still: Any = wp.zeros(count, dtype=wp.vec3, device=model.device)
        self._measuring: list[WorldLaunch] = []
        if count:
            inputs = [model.mesh_tables, state]
            self._measuring = [shares.record(measure_nodes, count, inputs=inputs, outputs=[self._nodes])]

    def positions(self) -> wp.array:
        """(W, n) vec3d places of the nodes of all meshes, glued and fixed ones too, world [m]."""
        for command in self._measuring:
            command.launch()
        return self._nodes

    def record_energy(self, energy: wp.array) -> list[WorldLaunch]:
        """Launches that add the strain energy of meshes to (W,) float64 [J]."""
        if not self._measuring:
            return []
        inputs = [self._model.mesh_tables, self._nodes, self._still]
        return [*self._measuring, self._shares.record(add_strain_energy, inputs=inputs, outputs=[energy])]
