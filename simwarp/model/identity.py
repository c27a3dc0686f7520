"""Identity of a model and of a Simulation, so that a state is only ever restored where it belongs."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from simwarp.core import file_keys
from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import Dof, FrictionRule, Material, PairRule, formatted
from simwarp.geometry.assets import HeightField, Hull, TriangleMesh
from simwarp.geometry.sprocket_profiles import SprocketProfile
from simwarp.meshes.mesh_specification import FlexibleMesh, MeshContact
from simwarp.model.effort_routing import drive_mode, has_bounded_drive, has_effort
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.specifications import JointSpec, ShapeSpec, Specification

VERSION: Final = "1"
"""Of the layout of states: another one is another identity."""

LONGEST_PART: Final = 60
WORLDS: Final = "worlds"
PART_ARRAYS: Final = "arrays of force elements and sensors"
OF_ALL_WORLDS: Final = (WORLDS, PART_ARRAYS)
"""Parts that depend on the number of worlds."""


@dataclasses.dataclass(frozen=True, repr=False)
class Identity(Readable):
    """Composition of a Simulation, in lines that people read.

    Part of it are the worlds, bodies, joints with their kinds, stops and drives, couplings, shapes with their
    geometries, capacities, force elements and sensors. Not part of it are the values of what may differ per world
    (`PARAMETERS`: masses, frictions, sizes ...), poses as built, and the numbers of the solver: a snapshot holds none
    of them, and whoever randomises them restores the same snapshot under all.

    Attributes:
        parts: lines by section.
        digest: of all of them: equal ones mean equal simulations.
    """

    parts: Mapping[str, tuple[str, ...]]
    digest: str

    def _readable_title(self) -> str:
        lines = sum(len(part) for part in self.parts.values())
        return f": {self.digest}, {plural(lines, 'line')} in {plural(len(self.parts), 'part')}"

    @classmethod
    def of(cls, parts: Mapping[str, Sequence[str]]) -> Identity:
        """That of the given sections."""
        lines = {name: tuple(values) for name, values in parts.items()}
        text = "\0".join(f"{name}\1" + "\2".join(values) for name, values in lines.items())
        return cls(lines, _digest(text.encode("utf-8")))

    def extended(self, parts: Mapping[str, Sequence[str]]) -> Identity:
        """With more sections."""
        return Identity.of({**self.parts, **parts})

    def of_each_world(self) -> Identity:
        """That of a single world: simulations of equal ones can be copied world by world, whatever their numbers."""
        return Identity.of({name: lines for name, lines in self.parts.items() if name not in OF_ALL_WORLDS})

    def difference(self, other: Identity) -> str:
        """The first thing that differs, as "its bodies: here 3, there 4"; empty for equal ones."""
        if self.digest == other.digest:
            return ""
        for name in dict.fromkeys((*self.parts, *other.parts)):
            mine, theirs = self.parts.get(name, ()), other.parts.get(name, ())
            if mine == theirs:
                continue
            if len(mine) != len(theirs):
                return f"{name}: here {len(mine)}, there {len(theirs)}"
            here, there = next(pair for pair in zip(mine, theirs, strict=True) if pair[0] != pair[1])
            return f"{name}: here {_short(here)}, there {_short(there)}"
        return "its layout"


def model_identity(builder: Specification, world_count: int, contact_capacity: int, rolling_friction: bool) -> Identity:
    """That of a model: everything that all worlds share for good."""
    assets: list[Hull | HeightField | TriangleMesh | SprocketProfile] = [
        *builder.hulls, *builder.height_fields, *builder.meshes, *builder.sprocket_profiles,
    ]  # fmt: skip
    return Identity.of(
        {
            "version": [VERSION],
            WORLDS: [str(world_count)],
            "bodies": [f"'{body.name}'" for body in builder.bodies],
            "joints": [_joint_line(joint) for joint in builder.joints],
            "couplings": [
                f"'{coupling.name}' of coordinates {', '.join(str(dof) for dof, _ in coupling.terms)}"
                for coupling in builder.couplings
            ],
            "shapes": [_shape_line(shape) for shape in builder.shapes],
            "geometries": [_asset_line(asset) for asset in assets],
            **({"flexible meshes": flexible} if (flexible := [_mesh_line(m) for m in builder.flexible_meshes]) else {}),
            "excluded pairs": [f"{a} and {b}" for a, b in sorted(builder.excluded_bodies)],
            "contact capacity": [str(contact_capacity)],
            "rolling friction": [str(rolling_friction)],
            **_contact_rules(builder),
        }
    )


def _contact_rules(builder: Specification) -> dict[str, list[str]]:
    """What is not as in models of before these rules: theirs stay readable."""
    excluded = [f"{a} and {b}" for a, b in sorted(builder.excluded_shapes)]
    given = [f"{a} and {b}{_surface_line(surface)}" for (a, b), surface in sorted(builder.given_pairs.items())]
    rules = [] if builder.friction_rule == 0 else [f"friction: {FrictionRule(builder.friction_rule).name.lower()}"]
    rules += [] if builder.pair_rule == 0 else [f"pairs: {PairRule(builder.pair_rule).name.lower()}"]
    parts = {"rules of contact": rules, "excluded pairs of shapes": excluded, "given pairs of shapes": given}
    return {name: lines for name, lines in parts.items() if lines}


def run_parts(elements: Sequence[Any], sensors: Sequence[Any], dt: float, *, share: int = 1) -> dict[str, list[str]]:
    """Parts that a Simulation adds to its model: force elements, and sensors, whose clocks count sub-steps of `dt` [s].

    `share`: of so many worlds the arrays are told of one; 1: of all.
    """
    clock = [f"sub-steps of {dt!r} s"] if sensors else []
    parts = (*elements, *sensors)
    return {
        "force elements": [_part_line(part) for part in elements],
        "sensors": [_part_line(part) for part in sensors],
        "clock of the sensors": clock,
        PART_ARRAYS: [
            f"{_part_line(part)}: {name} {array.dtype.__name__}{formatted((array.shape[0] // share, *array.shape[1:]))}"
            for part in parts
            for name, array in part.memory.items()
        ],
    }


def _part_line(part: Any) -> str:
    """Kind and name of a force element or sensor."""
    name, kind = getattr(part, "name", None), type(part).__name__
    kind = file_keys.PARTS.get(kind, kind)
    return f"{kind} '{name}'" if isinstance(name, str) else kind


def _shape_line(shape: ShapeSpec) -> str:
    ahead = f", priority {shape.material.priority}" if shape.material.priority else ""
    kind = shape.type.name.lower()
    return f"'{shape.name}' ({kind} on {shape.body}, group {shape.group}, mask {shape.mask:x}{ahead})"


def _surface_line(surface: Material | None) -> str:
    if surface is None:
        return ""
    words = ", ".join(f"{field.name}={getattr(surface, field.name)!r}" for field in dataclasses.fields(surface))
    return f" with surface {_digest(f'Material({words})'.encode())[:8]}"


def _joint_line(joint: JointSpec) -> str:
    efforts = [_effort_line(dof) for dof in joint.dofs]
    said = f" with {', '.join(efforts)}" if any(efforts) else ""
    assert len(joint.dofs) == len(ELEMENTS[joint.type].dofs)
    kind = joint.type.name.lower()
    kind = file_keys.JOINT_TYPES.get(kind, kind)
    if joint.terms:
        return f"'{joint.name}' ({kind} of coordinates {', '.join(str(dof) for dof, _ in joint.terms)}{said})"
    return f"'{joint.name}' ({kind} {joint.parent} to {joint.child}{said})"


def _effort_line(dof: Dof) -> str:
    """Parts of a coordinate's effort that are fixed when the model is made: its rows and its tables."""
    tables = [dof.spring_table, dof.damper_table, dof.damper_map, getattr(dof.drive, "table", None)]
    words = {
        "limit": dof.limit is not None,
        "friction": dof.friction > 0.0,
        "effort limit": has_bounded_drive(dof),
        "law": has_effort(dof),
        f"drive {drive_mode(dof).name.lower()}": dof.drive is not None,
        f"tables {_digest(repr(_plain(tables)).encode())[:8]}": any(table is not None for table in tables),
    }
    return " ".join(word for word, there in words.items() if there)


