"""Models in files: all that a builder holds, back bit by bit.

    sw.save_model(builder, "robot.json")
    builder = sw.load_model("robot.json")

Every number is the same one afterwards, so that what `finalize` makes of it, and every step, is too.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core import files
from simwarp.core.schema import Fault, Place
from simwarp.core.types import WORLD, JointType, ModelError, Pose, ShapeType, formatted
from simwarp.core.wording import shortened
from simwarp.geometry.assets import HeightField, Hull, TriangleMesh, triangle_mesh
from simwarp.geometry.sprocket_profiles import SprocketProfile, checked_profile
from simwarp.meshes.materials import Elastic, Rubber
from simwarp.meshes.mesh_faces import check_faces
from simwarp.meshes.mesh_parts import MeshPart, checked_part
from simwarp.meshes.mesh_specification import FlexibleMesh, MeshContact
from simwarp.meshes.mesh_surfaces import MeshSurface, checked_surface, surface_of
from simwarp.model.builder import MAX_COUPLING_TERMS, ModelBuilder
from simwarp.model.checks import (
    check_floats,
    checked_dofs,
    checked_inertia,
    checked_member,
    checked_name,
    finite_number,
    positive_number,
    whole_number,
)
from simwarp.model.flexible_meshes import check_nodes
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.model_format import (
    FORMAT,
    MODELS,
    MOST_PAIRS,
    MOST_THINGS,
    VERSION,
    BodyEntry,
    CouplingEntry,
    FlexibleMaterialEntry,
    FlexibleMeshEntry,
    FrameEntry,
    GivenPairEntry,
    HeightFieldEntry,
    HullEntry,
    JointEntry,
    MeshEntry,
    MeshPartEntry,
    MeshSurfaceEntry,
    ModelEntry,
    PackedArray,
    ShapeEntry,
    SprocketProfileEntry,
    dof_entry,
    dof_of,
    floats,
    material_entry,
    plain,
)
from simwarp.model.shapes import checked_material, checked_size
from simwarp.model.specifications import BodySpec, CouplingSpec, Frame, JointSpec, ShapeSpec, Specification

Array = npt.NDArray[np.float64]

ROUNDING: Final = 1e-6
"""By which a unit vector or quaternion of a file may miss its length."""
BULGE: Final = 1e-4
"""By which corners of a hull may stand out of its faces; times the extent."""
FREE_OF_BODIES: Final = (JointType.SHAFT, JointType.COMBINATION)
PAIRS: Final = ("excluded_bodies", "excluded_shapes", "given_pairs")
ROOMS: Final = {
    ShapeType.HULL: "hulls", ShapeType.HEIGHT_FIELD: "height_fields", ShapeType.MESH: "meshes",
    ShapeType.SPROCKET: "sprocket_profiles",
}  # fmt: skip


def save_model(builder: ModelBuilder, path: str | os.PathLike[str]) -> None:
    """Write all that a builder holds to a JSON file, which replaces another one only when it is complete.

    Args:
        builder: bodies, joints, couplings, shapes with their geometries, rules of contact, gravity.
        path: of the file.

    Raises:
        ModelError: it would be larger than `load_model` reads.
    """
    write_model(builder, path)


def write_model(builder: Specification, path: str | os.PathLike[str], robot: Mapping[str, Any] | None = None) -> None:
    """As `save_model`, with what a reader of robots keeps beside the model."""
    text = model_text(builder, robot)
    if len(text) > files.LARGEST_TEXT:
        raise ModelError(
            f"{Path(path).name}: a model file must have at most {files.LARGEST_TEXT / 1e6:.3g} MB, got "
            f"{len(text) / 1e6:.3g} MB; simplify its meshes"
        )
    files.write_file(Path(path), text)


def model_text(builder: Specification, robot: Mapping[str, Any] | None = None) -> str:
    """The text of a file of `write_model`."""
    return files.layout(plain(model_entry(builder, robot))) + "\n"


def load_model(path: str | os.PathLike[str]) -> ModelBuilder:
    """The builder of a file that `save_model` wrote; of a saved robot its model.

    Raises:
        ModelError: the file cannot be read, has another format or version, or breaks a rule: names file, key and rule.
    """
    return read_model(path)[0]


def read_model(path: str | os.PathLike[str]) -> tuple[ModelBuilder, Mapping[str, Any] | None, Place]:
    """As `load_model`, with what a reader of robots kept beside the model, and the place of it for errors."""
    if not isinstance(path, (str, os.PathLike)):
        raise ModelError(f"load_model: path must be the path of a file, got {formatted(path)}; pass 'robot.json'")
    name = shortened(Path(path).name or str(path))
    try:
        value = files.parse_json(files.read_text(Path(path), "model"), name)
    except files.FileError as error:
        told = f"{name}: cannot be read: {error.reason}" if error.reason else f"{error}; save the model anew"
        raise ModelError(told) from None
    place = Place(name, ModelError)
    _check_head(value, place)
    entry: ModelEntry = MODELS.load(ModelEntry, value, place.line)
    return builder_of(entry, place), entry.robot, place.at("robot")


def _check_head(value: Any, place: Place) -> None:
    """Format, version and lengths, before all the rest is judged."""
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        found = formatted(value.get("format")) if isinstance(value, dict) else formatted(value)
        raise place.at("format").error(f"must be '{FORMAT}', got {found}; pass a file of save_model")
    version = value.get("version")
    if isinstance(version, bool) or version != VERSION:
        raise place.at("version").error(f"must be {VERSION}, got {formatted(version)}; save it with this version")
    for key, items in value.items():
        most = MOST_PAIRS if key in PAIRS else MOST_THINGS
        if isinstance(items, list) and len(items) > most:
            raise place.at(key).error(f"must be at most {most} items, got {len(items)}; split the model")


# ---- to entries ------------------------------------------------------------------------------------------------------


def model_entry(builder: Specification, robot: Mapping[str, Any] | None = None) -> ModelEntry:
    """All of a builder."""
    return ModelEntry(
        gravity=floats(builder.gravity),
        friction_rule=builder.friction_rule.name.lower(),
        pair_rule=builder.pair_rule.name.lower(),
        bodies=tuple(_body_entry(body) for body in builder.bodies),
        joints=tuple(_joint_entry(joint) for joint in builder.joints),
        couplings=tuple(
            CouplingEntry(
                name=coupling.name, terms=_terms_entry(coupling.terms), damping=float(coupling.damping),
                offset=None if coupling.offset is None else float(coupling.offset),
            )
            for coupling in builder.couplings
        ),
        shapes=tuple(_shape_entry(shape) for shape in builder.shapes),
        hulls=tuple(
            HullEntry(
                vertices=PackedArray.of(hull.vertices), normals=PackedArray.of(hull.normals),
                edges=PackedArray.of(hull.edges), faces=tuple(tuple(map(int, face)) for face in hull.faces),
            )
            for hull in builder.hulls
        ),
        height_fields=tuple(
            HeightFieldEntry(heights=PackedArray.of(field.heights), spacing=floats(field.spacing))
            for field in builder.height_fields
        ),
        meshes=tuple(
            MeshEntry(vertices=PackedArray.of(mesh.vertices), triangles=PackedArray.of(mesh.triangles))
            for mesh in builder.meshes
        ),
        sprocket_profiles=tuple(
            SprocketProfileEntry(
                teeth=int(profile.teeth), arc_center_radius=float(profile.arc_center_radius),
                arc_radius=float(profile.arc_radius), arc_offset=float(profile.arc_offset),
            )
            for profile in builder.sprocket_profiles
        ),
        flexible_meshes=tuple(_flexible_mesh_entry(mesh) for mesh in builder.flexible_meshes),
        excluded_bodies=tuple(sorted((int(a), int(b)) for a, b in builder.excluded_bodies)),
        excluded_shapes=tuple(sorted((int(a), int(b)) for a, b in builder.excluded_shapes)),
        given_pairs=tuple(
            GivenPairEntry(shapes=pair, material=None if surface is None else material_entry(surface))
            for pair, surface in builder.given_pairs.items()
        ),
        robot=robot,
    )  # fmt: skip


def _body_entry(body: BodySpec) -> BodyEntry:
    rows = np.asarray(body.inertia, np.float64)
    diagonal = np.array_equal(rows.view(np.int64), np.diag(np.diag(rows)).view(np.int64))
    return BodyEntry(
        name=body.name, mass=float(body.mass),
        inertia=floats(np.diag(rows)) if diagonal else tuple(floats(row) for row in rows),
        position=floats(body.pose.position), rotation=floats(body.pose.rotation), velocity=floats(body.velocity),
        omega=floats(body.omega), posed=body.posed,
    )  # fmt: skip


def _joint_entry(joint: JointSpec) -> JointEntry:
    dofs = tuple(dof_entry(dof) for dof in joint.dofs)
    return JointEntry(
        name=joint.name, type=joint.type.name.lower(), parent=int(joint.parent), child=int(joint.child),
        frame0=_frame_entry(joint.frame0), frame1=_frame_entry(joint.frame1),
        dofs=dofs if any(plain(dof) for dof in dofs) else (),
        offset=float(joint.offset), inertia=float(joint.inertia), initial_q=float(joint.initial_q),
        initial_qd=float(joint.initial_qd), closes_loop=bool(joint.closes_loop), terms=_terms_entry(joint.terms),
    )  # fmt: skip


def _frame_entry(frame: Frame) -> FrameEntry:
    return FrameEntry(position=floats(frame.position), rotation=floats(frame.rotation))


def _terms_entry(terms: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
    return tuple((int(column), float(factor)) for column, factor in terms)


def _shape_entry(shape: ShapeSpec) -> ShapeEntry:
    return ShapeEntry(
        name=shape.name, type=shape.type.name.lower(), body=int(shape.body), size=floats(shape.size),
        position=floats(shape.pose.position), rotation=floats(shape.pose.rotation),
        material=material_entry(shape.material), margin=float(shape.margin), group=int(shape.group),
        mask=int(shape.mask), asset=int(shape.asset),
    )  # fmt: skip


def _flexible_mesh_entry(mesh: FlexibleMesh) -> FlexibleMeshEntry:
    parts = tuple(
        MeshPartEntry(
            elements=PackedArray.of(part.elements), thickness=part.thickness, pressure=float(part.pressure),
            fill=None if part.fill is None or (part.fill == 1.0).all() else PackedArray.of(part.fill),
            material=FlexibleMaterialEntry(
                kind="rubber" if isinstance(part.material, Rubber) else "elastic",
                **{field.name: float(getattr(part.material, field.name)) for field in dataclasses.fields(Elastic)},
            ),
        )
        for part in mesh.parts
    )  # fmt: skip
    seen = mesh.surface
    surface = MeshSurfaceEntry(
        nodes=PackedArray.of(seen.nodes), weights=PackedArray.of(seen.weights), triangles=PackedArray.of(seen.triangles)
    )
    return FlexibleMeshEntry(
        name=mesh.name, points=PackedArray.of(mesh.points), places=PackedArray.of(mesh.places), parts=parts,
        bodies=PackedArray.of(np.array(mesh.bodies, np.int32)), double=mesh.double, shapes=mesh.shapes,
        glued=tuple(node for node, is_glued in enumerate(mesh.glued) if is_glued),
        surface=surface if seen.is_embedded else None,
        contact="faces" if mesh.contact is MeshContact.FACES else "nodes",
    )  # fmt: skip


# ---- from entries ----------------------------------------------------------------------------------------------------


def builder_of(entry: ModelEntry, place: Place) -> ModelBuilder:
    """The builder of a file: every rule of the builder's own methods holds."""
    with _errors_at(place):
        builder = ModelBuilder(entry.gravity, friction_rule=entry.friction_rule, pair_rule=entry.pair_rule)
    made: dict[str, Callable[[Any, NameColumns], Any]] = {
        "hulls": lambda part, _: _hull(part),
        "height_fields": lambda part, _: _height_field(part),
        "meshes": lambda part, _: _mesh(part),
        "sprocket_profiles": lambda part, _: _sprocket_profile(part),
        "bodies": _body,
        "joints": lambda part, taken: _joint(builder, part, taken),
        "couplings": lambda part, taken: _coupling(builder, part, taken),
        "shapes": lambda part, taken: _shape(builder, part, taken),
        "flexible_meshes": lambda part, taken: _flexible_mesh(builder, part, taken),
    }
    for room, make in made.items():
        taken = NameColumns()
        for index, part in enumerate(getattr(entry, room)):
            with _errors_at(place.at(room, index)):
                getattr(builder, room).append(make(part, taken))
    pairs: dict[str, Callable[[Any], None]] = {
        "excluded_bodies": lambda pair: builder.exclude_collision(*pair),
        "excluded_shapes": lambda pair: builder.exclude_shapes(*pair),
        "given_pairs": lambda given: builder.add_shape_pair(*given.shapes, material=given.material),
    }
    for room, add in pairs.items():
        for index, part in enumerate(getattr(entry, room)):
            with _errors_at(place.at(room, index)):
                add(part)
    return builder


