"""Geoms of MJCF: contact shapes with their friction, exactly the pairs that MuJoCo lets meet, and what only shows."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np
import numpy.typing as npt

from simwarp.core.types import FrictionRule, Material, ShapeType
from simwarp.geometry.visual_mesh import VisualMesh, linear_from_srgb
from simwarp.importers.links.link_meshes import add_hulls, collision_hulls
from simwarp.importers.links.link_visuals import add_part
from simwarp.importers.mjcf.mjcf_source import DEFAULT_SOLIMP, DEFAULT_SOLREF, Source
from simwarp.importers.mjcf.mjcf_unsupported import is_off
from simwarp.model.model import meeting_pairs
from simwarp.model.shapes import NOT_CONVEX

if TYPE_CHECKING:
    from simwarp.sensors.scene import Visuals

Array = npt.NDArray[np.float64]

GROUP_BITS: Final = 0x7FFFFFFF
RIGID_CONTACT: Final = "contacts are rigid, without MuJoCo's softness"


def add_shapes(source: Source) -> dict[str, tuple[int, ...]]:
    """Adds every geom that can touch something; returns shape slots by name."""
    model = source.model
    wanted = colliding_geoms(model)
    names: dict[str, tuple[int, ...]] = {}
    hulls: dict[int, tuple[list[Array], float]] = {}
    for geom in range(model.ngeom):
        label = source.label("geom", geom)
        if not wanted[geom]:
            source.report.hold("geom visual", label, "only shows")
            continue
        _check_geom(source, geom)
        shapes = _add_geom(source, geom, hulls)
        if shapes:
            source.shapes[geom] = names[source.name("geom", geom)] = shapes
    if set_pairs(source):
        source.report.hold("contact", "", "rigid, with round friction cones: see docs/theory.md")
    return names


def shapes_by_root(source: Source) -> list[list[int]]:
    """Our shapes of each body of the world with all that hangs on it; the world's own are left out."""
    found: dict[int, list[int]] = {}
    for geom, shapes in source.shapes.items():
        root = int(source.model.body_rootid[source.model.geom_bodyid[geom]])
        if root != 0:
            found.setdefault(root, []).extend(shapes)
    return list(found.values())


def colliding_geoms(model: Any) -> npt.NDArray[np.bool_]:
    """(ngeom,) geoms that contact masks or explicit pairs name."""
    wanted: npt.NDArray[np.bool_] = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    wanted[model.pair_geom1] = wanted[model.pair_geom2] = True
    return wanted


def _check_geom(source: Source, geom: int) -> None:
    """What a geom may carry that has other equations here, or none."""
    model, report, label = source.model, source.report, source.label("geom", geom)
    if model.geom_margin[geom] != 0.0 or model.geom_gap[geom] != 0.0:
        report.approximate("geom margin", label, "margin and gap are 0")
    if np.any(model.geom_solref[geom] != DEFAULT_SOLREF) or np.any(model.geom_solimp[geom] != DEFAULT_SOLIMP):
        report.approximate("geom solref", label, RIGID_CONTACT)
    if np.any(model.geom_surfacevel[geom]):
        report.refuse("surfacevel", label)
    if np.any(model.geom_adhesion[geom]):
        report.refuse("adhesion", label)
    if (int(model.geom_contype[geom]) | int(model.geom_conaffinity[geom])) & ~GROUP_BITS:
        report.approximate("geom contype", label, "the highest of 32 bits is left out")


def _material(source: Source, geom: int) -> Material:
    """Friction by `condim`: 1 has none, 3 slides, 4 also spins, 6 also rolls."""
    slide, spin, roll = (float(value) for value in source.model.geom_friction[geom])
    dimensions = int(source.model.geom_condim[geom])
    return Material(
        friction=slide if dimensions >= 3 else 0.0,
        spinning_friction=spin if dimensions >= 4 else 0.0,
        rolling_friction=roll if dimensions >= 6 else 0.0,
        priority=int(source.model.geom_priority[geom]),
    )


