"""Meshes that move by themselves: a linearly implicit step of all worlds, without contacts and other bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from simwarp.flex.free_meshes_kernels import step_meshes
from simwarp.kernels.core.scratch import make_memory, memory_layouts
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.meshes.flexible_laws import FlexibleStep
from simwarp.kernels.meshes.mesh_loads import MeshMemory, MeshScratch
from simwarp.meshes.mesh_model import MeshModel

LANES = 32
"""Threads of a GPU that share a world."""


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
