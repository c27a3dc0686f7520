"""What a MJCF file only shows: its visual meshes are read when somebody asks for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ShapeType
from simwarp.geometry.visual_mesh import VisualMesh, linear_from_srgb
from simwarp.importers.links.link_visuals import add_part
from simwarp.importers.mjcf.mjcf_shapes import colliding_geoms, primitive_kinds
from simwarp.importers.mjcf.mjcf_source import Source

if TYPE_CHECKING:
    from simwarp.sensors.scene import Visuals

UNCOLOURED: Final = (0.5, 0.5, 0.5, 1.0)
"""Colour of a geom that has none of its own: that of its material counts then."""


def visuals_of_geoms(source: Source, compiled: Callable[[], tuple[Any, Any]]) -> Callable[[Visuals], None]:
    """What `Imported.add_visuals` calls: `compiled` gives the model with its visual meshes, and its data at `qpos0`."""

    def show(visuals: Visuals) -> None:
        model, data = compiled()
        touching = colliding_geoms(model)
        slots = dict(zip(np.nonzero(touching)[0].tolist(), sorted(source.shapes), strict=True))
        for geom in range(model.ngeom):
            colour = _colour(model, geom)
            if touching[geom]:
                for shape in source.shapes[slots[geom]] if _has_colour(model, geom) else ():
                    visuals.show(shape, color=colour[:3])
            elif colour[3] > 0.0:
                _show_geom(source, visuals, model, data, geom)

    return show


def _show_geom(source: Source, visuals: Visuals, model: Any, data: Any, geom: int) -> None:
    import mujoco

    kinds = {**primitive_kinds(), mujoco.mjtGeom.mjGEOM_MESH: ShapeType.MESH}
    kind = kinds.get(mujoco.mjtGeom(model.geom_type[geom]), ShapeType.PLANE)
    if kind is ShapeType.PLANE:
        return
    frame = source.frame(int(model.geom_bodyid[geom]), source.pose_of_axes(data.geom_xpos[geom], data.geom_xmat[geom]))
    mesh = _mesh(model, int(model.geom_dataid[geom])) if kind is ShapeType.MESH else None
    a, b, c = (float(value) for value in model.geom_size[geom])
    name = f"{source.prefix}{model.geom(geom).name or f'geom{geom}'}"
    add_part(visuals, name, frame, kind, (a, b, c), mesh, _colour(model, geom)[:3])


def _mesh(model: Any, mesh: int) -> VisualMesh:
    """Triangles of a mesh in the frame of its geoms."""
    corner, first = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    vertices = model.mesh_vert[corner : corner + int(model.mesh_vertnum[mesh])]
    triangles = model.mesh_face[first : first + int(model.mesh_facenum[mesh])]
    return VisualMesh(vertices=np.asarray(vertices, np.float64), triangles=np.asarray(triangles, np.int64))


def _has_colour(model: Any, geom: int) -> bool:
    """False where the file gives none: a shape then keeps the look that others may paint over."""
    return int(model.geom_matid[geom]) >= 0 or not np.allclose(model.geom_rgba[geom], UNCOLOURED)


def _colour(model: Any, geom: int) -> tuple[float, float, float, float]:
    """Linear albedo and opacity of a geom."""
    material = int(model.geom_matid[geom])
    rgba: npt.NDArray[np.float64] = np.asarray(model.geom_rgba[geom], np.float64)
    if material >= 0 and np.allclose(rgba, UNCOLOURED):
        rgba = np.asarray(model.mat_rgba[material], np.float64)
    red, green, blue = (float(value) for value in linear_from_srgb(rgba[:3]))
    return red, green, blue, float(rgba[3])
