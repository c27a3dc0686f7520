"""A task for a robot of one's own: what of the robot moves, and the files of a package around it."""

from __future__ import annotations

import dataclasses
import fnmatch
import json
import math
from collections.abc import Iterator, Sequence, Set
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.cli import UsageError, shortened
from simwarp.cli.robots.robot_templates import FIXED, FLOATING, JOINTS, README, TEST
from simwarp.core.rotation import matrix_of, quat_conjugate, quat_multiply, rotate
from simwarp.core.types import WORLD, Dof, JointType, PositionDrive, ShapeType
from simwarp.core.wording import suggestions
from simwarp.importers.imported import Imported
from simwarp.importers.saved_robot import robot_text
from simwarp.model.builder import ModelBuilder
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.specifications import JointSpec, ShapeSpec

Array = npt.NDArray[np.float64]

DAMPING: Final = 0.5
"""Damping ratio of a drive that the file does not tell, with all other joints locked."""
SLIDE: Final = 0.1
"""Way over which such a drive of a slide reaches its largest effort [m]; that of a hinge is 1 rad."""
WIDEST: Final = 1.0
"""Most that targets of a joint leave the pose at the start [rad], or in units of SLIDE."""
GRAVITY: Final = 9.81
GROUNDS: Final = (ShapeType.PLANE, ShapeType.HEIGHT_FIELD)


@dataclasses.dataclass(frozen=True)
class DrivenJoint:
    """A coordinate that the policy moves.

    Attributes:
        name: of the joint or tendon.
        drive: that pulls it to its target.
        lower, upper: of its targets.
    """

    name: str
    drive: PositionDrive
    lower: float
    upper: float

    def row(self) -> str:
        """Its line of the table in the task."""
        effort = self.drive.effort_limit
        if isinstance(effort, tuple) and -effort[0] == effort[1]:
            effort = effort[1]
        told = f"({', '.join(map(_digits, effort))})" if isinstance(effort, tuple) else _digits(effort)
        numbers = [_digits(self.drive.stiffness), _digits(self.drive.damping), told]
        return f"    {json.dumps(self.name)}: ({', '.join([*numbers, _digits(self.lower), _digits(self.upper)])}),"


@dataclasses.dataclass(frozen=True)
class Stance:
    """How a robot stands.

    Attributes:
        home: (dofs,) coordinates at the start.
        keyframe: that they are of; empty for the robot as built.
        floating: name of the joint of the base that floats; empty where it is fixed.
        base: name of that body.
        height: of a level ground [m]; None where there is another one.
        has_ground: the file has a ground.
    """

    home: Array
    keyframe: str
    floating: str = ""
    base: str = ""
    height: float | None = 0.0
    has_ground: bool = False


def robot_files(
    name: str, module: str, robot: Imported, source: str, *, velocity: bool, pose: Sequence[str] = ()
) -> dict[str, str]:
    """The module, its test, its page and the robot: path -> text, with @words@ of the package still in it.

    Args:
        name: of the task.
        module: of the package.
        robot: that it is about.
        source: file of the robot, for people.
        velocity: follow a commanded velocity.
        pose: of the joints at the start, see `with_pose`.

    Raises:
        UsageError: nothing of the robot can be driven, or its base is fixed and has no velocity.
    """
    stance = stance_of(robot, pose)
    joints = driven_joints(robot, stance.home)
    if not joints:
        raise UsageError(f"{source}: a task needs joints that can be driven, and there is none; add joints to the file")
    if velocity and not stance.floating:
        raise UsageError(f"{source}: --velocity is for robots whose base floats, this one's is fixed; leave it away")
    what = "follows commanded velocities" if velocity else "stands upright" if stance.floating else "reaches goals"
    summary = f"{source} {what}, {len(joints)} joints"
    home = (
        f"robot.keyframes[{json.dumps(stance.keyframe)}].q"
        if stance.keyframe
        else "robot.q_from(robot.coordinates.initial)"
    )
    count = len(joints)
    words = {
        "@what@": f"A robot, {source}, {what}" + (" of its joints" if what == "reaches goals" else ""),
        "@summary@": summary,
        "@source@": source,
        "@table@": JOINTS,
        "@joints@": "\n".join(joint.row() for joint in joints),
        "@home@": home,
        "@base@": stance.base,
        "@float@": stance.floating,
        "@stand@": _stand(stance),
        "@pose@": "\n".join(_home_rows(robot, stance.home, {joint.name for joint in joints})),
        "@posed@": f", as in the keyframe {json.dumps(stance.keyframe)}" if stance.keyframe else "",
        "@height@": " The height of the base follows from it." if _stand(stance) else "",
        "@ground@": "" if stance.has_ground else '        self.robot.builder.add_shape_plane(name="ground")\n',
        "@size@": str(9 + 3 * (count + velocity) if stance.floating else 4 * count),
    }
    texts = {
        "README.md": README,
        f"{module}/task.py": "".join(_chosen(FLOATING if stance.floating else FIXED, velocity)),
        f"tests/test_{module}.py": TEST,
    }
    for path, text in texts.items():
        for word in ("@table@", *words):
            text = text.replace(word, words[word])
        texts[path] = text
    return {**texts, f"{module}/robot.json": robot_text(robot)}


