"""Colours of flexible meshes by values, such as stresses of their elements."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.core.array_devices import refuse_elsewhere
from simwarp.core.types import ModelError, formatted
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.sensors.surface_values_kernels import ValueTables, color_corners

RAMP: Final = ((0.02, 0.04, 0.3), (0.01, 0.3, 0.6), (0.08, 0.55, 0.12), (0.85, 0.6, 0.03), (0.75, 0.05, 0.02))
"""Linear albedos from the least value to the most: dark blue, blue, green, yellow, red."""


def white_look(mesh: FlexibleMesh) -> VisualMesh:
    """A look of the surface of a mesh whose corners have colours of their own, white at first."""
    surface = mesh.surface
    return VisualMesh(
        vertices=surface.vertices(mesh.points), triangles=surface.triangles.astype(np.int64),
        color=np.ones((len(surface.triangles), 3, 3), np.float32),
    )  # fmt: skip


def color_by_values(
    mesh: FlexibleMesh, first_tree: int, values: wp.array, least: float, most: float, appearance: Any, device: Any
) -> None:
    """Writes the colours of a mesh in all worlds; arguments as for `Scene.set_values`.

    Args:
        mesh: that is coloured.
        first_tree: of its surface in world 0.
        values: (W, E) float32 of its elements or (W, n) of its nodes.
        least, most: values of the first and the last colour.
        appearance: tables of the scene.
        device: of the scene.

    Raises:
        ModelError: there are other than as many values as elements or nodes, or the ends are no rising numbers.
    """
    thing = f"scene: values of '{mesh.name}'"
    if not (np.isfinite(least) and np.isfinite(most) and least < most):
        raise ModelError(f"{thing}: least < most must hold, got {formatted(least)} and {formatted(most)}; swap them")
    elements = np.concatenate([part.elements.reshape(-1) for part in mesh.parts])
    sizes = [part.elements.shape for part in mesh.parts]
    owners = np.concatenate([np.repeat(np.arange(count), width) + first for (count, width), first in zip(
        sizes, np.cumsum([0, *(count for count, _ in sizes[:-1])]), strict=True
    )])  # fmt: skip
    counts = sum(count for count, _ in sizes), len(mesh.points)
    if values.ndim != 2 or values.dtype != wp.float32 or values.shape[1] not in counts:
        raise ModelError(
            f"{thing}: must be float32 (worlds, {counts[0]}) of elements or (worlds, {counts[1]}) of nodes, got "
            f"{values.dtype.__name__} {values.shape}; pass what sw.flex.mesh_stress returns"
        )
    refuse_elsewhere(f"{thing} must", values, device)
    of_nodes = values.shape[1] == counts[1] and counts[0] != counts[1]
    order = np.argsort(elements, kind="stable")
    source = np.arange(counts[1]) if of_nodes else owners[order]
    start = np.arange(counts[1] + 1) if of_nodes else np.searchsorted(elements[order], np.arange(counts[1] + 1))
    tables: Any = ValueTables()
    tables.first_tree = first_tree
    for name, given, dtype in (
        ("triangle", mesh.surface.triangles, int), ("node", mesh.surface.nodes, int),
        ("weight", mesh.surface.weights, float), ("source_start", start, int), ("source", source, int),
        ("ramp", RAMP, wp.vec3),
    ):  # fmt: skip
        setattr(tables, name, wp.array(np.ascontiguousarray(given), dtype=dtype, device=device))
    wp.launch(
        color_corners, dim=(values.shape[0], len(mesh.surface.triangles)), device=device,
        inputs=[tables, values, float(least), float(most)], outputs=[appearance],
    )  # fmt: skip
