"""Meshes of a model: their nodes are bodies of three coordinates, which elements tie to each other and, where they are
glued, to a body (kernels/meshes).
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from simwarp.core.types import WORLD, Material, ModelError, Pose, Vec3, finite_vector, formatted, pose as make_pose
from simwarp.core.wording import suggestion
from simwarp.meshes.materials import Elastic, Rubber
from simwarp.meshes.mesh_costs import check_cost
from simwarp.meshes.mesh_parts import MeshPart, as_array, checked_part, checked_points, lumped_masses
from simwarp.meshes.mesh_specification import FlexibleMesh, MeshContact
from simwarp.meshes.mesh_surfaces import surface_of
from simwarp.meshes.triangle_elements import crossed_nodes
from simwarp.meshes.volume_mesh import EmbeddedSurface
from simwarp.model.checks import checked_flag, checked_member, checked_name, checked_pose, positive_number
from simwarp.model.shapes import checked_material

Array: TypeAlias = npt.NDArray[np.float64]
Glue: TypeAlias = Mapping[int, Any] | Mapping[str, Any] | Mapping[int | str, Any]
"""Nodes, by numbers or the name of a set, for each body, by its index or name."""


FEWEST_CROSSES: Final = 4
"""Nodes of four triangles that make a pattern."""


class SolidSource(Protocol):
    """A mesh of solid elements (`sw.flex.box`, `lattice`, `read`)."""

    @property
    def points(self) -> Array:
        """(n, 3) nodes [m]."""

    @property
    def elements(self) -> npt.NDArray[np.int32]:
        """(m, 4) tetrahedra or (m, 8) hexahedra."""

    @property
    def fill(self) -> Array:
        """(m,) share of each cell's volume that is material."""

    @property
    def sets(self) -> Mapping[str, Any]:
        """Nodes by the name of a set."""

    @property
    def surface(self) -> EmbeddedSurface | None:
        """What is seen of it; None: the outside of its elements."""

    @property
    def boundary_nodes(self) -> npt.NDArray[np.int32]:
        """Nodes of its surface."""


class MeshBuilder(Protocol):
    """What a mesh needs of a `ModelBuilder`."""

    bodies: list[Any]
    joints: list[Any]
    shapes: list[Any]
    excluded_bodies: set[tuple[int, int]]
    flexible_meshes: list[FlexibleMesh]

    @property
    def add_body(self) -> Callable[..., int]:
        """`ModelBuilder.add_body`, and so on."""

    @property
    def add_shape_sphere(self) -> Callable[..., int]: ...  # noqa: D102

    @property
    def add_joint_spherical(self) -> Callable[..., int]: ...  # noqa: D102

    @property
    def exclude_collision(self) -> Callable[[int, int], None]: ...  # noqa: D102


def solid_part(name: Any, mesh: Any, material: Elastic | Rubber) -> MeshPart:
    """The part that a mesh of solid elements is of.

    Raises:
        ModelError: it is no such mesh.
    """
    thing = checked_name("mesh", name)
    if not all(hasattr(mesh, each) for each in ("points", "elements", "fill", "sets", "boundary_nodes")):
        raise ModelError(
            f"{thing}: mesh must be a VolumeMesh, got {formatted(mesh)}; make one by sw.flex.box, lattice or read"
        )
    return MeshPart(elements=mesh.elements, material=material, fill=mesh.fill)


def sheet_part(
    name: Any, triangles: Any, material: Elastic | Rubber, thickness: float, pressure: float
) -> MeshPart:  # fmt: skip
    """The part that a sheet is of.

    Raises:
        ModelError: these are no triangles.
    """
    thing = checked_name("mesh", name)
    elements = as_array(triangles)
    if elements.ndim != 2 or elements.shape[1] != 3 or elements.dtype.kind not in "iu":
        raise ModelError(
            f"{thing}: triangles must be integers of shape (e, 3), got {elements.dtype} {elements.shape}; "
            "give the nodes of each"
        )
    return MeshPart(elements=elements, material=material, thickness=thickness, pressure=pressure)


def warn_of_crosses(mesh: FlexibleMesh, *, stacklevel: int) -> None:
    """Warn where the diagonals of a sheet cross: rotation-free triangles are then far too stiff in bending.

    Warns:
        UserWarning: four triangles meet at more than a quarter of the nodes inside it, and at `FEWEST_CROSSES` or more.
    """
    crossed, inside = crossed_nodes(mesh.parts[0].elements)
    if crossed >= FEWEST_CROSSES and 4 * crossed > inside:
        warnings.warn(
            f"mesh '{mesh.name}': triangles should meet six at a node, got four at {crossed} of the {inside} nodes "
            "inside: where diagonals cross or alternate a sheet bends up to 40 % too little; let all run the same way",
            stacklevel=stacklevel,
        )


