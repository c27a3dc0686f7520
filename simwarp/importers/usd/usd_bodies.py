"""Rigid bodies and colliders of a USD stage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of, quat_multiply
from simwarp.core.types import Material, ModelError, Pose, ShapeType, pose as make_pose
from simwarp.geometry.assets import MassProperties, convex_hull, hull_mass, shape_mass
from simwarp.importers.links.link_frames import NO_MASS, composed, moved_mass
from simwarp.importers.links.link_meshes import HULL_CORNERS, collision_hulls
from simwarp.importers.links.link_tree import Link, LinkShape
from simwarp.importers.report import ImportReport
from simwarp.importers.source_files import needed
from simwarp.importers.usd.usd_stage import Stage, quaternion, vector

Array = npt.NDArray[np.float64]
Size = tuple[float, float, float]

AXES: Final[Mapping[str, Array]] = {
    "X": np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]),
    "Y": np.array([-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]),
    "Z": np.array([0.0, 0.0, 0.0, 1.0]),
}
"""Rotations by which z becomes that axis (xyzw)."""

SHAPES: Final = (
    "CubeShape", "SphereShape", "CapsuleShape", "Capsule1Shape", "CylinderShape", "Cylinder1Shape", "ConeShape",
    "PlaneShape", "MeshShape", "CustomShape", "SpherePointsShape",
)  # fmt: skip

HULLS: Final = ("convexHull", "convexDecomposition")
"""Approximations of meshes that are hulls."""


class BodyReader:
    """Reads links, their colliders and their masses.

    Args:
        stage: opened.
        world: pose of the stage's world in ours.
        report: what became of every element.
        decompose: take several hulls for a mesh: True, or options of coacd.
    """

    def __init__(self, stage: Stage, world: Pose, report: ImportReport, decompose: bool | Mapping[str, Any]) -> None:
        self.links: list[Link] = []
        self.link_of: dict[str, Link] = {}
        self.grounded: list[str] = []
        self.shape_paths: dict[str, str] = {}
        self.frames: dict[str, Pose] = {}
        self._stage = stage
        self._world = world
        self._report = report
        self._decompose = decompose
        self._reduced = 0.0
        self._materials = {str(m.primPath): self._material(m) for m in stage.of("RigidBodyMaterial")}
        self.colliders = {str(shape.primPath): shape for shape in stage.of(*SHAPES)}
        self._solids: dict[str, MassProperties] = {}

    # ---- bodies -----------------------------------------------------------------------------------------------------

    def read(self) -> None:
        """All bodies, then the colliders that nothing moves."""
        length = self._stage.units.length
        shapes: dict[str, list[LinkShape]] = {}
        for path, shape in self.colliders.items():
            made = self._shape(path, shape) if shape.collisionEnabled else None
            if made is not None:
                shapes.setdefault(str(shape.rigidBody), []).append(made)
        for body in self._stage.of("RigidBody"):
            path = str(body.primPath)
            frame = make_pose(length * vector(body.position), quaternion(body.rotation))
            link = Link(
                name=self.name_of(path), pose=composed(self._world, frame), mass=self._mass(path, body),
                shapes=shapes.pop(path, []), velocity=self._turned(length * vector(body.linearVelocity)),
                omega=self._turned(np.deg2rad(vector(body.angularVelocity))),
            )  # fmt: skip
            self._report.hold("rigid body", link.name)
            if body.kinematicBody or not body.rigidBodyEnabled:
                self.grounded.append(link.name)
                self._report.approximate("kinematic body", link.name, "welded to the world where it stands")
            self.links.append(link)
            self.link_of[path] = link
            self.frames[path] = frame
        for path, static in shapes.items():
            for shape in static:
                link = Link(name=f"{shape.name}_static", pose=self._world, shapes=[shape])
                self.links.append(link)
                self.grounded.append(link.name)
                self.link_of.setdefault(path, link)
        if self._reduced > 0.0:
            told = f"convex hulls with {HULL_CORNERS} corners, up to {self._reduced:.2g} m inside"
            self._report.approximate("collision hull", "", told)

    def name_of(self, path: str) -> str:
        """Name of a prim; its path where another body or collider has the same."""
        name = path.rpartition("/")[2]
        bodies = [str(body.primPath) for body in self._stage.of("RigidBody")]
        same = [other for other in bodies if other.rpartition("/")[2] == name]
        return name if len(same) <= 1 else path.lstrip("/")

    def _turned(self, value: Array) -> Array:
        return matrix_of(self._world.rotation) @ value

    def _mass(self, path: str, body: Any) -> MassProperties:
        """Mass, centre and inertia as UsdPhysics computes them: given values go before densities, these before 1000."""
        prim = self._stage.prim(path)
        mass, inertia, centre, axes = self._stage.physics.RigidBodyAPI(prim).ComputeMassProperties(self._solid)
        units = self._stage.units
        if not mass > 0.0 or not np.isfinite(mass):
            if not str(path) or not self._has_shapes(path):
                return NO_MASS
            raise ModelError(f"body '{path}': mass must be > 0 kg, got {mass}; give it a mass, or a density")
        principal = MassProperties(mass * units.mass, np.zeros(3), np.diag(vector(inertia)) * units.inertia)
        return moved_mass(principal, make_pose(units.length * vector(centre), quaternion(axes)))

    def _has_shapes(self, path: str) -> bool:
        return any(str(shape.rigidBody) == path for shape in self.colliders.values())

    def _solid(self, prim: Any) -> Any:
        """Volume and inertia of a collider at density 1, in units of the stage, for `ComputeMassProperties`."""
        gf = needed("pxr.Gf", "USD", "usd")
        shape = self.colliders[str(prim.GetPath())]
        solid = self._volume(str(prim.GetPath()), shape)
        told = self._stage.physics.RigidBodyAPI.MassInformation()
        told.volume = solid.mass
        told.inertia = gf.Matrix3f(*solid.inertia.astype(np.float64).reshape(-1).tolist())
        told.centerOfMass = gf.Vec3f(*solid.centre.tolist())
        told.localPos, told.localRot = shape.localPos, shape.localRot
        return told

    def _volume(self, path: str, shape: Any) -> MassProperties:
        if path not in self._solids:
            kind, size, turn = self._primitive(shape)
            if kind is None:
                points, _ = self._mesh(path, shape)
                self._solids[path] = hull_mass(convex_hull(points), 1.0)
            elif kind == ShapeType.PLANE:
                self._solids[path] = NO_MASS
            else:
                self._solids[path] = moved_mass(shape_mass(kind, size, 1.0), make_pose(rotation=turn))
        return self._solids[path]

    # ---- colliders --------------------------------------------------------------------------------------------------

    def _shape(self, path: str, shape: Any) -> LinkShape | None:
        length = self._stage.units.length
        name = self._shape_name(path)
        self.shape_paths[path] = name
        place = make_pose(length * vector(shape.localPos), quaternion(shape.localRot))
        materials = [self._materials[str(m)] for m in shape.materials if str(m) in self._materials]
        material = materials[0] if materials else None
        word = str(shape.type).rpartition(".")[2]
        if word in ("CustomShape", "SpherePointsShape"):
            self._report.refuse("collider", name)
            return None
        kind, size, turn = self._primitive(shape)
        if kind is None:
            return self._mesh_shape(path, name, shape, place, material)
        if kind != ShapeType.PLANE and not min(size) > 0.0:
            self._report.refuse("collider", name, "a length of its shape is 0; give it a size")
            return None
        self._report.hold(f"collider {kind.name.lower()}", name)
        scaled = tuple(length * value for value in size)
        turned = make_pose(place.position, quat_multiply(place.rotation, turn))
        return LinkShape(name=name, kind=kind, size=(scaled[0], scaled[1], scaled[2]), pose=turned, material=material)

    def _shape_name(self, path: str) -> str:
        name = path.rpartition("/")[2]
        same = [other for other in self.colliders if other.rpartition("/")[2] == name]
        return name if len(same) == 1 else path.lstrip("/")

    def _primitive(self, shape: Any) -> tuple[ShapeType | None, Size, Array]:
        """Kind, size in units of the stage, and the rotation of its axis; None for a mesh."""
        turn = AXES[str(getattr(shape, "axis", "Z"))[-1]]
        match str(shape.type).rpartition(".")[2]:
            case "CubeShape":
                x, y, z = (float(value) for value in shape.halfExtents)
                return ShapeType.BOX, (x, y, z), turn
            case "SphereShape":
                return ShapeType.SPHERE, (float(shape.radius),) * 3, turn
            case "CapsuleShape" | "CylinderShape" | "ConeShape" as word:
                kind = ShapeType[word.removesuffix("Shape").upper()]
                return kind, (float(shape.radius), float(shape.halfHeight), float(shape.radius)), turn
            case "PlaneShape":
                return ShapeType.PLANE, (0.0, 0.0, 0.0), turn
            case "Capsule1Shape" | "Cylinder1Shape" as word:
                kind = ShapeType.CAPSULE if word == "Capsule1Shape" else ShapeType.CYLINDER
                top, bottom = float(shape.topRadius), float(shape.bottomRadius)
                if abs(top - bottom) > 1e-6 * max(top, bottom):
                    told = "two radii; taken as their mean"
                    self._report.approximate(
                        f"collider {kind.name.lower()}", self._shape_name(str(shape.primPath)), told
                    )
                radius = 0.5 * (top + bottom)
                return kind, (radius, float(shape.halfHeight), radius), turn
            case _:
                return None, (1.0, 1.0, 1.0), turn

    def _mesh_shape(self, path: str, name: str, shape: Any, place: Pose, material: Material | None) -> LinkShape | None:
        """A mesh stands for its hull, whatever its approximation says."""
        word = str(shape.approximation)
        points, triangles = self._mesh(path, shape)
        hulls, off = collision_hulls(
            f"collider '{name}'", self._stage.units.length * points, triangles, self._decompose
        )
        self._reduced = max(self._reduced, off)
        if word in HULLS and (word == "convexHull" or self._decompose is not False):
            self._report.hold("collider mesh", name)
        else:
            self._report.approximate("collider mesh", name, f"its convex hull, in place of {word}")
        return LinkShape(name=name, kind=ShapeType.HULL, pose=place, hulls=tuple(hulls), material=material)

    def _mesh(self, path: str, shape: Any) -> tuple[Array, npt.NDArray[np.int64]]:
        """Points of a mesh in the frame of its collider, in units of the stage, and its triangles."""
        points, triangles = mesh_of(self._stage, path)
        return points * vector(shape.meshScale), triangles

    def _material(self, description: Any) -> Material:
        name = str(description.primPath).rpartition("/")[2]
        friction, static = float(description.dynamicFriction), float(description.staticFriction)
        if abs(friction - static) > 1e-6:
            self._report.approximate("material", name, "one friction, that of sliding, in place of two")
        else:
            self._report.hold("material", name)
        return Material(friction=friction, restitution=float(description.restitution))


def mesh_of(stage: Stage, path: str) -> tuple[Array, npt.NDArray[np.int64]]:
    """Points and triangles of a mesh; polygons become fans."""
    mesh = stage.geometry.Mesh(stage.prim(path))
    points = np.array(mesh.GetPointsAttr().Get() or [], np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], np.int64)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], np.int64)
    if counts.sum() != len(corners) or (len(corners) and not 0 <= corners.min() <= corners.max() < len(points)):
        raise ModelError(f"mesh '{path}': faces must name its points, got {len(corners)} corners; export it again")
    triangles = []
    start = 0
    for count in counts:
        face = corners[start : start + count]
        triangles += [(face[0], face[k], face[k + 1]) for k in range(1, count - 1)]
        start += count
    return points, np.array(triangles, np.int64).reshape(-1, 3)