def _add_geom(source: Source, geom: int, hulls: dict[int, tuple[list[Array], float]]) -> tuple[int, ...]:
    """Shape slots of a geom; none where it is refused."""
    model, data, builder = source.model, source.data, source.builder
    body = source.bodies[model.geom_bodyid[geom]]
    frame = source.attached(body, source.pose_of_axes(data.geom_xpos[geom], data.geom_xmat[geom]))
    size = model.geom_size[geom]
    options: dict[str, Any] = {
        "name": source.name("geom", geom), "pose": frame.pose, "material": _material(source, geom),
        "group": int(model.geom_contype[geom]) & GROUP_BITS, "mask": int(model.geom_conaffinity[geom]) & GROUP_BITS,
    }  # fmt: skip
    kind = mujoco.mjtGeom(model.geom_type[geom])
    label = source.label("geom", geom)
    source.report.hold(f"geom {kind.name.removeprefix('mjGEOM_').lower()}", label)
    match kind:
        case mujoco.mjtGeom.mjGEOM_HFIELD:
            return (_add_height_field(source, geom, body, options),)
        case mujoco.mjtGeom.mjGEOM_MESH:
            return _add_hulls(source, geom, body, options, hulls)
        case _ if kind in (kinds := primitive_kinds()):
            return (builder.add_shape_primitive(body, kinds[kind], size, **options),)
        case _:
            source.report.refuse(f"geom {kind.name.removeprefix('mjGEOM_').lower()}", label)
            return ()


def primitive_kinds() -> dict[Any, ShapeType]:
    """Our kind of shape of geoms without an asset."""
    names = ("PLANE", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
    return {getattr(mujoco.mjtGeom, f"mjGEOM_{name}"): ShapeType[name] for name in names}


def _add_hulls(
    source: Source, geom: int, body: int, options: dict[str, Any], hulls: dict[int, tuple[list[Array], float]]
) -> tuple[int, ...]:
    """The hull of a mesh, or those of its convex parts, of 64 corners at most; MuJoCo takes all of them. `hulls` are
    those of meshes seen before.
    """
    mesh, label = int(source.model.geom_dataid[geom]), source.label("geom", geom)
    if mesh not in hulls:
        points, triangles = mesh_points(source.model, mesh), mesh_triangles(source.model, mesh)
        hulls[mesh] = collision_hulls(f"geom '{label}'", points, triangles, source.decompose)
    parts, off = hulls[mesh]
    if off > 0.0:
        what = f"its hull has {len(parts[0])} corners" if len(parts) == 1 else f"its {len(parts)} hulls have 64 at most"
        why = f"{what}, others lie up to {1e3 * off:.2g} mm outside it"
        source.report.approximate("geom mesh corners", label, why)
    return add_hulls(source.builder, body, parts, **options)


def _add_height_field(source: Source, geom: int, body: int, options: dict[str, Any]) -> int:
    """Heights above the geom's plane; the base below it is left out, since the ground is solid."""
    model, field = source.model, int(source.model.geom_dataid[geom])
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    first = int(model.hfield_adr[field])
    half_x, half_y, top, _ = model.hfield_size[field]
    heights = top * np.asarray(model.hfield_data[first : first + rows * columns], np.float64).reshape(rows, columns)
    return source.builder.add_shape_height_field(body, heights, size=(2.0 * half_x, 2.0 * half_y), **options)


def mesh_triangles(model: Any, mesh: int) -> npt.NDArray[np.int64]:
    """(T, 3) vertices of a mesh's triangles."""
    first = int(model.mesh_faceadr[mesh])
    return np.asarray(model.mesh_face[first : first + int(model.mesh_facenum[mesh])], np.int64)


def mesh_points(model: Any, mesh: int) -> Array:
    """(N, 3) vertices of a mesh in the frame of its geoms [m]."""
    first = int(model.mesh_vertadr[mesh])
    return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], np.float64)


def set_pairs(source: Source) -> bool:
    """Makes the pairs of shapes that can meet, and their friction, those of MuJoCo: by masks, parents, excluded bodies
    and explicit pairs. Returns whether there are any.
    """
    wanted = wanted_pairs(source)
    builder = source.builder
    own = {slot for shapes in source.shapes.values() for slot in shapes}
    given = {pair for pair in meeting_pairs(builder) if own.issuperset(pair)}
    frictions = pair_frictions(source, wanted)
    for low, high in sorted((wanted - given) | set(frictions)):
        builder.add_shape_pair(low, high, material=frictions.get((low, high)))
    for low, high in sorted(given - wanted):
        builder.exclude_shapes(low, high)
    return bool(wanted)


