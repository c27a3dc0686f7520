"""USD stages with UsdPhysics: bodies, joints, colliders, drives and groups."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from simwarp.actuators import ActuatorSpec
from simwarp.actuators.actuator_spec import Law
from simwarp.core.rotation import rotate
from simwarp.core.types import JointType, ModelError, Pose
from simwarp.importers.imported import Imported, Keyframe
from simwarp.importers.links.link_frames import composed
from simwarp.importers.links.link_tree import (
    Assembled,
    Link,
    LinkJoint,
    assemble,
    floating_joints,
    massless_heads,
    tied_links,
    unchanged_on_error,
)
from simwarp.importers.links.link_visuals import visuals_of_links
from simwarp.importers.report import ImportReport
from simwarp.importers.self_collision import SelfCollision, checked_self_collision, set_self_collision
from simwarp.importers.source_files import FileFolders, source_file
from simwarp.importers.usd.usd_bodies import SHAPES, BodyReader
from simwarp.importers.usd.usd_joints import JointReader, Servo
from simwarp.importers.usd.usd_stage import (
    ARMATURE,
    OPEN_GRAVITY,
    Stage,
    open_stage,
    report_foreign,
    vector,
    warnings_reported,
)
from simwarp.importers.usd.usd_visuals import VisualReader
from simwarp.model.builder import ModelBuilder
from simwarp.model.checks import checked_pose

REFUSABLE: Final = {
    "joint": "it is none of ours",
    "collider": "no shape of ours has this geometry",
    "acceleration drive": "its gains are accelerations; make its type force",
    "massless body": "it moves without mass or inertia; give it a mass, or a density and a collider",
}
"""Kinds of elements that are refused, with the reason."""


def load_usd(
    path: str | Path,
    builder: ModelBuilder | None = None,
    *,
    pose: Pose | None = None,
    prefix: str = "",
    folders: Collection[str | Path] = (),
    decompose: bool | Mapping[str, Any] = False,
    self_collision: SelfCollision = None,
    allow: Collection[str] = (),
) -> Imported:
    """The robots and things of a USD file, in SI with the vertical z, whatever the units and axes of the stage.

    A joint's coordinate in the file is the angle or distance between its two frames; bodies start where they are
    placed. A D6 joint becomes its free axes in a row, named joint:axis. What no joint ties to the world floats, with
    six coordinates named after its first body. Drives are `PositionDrive`s and servos of `Imported.actuators`; their
    targets are the controls of the keyframe "initial".

    Args:
        path: a .usd, .usda, .usdc or .usdz file.
        builder: to add to; a new one, with the gravity of the file's first scene, when None.
        pose: of the file's world in ours; identity when None.
        prefix: of all names.
        folders: in which layers may lie, besides that of the file.
        decompose: take several hulls for a mesh instead of one: True, or options of `coacd.run_coacd`.
        self_collision: whether the robot's own parts touch each other: None as the file says (docs/import.md), True for
            all pairs, False for none, "adjacent-off" for all but those of bodies that a joint ties, "overlapping-off"
            for those that the file says and that do not overlap as built.
        allow: kinds of elements to drop with a warning where they would be refused: "joint", "collider",
            "acceleration drive", "massless body" (it is welded).

    Raises:
        ModelError: the file, one of its layers or an argument is not usable; names the element.
    """
    file = source_file(path, "load_usd", (".usd", ".usda", ".usdc", ".usdz"))
    report = ImportReport(file.name, REFUSABLE, allow)
    placed = checked_pose(f"{file.name}: import", pose)
    choice = checked_self_collision(file.name, self_collision)
    stage = open_stage(file, FileFolders(file, folders=folders), report)
    with warnings_reported(file, report):
        imported = _read(stage, file, placed, builder, prefix, decompose, choice, report)
    report.finish()
    return imported


def _read(
    stage: Stage, file: Path, placed: Pose, builder: ModelBuilder | None, prefix: str,
    decompose: bool | Mapping[str, Any], choice: SelfCollision, report: ImportReport,
) -> Imported:  # fmt: skip
    """An opened stage; arguments as of `load_usd`."""
    world = composed(placed, stage.world)
    bodies = BodyReader(stage, world, report, decompose)
    joints = JointReader(stage, world, bodies.link_of, report)
    try:
        bodies.read()
        joints.read()
        visuals = VisualReader(stage, world, bodies, report).read()
    except ModelError as error:
        raise ModelError(f"{file.name}: {error}") from None
    if not bodies.links:
        raise ModelError(f"{file.name}: must have a rigid body or a collider, got none; apply PhysicsRigidBodyAPI")
    report_foreign(stage, report, ARMATURE)
    links = [*bodies.links, *joints.frames]
    tied = _tied(links, joints.joints, bodies.grounded, report)
    report.check()
    target = ModelBuilder() if builder is None else builder
    if builder is None:
        target.gravity = _gravity(stage, world)
    with unchanged_on_error(target):
        result = assemble(target, links, tied, prefix=prefix, source=file.name)
        _exclude(stage, bodies, target, result, prefix, report)
        parts = [
            [shape for name in names for shape in result.shapes_of[prefix + name]] for names in tied_links(links, tied)
        ]
        set_self_collision(target, choice, parts, report)
    assert result.coordinates is not None
    actuators, targets = _servos(joints.servos, tied, result, prefix)
    start = Keyframe(
        q=result.coordinates.q_from(result.coordinates.initial), qd=np.zeros(target.dof_count), ctrl=targets
    )
    return Imported(
        builder=target, bodies=result.bodies, dofs=result.dofs, shapes=result.shapes, coordinates=result.coordinates,
        report=report, frames=result.frames, actuators=actuators, keyframes={f"{prefix}initial": start},
        show=visuals_of_links(visuals, result.frames, result.shapes_of, prefix),
    )  # fmt: skip


def _tied(
    links: Sequence[Link], joints: Sequence[LinkJoint], grounded: Sequence[str], report: ImportReport
) -> list[LinkJoint]:
    """The joints, with welds of what is fixed and coordinates of what floats; links without mass refused or welded."""
    ground = [
        LinkJoint(
            name=f"{link.name}_world", kind=JointType.FIXED, parent=None, child=link.name, anchor=link.pose.position
        )
        for link in links
        if link.name in grounded
    ]
    listed = list(joints)
    while True:
        tied = [*floating_joints(links, [*ground, *listed]), *ground, *listed]
        names = massless_heads(links, tied)
        for name in names:
            report.refuse("massless body", name)
        fresh = [
            LinkJoint(
                name=joint.name, kind=JointType.FIXED, parent=joint.parent, child=joint.child, anchor=joint.anchor
            )
            if joint.child in names and joint.kind != JointType.FIXED
            else joint
            for joint in listed
        ]
        if not names or fresh == listed or not report.is_allowed("massless body"):
            if names and report.is_allowed("massless body"):
                raise ModelError(f"{report.source}: body '{names[0]}' floats without mass; give it one")
            return tied
        listed = fresh


def _gravity(stage: Stage, world: Pose) -> Any:
    """Of the first scene; UsdPhysics's defaults stand for "downwards" and "of the Earth"."""
    scenes = stage.of("Scene")
    if not scenes:
        return np.array([0.0, 0.0, -9.81])
    magnitude = float(scenes[0].gravityMagnitude)
    size = magnitude * stage.units.length if 0.0 <= magnitude < OPEN_GRAVITY else 9.81
    direction = vector(scenes[0].gravityDirection)
    length = float(np.linalg.norm(direction))
    return size * (rotate(world.rotation, direction / length) if length > 0.0 else np.array([0.0, 0.0, -1.0]))


