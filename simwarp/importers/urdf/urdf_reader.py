"""URDF files: links and joints as they are, fixed joints welded, `mimic` as couplings."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError, Pose, formatted
from simwarp.importers.imported import Imported
from simwarp.importers.links.link_masses import Densities
from simwarp.importers.links.link_tree import Assembled, assemble, massless_heads, unchanged_on_error
from simwarp.importers.links.link_visuals import visuals_of_links
from simwarp.importers.report import ImportReport
from simwarp.importers.self_collision import SelfCollision, checked_self_collision, set_self_collision
from simwarp.importers.source_files import FileFolders, bytes_of, expansion_of, needed, parsed_xml, source_file
from simwarp.importers.urdf.urdf_joints import JointTree, JointValues, welded
from simwarp.importers.urdf.urdf_links import LinkReader
from simwarp.importers.urdf.urdf_listing import MASSLESS, REFUSABLE, list_elements
from simwarp.importers.urdf.urdf_transmissions import read_transmissions
from simwarp.model.builder import ModelBuilder
from simwarp.model.checks import checked_pose

Array = npt.NDArray[np.float64]

NO_PACKAGES: Final[Mapping[str, str]] = MappingProxyType({})


def load_urdf(
    path: str | Path,
    builder: ModelBuilder | None = None,
    *,
    base: Literal["fixed", "floating"] | None = None,
    pose: Pose | None = None,
    prefix: str = "",
    packages: Mapping[str, str | os.PathLike[str]] = NO_PACKAGES,
    decompose: bool | Mapping[str, Any] = False,
    density: float | Mapping[str, float] | None = None,
    self_collision: SelfCollision = None,
    allow: Collection[str] = (),
) -> Imported:
    """A robot of a URDF file.

    Links welded by fixed joints are one body, with the axes of the first of them. `qpos` of the result is, for a
    floating base, its position [m] and quaternion wxyz, then one coordinate of every joint in the order of the file
    (a planar one has three, a floating one the pose of its child in the world), mimicking joints included. The model
    stands at coordinates 0, mimicking joints at their offsets.

    Args:
        path: a .urdf file. Expand .xacro files first.
        builder: to add to; a new one when None.
        base: "fixed": the root link is welded to the world; "floating": it moves freely. Files do not tell.
        pose: of the root link's frame in the world; identity when None.
        prefix: of all names.
        packages: folder of each package that `package://` names; other files are read from the folder of the
            description, and from the package that it is in.
        decompose: take several hulls for a mesh instead of one: True, or options of `coacd.run_coacd`.
        density: of links whose mass or inertia the file does not tell, or of each by its name [kg/m³]: these come from
            the geometry of contact, or where there is none, from what is seen. A mass that is told stays.
        self_collision: whether the robot's own parts touch each other: None as the file says (docs/import.md), True for
            all pairs, False for none, "adjacent-off" for all but those of bodies that a joint ties, "overlapping-off"
            for those that the file says and that do not overlap as built.
        allow: kinds of elements to drop with a warning where they would be refused, each alone: "geometry", "origin",
            "massless link" (its joint becomes fixed), "mesh", "size" (a shape without extent), "mimic",
            "repeated element" (the first stays), "transmission".

    Raises:
        ModelError: the file, one of its meshes or an argument is not usable; names the element.
    """
    file = _checked_file(path, base)
    assert base is not None
    report = ImportReport(file.name, REFUSABLE, allow)
    placed = checked_pose(f"{file.name}: import", pose)
    choice = checked_self_collision(file.name, self_collision)
    root = parsed_xml(file.name, bytes_of(file))
    list_elements(root, file.name, report)
    transmissions = root.findall("transmission")
    capsules = _hidden_capsules(root)
    robot = _parsed(root, file.name)
    densities = None if density is None else Densities(file.name, density, "link")
    links = LinkReader(file.name, FileFolders(file, packages), report, capsules, decompose, densities)
    for link in robot.links:
        links.add(link, robot.materials)
    links.finish()
    if densities is not None:
        densities.check()
    report.check()
    joints = JointTree(file.name, robot, report)
    values = joints.placed(links.links, base, placed)
    values = _without_massless(links, values, report)
    report.check()
    target = ModelBuilder() if builder is None else builder
    with unchanged_on_error(target):
        assembled = assemble(target, links.links, [value.joint for value in values], prefix=prefix, source=file.name)
        _couple(target, assembled, values, prefix)
        set_self_collision(target, choice, [assembled.own_shapes], report)
        actuators = read_transmissions(transmissions, values, assembled, prefix, report)
        report.check()
    report.finish()
    assert assembled.coordinates is not None
    return Imported(
        builder=target, bodies=assembled.bodies, dofs=assembled.dofs, shapes=assembled.shapes,
        coordinates=assembled.coordinates, report=report, frames=assembled.frames, actuators=actuators,
        effort_limits={prefix + v.joint.name: v.effort for v in values if v.effort is not None},
        velocity_limits={prefix + v.joint.name: v.velocity for v in values if v.velocity is not None},
        show=visuals_of_links(links.visuals, assembled.frames, assembled.shapes_of, prefix),
    )  # fmt: skip


def _checked_file(path: str | Path, base: Any) -> Path:
    """The file, where it and the base are usable."""
    if base not in ("fixed", "floating"):
        raise ModelError(
            f"load_urdf: base must be 'fixed' or 'floating', got {formatted(base)}; a URDF does not tell "
            "whether its root link is welded to the world"
        )
    name = Path(path).name if isinstance(path, (str, os.PathLike)) else "URDF"
    if name.endswith(".xacro"):
        raise ModelError(f"{name}: a .xacro file must be expanded first; run: {expansion_of(Path(path))}")
    return source_file(path, "load_urdf", (".urdf", ".xml"))


def _hidden_capsules(root: Any) -> set[tuple[str, str, int]]:
    """(link, visual or collision, its number) of every capsule, which becomes a cylinder in the tree: yourdfpy knows
    none.
    """
    found = set()
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for number, part in enumerate(link.findall(kind)):
                for capsule in part.findall("geometry/capsule"):
                    capsule.tag = "cylinder"
                    found.add((link.get("name"), kind, number))
    return found


def _parsed(root: Any, source: str) -> Any:
    """The robot as yourdfpy reads it: neither meshes nor kinematics."""
    yourdfpy = needed("yourdfpy", f"{source}: reading URDF")
    etree = needed("lxml.etree", f"{source}: reading URDF")
    logging.getLogger("yourdfpy").addHandler(logging.NullHandler())
    try:
        text = io.BytesIO(etree.tostring(root))
        return yourdfpy.URDF.load(
            text, build_scene_graph=False, load_meshes=False, build_collision_scene_graph=False,
            load_collision_meshes=False,
        ).robot  # fmt: skip
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        raise ModelError(f"{source}: must be a URDF that yourdfpy reads, got {error!r}; check the file") from error


def _without_massless(links: LinkReader, values: list[JointValues], report: ImportReport) -> list[JointValues]:
    """The joints, those of links that move without mass refused, or welded where that is allowed."""
    while names := massless_heads(links.links, [value.joint for value in values]):
        weldable = {value.joint.child for value in values if value.joint.parent is not None}
        for name in names:
            remedy = "load with density=1000 (kg/m³) for mass by its geometry, " if name in links.weighable else ""
            report.refuse("massless link", name, MASSLESS.format(remedy))
            if name not in weldable:
                raise ModelError(
                    f"{report.source}: link '{name}' floats, but it has no mass or no inertia, nor has what is welded "
                    f"to it; give it an <inertial>, {remedy}or load with base='fixed'"
                )
        if not report.is_allowed("massless link"):
            return values
        values = [welded(value) if value.joint.child in names else value for value in values]
    return values


def _couple(builder: ModelBuilder, assembled: Assembled, values: list[JointValues], prefix: str) -> None:
    """Q = multiplier x q of the other joint + offset; both are 0 as built, where the offset stands already."""
    for value in values:
        if value.mimic is None or prefix + value.joint.name not in assembled.joints:
            continue
        terms = [(assembled.joints[prefix + value.joint.name], 1.0)]
        leader = prefix + value.mimic[0]
        if value.mimic[1] != 0.0 and leader in assembled.dofs:
            terms.append((assembled.joints[leader], -value.mimic[1]))
        builder.add_coupling(f"{prefix}{value.joint.name}_mimic", terms)
