"""STEP files: one body per part, of a density; joints are the user's."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from simwarp.core.types import JointType, ModelError, Pose, ShapeType, formatted
from simwarp.core.wording import nearest
from simwarp.geometry.assets import solid_mass
from simwarp.importers.imported import Imported
from simwarp.importers.links.link_frames import composed, pose_from_matrix
from simwarp.importers.links.link_masses import Densities
from simwarp.importers.links.link_meshes import HULL_CORNERS, collision_hulls
from simwarp.importers.links.link_tree import Link, LinkJoint, LinkShape, assemble, unchanged_on_error
from simwarp.importers.links.link_visuals import LinkVisual, visuals_of_links
from simwarp.importers.report import ImportReport
from simwarp.importers.self_collision import SelfCollision, checked_self_collision, set_self_collision
from simwarp.importers.source_files import check_installed, source_file
from simwarp.model.builder import ModelBuilder
from simwarp.model.checks import checked_pose

if TYPE_CHECKING:
    from simwarp.geometry.mesh_files import MeshPart

REFUSABLE: Final = {"part": "its surface is not closed, so that it has no mass; heal it in the CAD program"}
"""Kinds of elements that are refused, with the reason."""

DEFLECTION: Final = 0.01
"""Largest distance of triangles from the surface [mm]; at 0.1 volumes differ by 1e-3."""
TURN: Final = 0.5
"""Largest angle between neighbouring triangles of a curved face [rad]."""
PATIENCE: Final = 600.0
"""Time after which the conversion of a file is given up [s]."""

CONVERT: Final = (
    "import sys; sys.modules['trimesh'] = None; import cascadio; "
    "sys.exit(cascadio.step_to_glb(sys.argv[1], sys.argv[2], {}, {}))"
)
"""In a process of its own: a kernel of CAD may crash, or go on for ever, over a broken file. cascadio can do without
trimesh, whose import takes three times as long as the conversion.
"""


def load_step(
    path: str | Path,
    builder: ModelBuilder | None = None,
    *,
    density: float | Mapping[str, float] | None = None,
    fixed: Collection[str] = (),
    pose: Pose | None = None,
    prefix: str = "",
    decompose: bool | Mapping[str, Any] = False,
    self_collision: SelfCollision = None,
    allow: Collection[str] = (),
) -> Imported:
    """The parts of a STEP file as bodies, where the file places them. A part that is used n times becomes the bodies
    name, name_1 ... They have no joints: add those of the builder.

    Args:
        path: a .step or .stp file.
        builder: to add to; a new one when None.
        density: of all parts, or of each by its name [kg/m³].
        fixed: names of bodies that are welded to the world.
        pose: of the file's world in ours; identity when None.
        prefix: of all names.
        decompose: take several hulls for a part instead of one: True, or options of `coacd.run_coacd`.
        self_collision: whether the parts touch each other: None as the file says (docs/import.md), True for
            all pairs, False for none, "adjacent-off" for all but those of bodies that a joint ties, "overlapping-off"
            for those that the file says and that do not overlap as built.
        allow: ["part"] drops parts whose surface is not closed.

    Raises:
        ModelError: the file or an argument is not usable; names the part.
    """
    file = source_file(path, "load_step", (".step", ".stp"))
    report = ImportReport(file.name, REFUSABLE, allow)
    world = checked_pose(f"{file.name}: import", pose)
    choice = checked_self_collision(file.name, self_collision)
    weights = Densities(file.name, density, "part")
    links: list[Link] = []
    visuals: list[LinkVisual] = []
    reduced = 0.0
    for name, part in _named(_converted(file)):
        if not part.closed:
            report.refuse("part", name)
            continue
        report.hold("part", name)
        thing = f"{file.name}: part '{name}'"
        hulls, off = collision_hulls(thing, part.vertices, part.triangles, decompose)
        reduced = max(reduced, off)
        mass = solid_mass(part.vertices, part.triangles, weights.of(part.name))
        shape = LinkShape(name=name, kind=ShapeType.HULL, hulls=tuple(hulls))
        links.append(Link(name=name, pose=composed(world, pose_from_matrix(part.matrix)), mass=mass, shapes=[shape]))
        visuals.append(LinkVisual(name=f"{name}_visual", link=name, kind=ShapeType.MESH, mesh=part.visible))
    weights.check()
    if reduced > 0.0:
        report.approximate(
            "collision hull", "", f"convex hulls with {HULL_CORNERS} corners, up to {reduced:.2g} m inside"
        )
    report.check()
    target = ModelBuilder() if builder is None else builder
    welds = _welds(file.name, links, fixed)
    with unchanged_on_error(target):
        result = assemble(target, links, welds, prefix=prefix, source=file.name)
        set_self_collision(target, choice, [result.own_shapes], report)
    report.finish()
    assert result.coordinates is not None
    return Imported(
        builder=target, bodies=result.bodies, dofs=result.dofs, shapes=result.shapes, coordinates=result.coordinates,
        report=report, frames=result.frames, show=visuals_of_links(visuals, result.frames, result.shapes_of, prefix),
    )  # fmt: skip


def _converted(file: Path) -> list[MeshPart]:
    """Parts of a STEP file as triangles."""
    check_installed("cascadio", f"{file.name}: reading STEP")
    from simwarp.geometry.mesh_files import load_mesh_parts  # trimesh takes a while to import

    with tempfile.TemporaryDirectory() as folder:
        output = os.path.join(folder, "parts.glb")
        command = [sys.executable, "-I", "-c", CONVERT.format(DEFLECTION, TURN), str(file.resolve()), output]
        try:
            done = subprocess.run(
                command, capture_output=True, encoding="utf-8", errors="replace", timeout=PATIENCE, check=False
            )
        except subprocess.TimeoutExpired:
            raise ModelError(
                f"{file.name}: must be a STEP file of solids, got one that takes over {PATIENCE:g} s; check its numbers"
            ) from None
        if done.returncode != 0 or not os.path.isfile(output):
            told = " ".join((done.stdout + done.stderr).split())
            reason = told[told.find("Line ") :].split("*")[0].strip() if "Line " in told else f"code {done.returncode}"
            raise ModelError(f"{file.name}: must be a STEP file of solids, got: {reason}; export it again")
        parts = load_mesh_parts(output)
    if not parts:
        raise ModelError(f"{file.name}: must hold solids, got none; export bodies, not sketches")
    return parts


def _named(parts: Sequence[MeshPart]) -> list[tuple[str, MeshPart]]:
    """Each part with a name of its own."""
    found: dict[str, MeshPart] = {}
    for part in parts:
        name, count = part.name, 0
        while name in found:
            count += 1
            name = f"{part.name}_{count}"
        found[name] = part
    return list(found.items())


def _welds(source: str, links: Sequence[Link], fixed: Collection[str]) -> list[LinkJoint]:
    if isinstance(fixed, str):
        raise ModelError(f"{source}: fixed must be a list of names, got {formatted(fixed)}; write [{formatted(fixed)}]")
    names = {link.name: link for link in links}
    for name in fixed:
        if name not in names:
            hint = f"{nearest(name, names)}; known: {', '.join(names)}"
            raise ModelError(f"{source}: fixed must name parts, got {formatted(name)}{hint}")
    return [
        LinkJoint(
            name=f"{name}_world", kind=JointType.FIXED, parent=None, child=name, anchor=names[name].pose.position
        )
        for name in dict.fromkeys(fixed)
    ]  # fmt: skip
