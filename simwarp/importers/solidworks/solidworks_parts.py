"""Parts of an exported script: pose, mass, collision shapes, what is seen, and markers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import frame_from_axis
from simwarp.core.types import Material, ModelError, Pose, ShapeType, pose as make_pose
from simwarp.geometry.assets import MassProperties
from simwarp.geometry.visual_mesh import VisualMesh, linear_from_srgb
from simwarp.importers.links.link_frames import NO_MASS, composed, moved_mass, relative
from simwarp.importers.links.link_meshes import HULL_CORNERS, collision_hulls, reduced_hull
from simwarp.importers.links.link_tree import Link, LinkShape
from simwarp.importers.links.link_visuals import LinkVisual
from simwarp.importers.report import ImportReport
from simwarp.importers.solidworks.exported_script import Call, Matrix, Record
from simwarp.importers.source_files import FileFolders

Array = npt.NDArray[np.float64]
Size = tuple[float, float, float]

MODEL: Final = "GetCollisionModel."

QUIET: Final = (
    "SetName", "SetPos", "SetRot", "SetMass", "SetInertiaXX", "SetInertiaXY", "SetFrame_COG_to_REF", "SetFrameCOMToRef",
    "SetBodyFixed", "SetFixed", "SetCollide", "EnableCollision", "AddVisualShape", "AddCollisionShape",
    "AddCollisionModel", "AddMarker", MODEL + "ClearModel", MODEL + "BuildModel",
)  # fmt: skip
"""Calls that the reader understands, besides those that add collision shapes."""

NEAR: Final = {
    MODEL + "SetEnvelope": "distance of contact detection; that of the solver is used",
    MODEL + "SetSafeMargin": "distance of contact detection; that of the solver is used",
    MODEL + "SetFamily": "groups of shapes; every pair of parts that no joint ties may meet",
    MODEL + "SetFamilyMaskNoCollisionWithFamily": "groups of shapes; every pair of parts that no joint ties may meet",
    MODEL + "DisallowCollisionsWith": "groups of shapes; every pair of parts that no joint ties may meet",
}

MATERIAL: Final = {
    "SetFriction": "friction", "SetSfriction": "friction", "SetKfriction": "friction", "SetStaticFriction": "friction",
    "SetSlidingFriction": "friction", "SetRestitution": "restitution", "SetCohesion": "cohesion",
    "SetRollingFriction": "rolling_friction", "SetSpinningFriction": "spinning_friction",
    "SetCompliance": "compliance",
}  # fmt: skip


def text_argument(record: Record, default: str, *methods: str) -> str:
    """The text that a call was given last."""
    call = record.last(*methods)
    value = call.values[0] if call is not None and call.values else default
    return value if isinstance(value, str) and value else default


def is_true(record: Record, *methods: str) -> bool:
    """True if the last of these calls was given True."""
    call = record.last(*methods)
    return call is not None and call.values[:1] == [True]


class PartReader:
    """Turns records of bodies into links.

    Args:
        source: the file, for errors.
        folders: of its meshes.
        report: what became of every element.
        halves: boxes and cylinders are told by half lengths, cylinders about y.
    """

    def __init__(self, source: str, folders: FileFolders, report: ImportReport, halves: bool) -> None:
        self.source = source
        self.links: list[Link] = []
        self.visuals: list[LinkVisual] = []
        self.markers: list[tuple[str, str, Pose]] = []
        self._folders = folders
        self._report = report
        self._halves = halves
        self._reduced = 0.0

    def add(self, body: Record, place: Pose) -> Link:
        """A part, in a world at `place`."""
        name = text_argument(body, f"part of line {body.line}", "SetName")
        thing = f"part '{name}' (line {body.line})"
        if any(name == link.name for link in self.links):
            raise ModelError(f"{self.source}: {thing}: the name must be unique, got it twice; rename one")
        frame = make_pose(
            self._given(thing, body, np.zeros(3), "SetPos"), self._given(thing, body, make_pose().rotation, "SetRot")
        )
        link = Link(name=name, pose=composed(place, frame), mass=self._mass(thing, body))
        self._report.hold("part", name)
        if not any(call.method in ("SetCollide", "EnableCollision") and call.values == [False] for call in body.calls):
            link.shapes = self._shapes(thing, name, body)
        self._add_visuals(name, body)
        for call in body.calls:
            if call.method == "AddMarker":
                self._add_marker(name, call, frame)
            elif call.method in NEAR:
                self._report.approximate(call.method.removeprefix(MODEL), name, NEAR[call.method])
            elif call.method not in QUIET and not call.method.startswith(MODEL + "Add"):
                self._report.refuse("statement", f"line {call.line}", f"{call.method} of part '{name}' is not known")
        self.links.append(link)
        return link

    def _given(self, thing: str, record: Record, default: Array, *methods: str) -> Array:
        call = record.last(*methods)
        if call is None:
            return default
        value = call.values[0] if call.values else None
        if not isinstance(value, np.ndarray) or value.shape != default.shape:
            raise ModelError(f"{self.source}: {thing}: {call.method} must have a value of the exporter, got another")
        return value

    def _mass(self, thing: str, body: Record) -> MassProperties:
        """In the frame of the part. Moments and products (entries of the matrix) are about the centre of mass."""
        call = body.last("SetMass")
        if call is None:
            if is_true(body, "SetFixed", "SetBodyFixed"):
                return NO_MASS
            raise ModelError(f"{self.source}: {thing}: must have a mass, got none; give it a material in SolidWorks")
        mass = call.values[0] if call.values else None
        if isinstance(mass, bool) or not isinstance(mass, (int, float)) or not mass > 0.0:
            raise ModelError(
                f"{self.source}: {thing}: SetMass must be a number > 0 kg, got {mass!r}; give it a material"
            )
        xx, yy, zz = self._given(thing, body, np.ones(3), "SetInertiaXX")
        xy, xz, yz = self._given(thing, body, np.zeros(3), "SetInertiaXY")
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        moments = np.linalg.eigvalsh(inertia)
        if moments[0] <= 0.0:
            raise ModelError(
                f"{self.source}: {thing}: principal moments must be > 0 kg·m², got {moments.tolist()}; "
                "check its material"
            )
        centre = body.last("SetFrame_COG_to_REF", "SetFrameCOMToRef")
        frame = centre.values[0] if centre is not None and centre.values else make_pose()
        if not isinstance(frame, Pose):
            raise ModelError(f"{self.source}: {thing}: the frame of the centre of mass must be a ChFrame, got another")
        return moved_mass(MassProperties(float(mass), np.zeros(3), inertia), frame)

    # ---- collision --------------------------------------------------------------------------------------------------

    def _shapes(self, thing: str, name: str, body: Record) -> list[LinkShape]:
        made: list[LinkShape] = []
        for call in body.calls:
            if call.method in ("AddCollisionShape", MODEL + "AddShape"):
                found = self._new_shape(thing, call)
            elif call.method.startswith(MODEL + "Add"):
                found = self._old_shape(thing, call)
            else:
                continue
            if found is None:
                self._report.refuse("collision shape", f"line {call.line}")
                continue
            kind, size, place, hulls, material = found
            own = f"{name}_{len(made)}"
            self._report.hold(f"collision {kind.name.lower()}", own)
            made.append(LinkShape(name=own, kind=kind, size=size, pose=place, hulls=hulls, material=material))
        return made

    def _new_shape(self, thing: str, call: Call) -> Any:
        """ChCollisionShape...(material, sizes), and its frame."""
        shape, *frames = call.values
        place = frames[0] if frames and isinstance(frames[0], Pose) else make_pose()
        if not isinstance(shape, Record):
            return None
        sizes = [float(value) for value in shape.values if isinstance(value, (int, float)) and value is not True]
        material = self._material(shape.values)
        match shape.kind:
            case "ChCollisionShapeBox" if len(sizes) == 3:
                return ShapeType.BOX, _size(0.5 * np.array(sizes)), place, (), material
            case "ChCollisionShapeSphere" if len(sizes) == 1:
                return ShapeType.SPHERE, _size(sizes * 3), place, (), material
            case "ChCollisionShapeCylinder" if len(sizes) == 2:
                return ShapeType.CYLINDER, _size([sizes[0], 0.5 * sizes[1], sizes[0]]), place, (), material
            case "ChCollisionShapeConvexHull":
                return self._hull(thing, shape.values, place, material)
            case "ChCollisionShapeTriangleMesh":
                return self._mesh(thing, shape.values, place, material)
            case _:
                return None

    def _old_shape(self, thing: str, call: Call) -> Any:
        """GetCollisionModel().Add...(material, sizes, position, rotation)."""
        values = call.values
        sizes = [float(value) for value in values if isinstance(value, (int, float)) and not isinstance(value, bool)]
        points = [value for value in values if isinstance(value, np.ndarray) and value.shape == (3,)]
        turns = [value.rotation if isinstance(value, Matrix) else value for value in values]
        turn = next((v for v in turns if isinstance(v, np.ndarray) and v.shape == (4,)), make_pose().rotation)
        place = make_pose(points[0] if points else np.zeros(3), turn)
        material = self._material(values)
        factor = 1.0 if self._halves else 0.5
        match call.method.removeprefix(MODEL):
            case "AddBox" if len(sizes) == 3:
                return ShapeType.BOX, _size(factor * np.array(sizes)), place, (), material
            case "AddSphere" if len(sizes) == 1:
                return ShapeType.SPHERE, _size(sizes * 3), place, (), material
            case "AddCylinder" if len(sizes) == 3 and abs(sizes[0] - sizes[1]) <= 1e-6 * sizes[0]:
                lying = make_pose(rotation=(-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))  # z becomes y
                return ShapeType.CYLINDER, _size([sizes[0], sizes[2], sizes[0]]), composed(place, lying), (), material
            case "AddCylinder" if len(sizes) == 1 and len(points) == 2:
                return self._cylinder_between(sizes[0], points, material)
            case "AddCylinder" if len(sizes) == 2:
                return ShapeType.CYLINDER, _size([sizes[0], 0.5 * sizes[1], sizes[0]]), place, (), material
            case "AddConvexHull":
                return self._hull(thing, values, place, material)
            case "AddTriangleMesh":
                return self._mesh(thing, values, place, material)
            case _:
                return None

    def _cylinder_between(self, radius: float, ends: Sequence[Array], material: Material | None) -> Any:
        axis = ends[1] - ends[0]
        turn = frame_from_axis("cylinder", axis)
        half = 0.5 * float(np.linalg.norm(axis))
        place = make_pose(0.5 * (ends[0] + ends[1]), turn)
        return ShapeType.CYLINDER, (radius, half, radius), place, (), material

    def _hull(self, thing: str, values: Sequence[Any], place: Pose, material: Material | None) -> Any:
        listed = next((v for v in values if isinstance(v, Record) and v.kind.startswith("vector_")), None)
        if listed is None:
            return None
        try:
            corners, off = reduced_hull(np.array(listed.items, np.float64).reshape(-1, 3))
        except ModelError as error:
            raise ModelError(f"{self.source}: {thing}: {error}") from None
        self._reduced = max(self._reduced, off)
        return ShapeType.HULL, (1.0, 1.0, 1.0), place, (corners,), material

    def _mesh(self, thing: str, values: Sequence[Any], place: Pose, material: Material | None) -> Any:
        """A triangle mesh stands for its convex hull."""
        mesh = next((v for v in values if isinstance(v, Record) and v.kind == "ChTriangleMeshConnected"), None)
        file = text_argument(mesh, "", "LoadWavefrontMesh") if mesh is not None else ""
        if mesh is None or not file:
            return None
        try:
            from simwarp.geometry.mesh_files import load_mesh  # trimesh takes a while to import

            vertices, triangles = load_mesh(self._folders.resolve(file))
            points = self._transformed(mesh, np.asarray(vertices))
            hulls, off = collision_hulls(f"mesh '{file}'", points, np.asarray(triangles), False)
        except ModelError as error:
            raise ModelError(f"{self.source}: {thing}: {error}") from None
        self._reduced = max(self._reduced, off)
        self._report.approximate("collision mesh", file, "its convex hull")
        return ShapeType.HULL, (1.0, 1.0, 1.0), place, tuple(hulls), material

    def _transformed(self, mesh: Record, points: Array) -> Array:
        """Points of a mesh after its calls of Transform(vector, matrix)."""
        for call in mesh.calls:
            if call.method == "Transform" and len(call.values) == 2 and isinstance(call.values[1], Matrix):
                points = points @ call.values[1].entries.T + call.values[0]
            elif call.method != "LoadWavefrontMesh":
                self._report.refuse("statement", f"line {call.line}", f"{call.method} of a mesh is not known")
        return points

    def _material(self, values: Sequence[Any]) -> Material | None:
        surface = next((v for v in values if isinstance(v, Record) and "Material" in v.kind), None)
        if surface is None:
            return None
        fields: dict[str, Any] = {}
        for call in surface.calls:
            if call.method not in MATERIAL:
                self._report.approximate(
                    f"material {call.method}", f"line {call.line}", "of another contact law; left out"
                )
            elif call.values and isinstance(call.values[0], (int, float)):
                fields[MATERIAL[call.method]] = float(call.values[0])
        return Material(**fields)

    def finish(self) -> None:
        """Reports hulls that lost corners."""
        if self._reduced > 0.0:
            told = f"convex hulls with {HULL_CORNERS} corners, up to {self._reduced:.2g} m inside those of all points"
            self._report.approximate("collision hull", "", told)

    # ---- what is seen, and markers ----------------------------------------------------------------------------------

    def _add_visuals(self, name: str, body: Record) -> None:
        shown = [
            (call.values[0], call.values[1:]) for call in body.calls if call.method == "AddVisualShape" and call.values
        ]
        levels = [item for item in body.items if isinstance(item, Record) and item.kind == "ChAssetLevel"]
        for level in levels:
            place, turn = level.last("GetFrame.SetPos"), level.last("GetFrame.SetRot")
            frame = make_pose(
                place.values[0] if place is not None else np.zeros(3),
                turn.values[0] if turn is not None else make_pose().rotation,
            )
            shown += [(item, [frame]) for item in level.items]
        for number, (shape, frames) in enumerate(shown):
            file = text_argument(shape, "", "SetFilename") if isinstance(shape, Record) else ""
            if not file:
                self._report.approximate("visual shape", f"line {body.line}", "no file of a mesh; left out")
                continue
            own = f"{name}_visual_{number}"
            self._report.hold("visual mesh", own)
            self.visuals.append(
                LinkVisual(
                    name=own, link=name, kind=ShapeType.MESH, mesh=self._loader(file), color=_color(shape),
                    pose=frames[0] if frames and isinstance(frames[0], Pose) else make_pose(),
                )
            )  # fmt: skip

    def _loader(self, file: str) -> Any:
        folders = self._folders

        def read() -> VisualMesh:
            from simwarp.geometry.mesh_files import load_visual_mesh  # trimesh takes a while to import

            return load_visual_mesh(folders.resolve(file))

        return read

    def _add_marker(self, part: str, call: Call, frame: Pose) -> None:
        """A marker stands in the world; what is kept is its place on the part."""
        marker = call.values[0] if call.values else None
        if not isinstance(marker, Record):
            return
        name = text_argument(marker, f"marker of line {marker.line}", "SetName")
        placed = marker.last("Impose_Abs_Coord", "ImposeAbsoluteTransform")
        if placed is None or not placed.values or not isinstance(placed.values[0], Pose):
            self._report.refuse("statement", f"line {marker.line}", f"marker '{name}' has no place")
            return
        self._report.hold("marker", name)
        self.markers.append((name, part, relative(frame, placed.values[0])))


def _size(values: Any) -> Size:
    a, b, c = (float(value) for value in values)
    return a, b, c


def _color(shape: Record) -> Size | None:
    call = shape.last("SetColor")
    if call is None or not isinstance(call.values[0], np.ndarray):
        return None
    return _size(linear_from_srgb(np.clip(call.values[0], 0.0, 1.0)))