def _stand(stance: Stance) -> str:
    """Lines that put the robot's lowest point on the ground."""
    if not stance.floating or stance.height is None:
        return ""
    height = f"{_digits(stance.height)} " if stance.height else ""
    sign = f"+= {height}-" if height else "-="
    return (
        "        self.simulation.set_joint_state(None, self.home.repeat(self.num_worlds, 1), None)\n"
        f'        self.home[robot.dofs["{stance.floating}"] + 2] {sign} robot.lowest_point(self.simulation.state)\n'
    )


def _home_rows(robot: Imported, home: Array, driven: Set[str]) -> Iterator[str]:
    """Lines of the table of the pose: joints that are driven, and others that do not stand at 0."""
    for name, (column, _) in _single_dofs(robot).items():
        if name in driven or home[column] != 0.0:
            yield f"    {json.dumps(name)}: {_digits(float(home[column]))},"


def _chosen(template: str, velocity: bool) -> Iterator[str]:
    """The lines of a template that are for this kind of task."""
    for line in template.splitlines(keepends=True):
        if line[:2] in ("%v", "%s"):
            if (line[1] == "v") == velocity:
                yield line[3:] or "\n"
        else:
            yield line


def _digits(value: float) -> str:
    """Four digits of a number, as Python reads them."""
    return f'float("{value}")' if math.isinf(value) else repr(float(f"{value:.4g}") + 0.0)


# ---- the robot -------------------------------------------------------------------------------------------------------


def stance_of(robot: Imported, pose: Sequence[str] = ()) -> Stance:
    """Where the robot starts: its keyframe "home", else its first one, else as built, with the joints of `pose`."""
    builder, keyframes = robot.builder, robot.keyframes
    keyframe = "home" if "home" in keyframes else next(iter(keyframes), "")
    home = keyframes[keyframe].q if keyframe else robot.q_from(robot.coordinates.initial)
    home = with_pose(robot, home, pose, has_keyframe=bool(keyframe))
    names = {column: name for name, column in robot.dofs.items()}
    bodies = {body: name for name, body in robot.bodies.items()}
    for index, joint in enumerate(builder.joints):
        column = builder.dof_start(index)
        if joint.type == JointType.FREE and joint.child in bodies and column in names and _carries(robot, joint.child):
            grounds = [shape for shape in builder.shapes if shape.body == WORLD and shape.type in GROUNDS]
            return Stance(
                home, keyframe, floating=names[column], base=bodies[joint.child], height=_level(grounds),
                has_ground=bool(grounds),
            )  # fmt: skip
    return Stance(home, keyframe)


def _level(grounds: list[ShapeSpec]) -> float | None:
    """Height of the ground, 0 where there is none [m]; None where it is not one level plane."""
    if not grounds:
        return 0.0
    plane = grounds[0]
    level = len(grounds) == 1 and plane.type == ShapeType.PLANE and matrix_of(plane.pose.rotation)[2, 2] > 1.0 - 1e-9
    return float(plane.pose.position[2]) if level else None


def with_pose(robot: Imported, home: Array, words: Sequence[str], *, has_keyframe: bool) -> Array:
    """Coordinates at the start: those given, with joints at the middle of their limits where 0 is outside.

    Args:
        robot: that has the joints.
        home: (dofs,) coordinates so far.
        words: NAME=VALUE each, or several with commas between; * and ? in a name stand for letters [rad or m].
        has_keyframe: the coordinates so far are of the file: none is moved into its limits.

    Raises:
        UsageError: a word is no such thing, names no joint, or a value that its joint cannot have.
    """
    home, single = home.copy(), _single_dofs(robot)
    for column, dof in single.values():
        if dof.limit is not None and not has_keyframe and not dof.limit[0] <= home[column] <= dof.limit[1]:
            home[column] = 0.5 * (dof.limit[0] + dof.limit[1])
    for word in (part for text in words for part in text.split(",") if part):
        pattern, _, text = word.rpartition("=")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (pattern and math.isfinite(value)):
            raise UsageError(f"--pose must be JOINT=VALUE [rad or m], got '{shortened(word)}'")
        named = [name for name in single if fnmatch.fnmatchcase(name, pattern)]
        if not named:
            hint = suggestions(pattern, single, f"joints: {', '.join(list(single)[:12])}", cutoff=0.6)
            raise UsageError(f"--pose names no hinge or slide with '{shortened(pattern)}'; {hint}")
        for name in named:
            column, dof = single[name]
            lower, upper = dof.limit or (-math.inf, math.inf)
            if not lower <= value <= upper:
                raise UsageError(
                    f"--pose of '{name}' must be within its limits, {lower:.4g} to {upper:.4g}, got {value:g}"
                )
            home[column] = value
    return home


