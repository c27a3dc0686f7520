"""SolidWorks assemblies, from the Python script that the Chrono add-in exports: parts, and mates summed to joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import frame_from_axis, matrix_of, rotate
from simwarp.core.types import JointType, ModelError, Pose, formatted, pose as make_pose
from simwarp.core.wording import nearest
from simwarp.importers.imported import Imported
from simwarp.importers.links.link_frames import composed, point_of
from simwarp.importers.links.link_tree import Link, LinkJoint, assemble, floating_joints, frame_on, unchanged_on_error
from simwarp.importers.links.link_visuals import visuals_of_links
from simwarp.importers.report import ImportReport
from simwarp.importers.self_collision import SelfCollision, checked_self_collision, set_self_collision
from simwarp.importers.solidworks.exported_script import Record, Script, ScriptReader
from simwarp.importers.solidworks.mates import KINDS, SETTINGS, Mate, between, mate_name, read_mate, rest_of
from simwarp.importers.solidworks.solidworks_parts import PartReader, is_true
from simwarp.importers.source_files import FileFolders, bytes_of, source_file
from simwarp.model.builder import ModelBuilder
from simwarp.model.checks import checked_pose

Array = npt.NDArray[np.float64]

REFUSABLE: Final = {
    "statement": "not written by the exporter",
    "mates": "the motion that they leave is no joint",
    "link": "only mates are read; motors and springs are added by hand",
    "collision shape": "no shape of ours has this geometry",
}
"""Kinds of elements that are refused, with the reason."""

UP: Final[Mapping[str, tuple[float, float, float, float]]] = MappingProxyType(
    {"z": (0.0, 0.0, 0.0, 1.0), "y": (float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))}
)
"""Rotation of a world whose vertical is that axis into ours: for y, (x, y, z) becomes (x, -z, y)."""


def load_solidworks(
    path: str | Path,
    builder: ModelBuilder | None = None,
    *,
    base: str | None = None,
    pose: Pose | None = None,
    prefix: str = "",
    up: Literal["y", "z"] = "z",
    folders: Collection[str | Path] = (),
    self_collision: SelfCollision = None,
    allow: Collection[str] = (),
) -> Imported:
    """An assembly of the script that Chrono::SolidWorks exports. The script is read as data: nothing in it runs.

    The mates between two parts are summed; what they leave is their joint, named by them ("Concentric1+Coincident1").
    It turns positively about the direction of its first mate, seen from the part that is nearer to the ground. Parts
    that the file fixes are welded to the world; others that no chain of joints holds float, with six coordinates.

    Args:
        path: the exported .py file.
        builder: to add to; a new one when None.
        base: name of a part to weld to the world besides.
        pose: of the file's world in ours; identity when None.
        prefix: of all names.
        up: the file's vertical axis.
        folders: in which meshes may lie, besides that of the file.
        self_collision: whether the parts touch each other: None as the file says (docs/import.md), True for
            all pairs, False for none, "adjacent-off" for all but those of bodies that a joint ties, "overlapping-off"
            for those that the file says and that do not overlap as built.
        allow: kinds of elements to drop with a warning where they would be refused: "statement", "mates" (the parts
            are then not tied), "link", "collision shape".

    Raises:
        ModelError: the file, one of its meshes or an argument is not usable; names the element.
    """
    if up not in UP:
        raise ModelError(f"load_solidworks: up must be 'z' or 'y', got {formatted(up)}; name the file's vertical axis")
    file = source_file(path, "load_solidworks", (".py",))
    report = ImportReport(file.name, REFUSABLE, allow)
    choice = checked_self_collision(file.name, self_collision)
    world = composed(checked_pose(f"{file.name}: import", pose), make_pose(rotation=UP[up]))
    script = ScriptReader(file.name, report).read(bytes_of(file).decode("utf-8-sig", "replace"))
    report.check()
    places = FileFolders(file, folders=folders)
    parts = PartReader(file.name, places, report, _has_half_lengths(script))
    link_of = {id(item): parts.add(item, world) for item in script.items if item.kind == "ChBodyAuxRef"}
    parts.finish()
    mates = _mates(script, link_of, file.name, report)
    grounded = _grounded(script, link_of, base, file.name)
    joints = _joints(mates, link_of, grounded, world, report)
    report.check()
    target = ModelBuilder() if builder is None else builder
    with unchanged_on_error(target):
        tied = [*(_on_world(link) for link in grounded), *joints]
        floating = floating_joints(parts.links, tied)
        result = assemble(target, parts.links, [*floating, *tied], prefix=prefix, source=file.name)
        set_self_collision(target, choice, [result.own_shapes], report)
    report.finish()
    assert result.coordinates is not None
    sites = {prefix + name: frame_on(result.frames, prefix + part, place) for name, part, place in parts.markers}
    return Imported(
        builder=target, bodies=result.bodies, dofs=result.dofs, shapes=result.shapes, coordinates=result.coordinates,
        report=report, frames=result.frames, sites=sites,
        show=visuals_of_links(parts.visuals, result.frames, result.shapes_of, prefix),
    )  # fmt: skip


def _has_half_lengths(script: Script) -> bool:
    """True for releases before 8, whose boxes are told by half lengths: they show meshes as assets, and their
    cylinders have two radii.
    """
    for item in script.items:
        if any(record.kind == "ChAssetLevel" for record in item.items if isinstance(record, Record)):
            return True
        for call in item.calls:
            numbers = [v for v in call.values if isinstance(v, (int, float)) and not isinstance(v, bool)]
            if call.method == "GetCollisionModel.AddCylinder" and len(numbers) == 3:
                return True
            if call.method == "GetCollisionModel.AddBox" and not isinstance(call.values[0], Record):
                return True
    return False


def _mates(script: Script, link_of: Mapping[int, Link], source: str, report: ImportReport) -> list[Mate]:
    found: list[Mate] = []
    for item in script.items:
        if id(item) in link_of:
            continue
        name = mate_name(item)
        if item.kind not in KINDS:
            report.refuse("link", name, f"{item.kind} is no mate{nearest(item.kind, KINDS)}")
            continue
        for call in item.calls:
            if call.method not in SETTINGS:
                report.refuse("statement", f"line {call.line}", f"{call.method} of mate '{name}' is not known")
        if is_true(item, "SetDisabled"):
            report.approximate("disabled mate", name, "left out")
            continue
        try:
            mate = read_mate(item, name, script.is_old)
        except ModelError as error:
            raise ModelError(f"{source}: {error}") from None
        for body in (mate.first, mate.second):
            if id(body) not in link_of:
                raise ModelError(f"{source}: mate '{name}' (line {item.line}): its parts must be in exported_items")
        found.append(mate)
    return found


def _grounded(script: Script, link_of: Mapping[int, Link], base: str | None, source: str) -> list[Link]:
    """Links that are welded to the world."""
    bodies = [item for item in script.items if id(item) in link_of]
    grounded = [link_of[id(body)] for body in bodies if is_true(body, "SetFixed", "SetBodyFixed")]
    if base is not None:
        names = [link.name for link in link_of.values()]
        if base not in names:
            raise ModelError(f"{source}: base must be the name of a part, got {formatted(base)}{nearest(base, names)}")
        grounded += [link for link in link_of.values() if link.name == base and link not in grounded]
    return grounded


def _joints(
    mates: Sequence[Mate], link_of: Mapping[int, Link], grounded: Sequence[Link], world: Pose, report: ImportReport
) -> list[LinkJoint]:
    """A joint for each pair of parts with mates, its parent the part that is nearer to the ground."""
    pairs = between(mates)
    depth = _depths([(link_of[a], link_of[b]) for a, b in pairs], list(link_of.values()), grounded)
    made = []
    for pair, listed in pairs.items():
        rest = rest_of(listed)
        names = list(dict.fromkeys(mate.name for mate in listed))
        title = "+".join(names)
        parent, child = sorted((link_of[part] for part in pair), key=lambda link: depth[link.name])
        if rest.kind is None:
            ends = f"'{parent.name}' and '{child.name}'"
            report.refuse(
                "mates", title, f"between {ends} they leave {rest.freedom} motions that are none of a hinge, slide, "
                "cylinder, ball or plane; add mates, or lock parts",
            )  # fmt: skip
            continue
        report.hold(f"mates {rest.kind.name.lower()}", title)
        axis = None if rest.axis is None else rotate(world.rotation, rest.axis)
        across = None
        if rest.axis is not None and rest.kind == JointType.PLANAR:  # it turns with the file's world
            across = rotate(world.rotation, matrix_of(frame_from_axis(title, rest.axis))[:, 0])
        made.append(
            LinkJoint(
                name=title, kind=rest.kind, parent=parent.name, child=child.name, anchor=point_of(world, rest.anchor),
                axis=axis, direction=across,
            )
        )  # fmt: skip
    return made


def _depths(pairs: Sequence[tuple[Link, Link]], links: Sequence[Link], grounded: Sequence[Link]) -> dict[str, int]:
    """Place of each link in a walk from the ground, then from the first link that is not reached, and so on."""
    order: dict[str, int] = {}
    for start in [*grounded, *links]:
        front = [] if start.name in order else [start.name]
        for name in front:
            order.setdefault(name, len(order))
            for a, b in pairs:
                other = b.name if a.name == name else a.name if b.name == name else None
                if other is not None and other not in order and other not in front:
                    front.append(other)
    return order


def _on_world(link: Link) -> LinkJoint:
    return LinkJoint(
        name=f"{link.name}_world", kind=JointType.FIXED, parent=None, child=link.name, anchor=link.pose.position
    )
