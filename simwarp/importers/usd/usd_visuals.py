"""What of a USD stage is seen: on bodies, within instances, and beside them on the world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from simwarp.core.types import Pose, ShapeType, pose as make_pose
from simwarp.geometry.primitive_meshes import primitive_mesh
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.importers.links.link_frames import inverse
from simwarp.importers.links.link_tree import Link
from simwarp.importers.links.link_visuals import LinkVisual
from simwarp.importers.report import ImportReport
from simwarp.importers.usd.usd_bodies import AXES, BodyReader, mesh_of
from simwarp.importers.usd.usd_stage import Stage

Array = npt.NDArray[np.float64]
Colour = tuple[float, float, float]

PRIMITIVES: Final = ("Cube", "Sphere", "Capsule", "Cylinder", "Cone")


class VisualReader:
    """Reads visible prims once bodies and colliders are known.

    Args:
        stage: opened.
        world: pose of the stage's world in ours.
        bodies: read; what no body carries gets a link of its own there, which is welded to the world.
        report: what became of every element.
    """

    def __init__(self, stage: Stage, world: Pose, bodies: BodyReader, report: ImportReport) -> None:
        self._stage = stage
        self._world = world
        self._bodies = bodies
        self._report = report

    def read(self) -> list[LinkVisual]:
        """Visible parts. Colliders of a body are among them where it has others as well: those that are not are drawn
        as shapes. On the world they always are.
        """
        carried: dict[str, list[Any]] = {}
        prims = iter(self._stage.prims())
        for prim in prims:
            if prim.IsA(self._stage.geometry.PointInstancer):
                prims.PruneChildren()  # its prototypes are seen in its instances only
                self._report.approximate("visual", _path(prim), "a PointInstancer is not shown")
            elif prim.IsA(self._stage.geometry.Gprim) and self._is_seen(prim):
                carried.setdefault(self._body_of(_path(prim)), []).append(prim)
        visuals = []
        for body, found in carried.items():
            others = [prim for prim in found if _path(prim) not in self._bodies.colliders]
            parts = (found if body else others) if others else []
            link = self._link(body, parts)
            made = [self._visual(prim, link, self._bodies.frames.get(body, make_pose())) for prim in parts]
            visuals += [part for part in made if part is not None]
        return visuals

    def _is_seen(self, prim: Any) -> bool:
        imageable = self._stage.geometry.Imageable(prim)
        if str(imageable.ComputeVisibility()) == "invisible":
            self._report.hold("invisible", _path(prim))
            return False
        return str(imageable.ComputePurpose()) != "guide"

    def _body_of(self, path: str) -> str:
        """The nearest rigid body above; empty for the world."""
        while path and path not in self._bodies.frames:
            path = path.rpartition("/")[0]
        return path

    def _link(self, body: str, parts: list[Any]) -> str:
        """Name of the link that carries what is seen."""
        if body:
            return self._bodies.link_of[body].name
        names = {link.name for link in self._bodies.links}
        name = "scenery"
        while name in names:
            name += "_"
        if parts:
            self._bodies.links.append(Link(name=name, pose=self._world))
            self._bodies.grounded.append(name)
        return name

    def _visual(self, prim: Any, link: str, frame: Pose) -> LinkVisual | None:
        name = f"{_path(prim).lstrip('/')}_visual"
        points, triangles = visual_points(self._stage, prim)
        if points is None or not len(triangles):
            what = f"a {prim.GetTypeName()}" if points is None else "a mesh without faces"
            self._report.approximate("visual", name, f"{what} is not shown")
            return None
        self._report.hold("visual mesh", name)
        mesh = VisualMesh(vertices=self._in_body(prim, frame, points), triangles=triangles)
        color = _display_color(self._stage.geometry, prim)
        return LinkVisual(name=name, link=link, kind=ShapeType.MESH, mesh=lambda: mesh, color=color)

    def _in_body(self, prim: Any, frame: Pose, points: Array) -> Array:
        """Points of a prim, in its own units, in the frame of its body [m]."""
        matrix = np.array(self._stage.geometry.Xformable(prim).ComputeLocalToWorldTransform(0.0), np.float64)
        world = (points @ matrix[:3, :3] + matrix[3, :3]) * self._stage.units.length
        back = inverse(frame)
        return world @ matrix_of(back.rotation).T + back.position


def visual_points(stage: Stage, prim: Any) -> tuple[Array | None, npt.NDArray[np.int64]]:
    """Points and triangles of a geometric prim in its own frame and units; None where it is none that is shown."""
    geometry = stage.geometry
    kind = str(prim.GetTypeName())
    none = np.zeros((0, 3), np.int64)
    if kind == "Mesh":
        return mesh_of(stage, _path(prim))
    values: Mapping[str, Any] = {
        name: prim.GetAttribute(name).Get() for name in ("size", "radius", "height") if prim.GetAttribute(name)
    }
    if kind not in PRIMITIVES:
        return None, none
    points, triangles = primitive_mesh(kind.lower(), {name: float(value) for name, value in values.items()})
    axis = geometry.Cylinder(prim).GetAxisAttr().Get() if prim.GetAttribute("axis") else "Z"
    return points @ matrix_of(AXES[str(axis)]).T, triangles


def _path(prim: Any) -> str:
    return str(prim.GetPath())


def _display_color(geometry: Any, prim: Any) -> Colour | None:
    value = geometry.Gprim(prim).GetDisplayColorAttr().Get()
    if not value:
        return None
    red, green, blue = (min(max(float(part), 0.0), 1.0) for part in value[0])
    return red, green, blue