def build_mesh(
    builder: MeshBuilder, name: str, points: Any, parts: Sequence[MeshPart], *, sets: Mapping[str, Any],
    pose: Pose | None, glue: Glue | None, fixed: Any, radius: float | None,
    surface: Material | None, touching: Sequence[int] | None, velocity: Vec3, omega: Vec3, double: bool,
    embedded: EmbeddedSurface | None = None, contact: MeshContact | str = MeshContact.NODES,
) -> FlexibleMesh:  # fmt: skip
    """Add a mesh to a builder, or nothing where something is wrong; arguments as for `ModelBuilder.add_solid_mesh`,
    and the surface that its cells carry.

    Raises:
        ModelError: an argument cannot be used.
    """
    thing = checked_name("mesh", name)
    rest = checked_points(thing, points)
    made = tuple(checked_part(thing, rest, part) for part in parts)
    masses = lumped_masses(rest, made)
    unused = np.flatnonzero(masses == 0.0)
    if len(unused):
        raise ModelError(
            f"{thing}: every node must be one of an element, got {len(unused)} that are not, the first {unused[0]}; "
            "leave them out"
        )
    where = checked_member(thing, "contact", contact, MeshContact)
    precise = checked_flag(thing, "double", double)
    thick = _usual_radius(rest, made)
    if radius is not None:
        thick = positive_number(thing, "radius", radius, "m", "None takes the usual one")
    stuff = _checked_surface(thing, surface)
    place = make_pose() if pose is None else checked_pose(thing, pose)
    turn = matrix_of(place.rotation)
    at = np.asarray(place.position) + rest @ turn.T
    held, joined = _held_nodes(builder, thing, len(rest), sets, glue, fixed)
    own = [node for node in range(len(rest)) if node not in held]
    if not own:
        raise ModelError(f"{thing}: some node must move by itself, got all {len(rest)} glued or fixed; use a shape")
    check_cost(thing, len(own), made)
    v, w = finite_vector(thing, "velocity", velocity, 3), finite_vector(thing, "omega", omega, 3)
    counts = len(builder.bodies), len(builder.shapes), len(builder.joints)
    apart = set(builder.excluded_bodies)
    centre = masses @ at / masses.sum()
    try:
        bodies, places = [WORLD] * len(rest), at.copy()
        for node in own:
            size = 0.1 * float(masses[node]) ** (1.0 / 3.0)
            bodies[node] = builder.add_body(
                f"{name}_{node}", mass=float(masses[node]), inertia=(float(masses[node]) * size**2,) * 3,
                pose=Pose(at[node], np.array([0.0, 0.0, 0.0, 1.0])),
                velocity=tuple(v + np.cross(w, at[node] - centre)),
            )  # fmt: skip
        for node, body in held.items():
            bodies[node] = body
            if body != WORLD:
                owner = builder.bodies[body].pose
                places[node] = matrix_of(owner.rotation).T @ (at[node] - np.asarray(owner.position))
        for node, body in joined.items():
            builder.add_joint_spherical(f"{name}_{node}_glue", body, bodies[node], anchor=tuple(at[node]))
        shapes: tuple[int, ...] = ()
        if radius is not None or surface is not None or where is MeshContact.FACES:
            together = [bodies[node] for node in (own if touching is None else touching) if node not in held]
            shapes = tuple(builder.add_shape_sphere(body, radius=thick, material=stuff) for body in together)
            owners = sorted({body for body in [*held.values(), *joined.values()] if body != WORLD})
            near = sorted(together)
            builder.excluded_bodies.update(itertools.combinations(near, 2))
            for one, owner in itertools.product(near, owners):
                builder.exclude_collision(one, owner)
    except ModelError:
        del builder.bodies[counts[0] :], builder.shapes[counts[1] :], builder.joints[counts[2] :]
        builder.excluded_bodies &= apart
        raise
    glued = tuple(node in held and held[node] != WORLD for node in range(len(rest)))
    seen = surface_of(made, embedded)
    mesh = FlexibleMesh(name, rest, made, tuple(bodies), glued, places, precise, shapes, seen, where)
    builder.flexible_meshes.append(mesh)
    return mesh


def _checked_surface(thing: str, surface: Any) -> Material:
    """The surface of nodes' spheres."""
    if surface is None:
        return Material()
    if not isinstance(surface, Material):
        raise ModelError(f"{thing}: surface must be a Material, got {formatted(surface)}; write sw.Material(...)")
    return checked_material(thing, surface)