def _plain(value: Any) -> Any:
    """Nested tables as lists of floats: equal numbers look alike whatever held them."""
    if value is None:
        return None
    return [_plain(part) for part in value] if isinstance(value, (Sequence, np.ndarray)) else float(value)


def _asset_line(asset: Hull | HeightField | TriangleMesh | SprocketProfile) -> str:
    if isinstance(asset, Hull):
        return f"hull of {len(asset.vertices)} points {_array_digest(asset.vertices)}"
    if isinstance(asset, HeightField):
        content = _array_digest(asset.heights, np.array(asset.spacing))
        return f"height field of {formatted(asset.heights.shape)} {content}"
    if isinstance(asset, SprocketProfile):
        arcs = np.array([asset.arc_center_radius, asset.arc_radius, asset.arc_offset])
        return f"sprocket of {asset.teeth} teeth {_array_digest(arcs)}"
    return f"mesh of {len(asset.triangles)} triangles {_array_digest(asset.vertices, asset.triangles)}"


def _mesh_line(mesh: FlexibleMesh) -> str:
    arrays = [part.elements for part in mesh.parts]
    content = _array_digest(mesh.points, mesh.places, np.array([mesh.bodies, mesh.glued]), *arrays)
    touching = "" if mesh.contact is MeshContact.NODES else f", touching at {mesh.contact.name.lower()}"
    return f"'{mesh.name}' of {len(mesh.points)} nodes {content}{touching}"


def _array_digest(*arrays: Any) -> str:
    return _digest(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays))[:16]


def _digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def _short(line: str) -> str:
    return line if len(line) <= LONGEST_PART else f"{line[: LONGEST_PART - 4]} ..."
