"""What a builder adds of flexible bodies: rods, solids and sheets."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from simwarp.core.types import Material, Pose, Vec3
from simwarp.meshes.materials import Elastic, Rubber
from simwarp.meshes.mesh_specification import FlexibleMesh, MeshContact
from simwarp.model.flexible_meshes import (
    Glue,
    MeshBuilder,
    SolidSource,
    build_mesh,
    sheet_part,
    solid_part,
    warn_of_crosses,
)
from simwarp.model.rod_sections import AnySection
from simwarp.model.rods import Rod, RodBuilder, RodEnd, RodMaterial, build_rod


class FlexibleParts:
    """Flexible bodies of a builder.

    Attributes:
        flexible_meshes: solids and sheets, in the order in which they were added.
    """

    def __init__(self) -> None:
        super().__init__()
        self.flexible_meshes: list[FlexibleMesh] = []

    def add_rod(
        self: RodBuilder, name: str, points: npt.ArrayLike, *, section: AnySection, material: RodMaterial,
        up: Vec3 | None = None, twist: float = 0.0, elements: int | None = None, start: RodEnd = None,
        end: RodEnd = None, radius: float | None = None, surface: Material | None = None,
    ) -> Rod:  # fmt: skip
        """A rod along points, at rest as built: bodies `name_0`, `name_1` ... at the points, elastic joints between
        them, and joints at its ends. Straight or curved, from ropes to shafts (docs/flexible.md).

        Args:
            name: of it.
            points: (nodes, 3), two or more, world frame [m].
            section: a `Round`, `Tube`, `Rectangle` or `Section` of `sw.flex`.
            material: such as `sw.flex.Elastic`.
            up: direction of the section's z axis at the start, made perpendicular to the rod; when None the world's z
                axis, or its y axis for a rod that begins vertically. It is carried along without turning about the rod.
            twist: angle by which the section at the end is turned about the rod at rest [rad].
            elements: take so many of equal length along the points, in the place of one between each two.
            start, end: a `Clamp` or `Hinge` of `sw.flex` that holds the first or last point; None: it is loose. A last
                point at the first, clamped to `name_0`, makes a ring.
            radius: of the capsules that touch others [m]; the section's largest distance from the axis when None.
            surface: of the capsules; None: without a radius the rod touches nothing.

        Raises:
            ModelError: an argument cannot be used.
        """
        ends = start, end
        return build_rod(self, name, points, section, material, up, twist, elements, ends, radius, surface)

    def add_solid_mesh(
        self: MeshBuilder, name: str, mesh: SolidSource, *, material: Elastic | Rubber, pose: Pose | None = None,
        glue: Glue | None = None, fixed: Any = (), radius: float | None = None,
        surface: Material | None = None, velocity: Vec3 = (0.0, 0.0, 0.0), omega: Vec3 = (0.0, 0.0, 0.0),
        double: bool = False, contact: MeshContact | str = MeshContact.NODES,
    ) -> FlexibleMesh:  # fmt: skip
        """A flexible solid of tetrahedra or hexahedra, at rest in the shape of the mesh: its nodes are bodies of three
        coordinates, `name_0`, `name_1` and on, which elements tie together (docs/flexible.md).

        Args:
            name: of it.
            mesh: such as `sw.flex.box`, `sw.flex.lattice`, `sw.flex.read` make.
            material: a `sw.flex.Elastic` or `sw.flex.Rubber`.
            pose: of the mesh's frame in the world; identity when None.
            glue: nodes (numbers, or the name of one of the mesh's sets) that move with a body, by its index or name.
                Those of the first body bring no mass: give it to the body. Those of further ones keep theirs and are
                held by a ball joint each (three rows of the solver).
            fixed: nodes that do not move, likewise.
            radius: of spheres around the nodes of its surface, which touch other shapes [m]; a fiftieth of the shortest
                edge when None.
            surface: of these spheres; None: without a radius it touches nothing.
            velocity, omega: of all of it as a rigid body at the start [m/s, rad/s], world.
            double: factor its matrix in double precision: for stiff meshes that are glued to light bodies.
            contact: "nodes", or "faces": convex shapes touch its surface between nodes too, which is as thick.

        Raises:
            ModelError: an argument cannot be used.
        """
        part = solid_part(name, mesh, material)
        return build_mesh(
            self, name, mesh.points, [part], sets=mesh.sets, pose=pose, glue=glue, fixed=fixed, radius=radius,
            surface=surface, touching=mesh.boundary_nodes.tolist(), velocity=velocity, omega=omega, double=double,
            embedded=mesh.surface, contact=contact,
        )  # fmt: skip

    def add_shell(
        self: MeshBuilder, name: str, vertices: npt.ArrayLike, triangles: npt.ArrayLike, *, thickness: float,
        material: Elastic | Rubber, pose: Pose | None = None, glue: Glue | None = None,
        fixed: Any = (), pressure: float = 0.0, radius: float | None = None, surface: Material | None = None,
        velocity: Vec3 = (0.0, 0.0, 0.0), omega: Vec3 = (0.0, 0.0, 0.0), double: bool = False,
        contact: MeshContact | str = MeshContact.NODES,
    ) -> FlexibleMesh:  # fmt: skip
        """A flexible sheet of triangles, at rest in the shape of its vertices: cloth, tarps, membranes, tires. Its
        nodes are bodies of three coordinates, `name_0`, `name_1` and on (docs/flexible.md).

        Args:
            name: of it.
            vertices: (n, 3) nodes [m].
            triangles: (e, 3) nodes of each, counter-clockwise about their normal.
            thickness: [m].
            material: a `sw.flex.Elastic` or `sw.flex.Rubber`.
            pose: of the vertices' frame in the world; identity when None.
            glue: nodes that move with a body, by its index or name. The first body's mass has to include theirs; those
                of further bodies keep their mass and are held by a ball joint each (three rows of the solver).
            fixed: nodes that do not move.
            pressure: that pushes triangles along their normals [Pa].
            radius: of spheres around its nodes, which touch other shapes [m]; half the thickness when None.
            surface: of these spheres; None: without a radius it touches nothing.
            velocity, omega: of all of it as a rigid body at the start [m/s, rad/s], world.
            double: factor its matrix in double precision.
            contact: "nodes", or "faces": convex shapes touch its triangles between nodes too, on both sides.

        Warns:
            UserWarning: diagonals cross or alternate: a sheet of such triangles bends too little.

        Raises:
            ModelError: an argument cannot be used.
        """
        part = sheet_part(name, triangles, material, thickness, pressure)
        mesh = build_mesh(
            self, name, vertices, [part], sets={}, pose=pose, glue=glue, fixed=fixed, radius=radius, surface=surface,
            touching=None, velocity=velocity, omega=omega, double=double, contact=contact,
        )  # fmt: skip
        warn_of_crosses(mesh, stacklevel=3)
        return mesh
