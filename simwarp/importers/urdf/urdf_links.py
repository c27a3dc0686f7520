"""Links of a URDF file: mass, collision geometry and what is seen."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError, Pose, ShapeType, formatted, pose as make_pose
from simwarp.geometry.assets import MassProperties
from simwarp.geometry.visual_mesh import VisualMesh, linear_from_srgb
from simwarp.importers.links.link_frames import NO_MASS, moved_mass, pose_from_matrix
from simwarp.importers.links.link_masses import Densities, mesh_solid, missing_mass, primitive_solid
from simwarp.importers.links.link_meshes import HULL_CORNERS, collision_hulls, scaled_mesh, scaled_visual
from simwarp.importers.links.link_tree import Link, LinkShape, free_name
from simwarp.importers.links.link_visuals import LinkVisual
from simwarp.importers.report import ImportedWarning, ImportReport
from simwarp.importers.source_files import FileFolders

Array = npt.NDArray[np.float64]
Size = tuple[float, float, float]


class LinkReader:
    """Turns links of yourdfpy into ours, one after the other.

    Args:
        source: the file, for errors.
        folders: of its meshes.
        report: what became of every element.
        capsules: (link, visual or collision, number) of cylinders that are capsules.
        decompose: see `load_urdf`.
        densities: of links whose mass the file does not tell; None where there are none.
    """

    def __init__(
        self, source: str, folders: FileFolders, report: ImportReport, capsules: set[tuple[str, str, int]],
        decompose: bool | Mapping[str, Any], densities: Densities | None,
    ) -> None:  # fmt: skip
        self.source = source
        self.links: list[Link] = []
        self.visuals: list[LinkVisual] = []
        self._folders = folders
        self._report = report
        self._capsules = capsules
        self._decompose = decompose
        self._densities = densities
        self.weighable: set[str] = set()
        self._hulls: dict[tuple[Path, Size], tuple[list[Array], float]] = {}
        self._names: set[str] = set()
        self._reduced: dict[str, float] = {}

    def add(self, link: Any, materials: Sequence[Any]) -> None:
        """One link, and what is seen of it."""
        if any(link.name == other.name for other in self.links):
            raise ModelError(f"{self.source}: link '{link.name}': the name must be unique, got it twice; rename one")
        self._report.hold("link", link.name)
        if link.collisions or link.visuals:
            self.weighable.add(link.name)
        made = Link(name=link.name, pose=make_pose(), mass=self._completed(link, self._mass(link)))
        for number, part in enumerate(link.collisions):
            shape = self._shape(link, number, part)
            if shape is not None:
                made.shapes.append(shape)
        self.links.append(made)
        for number, part in enumerate(link.visuals):
            seen = self._visual(link, number, part, materials)
            if seen is not None:
                self.visuals.append(seen)

    def finish(self) -> None:
        """Reports the hulls that lost corners, in one line."""
        for name in self._reduced:
            told = f"its convex hull with {HULL_CORNERS} corners, up to {max(self._reduced.values()):.2g} m inside"
            self._report.approximate("collision mesh", name, told)

    def _mass(self, link: Any) -> MassProperties:
        """In the link's frame."""
        given = link.inertial
        if given is None:
            return NO_MASS
        self._report.hold("inertial", link.name)
        inertia = np.asarray(given.inertia, np.float64)
        moments = np.linalg.eigvalsh(inertia)
        thing = f"{self.source}: inertia of link '{link.name}'"
        if moments[0] < -1e-9 * max(abs(float(moments[2])), 1e-30):
            raise ModelError(
                f"{thing}: principal moments must not be negative, got {moments.tolist()}; check its entries"
            )
        if moments[2] > (moments[0] + moments[1]) * 1.01:
            self._report.approximate(
                "inertia", link.name, "no distribution of mass has moments a + b < c; taken as they are"
            )
        return moved_mass(MassProperties(float(given.mass), np.zeros(3), inertia), _origin(given.origin))

    def _completed(self, link: Any, given: MassProperties) -> MassProperties:
        """What the file does not tell of a link's mass, from its geometry: that of contact, else what is seen."""
        density = None if self._densities is None else self._densities.find(link.name)
        if density is None or (given.mass > 0.0 and np.linalg.eigvalsh(given.inertia)[0] > 0.0):
            return given
        role = "collision" if link.collisions else "visual"
        found = [
            self._solid(link, role, number, part)
            for number, part in enumerate(link.collisions if link.collisions else link.visuals)
        ]
        parts = [solid for solid, _ in found if solid.mass > 0.0]
        if not parts:
            return given
        mass = missing_mass(given, parts, density)
        told = f"{mass.mass:.4g} kg by its {role} geometry"
        if all(closed for _, closed in found):
            self._report.hold("mass by density", link.name, told)
        else:
            self._report.approximate("mass by density", link.name, "of hulls, where meshes are not closed")
        return mass

    def _solid(self, link: Any, role: str, number: int, part: Any) -> tuple[MassProperties, bool]:
        """Of a part at density 1, and whether it is the solid itself; nothing where its file cannot be used."""
        kind, size = self._primitive((link.name, role, number), part.geometry)
        place = _origin(part.origin)
        if kind is not None:
            return primitive_solid(kind, size, place) if min(size) > 0.0 else NO_MASS, True
        scale = _scale(part.geometry.mesh)
        if not min(map(abs, scale)) > 0.0:
            return NO_MASS, True
        try:
            return mesh_solid(*self._mesh(part.geometry.mesh, scale), place)
        except ModelError as error:
            if role == "visual":  # a mesh of contact is refused where it is made a shape
                self._refuse_mesh(link.name, part.geometry.mesh, error)
            return NO_MASS, True

    # ---- collision geometry ----------------------------------------------------------------------------------------

    def _shape(self, link: Any, number: int, part: Any) -> LinkShape | None:
        name = free_name(
            self._names, part.name or (link.name if len(link.collisions) == 1 else f"{link.name}_{number}")
        )
        kind, size = self._primitive((link.name, "collision", number), part.geometry)
        place = _origin(part.origin)
        mesh = part.geometry.mesh
        if not min(size if kind is not None else map(abs, _scale(mesh))) > 0.0:
            self._report.refuse("size", name)
            return None
        if kind is not None:
            self._report.hold(f"collision {kind.name.lower()}", name)
            return LinkShape(name=name, kind=kind, size=size, pose=place)
        found = self._mesh_hulls(link.name, mesh)
        if found is None:
            return None
        hulls, moved = found
        if moved > 0.0:
            self._reduced[name] = moved
        else:
            self._report.hold("collision mesh", name, "as convex hulls")
        return LinkShape(name=name, kind=ShapeType.HULL, pose=place, hulls=tuple(hulls))

    def _mesh_hulls(self, link: str, mesh: Any) -> tuple[list[Array], float] | None:
        """Hulls of a mesh; None where it is refused."""
        scale = _scale(mesh)
        try:
            path = self._folders.resolve(mesh.filename)
            if (path, scale) not in self._hulls:
                vertices, triangles = self._mesh(mesh, scale)
                self._hulls[path, scale] = collision_hulls(
                    f"mesh '{mesh.filename}'", vertices, triangles, self._decompose
                )
        except ModelError as error:
            self._refuse_mesh(link, mesh, error)
            return None
        return self._hulls[path, scale]

    def _mesh(self, mesh: Any, scale: Size) -> tuple[Array, npt.NDArray[np.int64]]:
        """Vertices [m] and triangles of a mesh's file."""
        from simwarp.geometry.mesh_files import load_mesh  # trimesh takes a while to import

        return scaled_mesh(*load_mesh(self._folders.resolve(mesh.filename)), scale)

    def _refuse_mesh(self, link: str, mesh: Any, error: ModelError) -> None:
        # the file is named once, and those of one reason together
        reason = str(error).removeprefix(f"file {formatted(mesh.filename)}: ")
        self._report.refuse("mesh", f"{link}: {mesh.filename}", reason)

    def _primitive(self, key: tuple[str, str, int], geometry: Any) -> tuple[ShapeType | None, Size]:
        """Kind and size of a geometry; None for a mesh."""
        if geometry.box is not None:
            x, y, z = (0.5 * float(value) for value in geometry.box.size)
            return ShapeType.BOX, (x, y, z)
        if geometry.sphere is not None:
            radius = float(geometry.sphere.radius)
            return ShapeType.SPHERE, (radius, radius, radius)
        if geometry.cylinder is not None:
            radius, half = float(geometry.cylinder.radius), 0.5 * float(geometry.cylinder.length)
            kind = ShapeType.CAPSULE if key in self._capsules else ShapeType.CYLINDER
            return kind, (radius, half, radius)
        return None, (1.0, 1.0, 1.0)

    # ---- what is seen -----------------------------------------------------------------------------------------------

    def _visual(self, link: Any, number: int, part: Any, materials: Sequence[Any]) -> LinkVisual | None:
        """A visible part; None where it has no extent."""
        kind, size = self._primitive((link.name, "visual", number), part.geometry)
        name = f"{link.name}_visual_{number}"
        if not min(size if kind is not None else map(abs, _scale(part.geometry.mesh))) > 0.0:
            self._report.approximate("visual size", name, "a length is 0: there is nothing to see")
            return None
        self._report.hold(f"visual {'mesh' if kind is None else kind.name.lower()}", name)
        color = _color(part.material, materials)
        place = _origin(part.origin)
        if kind is not None:
            return LinkVisual(name=name, link=link.name, kind=kind, size=size, pose=place, color=color)
        mesh, scale, folders = part.geometry.mesh, _scale(part.geometry.mesh), self._folders

        def read() -> VisualMesh | None:
            from simwarp.geometry.mesh_files import load_visual_mesh  # trimesh takes a while to import

            try:
                return scaled_visual(load_visual_mesh(folders.resolve(mesh.filename)), scale)
            except ModelError as error:
                if not self._report.is_allowed("mesh"):
                    raise
                text = f"{self.source}: dropped visual mesh '{name}': {error}"
                warnings.warn(text, ImportedWarning, stacklevel=2)
                return None

        return LinkVisual(name=name, link=link.name, kind=ShapeType.MESH, pose=place, mesh=read, color=color)


def _scale(mesh: Any) -> Size:
    x, y, z = np.broadcast_to(np.asarray(1.0 if mesh.scale is None else mesh.scale, np.float64), (3,)).tolist()
    return float(x), float(y), float(z)


def _origin(matrix: Array | None) -> Pose:
    return make_pose() if matrix is None else pose_from_matrix(matrix)


def _color(material: Any, materials: Sequence[Any]) -> Size | None:
    """Linear albedo of a material, or of the robot's one of its name."""
    if material is None:
        return None
    color = material.color
    if color is None:
        color = next((other.color for other in materials if other.name and other.name == material.name), None)
    if color is None:
        return None
    red, green, blue = (float(value) for value in linear_from_srgb(np.clip(color.rgba[:3], 0.0, 1.0)))
    return red, green, blue