def _servos(
    servos: Sequence[Servo], joints: Sequence[LinkJoint], result: Assembled, prefix: str
) -> tuple[tuple[ActuatorSpec, ...], Any]:
    """An actuator for each drive: its control is the file's coordinate [m or rad]."""
    offset = {joint.name: joint.offset for joint in joints}
    kept = [servo for servo in servos if prefix + servo.joint in result.dofs]
    actuators = tuple(
        ActuatorSpec(
            name=prefix + servo.joint, terms=((result.dofs[prefix + servo.joint], 1.0),), law=Law.SERVO,
            length_offset=offset[servo.joint],
        )
        for servo in kept
    )  # fmt: skip
    return actuators, np.array([servo.target for servo in kept], np.float64)


# ---- pairs that do not meet ------------------------------------------------------------------------------------------


def _inverted(stage: Stage, path: Any) -> bool:
    """Whether a collision group meets none but the groups that it lists.

    What the parser says is memory that it has not set where the stage says nothing (OpenUSD 25.11 to 26.11).
    """
    return bool(stage.physics.CollisionGroup(stage.prim(path)).GetInvertFilteredGroupsAttr().Get())


def _exclude(
    stage: Stage, bodies: BodyReader, builder: ModelBuilder, result: Assembled, prefix: str, report: ImportReport
) -> None:
    """Filtered pairs and groups: shapes that never meet."""
    shapes = {path: result.shapes.get(prefix + name, ()) for path, name in bodies.shape_paths.items()}
    below: dict[str, list[str]] = {path: [path] for path in shapes}
    for shape in stage.of(*SHAPES):
        if str(shape.primPath) in shapes:
            below.setdefault(str(shape.rigidBody), []).append(str(shape.primPath))
    for articulation in stage.of("Articulation"):
        owned = [path for body in articulation.articulatedBodies for path in below.get(str(body), [])]
        below.setdefault(str(articulation.primPath), owned)
    pairs: set[tuple[int, int]] = set()

    def part(first: Sequence[str], second: Sequence[str]) -> None:
        for a, b in itertools.product(first, second):
            for one, other in itertools.product(shapes.get(a, ()), shapes.get(b, ())):
                if builder.shapes[one].body != builder.shapes[other].body:
                    pairs.add((min(one, other), max(one, other)))

    for thing in stage.of("RigidBody", "Articulation", *SHAPES):
        for other in thing.filteredCollisions:
            report.hold("filtered pair", f"{thing.primPath} and {other}")
            part(below.get(str(thing.primPath), []), below.get(str(other), []))
    members: dict[str, list[str]] = {}
    for shape in stage.of(*SHAPES):
        for group in shape.collisionGroups:
            members.setdefault(str(group), []).append(str(shape.primPath))
    groups = stage.of("CollisionGroup")
    for group in groups:
        own, listed = str(group.primPath), {str(other) for other in group.filteredGroups}
        report.hold("collision group", own)
        apart = {str(g.primPath) for g in groups} - listed if _inverted(stage, group.primPath) else listed
        for other in apart:
            part(members.get(own, []), members.get(other, []))
    for one, other in sorted(pairs):
        builder.exclude_shapes(one, other)