def _usual_radius(points: Array, parts: Sequence[MeshPart]) -> float:
    """Of spheres around nodes [m]: half the thickness of a sheet, a fiftieth of a solid's shortest edge."""
    sheets = [part.thickness for part in parts if part.thickness is not None]
    if sheets:
        return 0.5 * max(sheets)
    corners = points[parts[0].elements]
    return 0.02 * float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min())


def refuse_meshes(thing: str, builder: Any) -> None:
    """Raises a ModelError where a model has meshes."""
    if builder.flexible_meshes:
        raise ModelError(
            f"{thing}: the model must be without flexible meshes, got '{builder.flexible_meshes[0].name}'; use a model "
            "of rigid bodies and rods"
        )


def check_nodes(thing: str, mesh: FlexibleMesh, builder: MeshBuilder) -> None:
    """Every node that moves by itself is a body of its own, with mass.

    Raises:
        ModelError: one is not.
    """
    taken = {other.bodies[node] for other in builder.flexible_meshes for node in other.nodes}
    for node in mesh.nodes:
        body = mesh.bodies[node]
        if body in taken or builder.bodies[body].mass <= 0.0:
            what = "which another node is" if body in taken else "which has no mass"
            raise ModelError(
                f"{thing}: a node must be a body of its own with mass, got body {body} for node {node}, {what}; give "
                "it another"
            )
        taken.add(body)


def _held_nodes(
    builder: MeshBuilder, thing: str, count: int, sets: Mapping[str, Any], glue: Glue | None,
    fixed: Any,
) -> tuple[dict[int, int], dict[int, int]]:  # fmt: skip
    """Body of each node that does not move by itself (WORLD: it is fixed), and of those that balls hold at a further
    body: the factor of a mesh folds into one.
    """
    held: dict[int, int] = dict.fromkeys(_chosen(thing, "fixed", count, sets, fixed), WORLD)
    joined: dict[int, int] = {}
    owner: int | None = None
    if glue is not None and not isinstance(glue, Mapping):
        raise ModelError(f"{thing}: glue must be {{body: nodes}}, got {formatted(glue)}; leave it out for none")
    of_meshes = {mesh.bodies[node]: mesh for mesh in builder.flexible_meshes for node in mesh.nodes}
    for holder, nodes in (glue or {}).items():
        body = holder
        if isinstance(holder, str):
            names = [each.name for each in builder.bodies]
            if holder not in names:
                raise ModelError(
                    f"{thing}: glue must name bodies that were added, got {formatted(holder)}; "
                    + suggestion(holder, names, "add it before the mesh")
                )
            body = names.index(holder)
        if isinstance(body, bool) or not isinstance(body, (int, np.integer)) or not 0 <= body < len(builder.bodies):
            raise ModelError(
                f"{thing}: glue must name bodies that were added, got {formatted(holder)}; `fixed` holds nodes in the "
                "world"
            )
        if body in of_meshes:
            raise ModelError(
                f"{thing}: glue must name a body that turns, got '{builder.bodies[body].name}', a node of "
                f"'{of_meshes[int(body)].name}'; join nodes by add_joint_spherical"
            )
        chosen = _chosen(thing, "glue", count, sets, nodes)
        if owner is None and chosen:
            owner = int(body)
        place = held if body == owner else joined
        for node in chosen:
            if node in held or node in joined:
                raise ModelError(f"{thing}: a node must be held once, got node {node} twice; leave it out of one set")
            place[node] = int(body)
    return held, joined


def _chosen(thing: str, label: str, count: int, sets: Mapping[str, Any], nodes: Any) -> list[int]:
    """Nodes by their numbers or the name of a set."""
    if isinstance(nodes, str):
        if nodes not in sets:
            raise ModelError(
                f"{thing}: {label} must be nodes or a set of the mesh, got {formatted(nodes)}; "
                + suggestion(nodes, list(sets), f"it has {', '.join(sets)}" if sets else "it has no sets: give numbers")
            )
        nodes = sets[nodes]
    given = as_array(nodes)
    if given.size == 0:
        return []
    if given.ndim != 1 or given.dtype.kind not in "iu":
        raise ModelError(
            f"{thing}: {label} must be numbers of nodes or the name of a set, got {formatted(nodes)}; "
            "leave it out for none"
        )
    wrong = given[(given < 0) | (given >= count)]
    if len(wrong):
        raise ModelError(f"{thing}: {label} must be nodes from 0 to {count - 1}, got {int(wrong[0])}; count from 0")
    return [int(node) for node in dict.fromkeys(given.tolist())]