def _single_dofs(robot: Imported) -> dict[str, tuple[int, Dof]]:
    """Hinges and slides that follow no other one, with their columns."""
    followers = {coupling.terms[0][0] for coupling in robot.builder.couplings}
    found = {}
    for name, column in robot.dofs.items():
        index, _ = robot.builder.coordinate_of(column)
        joint = robot.builder.joints[index]
        if len(joint.dofs) == 1 and column not in followers:
            found[name] = (column, joint.dofs[0])
    return found


def _carries(robot: Imported, body: int) -> bool:
    """True if joints hang on a body: an object that floats alone has none."""
    return any(joint.parent == body and joint.dofs for joint in robot.builder.joints)


def driven_joints(robot: Imported, home: Array) -> list[DrivenJoint]:
    """What has a drive, else what actuators push, else all hinges and slides that follow no other one."""
    builder = robot.builder
    pushed = {column for spec in robot.actuators for column, _ in spec.terms}
    followers = {coupling.terms[0][0] for coupling in builder.couplings}
    found = []
    for name, column in {**robot.dofs, **robot.tendons}.items():
        index, local = builder.coordinate_of(column)
        joint = builder.joints[index]
        if len(joint.dofs) > 1:
            continue
        dof = joint.dofs[local]
        if isinstance(dof.drive, PositionDrive):
            drive = dof.drive
        elif column in pushed or (not pushed and column not in followers and joint.type != JointType.COMBINATION):
            drive = _made_drive(robot, name, column, index)
        else:
            continue
        found.append(DrivenJoint(name, drive, *_targets(joint, dof, float(home[column]))))
    return found


def _targets(joint: JointSpec, dof: Dof, home: float) -> tuple[float, float]:
    """Range of a joint's targets: around the pose at the start, within its stops."""
    reach = WIDEST * (SLIDE if joint.type == JointType.PRISMATIC else 1.0)
    lower, upper = dof.limit or (-math.inf, math.inf)
    return max(lower, home - reach), min(upper, home + reach)


def _made_drive(robot: Imported, name: str, column: int, index: int) -> PositionDrive:
    """A drive that gives its largest effort one radian from its target."""
    joint = robot.builder.joints[index]
    effort = _effort_of(robot, name, column)
    if not math.isfinite(effort):
        # what holds the robot's weight at half its extent, or lifts it
        places = np.array([body.pose.position for body in robot.builder.bodies])
        lever = 0.5 * float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) > 1 else 0.5
        effort = robot.mass * GRAVITY * (1.0 if joint.type == JointType.PRISMATIC else max(lever, 0.1))
    stiffness = effort / (SLIDE if joint.type == JointType.PRISMATIC else 1.0)
    damping = 2.0 * DAMPING * math.sqrt(stiffness * inertia_along(robot.builder, index))
    return PositionDrive(stiffness=stiffness, damping=damping, effort_limit=effort)


def inertia_along(builder: ModelBuilder, index: int) -> float:
    """What a hinge or slide moves as built, all other joints locked: moment of inertia [kg·m²], or mass [kg]."""
    joint = builder.joints[index]
    moved, fresh = {joint.child}, True
    while fresh:
        more = {
            other.child for other in builder.joints
            if other.parent in moved and other.child >= 0 and not other.closes_loop and ELEMENTS[other.type].tree
        }  # fmt: skip
        fresh = not more <= moved
        moved |= more
    child = builder.bodies[joint.child].pose
    axis = matrix_of(quat_multiply(child.rotation, joint.frame1.rotation))[:, 2]
    anchor = child.position + rotate(child.rotation, joint.frame1.position)
    total = joint.dofs[0].armature
    for body in (builder.bodies[one] for one in moved):
        if joint.type == JointType.PRISMATIC:
            total += body.mass
            continue
        own = rotate(quat_conjugate(body.pose.rotation), axis)
        total += float(own @ body.inertia @ own)
        total += body.mass * float(np.square(np.cross(body.pose.position - anchor, axis)).sum())
    return total


def _effort_of(robot: Imported, name: str, column: int) -> float:
    """Largest effort of what pushes a coordinate; infinite where the file does not tell."""
    efforts = []
    for spec in robot.actuators:
        for moved, factor in spec.terms:
            if moved == column:
                ranges = [spec.force_range] if spec.force_range else []
                if spec.ctrl_range and not any(spec.bias) and not any(spec.gain[1:]):
                    ranges.append((spec.gain[0] * spec.ctrl_range[0], spec.gain[0] * spec.ctrl_range[1]))
                efforts.append(min((abs(factor) * max(map(abs, pair)) for pair in ranges), default=math.inf))
    told = robot.effort_limits.get(name, math.inf)
    return min(sum(efforts), told) if efforts else told
