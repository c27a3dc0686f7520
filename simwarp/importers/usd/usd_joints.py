"""Joints of a USD stage: placed where the bodies stand, limits and drives in SI; D6 joints as chains."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simwarp.core.rotation import matrix_of
from simwarp.core.types import Dof, JointType, ModelError, Pose, PositionDrive, pose as make_pose
from simwarp.importers.links.link_frames import composed, point_of, relative
from simwarp.importers.links.link_tree import Link, LinkJoint, free_name
from simwarp.importers.report import ImportReport
from simwarp.importers.usd.usd_stage import ARMATURE, Stage, foreign_value, quaternion, vector

Array = npt.NDArray[np.float64]

JOINTS: Final = ("FixedJoint", "RevoluteJoint", "PrismaticJoint", "SphericalJoint", "D6Joint", "DistanceJoint",
                 "CustomJoint")  # fmt: skip

OPEN: Final = 1.0e30
"""Limits and forces beyond it are none."""

APART: Final = 1.0e-4
"""Frames of a joint that are farther apart as placed are told [m, rad]."""

FREEDOMS: Final = ("TransX", "TransY", "TransZ", "RotX", "RotY", "RotZ")


@dataclasses.dataclass(frozen=True)
class Servo:
    """The drive of a coordinate.

    Attributes:
        joint: its name.
        target: where it drives to, in the file's coordinate [m or rad].
    """

    joint: str
    target: float


class JointReader:
    """Reads joints between links.

    Args:
        stage: opened.
        world: pose of the stage's world in ours.
        link_of: link of each body, by path.
        report: what became of every element.
    """

    def __init__(self, stage: Stage, world: Pose, link_of: Mapping[str, Link], report: ImportReport) -> None:
        self.joints: list[LinkJoint] = []
        self.frames: list[Link] = []
        self.servos: list[Servo] = []
        self._stage = stage
        self._world = world
        self._link_of = link_of
        self._report = report
        self._names: set[str] = set()

    def read(self) -> None:
        """All joints, in the order of the file."""
        for joint in self._stage.of(*JOINTS):
            name = free_name(self._names, str(joint.primPath).rpartition("/")[2])
            kind = str(joint.type).rpartition(".")[2]
            if not joint.jointEnabled:
                self._report.approximate("disabled joint", name, "left out")
                continue
            if kind in ("DistanceJoint", "CustomJoint"):
                self._report.refuse("joint", name, f"a {kind} is none of ours")
                continue
            self._add(name, kind, joint)

    def _add(self, name: str, kind: str, joint: Any) -> None:
        ends = [self._link_of.get(str(path)) for path in (joint.body0, joint.body1)]
        if ends[0] is None and ends[1] is None:
            self._report.refuse("joint", name, "it ties no rigid body")
            return
        if joint.breakForce < OPEN or joint.breakTorque < OPEN:
            self._report.approximate("break force", name, "the joint never breaks")
        if joint.collisionEnabled:
            self._report.approximate("collisionEnabled", name, "bodies that a joint ties do not meet")
        frames = [
            self._frame(end, position, turn)
            for end, position, turn in (
                (ends[0], joint.localPose0Position, joint.localPose0Orientation),
                (ends[1], joint.localPose1Position, joint.localPose1Orientation),
            )
        ]
        if kind == "D6Joint":
            self._add_chain(name, joint, ends, frames)
            return
        self._report.hold(f"joint {kind.removesuffix('Joint').lower()}", name)
        axis = "XYZ".index(str(getattr(joint, "axis", "X"))[-1])
        self._add_single(name, kind, joint, ends, frames, axis)

    def _frame(self, link: Link | None, position: Any, turn: Any) -> Pose:
        """A frame of a joint in our world."""
        local = make_pose(self._stage.units.length * vector(position), quaternion(turn))
        return composed(self._world if link is None else link.pose, local)

    # ---- joints of one kind -----------------------------------------------------------------------------------------

    def _add_single(
        self, name: str, kind: str, joint: Any, ends: list[Link | None], frames: list[Pose], axis: int
    ) -> None:
        moved = relative(*frames)
        vector_turn = Rotation(moved.rotation).as_rotvec()
        value, types = 0.0, {"FixedJoint": JointType.FIXED, "SphericalJoint": JointType.SPHERICAL}
        offset, turned = moved.position.copy(), vector_turn.copy()
        if kind == "RevoluteJoint":
            value, turned[axis] = float(vector_turn[axis]), 0.0
        elif kind == "PrismaticJoint":
            value, offset[axis] = float(offset[axis]), 0.0
        elif kind == "SphericalJoint":
            turned[:] = 0.0
            if joint.limit.enabled and max(joint.limit.lower, joint.limit.upper) >= 0.0:
                self._report.approximate("cone limit", name, "left out: the ball turns freely")
        self._note_offset(name, offset, turned)
        dofs: tuple[Dof, ...] = ()
        joint_type = types.get(kind, JointType.REVOLUTE if kind == "RevoluteJoint" else JointType.PRISMATIC)
        if joint_type in (JointType.REVOLUTE, JointType.PRISMATIC):
            angular = joint_type == JointType.REVOLUTE
            dofs = (self._dof(name, joint, joint.limit, joint.drive, value, angular=angular),)
        direction = matrix_of(frames[1].rotation)[:, axis]
        self.joints.append(_between(name, joint_type, ends, frames[1].position, direction, dofs, value))

    def _note_offset(self, name: str, offset: Array, turned: Array) -> None:
        gap = max(float(np.linalg.norm(offset)), float(np.linalg.norm(turned)))
        if gap > APART:
            self._report.approximate(
                "joint frames", name, "they do not meet where the bodies stand; taken as they stand"
            )

    def _dof(self, name: str, joint: Any, limit: Any, drive: Any, value: float, *, angular: bool) -> Dof:
        """Limit, drive and armature in SI, about the coordinate as built."""
        units = self._stage.units
        size = math.pi / 180.0 if angular else units.length
        stops = None
        if limit is not None and limit.enabled and (limit.lower > -OPEN or limit.upper < OPEN):
            lower, upper = float(limit.lower) * size - value, float(limit.upper) * size - value
            if not lower < upper:
                raise ModelError(
                    f"joint '{name}': limit must have lower < upper, got {limit.lower} and {limit.upper}; exchange "
                    "them, or make the joint fixed"
                )
            stops = (max(lower, -OPEN * 10.0), min(upper, OPEN * 10.0))
        armature = foreign_value(self._stage.prim(joint.primPath), ARMATURE)
        return Dof(
            limit=stops, armature=armature * (units.inertia if angular else units.mass),
            drive=self._drive(name, drive, size, angular=angular),
        )  # fmt: skip

    def _drive(self, name: str, drive: Any, size: float, *, angular: bool) -> PositionDrive | None:
        if drive is None or not drive.enabled or (drive.stiffness == 0.0 and drive.damping == 0.0):
            return None
        if drive.forceLimit <= 0.0:
            return None
        if drive.acceleration:
            self._report.refuse("acceleration drive", name)
            return None
        units = self._stage.units
        force = units.inertia if angular else units.mass * units.length
        limit = float(drive.forceLimit)
        self._report.hold("drive", name)
        self.servos.append(Servo(name, float(drive.targetPosition) * size))
        if drive.targetVelocity != 0.0:
            self._report.approximate("target velocity", name, "0 at the start: set joint_target_qd")
        return PositionDrive(
            stiffness=float(drive.stiffness) * force / size, damping=float(drive.damping) * force / size,
            effort_limit=limit * force if limit < OPEN else math.inf,
        )  # fmt: skip

    # ---- chains -----------------------------------------------------------------------------------------------------

    def _add_chain(self, name: str, joint: Any, ends: list[Link | None], frames: list[Pose]) -> None:
        """A D6 joint: what is not locked becomes slides along x, y, z, then hinges about x, y, z, with bare frames
        between them.
        """
        limits = {str(pair.first).rpartition(".")[2]: pair.second for pair in joint.jointLimits}
        drives = {str(pair.first).rpartition(".")[2]: pair.second for pair in joint.jointDrives}
        free = [word for word in FREEDOMS if word not in limits or limits[word].lower <= limits[word].upper]
        if len(free) == len(FREEDOMS) and not any(word in limits or word in drives for word in FREEDOMS):
            self._report.hold("joint d6", name, "locks nothing")
            return
        moved = relative(*frames)
        angles = Rotation(moved.rotation).as_euler("XYZ")
        values = dict(zip(FREEDOMS, [*moved.position.tolist(), *angles.tolist()], strict=True))
        locked = np.array([0.0 if word in free else values[word] for word in FREEDOMS])
        self._note_offset(name, locked[:3], locked[3:])
        if len([word for word in free if word.startswith("Rot")]) == 3:
            told = "three hinges about x, y, z in a row, in place of a twist and a swing"
            self._report.approximate("joint d6", name, told)
        else:
            self._report.hold("joint d6", name)
        if not free:
            self.joints.append(_between(name, JointType.FIXED, ends, frames[1].position, np.zeros(3), (), 0.0))
            return
        places = self._axes(frames[0], values, free)
        above = ends[0]
        for number, word in enumerate(free):
            own = name if len(free) == 1 else f"{name}:{self._title(joint, word)}"
            point, axis = places[word]
            below = ends[1]
            if number + 1 < len(free):
                below = Link(name=f"{own}_frame", pose=make_pose(point, frames[0].rotation))
                self.frames.append(below)
            angular = word.startswith("Rot")
            kind = JointType.REVOLUTE if angular else JointType.PRISMATIC
            dof = self._dof(own, joint, limits.get(word), drives.get(word), values[word], angular=angular)
            self.joints.append(_between(own, kind, [above, below], point, axis, (dof,), values[word]))
            above = below

    def _title(self, joint: Any, word: str) -> str:
        axis = ("trans" if word.startswith("Trans") else "rot") + word[-1]
        given = self._stage.prim(joint.primPath).GetAttribute(f"mjcf:{axis}:name")
        return str(given.Get()) if given and given.Get() else axis

    def _axes(self, frame: Pose, values: Mapping[str, float], free: list[str]) -> dict[str, tuple[Array, Array]]:
        """A point and the direction of every axis, where the joint stands."""
        axes, angles = matrix_of(frame.rotation), [values[f"Rot{axis}"] for axis in "XYZ"]
        point = point_of(frame, np.array([values[f"Trans{axis}"] for axis in "XYZ"]))
        found = {f"Trans{axis}": (point, axes[:, k]) for k, axis in enumerate("XYZ")}
        turned = Rotation.from_matrix(axes)
        for k, axis in enumerate("XYZ"):
            found[f"Rot{axis}"] = (point, turned.apply(np.eye(3)[k]))
            if f"Rot{axis}" in free:
                turned = turned * Rotation.from_rotvec(angles[k] * np.eye(3)[k])
        return found


def _between(
    name: str, kind: JointType, ends: list[Link | None], anchor: Array, axis: Array, dofs: tuple[Dof, ...],
    value: float,
) -> LinkJoint:  # fmt: skip
    """A joint whose child is a link: the second one, or the first where the second is the world."""
    parent, child = ends
    if child is None:
        parent, child, axis = None, parent, -axis
    assert child is not None
    return LinkJoint(
        name=name, kind=kind, parent=None if parent is None else parent.name, child=child.name, anchor=anchor,
        axis=axis, dofs=dofs, offset=value,
    )  # fmt: skip
