"""Flexible meshes on soil: their outer triangles as the kernels take them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
import warp as wp

from simwarp.core.arrays import with_zeros
from simwarp.core.types import WORLD, ModelError
from simwarp.core.wording import close_names
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.meshes.mesh_surfaces import surface_of
from simwarp.model.checks import checked_instances
from simwarp.model.model import Model
from simwarp.model.rules import held_fields, instance_of
from simwarp.soil.sheet_pressing_kernels import SoilSheets
from simwarp.soil.soil_columns_kernels import SIDE


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilMesh:
    """The surface of a flexible mesh on soil, such as a tire's. Triangles press that have no fixed or glued node.

    Attributes:
        mesh: that `add_shell` or `add_solid_mesh` returned.
    """

    mesh: Annotated[FlexibleMesh, instance_of(FlexibleMesh, "pass what add_shell or add_solid_mesh returned")]

    def __post_init__(self) -> None:
        held_fields(type(self).__name__, type(self), vars(self))


def loose_triangles(mesh: FlexibleMesh) -> Any:
    """(t, 3) nodes of the outer triangles whose nodes all move by themselves.

    Raises:
        ModelError: there is none.
    """
    surface = surface_of(mesh.parts)
    triangles = surface.nodes[:, 0][surface.triangles]
    loose = np.zeros(len(mesh.points), bool)
    loose[list(mesh.nodes)] = True
    found = triangles[loose[triangles].all(axis=1)]
    if not len(found):
        raise ModelError(
            f"soil: mesh '{mesh.name}' must have a triangle whose nodes are free, got none; fix or glue fewer nodes"
        )
    return found


def _part_lift(part: MeshPart) -> float:
    return 0.0 if part.thickness is None else 0.5 * part.thickness


def checked_meshes(meshes: Any, pushed_aside: bool, bladed: bool) -> tuple[SoilMesh, ...]:
    """Meshes as they were given.

    Raises:
        ModelError: it is no list of them, one is there twice, or soil is pushed aside or cut besides.
    """
    remedy = "wrap what add_shell returned in one"
    listed: tuple[SoilMesh, ...] = checked_instances("soil", "meshes", meshes, (SoilMesh,), "of SoilMesh", remedy)
    names = [each.mesh.name for each in listed]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ModelError(f"soil: meshes must be different, got '{twice}' twice; name it once")
    if listed and bladed:
        raise ModelError("soil: meshes must be none beside blades, got some; give them a soil of their own")
    if listed and pushed_aside:
        raise ModelError("soil: bulldozing must be None below meshes, got one; leave it away")
    return listed


def pages_below(sheets: Sequence[SoilMesh], spacing: float) -> int:
    """Pages that all may lie on together, in any pose near their rest shape."""
    side, total = int(SIDE) * spacing, 0
    for sheet in sheets:
        points = sheet.mesh.points
        across = 2.0 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
        total += (int(across / side) + 2) ** 2
    return total


def sheet_tables(model: Model, sheets: Sequence[SoilMesh]) -> Any:
    """Meshes as the kernels take them.

    Raises:
        ModelError: a mesh is none of the model's, or all its triangles are held.
    """
    device, worlds = model.device, model.world_count
    bodies: list[int] = []
    triangles: list[Any] = []
    nodes, ends, centres = [0], [0], []
    known = {mesh.name: mesh for mesh in model.builder.flexible_meshes}
    for sheet in sheets:
        mesh = sheet.mesh
        if known.get(mesh.name) is not mesh:
            near = close_names(mesh.name, list(known), 3) or list(known)
            raise ModelError(
                f"soil: mesh '{mesh.name}' must be one of the model's, got another; it has {', '.join(near) or 'none'}"
            )
        own = loose_triangles(mesh)
        used, places = np.unique(own, return_inverse=True)
        triangles.append(places.reshape(-1, 3) + len(bodies))
        bodies += [mesh.bodies[node] for node in used]
        nodes.append(len(bodies))
        ends.append(ends[-1] + len(own))
        centres.append(mesh.bodies[int(used[0])] if mesh.owner == WORLD else mesh.owner)
    table: Any = SoilSheets()
    for name, values in (("node_start", nodes), ("body", bodies), ("triangle_start", ends), ("centre", centres)):
        setattr(table, name, wp.array(np.array(values, np.int32), dtype=int, device=device))
    joined = np.concatenate(triangles) if triangles else np.zeros((0, 3))
    table.triangle = wp.array(joined.astype(np.int32), dtype=wp.vec3i, device=device)
    lifts = [max(map(_part_lift, sheet.mesh.parts)) for sheet in sheets]
    table.lift = wp.array(np.array(lifts, np.float32), dtype=float, device=device)
    with_zeros(table, (worlds, len(bodies)), device, "place", "depth", "force", "mass", "before_v")
    with_zeros(table, (worlds, len(joined)), device, "low", "row")
    return with_zeros(table, (worlds, len(sheets)), device, "low_count")