def wanted_pairs(source: Source) -> set[tuple[int, int]]:
    """Pairs of our shape slots that MuJoCo lets meet."""
    model = source.model
    if is_off(model, "contact"):
        return set()
    by_parent = not is_off(model, "filterparent")
    apart = {(int(each) >> 16, int(each) & 0xFFFF) for each in model.exclude_signature}
    pairs: set[tuple[int, int]] = set()
    for one, other in itertools.combinations(sorted(source.shapes), 2):
        types = int(model.geom_contype[one]), int(model.geom_contype[other])
        affinities = int(model.geom_conaffinity[one]), int(model.geom_conaffinity[other])
        if not (types[0] & affinities[1] or types[1] & affinities[0]):
            continue
        bodies = int(model.geom_bodyid[one]), int(model.geom_bodyid[other])
        if bodies in apart or bodies[::-1] in apart or _held_apart(model, bodies, by_parent):
            continue
        pairs.add((one, other))
    for one, other in zip(model.pair_geom1, model.pair_geom2, strict=True):
        if source.bodies[model.geom_bodyid[one]] != source.bodies[model.geom_bodyid[other]]:
            pairs.add((int(min(one, other)), int(max(one, other))))
    kinds = source.builder.shapes
    found = {
        (min(low, high), max(low, high))
        for one, other in pairs
        for low, high in itertools.product(source.shapes.get(one, ()), source.shapes.get(other, ()))
    }
    return {(low, high) for low, high in found if not {kinds[low].type, kinds[high].type} <= set(NOT_CONVEX)}


def _held_apart(model: Any, bodies: tuple[int, int], by_parent: bool) -> bool:
    """True of one and the same moving body, of two fixed ones, and of a parent and its child but for the world."""
    welded = int(model.body_weldid[bodies[0]]), int(model.body_weldid[bodies[1]])
    if welded[0] == welded[1]:
        return True
    if not by_parent or 0 in welded:
        return False
    parents = [int(model.body_weldid[model.body_parentid[body]]) for body in welded]
    return welded[0] == parents[1] or welded[1] == parents[0]


def pair_frictions(source: Source, pairs: set[tuple[int, int]]) -> dict[tuple[int, int], Material]:
    """Surfaces of the pairs whose friction the two geoms do not give by priority and the builder's rule."""
    model, rule = source.model, source.builder.friction_rule
    geom_of = {slot: geom for geom, slots in source.shapes.items() for slot in slots}
    explicit = {
        (int(min(one, other)), int(max(one, other))): index
        for index, (one, other) in enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True))
    }
    found = {}
    for low, high in pairs:
        one, other = sorted((geom_of[low], geom_of[high]))
        theirs = pair_friction(model, (one, other), explicit.get((one, other)))
        mine = combined_friction([_material(source, geom) for geom in (one, other)])
        if rule is not FrictionRule.MAX or not np.allclose(mine, theirs, rtol=1e-12, atol=0.0):
            slide, spin, roll = (float(value) for value in theirs)
            found[low, high] = Material(friction=slide, spinning_friction=spin, rolling_friction=roll)
    return found


def combined_friction(materials: list[Material]) -> Array:
    """(slide, spin, roll) of two of our surfaces under the rule "max"."""
    first, second = materials
    rows = np.array([[m.friction, m.spinning_friction, m.rolling_friction] for m in materials])
    if first.priority != second.priority:
        return np.asarray(rows[int(second.priority > first.priority)])
    return np.asarray(rows.max(axis=0))


def pair_friction(model: Any, geoms: tuple[int, ...], pair: int | None) -> Array:
    """(slide, spin, roll) that MuJoCo gives a contact."""
    if pair is not None:
        dimensions, values = int(model.pair_dim[pair]), model.pair_friction[pair][[0, 2, 3]]
    else:
        priorities = [int(model.geom_priority[geom]) for geom in geoms]
        if priorities[0] != priorities[1]:
            chosen = geoms[int(priorities[1] > priorities[0])]
            dimensions, values = int(model.geom_condim[chosen]), model.geom_friction[chosen]
        else:
            dimensions = max(int(model.geom_condim[geom]) for geom in geoms)
            values = np.maximum(model.geom_friction[geoms[0]], model.geom_friction[geoms[1]])
    return np.asarray(values * (np.array([3, 4, 6]) <= dimensions), np.float64)


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
    kinds = {**primitive_kinds(), mujoco.mjtGeom.mjGEOM_MESH: ShapeType.MESH}
    kind = kinds.get(mujoco.mjtGeom(model.geom_type[geom]), ShapeType.PLANE)
    if kind is ShapeType.PLANE:
        return
    frame = source.frame(int(model.geom_bodyid[geom]), source.pose_of_axes(data.geom_xpos[geom], data.geom_xmat[geom]))
    own, mesh = int(model.geom_dataid[geom]), None
    if kind is ShapeType.MESH:
        mesh = VisualMesh(vertices=mesh_points(model, own), triangles=mesh_triangles(model, own))
    a, b, c = (float(value) for value in model.geom_size[geom])
    name = f"{source.prefix}{model.geom(geom).name or f'geom{geom}'}"
    add_part(visuals, name, frame, kind, (a, b, c), mesh, _colour(model, geom)[:3])


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
