"""Default colours of instances, rods and balls for bodies without shapes."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import quat_from_matrix
from simwarp.core.types import WORLD, JointType, ShapeType, Vec3, pose
from simwarp.sensors.cameras.appearance import CheckerTexture
from simwarp.sensors.instances import GREY
from simwarp.sensors.scene import Visuals

Array = npt.NDArray[np.float64]

PALETTE: Final = (
    (0.78, 0.22, 0.05), (0.05, 0.22, 0.55), (0.82, 0.48, 0.05), (0.06, 0.4, 0.36), (0.45, 0.12, 0.4),
    (0.3, 0.42, 0.08), (0.6, 0.3, 0.2), (0.2, 0.35, 0.65),
)  # fmt: skip
"""Linear albedos of bodies, in turn."""
STONE: Final = (0.42, 0.4, 0.37)
FLOOR: Final = ((0.21, 0.225, 0.24), (0.25, 0.265, 0.28))
"""Linear albedos of a ground's squares: darker than what stands on it, and so near to each other that it is quiet."""
GROUNDS: Final = (ShapeType.PLANE, ShapeType.HEIGHT_FIELD)


def paint(visuals: Visuals, tile: float | None = None) -> None:
    """Gives colours to what still has the default grey: grounds a checker, other fixed things a stone's; bodies one by
    how many joints are between them and their root, or one each where there are none.

    Args:
        visuals: of a builder with its bodies and joints.
        tile: side of the checker's squares [m]; None: about half of what the bodies span.
    """
    ground: int | None = None
    colors = body_colors(visuals)
    for index, instance in enumerate(visuals.instances):
        if tuple(instance.appearance.color) != GREY or instance.appearance.texture >= 0:
            continue
        appearance = dataclasses.replace(
            instance.appearance, color=STONE if instance.body == WORLD else colors[instance.body]
        )
        if instance.kind in GROUNDS:
            if ground is None:
                ground = visuals.texture(CheckerTexture(colors=FLOOR, metres=_tile(visuals) if tile is None else tile))
            appearance = dataclasses.replace(appearance, color=(1.0, 1.0, 1.0), texture=ground)
        visuals.instances[index] = dataclasses.replace(instance, appearance=appearance)


def _tile(visuals: Visuals) -> float:
    """A power of two metres near half of what the bodies span."""
    places = np.array([body.pose.position for body in visuals.builder.bodies]).reshape(-1, 3)
    span = float(np.ptp(places, axis=0).max(initial=0.0)) if len(places) > 1 else 2.0
    return float(2.0 ** np.clip(np.round(np.log2(max(span, 1e-3) / 2.0)), -4, 4))


def body_colors(visuals: Visuals) -> list[Vec3]:
    """A colour of the palette for every body."""
    builder = visuals.builder
    parent = {
        joint.child: joint.parent for joint in reversed(builder.joints)
        if joint.type not in (JointType.SHAFT, JointType.FREE) and joint.child != WORLD
    }  # fmt: skip
    jointed = set(parent) | set(parent.values())
    numbers = []
    for body in range(len(builder.bodies)):
        depth, seen, above = 0, {body}, parent.get(body, WORLD)
        while above != WORLD and above not in seen:
            seen.add(above)
            depth, above = depth + 1, parent.get(above, WORLD)
        numbers.append(depth if body in jointed else body)
    return [PALETTE[number % len(PALETTE)] for number in numbers]


def add_skeleton(visuals: Visuals, radius: float, color: Vec3 | None = None) -> None:
    """Draws every jointed body as rods: from its joint towards the parent to its other joints and to the middles of
    its shapes; from the centre of mass of a root to its joints.

    Args:
        visuals: of a builder with its joints and shapes.
        radius: of the rods [m].
        color: linear; None: that of the body in the palette.
    """
    builder = visuals.builder
    start: dict[int, Array] = {}
    ends: dict[int, list[Array]] = {}
    for joint in builder.joints:
        if joint.type in (JointType.SHAFT, JointType.FREE):
            continue
        if joint.parent >= 0:
            ends.setdefault(joint.parent, []).append(joint.frame0.position)
        if joint.child >= 0 and joint.child in start:  # it closes a loop
            ends.setdefault(joint.child, []).append(joint.frame1.position)
        elif joint.child >= 0:
            start[joint.child] = joint.frame1.position
    for shape in builder.shapes:
        if shape.body in start:
            ends.setdefault(shape.body, []).append(shape.pose.position)
    colors = body_colors(visuals)
    for body, points in ends.items():
        first = start.get(body, np.zeros(3))
        for index, end in enumerate(points):
            length = float(np.linalg.norm(end - first))
            if length > radius:
                visuals.add_capsule(
                    body, radius=radius, half_length=0.5 * length, name=f"bone_{body}_{index}",
                    pose=pose(0.5 * (first + end), _turn_to((end - first) / length)),
                    color=colors[body] if color is None else color,
                )  # fmt: skip


def add_bodies(visuals: Visuals) -> None:
    """Draws every body as the box that has its inertia, and rods from there to its joints: a builder without shapes.

    A homogeneous box of half lengths a, b, c has the moments m (b² + c²) / 3 and so on, in its principal axes.
    """
    bodies = visuals.builder.bodies
    places = np.array([body.pose.position for body in bodies]).reshape(-1, 3)
    span = float(np.ptp(places, axis=0).max(initial=0.0))
    radius = max(0.02 * span, 0.02)
    # boxes of motors' rotors or published inertias can be far larger or smaller than the robot
    most = max(0.5 * span, 0.5)
    for body, color in enumerate(body_colors(visuals)):
        half, turn = inertia_box(bodies[body].mass, bodies[body].inertia)
        sizes = np.clip(half, radius, most)
        visuals.add_box(body, half=tuple(sizes), name=f"box_{body}", pose=pose((0.0, 0.0, 0.0), turn), color=color)
    add_rods(visuals, radius)


def inertia_box(mass: float, inertia: Array) -> tuple[Array, Array]:
    """Half lengths [m] and rotation (xyzw, in body axes) of the homogeneous box of a mass [kg] and inertia [kg·m²]."""
    moments, axes = np.linalg.eigh(np.asarray(inertia, np.float64))
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    if mass <= 0.0:
        return np.zeros(3), quat_from_matrix(axes)
    squares = 1.5 * (moments.sum() - 2.0 * moments) / mass
    return np.sqrt(np.maximum(squares, 0.0)), quat_from_matrix(axes)


def add_rods(visuals: Visuals, radius: float) -> None:
    """Draws rods from the centre of mass of every body to its joints.

    Args:
        visuals: of a builder with its joints.
        radius: of the rods [m].
    """
    colors = body_colors(visuals)
    for index, joint in enumerate(visuals.builder.joints):
        if joint.type in (JointType.SHAFT, JointType.FREE):
            continue
        for body, frame in ((joint.parent, joint.frame0), (joint.child, joint.frame1)):
            length = float(np.linalg.norm(frame.position))
            if body >= 0 and length > radius:
                visuals.add_capsule(
                    body, radius=radius, half_length=0.5 * length, name=f"rod_{index}_{body}",
                    pose=pose(0.5 * frame.position, _turn_to(frame.position / length)), color=colors[body],
                )  # fmt: skip


def _turn_to(axis: Array) -> Array:
    """A rotation that takes z to a unit axis."""
    helper = np.eye(3)[int(np.abs(axis).argmin())]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return quat_from_matrix(np.stack([x, np.cross(axis, x), axis], axis=1))