@contextlib.contextmanager
def _errors_at(place: Place) -> Iterator[None]:
    """Errors of what is built inside name the place in the file."""
    try:
        yield
    except ModelError as error:
        raise ModelError(place.line(Fault(place.keys, str(error)))) from None


class NameColumns:
    """Names of one kind of thing, and the columns of `joint_q` in the order of its joints."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.columns: list[JointType] = []

    def new(self, kind: str, name: str) -> str:
        """The thing for errors, or a ModelError where its name is no name or there already."""
        thing = checked_name(kind, name)
        if name in self.names:
            raise ModelError(f"{thing}: the name must be unique, got it twice; choose another")
        self.names.add(name)
        return thing


def _unit(thing: str, field: str, values: tuple[float, ...]) -> Array:
    """A unit quaternion as it is: to normalise it again would change its last bits."""
    array = np.array(values, np.float64)
    if not abs(float(np.linalg.norm(array)) - 1.0) <= ROUNDING:
        raise ModelError(
            f"{thing}: {field} must be a unit quaternion (xyzw), got {formatted(array)}; divide by its length"
        )
    return array


def _frame(thing: str, field: str, entry: FrameEntry) -> Frame:
    return Frame(np.array(entry.position, np.float64), _unit(thing, f"{field}.rotation", entry.rotation))


def _pose(thing: str, entry: BodyEntry | ShapeEntry) -> Pose:
    return Pose(np.array(entry.position, np.float64), _unit(thing, "rotation", entry.rotation))


def _body(entry: BodyEntry, taken: NameColumns) -> BodySpec:
    thing = taken.new("body", entry.name)
    inertia = np.zeros((3, 3))
    if entry.posed and entry.mass != 0.0:
        raise ModelError(f"{thing}: mass must be 0 of a body that is posed, got {formatted(entry.mass)}; write 0")
    if entry.mass != 0.0:
        positive_number(thing, "mass", entry.mass, "kg", "0 is that of a frame between joints")
        inertia = checked_inertia(thing, entry.inertia, strict=False)
    elif np.any(entry.inertia):
        raise ModelError(f"{thing}: without mass the inertia must be 0, got {formatted(entry.inertia)}; leave it out")
    return BodySpec(
        entry.name, entry.mass, inertia, _pose(thing, entry), np.array(entry.velocity, np.float64),
        np.array(entry.omega, np.float64), entry.posed,
    )  # fmt: skip


def _joint(builder: ModelBuilder, entry: JointEntry, taken: NameColumns) -> JointSpec:
    thing = taken.new("joint", entry.name)
    kind = checked_member(thing, "type", entry.type, JointType)
    most = len(builder.bodies) - 1
    for field in ("parent", "child"):
        whole_number(thing, field, getattr(entry, field), WORLD, most, "count bodies from 0; -1 is the world")
    frame0, frame1 = _frame(thing, "frame0", entry.frame0), _frame(thing, "frame1", entry.frame1)
    if kind in FREE_OF_BODIES:
        _want(thing, "parent and child", (entry.parent, entry.child), (WORLD, WORLD), kind)
    elif entry.parent == entry.child:
        raise ModelError(f"{thing}: parent and child must differ, got {entry.parent} for both; name two bodies")
    if kind == JointType.FREE:
        _want(thing, "parent", entry.parent, WORLD, kind)
        _want(thing, "frame0", entry.frame0, FrameEntry(), kind)
        check_floats(thing, entry.child, builder.bodies[entry.child].name, builder.joints)
    if kind == JointType.RELATIVE_ROTATION:  # nothing acts on it
        _want(thing, "dofs", entry.dofs, (), kind)
    dofs = checked_dofs(thing, kind.name, len(ELEMENTS[kind].dofs), tuple(dof_of(dof) for dof in entry.dofs))
    if entry.closes_loop and kind not in (JointType.FIXED, JointType.SPHERICAL):
        _want(thing, "closes_loop", True, False, kind)
    if kind in (JointType.ROD, JointType.REVOLUTE_SPHERICAL, JointType.ELASTIC):
        positive_number(thing, "offset", entry.offset, "m", "give the distance of its ends")
    elif kind != JointType.REVOLUTE_TRANSLATIONAL:
        _want(thing, "offset", entry.offset, 0.0, kind)
    if kind == JointType.SHAFT:
        positive_number(thing, "inertia", entry.inertia, "kg·m²", "couple joints directly if it has none")
    else:
        _want(thing, "inertia", entry.inertia, 0.0, kind)
        _want(thing, "initial_qd", entry.initial_qd, 0.0, kind)
    if kind not in FREE_OF_BODIES:
        _want(thing, "initial_q", entry.initial_q, 0.0, kind)
    if kind == JointType.COMBINATION:
        _check_terms(thing, entry.terms, taken.columns)
    else:
        _want(thing, "terms", entry.terms, (), kind)
    taken.columns += [kind] * len(dofs)
    return JointSpec(
        entry.name, kind, entry.parent, entry.child, frame0, frame1, dofs, offset=entry.offset, inertia=entry.inertia,
        initial_q=entry.initial_q, initial_qd=entry.initial_qd, closes_loop=entry.closes_loop, terms=entry.terms,
    )  # fmt: skip


def _want(thing: str, field: str, value: Any, wanted: Any, kind: JointType) -> None:
    """A field that has one value only in joints of a kind."""
    if value != wanted:
        raise ModelError(
            f"{thing}: {field} must be {formatted(wanted)} in a joint of type {kind.name.lower()}, "
            f"got {formatted(value)}; "
            "leave it out"
        )


def _check_terms(thing: str, terms: tuple[tuple[int, float], ...], columns: list[JointType]) -> None:
    """Terms of a coupling or combination: columns of joints, each with a factor."""
    if not 1 <= len(terms) <= MAX_COUPLING_TERMS:
        raise ModelError(f"{thing}: needs 1 to {MAX_COUPLING_TERMS} terms, got {len(terms)}; chain couplings")
    for column, factor in terms:
        whole_number(thing, "a column of terms", column, 0, len(columns) - 1, "see dof_start")
        if columns[column] == JointType.COMBINATION:
            raise ModelError(f"{thing}: column {column} must not be that of a combination; name its own terms")
        if finite_number(thing, "coefficient", factor) == 0.0:
            raise ModelError(f"{thing}: coefficient must not be 0, got 0.0; leave the term out")


def _coupling(builder: ModelBuilder, entry: CouplingEntry, taken: NameColumns) -> CouplingSpec:
    thing = taken.new("coupling", entry.name)
    if not taken.columns:
        taken.columns = [joint.type for joint in builder.joints for _ in joint.dofs]
    _check_terms(thing, entry.terms, taken.columns)
    return CouplingSpec(entry.name, entry.terms, entry.offset, entry.damping)


def _shape(builder: ModelBuilder, entry: ShapeEntry, taken: NameColumns) -> ShapeSpec:
    thing = taken.new("shape", entry.name)
    kind = checked_member(thing, "type", entry.type, ShapeType)
    whole_number(thing, "body", entry.body, WORLD, len(builder.bodies) - 1, "count bodies from 0; -1 is the world")
    known = len(getattr(builder, ROOMS[kind])) if kind in ROOMS else 0
    least = 0 if kind in ROOMS else -1
    whole_number(thing, "asset", entry.asset, least, known - 1, f"count {ROOMS.get(kind, 'none: leave it out')} from 0")
    size = checked_size(thing, kind, entry.size)
    return ShapeSpec(
        entry.name, entry.body, kind, _pose(thing, entry), size, checked_material(thing, entry.material), entry.margin,
        entry.group, entry.mask, entry.asset,
    )  # fmt: skip


# ---- geometries ------------------------------------------------------------------------------------------------------


def _hull(entry: HullEntry) -> Hull:
    """A hull, held to be a closed convex polyhedron: the kernels rely on it."""
    vertices, normals = (
        entry.vertices.unpacked("vertices", "float64", 3),
        entry.normals.unpacked("normals", "float64", 3),
    )
    edges, faces = entry.edges.unpacked("edges", "float64", 3), entry.faces
    corners = [corner for face in faces for corner in face]
    sides = [side for face in faces for side in zip(face, (*face[1:], *face[:1]), strict=True)]
    closed = len(faces) == len(normals) >= 4 and min(map(len, faces), default=0) >= 3 and len(edges) >= 3
    closed = closed and set(corners) == set(range(len(vertices))) and len(set(sides)) == len(sides)
    closed = closed and {(b, a) for a, b in sides} == set(sides) and len(vertices) + len(faces) == len(sides) // 2 + 2
    if not closed:
        raise ModelError("a hull must be a closed polyhedron, got faces that do not close; save it anew")
    for name, vectors in (("normals", normals), ("edges", edges)):
        if np.abs(np.linalg.norm(vectors, axis=1) - 1.0).max() > ROUNDING:
            raise ModelError(f"{name} of a hull must be unit vectors, got others; save it anew")
    levels = np.einsum("fk,fk->f", normals, vertices[[face[0] for face in faces]])
    extent = float(np.ptp(vertices, axis=0).max())
    if extent <= 0.0 or max(float((vertices @ n).max() - level) for n, level in zip(normals, levels, strict=True)) > (
        BULGE * extent
    ):
        raise ModelError("a hull must be convex, got corners outside of its faces; save it anew")
    return Hull(vertices, faces, normals, edges)


def _height_field(entry: HeightFieldEntry) -> HeightField:
    heights = entry.heights.unpacked("heights", "float32")
    if heights.ndim != 2 or min(heights.shape) < 2:
        raise ModelError(
            f"heights must be (rows >= 2, columns >= 2), got shape {formatted(heights.shape)}; save it anew"
        )
    return HeightField(heights, entry.spacing)


def _mesh(entry: MeshEntry) -> TriangleMesh:
    vertices, triangles = (
        entry.vertices.unpacked("vertices", "float32", 3),
        entry.triangles.unpacked("triangles", "int32", 3),
    )
    # changes nothing in a mesh that it has made
    return triangle_mesh(vertices, triangles)


def _sprocket_profile(entry: SprocketProfileEntry) -> SprocketProfile:
    profile = SprocketProfile(entry.teeth, entry.arc_center_radius, entry.arc_radius, entry.arc_offset)
    return checked_profile("sprocket profile", profile)


def _flexible_mesh(builder: ModelBuilder, entry: FlexibleMeshEntry, taken: NameColumns) -> FlexibleMesh:
    thing = taken.new("mesh", entry.name)
    points, places = entry.points.unpacked("points", "float64", 3), entry.places.unpacked("places", "float64", 3)
    bodies = entry.bodies.unpacked("bodies", "int32")
    parts = tuple(_mesh_part(thing, points, part) for part in entry.parts)
    if not parts or bodies.shape != (len(points),) or places.shape != points.shape:
        raise ModelError(f"{thing}: parts must be there, bodies and places one for each of {len(points)} points")
    glued = np.zeros(len(points), bool)
    for node in entry.glued:
        glued[whole_number(thing, "glued", node, 0, len(points) - 1, "count nodes from 0")] = True
    for index in bodies.tolist():
        whole_number(thing, "bodies", index, WORLD, len(builder.bodies) - 1, "count bodies from 0; -1 is the world")
    for index in entry.shapes:
        whole_number(thing, "shapes", index, 0, len(builder.shapes) - 1, "count shapes from 0")
    mesh = FlexibleMesh(
        entry.name, points, parts, tuple(bodies.tolist()), tuple(glued.tolist()), places, entry.double, entry.shapes,
        _mesh_surface(thing, len(points), parts, entry.surface), MeshContact[entry.contact.upper()],
    )  # fmt: skip
    check_nodes(thing, mesh, builder)
    check_faces(thing, mesh, [shape.body for shape in builder.shapes])
    return mesh


def _mesh_surface(
    thing: str, count: int, parts: tuple[MeshPart, ...], entry: MeshSurfaceEntry | None
) -> MeshSurface:  # fmt: skip
    if entry is None:
        return surface_of(parts)
    nodes, weights = entry.nodes.unpacked("nodes", "int32"), entry.weights.unpacked("weights", "float64")
    return checked_surface(thing, count, nodes, weights, entry.triangles.unpacked("triangles", "int32", 3))


def _mesh_part(thing: str, points: Array, entry: MeshPartEntry) -> MeshPart:
    columns = entry.elements.shape[1:]
    kind = Rubber if entry.material.kind == "rubber" else Elastic
    material = kind(**{field.name: getattr(entry.material, field.name) for field in dataclasses.fields(Elastic)})
    part = MeshPart(
        elements=entry.elements.unpacked("elements", "int32", *columns), material=material, thickness=entry.thickness,
        pressure=entry.pressure, fill=None if entry.fill is None else entry.fill.unpacked("fill", "float64"),
    )  # fmt: skip
    return checked_part(thing, points, part)
