"""Flexible bodies of MJCF, of `flexcomp` or `flex`: lines become rods, sheets shells, volumes solid meshes.

Vertices that slides move freely become nodes, with the file's masses; pins, which are fixed to other bodies, are held
there. What MuJoCo compiles away (Young's modulus, thickness) is read of its specification.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Material, ModelError
from simwarp.importers.mjcf.mjcf_shapes import GROUP_BITS
from simwarp.importers.mjcf.mjcf_source import DEFAULT_SOLIMP, DEFAULT_SOLREF, Source
from simwarp.meshes.materials import Elastic
from simwarp.meshes.mesh_columns import mesh_cost
from simwarp.meshes.volume_mesh import VolumeMesh
from simwarp.model.rod_sections import Section
from simwarp.model.rods import Clamp, Hinge

Array = npt.NDArray[np.float64]

KIND: Final = {1: "rod", 2: "shell", 3: "solid"}
"""What flexes become, by their dimension."""
SLIDES: Final = 3
"""Of a vertex that moves freely."""
TWIST: Final = "_twist(_[0-9]+)?"
"""Behind the name of a line: bodies with a hinge that MuJoCo adds for the twist of its edges."""
TWIST_MASS: Final = 1e-9
"""Of these [kg]."""


@dataclasses.dataclass(frozen=True)
class Flex:
    """A flex of the compiled model.

    Attributes:
        index: among the flexes.
        name: without prefix.
        spec: as the file gives it.
        points: (n, 3) vertices as built, our world [m].
        elements: (e, 2), (e, 3) or (e, 4) vertices of its elements.
        owners: body of the source of each vertex.
        own: vertices that move by themselves.
    """

    index: int
    name: str
    spec: Any
    points: Array
    elements: npt.NDArray[np.int32]
    owners: npt.NDArray[np.int32]
    own: tuple[int, ...]


def vertex_bodies(source: Source) -> frozenset[int]:
    """Bodies of the source that are vertices of flexes alone, or turn with their edges: they are no bodies of ours."""
    found: set[int] = set()
    for flex in _flexes(source):
        found.update(int(flex.owners[vertex]) for vertex in flex.own)
        light = np.flatnonzero(source.model.body_mass <= TWIST_MASS).tolist() if flex.elements.shape[1] == 2 else []
        twist = re.compile(re.escape(flex.name) + TWIST)
        found.update(body for body in light if twist.fullmatch(source.label("body", body)))
    return frozenset(found)


def add_flexes(source: Source) -> dict[str, int]:
    """Adds every flex that is not refused, behind the bodies that it is held by; returns its nodes by name."""
    found: dict[str, int] = {}
    for flex in _flexes(source):
        kind = _unsupported(source, flex)
        if kind is not None:
            source.report.refuse(kind, flex.name)
            continue
        try:
            nodes = _add(source, flex)
        except ModelError as error:
            raise ModelError(f"{source.report.source}: flex '{flex.name}': {error}") from None
        for vertex, node in nodes.items():
            source.bodies[flex.owners[vertex]] = node
            spec = source.builder.bodies[node]
            mass = float(source.model.body_mass[flex.owners[vertex]])
            source.builder.bodies[node] = dataclasses.replace(
                spec, mass=mass, inertia=np.asarray(spec.inertia) * (mass / spec.mass)
            )
            found[spec.name] = node
        _report(source, flex)
    return found


def _flexes(source: Source) -> list[Flex]:
    """All flexes of the model."""
    model, found = source.model, []
    for index in range(model.nflex):
        first, count = int(model.flex_vertadr[index]), int(model.flex_vertnum[index])
        owners = np.array(model.flex_vertbodyid[first : first + count], np.int32)
        size = int(model.flex_dim[index]) + 1
        start, elements = int(model.flex_elemdataadr[index]), int(model.flex_elemnum[index])
        places = source.data.flexvert_xpos[first : first + count]
        found.append(
            Flex(
                index, source.flexes[index].name or f"flex{index}", source.flexes[index],
                np.stack([source.point(place) for place in places]),
                np.array(model.flex_elem[start : start + size * elements], np.int32).reshape(-1, size), owners,
                tuple(vertex for vertex in range(count) if _moves_freely(model, owners, vertex)),
            )
        )  # fmt: skip
    return found


def _moves_freely(model: Any, owners: npt.NDArray[np.int32], vertex: int) -> bool:
    """True of a vertex with a body of its own that only three slides move."""
    body = int(owners[vertex])
    if body <= 0 or int((owners == body).sum()) > 1 or model.body_geomnum[body] or model.body_jntnum[body] != SLIDES:
        return False
    first = int(model.body_jntadr[body])
    return bool((model.jnt_type[first : first + SLIDES] == mujoco.mjtJoint.mjJNT_SLIDE).all())


def _unsupported(source: Source, flex: Flex) -> str | None:
    """The kind of refusal (`mjcf_unsupported.REFUSABLE`) that a flex meets; None: it can be built."""
    model, index, spec = source.model, flex.index, flex.spec
    if model.flex_rigid[index]:
        return "flex rigid"
    if model.flex_interp[index]:
        return "flex dof"
    if np.any(spec.stressyield):
        return "flex yield"
    if spec.elastic3d or not spec.young > 0.0:
        return "flex elasticity"
    dimension = int(model.flex_dim[index])
    if dimension == 1:
        return _unsupported_line(source, flex)
    if model.flex_edgeequality[index]:
        return "flex edge"
    if dimension == 2 and spec.elastic2d == 0:
        return "flex elasticity"
    holders = {source.bodies[body] for vertex, body in enumerate(flex.owners.tolist()) if vertex not in flex.own}
    return "flex pin" if len(holders - {WORLD}) > 1 else None


def _unsupported_line(source: Source, flex: Flex) -> str | None:
    """The same of a flex of edges."""
    model, index = source.model, flex.index
    if flex.spec.section != mujoco.mjtFlexSection.mjFLEXSECTION_CIRCLE:
        return "flex section"
    if not model.flex_edgeequality[index] and not model.flex_edgestiffness[index] > 0.0:
        return "flex edge"
    count = len(flex.points)
    in_order = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    if not np.array_equal(flex.elements, in_order):
        return "flex line"
    start, end = _held_ends(flex)
    return None if start + end + len(flex.own) == count and len(flex.own) else "flex pin"


def _held_ends(flex: Flex) -> tuple[int, int]:
    """How many vertices are held from the first on, and how many up to the last."""
    own = set(flex.own)
    free = [vertex for vertex in range(len(flex.points)) if vertex in own]
    return (free[0], len(flex.points) - 1 - free[-1]) if free else (len(flex.points), 0)


def _add(source: Source, flex: Flex) -> dict[int, int]:
    """Adds a flex; our body of each vertex that moves by itself."""
    if flex.elements.shape[1] == 2:
        return _add_rod(source, flex)
    builder, name, spec = source.builder, source.prefix + flex.name, flex.spec
    held: dict[int, list[int]] = {}
    for vertex, body in enumerate(flex.owners.tolist()):
        if vertex not in flex.own:
            held.setdefault(source.bodies[body], []).append(vertex)
    options: dict[str, Any] = {"fixed": held.pop(WORLD, []), "glue": held, **_contact(source, flex)}
    if flex.elements.shape[1] == 3:
        corners = flex.points[flex.elements]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
        material = _material(source, flex, float(areas.sum()) * spec.thickness)
        mesh = builder.add_shell(
            name, flex.points, flex.elements, thickness=spec.thickness, material=material, **options
        )
    else:
        # MuJoCo's tetrahedra go either way round
        corners = flex.points[flex.elements]
        volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
        elements = np.where((volumes < 0.0)[:, None], flex.elements[:, [0, 2, 1, 3]], flex.elements)
        material = _material(source, flex, float(np.abs(volumes).sum()))
        volume = VolumeMesh(points=flex.points, elements=elements)
        mesh = builder.add_solid_mesh(name, volume, material=material, **options)
    _set_masks(source, flex, mesh.shapes)
    return {vertex: mesh.bodies[vertex] for vertex in flex.own}


def _add_rod(source: Source, flex: Flex) -> dict[int, int]:
    """Adds a flex of edges, from the last vertex that is held at its start to the first at its end."""
    model, spec, count = source.model, flex.spec, len(flex.points)
    start, end = _held_ends(flex)
    first, last = max(start - 1, 0), count - max(end, 1)
    points = flex.points[first : last + 1]
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    radius = float(model.flex_radius[flex.index])
    second = np.pi * radius**4 / 4.0
    twist = 1.0 if spec.shear == 0.0 else spec.shear * 2.0 * (1.0 + spec.poisson) / spec.young
    area = np.pi * radius**2
    if model.flex_edgestiffness[flex.index] > 0.0:
        area = float(model.flex_edgestiffness[flex.index]) * length / (len(points) - 1) / spec.young
    section = Section(
        area=area, inertia_y=second, inertia_z=second, torsion=2.0 * second * twist, shear_y=0.9, shear_z=0.9,
        reach_y=radius, reach_z=radius,
    )  # fmt: skip
    ends = [
        None if held == 0 else (Hinge if held == 1 else Clamp)(source.bodies[flex.owners[vertex]])
        for held, vertex in ((start, first), (end, last))
    ]
    rod = source.builder.add_rod(
        source.prefix + flex.name, points, section=section, material=_material(source, flex, area * length),
        start=ends[0], end=ends[1], **_contact(source, flex),
    )  # fmt: skip
    bodies = source.builder.bodies
    for vertex, body in enumerate(rod.bodies, first):  # numbered as the file's vertices
        bodies[body] = dataclasses.replace(bodies[body], name=f"{source.prefix}{flex.name}_{vertex}")
    _set_masks(source, flex, rod.shapes)
    return {vertex: rod.bodies[vertex - first] for vertex in flex.own}


def _material(source: Source, flex: Flex, volume: float) -> Elastic:
    """Of a flex whose vertices, those that move, weigh together what so many of them do of this volume [m³]."""
    spec, mass = flex.spec, source.model.body_mass[flex.owners[list(flex.own)]].sum()
    density = float(mass) * len(flex.points) / len(flex.own) / volume
    return Elastic(
        young=spec.young, poisson=spec.poisson, density=density,
        damping_time=float(source.model.flex_damping[flex.index]),
    )  # fmt: skip


def _contact(source: Source, flex: Flex) -> dict[str, Any]:
    """Arguments of what touches others; none where the masks let it touch nothing."""
    model, index = source.model, flex.index
    if not int(model.flex_contype[index]) | int(model.flex_conaffinity[index]):
        return {}
    slide, spin, roll = (float(value) for value in model.flex_friction[index])
    dimensions = int(model.flex_condim[index])
    surface = Material(
        friction=slide if dimensions >= 3 else 0.0, spinning_friction=spin if dimensions >= 4 else 0.0,
        rolling_friction=roll if dimensions >= 6 else 0.0, priority=int(model.flex_priority[index]),
    )  # fmt: skip
    return {"radius": float(model.flex_radius[index]), "surface": surface}


def _set_masks(source: Source, flex: Flex, shapes: Sequence[int]) -> None:
    """Gives the shapes of nodes the flex's masks, which meet those of geoms by the file's rule."""
    model, slots = source.model, source.builder.shapes
    group = int(model.flex_contype[flex.index]) & GROUP_BITS
    mask = int(model.flex_conaffinity[flex.index]) & GROUP_BITS
    for shape in shapes:
        slots[shape] = dataclasses.replace(slots[shape], group=group, mask=mask)


def _report(source: Source, flex: Flex) -> None:
    """What became of a flex, and which of its equations are others."""
    model, report, index, name = source.model, source.report, flex.index, flex.name
    kind = KIND[int(model.flex_dim[index])]
    size = f"{len(flex.own)} nodes" if kind == "rod" else mesh_cost(source.builder.flexible_meshes[-1]).summary
    report.hold("flex", name, f"a {kind} of {size}")
    if kind == "rod":
        report.approximate("flex rod", name, "elements bend, shear and stretch between vertices (add_rod)")
        if model.flex_edgeequality[index]:
            report.approximate("flex edge equality", name, "edges stretch as the section of its radius does")
    elif kind == "shell":
        report.approximate("flex shell", name, "rotation-free triangles, which stretch and bend by the thickness")
    if int(model.flex_contype[index]) | int(model.flex_conaffinity[index]):
        report.approximate("flex contact", name, "spheres at vertices and capsules of rods touch, a flex not itself")
        soft = model.flex_solref[index] != DEFAULT_SOLREF, model.flex_solimp[index] != DEFAULT_SOLIMP
        if np.any(soft[0]) or np.any(soft[1]):
            report.approximate("flex solref", name, "contacts are rigid, without MuJoCo's softness")
        if model.flex_margin[index] or model.flex_gap[index]:
            report.approximate("flex margin", name, "margin and gap are 0")
    if model.flex_edgedamping[index]:
        report.approximate("flex edge damping", name, "edges are damped by the elasticity's damping alone")
