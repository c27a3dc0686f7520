"""Joints of a URDF file: the tree that they make, where links stand as built, limits and efforts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import rotate
from simwarp.core.types import Dof, JointType, ModelError, Pose, pose as make_pose
from simwarp.core.wording import nearest
from simwarp.importers.links.link_frames import composed, point_of, pose_from_matrix
from simwarp.importers.links.link_tree import Link, LinkJoint
from simwarp.importers.report import ImportReport
from simwarp.importers.urdf.urdf_listing import JOINT_TYPES

Array = npt.NDArray[np.float64]

KINDS = {
    "revolute": JointType.REVOLUTE, "continuous": JointType.REVOLUTE, "prismatic": JointType.PRISMATIC,
    "fixed": JointType.FIXED, "floating": JointType.FREE, "planar": JointType.PLANAR,
}  # fmt: skip
SINGLE = (JointType.REVOLUTE, JointType.PRISMATIC)
RIGHT: Final = np.array([1.0, 0.0, 0.0])
UP: Final = np.array([0.0, 0.0, 1.0])


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointValues:
    """A joint, and what the file says about it besides.

    Attributes:
        joint: placed in the world.
        effort: largest effort of what drives it [N or N·m]; None where not given.
        velocity: highest speed of what drives it [m/s or rad/s]; None where not given.
        mimic: (joint, multiplier).
    """

    joint: LinkJoint
    effort: float | None = None
    velocity: float | None = None
    mimic: tuple[str, float] | None = None


def welded(value: JointValues) -> JointValues:
    """The same joint without any motion."""
    return JointValues(joint=dataclasses.replace(value.joint, kind=JointType.FIXED, dofs=()))


def in_plane(axis: Array) -> Array:
    """First axis of a planar joint in the joint's frame: x, turned by the shortest rotation that takes z to the unit
    normal `axis`, as MuJoCo's reader has it. Files only give the normal, and nearly always it is z.
    """
    across = np.cross(UP, axis)
    sine, cosine = float(np.linalg.norm(across)), float(axis[2])
    about = across / sine if sine > 1e-12 else RIGHT  # straight down: half a turn about x
    half = 0.5 * math.atan2(sine, cosine)
    return rotate(np.array([*(math.sin(half) * about), math.cos(half)]), RIGHT)


class JointTree:
    """The joints of a robot, checked to be a tree.

    Raises:
        ModelError: a name is taken or unknown, a link has two parents or none leads to it, or there are two roots.
    """

    def __init__(self, source: str, robot: Any, report: ImportReport) -> None:
        self.source = source
        self.joints = {joint.name: joint for joint in robot.joints}
        self._report = report
        self._check_names(robot)
        children = {joint.child for joint in robot.joints}
        roots = [link.name for link in robot.links if link.name not in children]
        if len(roots) != 1:
            told = f"{len(roots)} ({', '.join(roots[:4])})" if roots else "none: the joints run in a circle"
            raise ModelError(f"{source}: one link must be the root, which no joint hangs on another; got {told}")
        self.root = roots[0]
        self.order = self._from_root(robot)
        self.offsets = {name: self._offset(name, ()) for name in self.joints}

    def _check_names(self, robot: Any) -> None:
        if not robot.links:
            raise ModelError(f"{self.source}: must have a <link>, got none; check the file")
        links = {link.name for link in robot.links}
        parent_of: dict[str, str] = {}
        seen: set[str] = set()
        for joint in robot.joints:
            thing = f"{self.source}: joint '{joint.name}'"
            if joint.name in seen:
                raise ModelError(f"{thing}: the name must be unique, got it twice; rename one")
            seen.add(joint.name)
            if joint.type not in KINDS:
                hint = nearest(joint.type, JOINT_TYPES)
                raise ModelError(f"{thing}: type must be one of {', '.join(JOINT_TYPES)}, got '{joint.type}'{hint}")
            for role, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in links:
                    raise ModelError(f"{thing}: its {role} must be a link, got '{link}'{nearest(link, links)}")
            if joint.child in parent_of:
                raise ModelError(
                    f"{thing}: link '{joint.child}' must hang on one joint, but '{parent_of[joint.child]}' holds it "
                    "too; URDF has no closed loops"
                )
            parent_of[joint.child] = joint.name

    def _from_root(self, robot: Any) -> list[Any]:
        """The joints, parents before children."""
        below: dict[str, list[Any]] = {}
        for joint in robot.joints:
            below.setdefault(joint.parent, []).append(joint)
        order: list[Any] = []
        stack = [self.root]
        while stack:
            found = below.get(stack.pop(), [])
            order += found
            stack += [joint.child for joint in found]
        lost = [joint.name for joint in robot.joints if joint not in order]
        if lost:
            raise ModelError(
                f"{self.source}: joints must hang on the root '{self.root}', but '{lost[0]}' is part of a circle of "
                f"{len(lost)}; URDF has no closed loops"
            )
        return order

    def _offset(self, name: str, asking: tuple[str, ...]) -> float:
        """Coordinate as built: 0, or where a mimicking joint stands then."""
        joint = self.joints[name]
        if joint.mimic is None:
            return 0.0
        thing = f"{self.source}: joint '{name}': mimic"
        other = joint.mimic.joint
        if other not in self.joints:
            self._report.refuse("mimic", name, f"it must name a joint, got '{other}'{nearest(other, self.joints)}")
            joint.mimic = None
            return 0.0
        if other == name or other in asking:
            raise ModelError(f"{thing}: must lead to a joint that moves by itself, but it leads back to '{other}'")
        for each in (name, other):
            if KINDS[self.joints[each].type] not in SINGLE:
                raise ModelError(
                    f"{thing}: needs two joints of one coordinate, but '{each}' is {self.joints[each].type}; drop it"
                )
        return float(joint.mimic.multiplier) * self._offset(other, (*asking, name)) + float(joint.mimic.offset)

    # ---- placed -----------------------------------------------------------------------------------------------------

    def placed(self, links: Sequence[Link], base: str, pose: Pose) -> list[JointValues]:
        """Puts every link where it stands as built; returns the joints, that of the base first, in the file's order."""
        link_of = {link.name: link for link in links}
        link_of[self.root].pose = pose
        kind = JointType.FIXED if base == "fixed" else JointType.FREE
        root = LinkJoint(name=f"{self.root}_{base}", kind=kind, parent=None, child=self.root, anchor=pose.position)
        made: dict[str, LinkJoint] = {}
        for joint in self.order:
            made[joint.name] = self._place(joint, link_of)
        return [JointValues(joint=root), *(self._values(name, made[name]) for name in self.joints)]

    def _place(self, joint: Any, link_of: dict[str, Link]) -> LinkJoint:
        kind, offset = KINDS[joint.type], self.offsets[joint.name]
        origin = make_pose() if joint.origin is None else pose_from_matrix(joint.origin)
        frame = composed(link_of[joint.parent].pose, origin)
        axis = np.asarray(joint.axis, np.float64)
        length = float(np.linalg.norm(axis))
        if kind in (*SINGLE, JointType.PLANAR) and not length > 1e-12:
            raise ModelError(
                f"{self.source}: joint '{joint.name}': axis must have a length, got zeros; give a direction"
            )
        axis = axis / max(length, 1e-12)
        motion = make_pose()
        if kind == JointType.REVOLUTE:
            motion = make_pose(rotation=[*(math.sin(0.5 * offset) * axis), math.cos(0.5 * offset)])
        elif kind == JointType.PRISMATIC:
            motion = make_pose(offset * axis)
        link_of[joint.child].pose = composed(frame, motion)
        return LinkJoint(
            name=joint.name, kind=kind, parent=None if kind == JointType.FREE else joint.parent, child=joint.child,
            anchor=point_of(frame, motion.position), axis=rotate(frame.rotation, axis), offset=offset,
            direction=rotate(frame.rotation, in_plane(axis)) if kind == JointType.PLANAR else None,
            dofs=(self._dof(joint, offset),) if kind in SINGLE else (),
        )  # fmt: skip

    def _dof(self, joint: Any, offset: float) -> Dof:
        limit = self._stops(joint)
        dynamics = joint.dynamics
        return Dof(
            limit=None if limit is None else (limit[0] - offset, limit[1] - offset),
            damping=float(dynamics.damping or 0.0) if dynamics is not None else 0.0,
            friction=float(dynamics.friction or 0.0) if dynamics is not None else 0.0,
        )

    def _stops(self, joint: Any) -> tuple[float, float] | None:
        """Lower and upper stop; None where there are none."""
        given = joint.limit
        if joint.type == "continuous" or given is None or (given.lower is None and given.upper is None):
            if joint.type != "continuous":
                self._report.approximate(
                    "limit", joint.name, "neither lower nor upper is given; taken to be without stops, where URDF "
                    "says 0 for both",
                )  # fmt: skip
            return None
        lower, upper = float(given.lower or 0.0), float(given.upper or 0.0)
        if lower == upper == 0.0:
            self._report.approximate("limit", joint.name, "lower and upper are 0; taken as not given: no stops")
            return None
        if not lower < upper:
            raise ModelError(
                f"{self.source}: joint '{joint.name}': limit must have lower < upper, got {lower} and {upper}; "
                "exchange them, or make the joint fixed"
            )
        return lower, upper

    def _values(self, name: str, joint: LinkJoint) -> JointValues:
        given = self.joints[name]
        self._report.hold(f"joint {given.type}", name)
        if joint.kind not in SINGLE:
            for tag in ("limit", "dynamics"):
                if getattr(given, tag) is not None and given.type != "fixed":
                    self._report.approximate(
                        f"{tag} of a {given.type} joint", name, "has no single coordinate; left out"
                    )
            return JointValues(joint=joint)
        mimic = given.mimic
        if mimic is not None:
            self._report.hold("mimic", name)
        if given.dynamics is not None:
            self._report.hold("dynamics", name)
        if joint.dofs and joint.dofs[0].limit is not None:
            self._report.hold("limit", name)
        return JointValues(
            joint=joint, effort=self._bound(given, "effort"), velocity=self._bound(given, "velocity"),
            mimic=None if mimic is None else (mimic.joint, float(mimic.multiplier)),
        )  # fmt: skip

    def _bound(self, joint: Any, field: str) -> float | None:
        value = None if joint.limit is None else getattr(joint.limit, field)
        if value is None:
            return None
        if value == 0.0:
            self._report.approximate(field, joint.name, f"limit {field} is 0; taken as not given")
            return None
        if value < 0.0:
            raise ModelError(f"{self.source}: joint '{joint.name}': {field} must be > 0, got {value}; check its sign")
        self._report.hold(field, joint.name, "kept for whoever adds drives")
        return float(value)
