"""One side of an axle during assembly: hardpoints in the world, mirrored where the right side asks for it."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from simwarp.core.rotation import frame_from_axis, rotate
from simwarp.core.types import Pose, Table, pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.spec.parts import Array, inertia_matrix
from simwarp.vehicle.spec.vehicle_spec import Bushing, ForceLine, Points, RigidPart, Vec3


def arm_axes(front: Vec3, back: Vec3, tip: Vec3) -> Array:
    """Axes (columns) of an A-arm: x from its back to its front pivot, z normal to its plane."""
    f, b, t = (np.asarray(p, float) for p in (front, back, tip))
    z = np.cross(b - t, f - t)
    x = f - b
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def link_axes(start: Vec3, end: Vec3) -> Array:
    """Axes (columns) of a link: y from its start to its end, x level."""
    y = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    x = np.cross(y, (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def plane_axes(tip: Vec3, root: Vec3, third: Vec3) -> Array:
    """Axes (columns) of a link: z from its tip to its root, y normal to the plane with a third point."""
    t, r, p = (np.asarray(point, float) for point in (tip, root, third))
    z, y = r - t, np.cross(t - p, r - p)
    z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)


def across(start: Vec3, end: Vec3) -> tuple[Vec3, Vec3]:
    """Two unit vectors perpendicular to a line and to each other."""
    z = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return vec3(x), vec3(np.cross(z, x))


def vec3(values: Array) -> Vec3:
    """Three numbers as a tuple."""
    x, y, z = (float(v) for v in values)
    return x, y, z


@dataclasses.dataclass(frozen=True)
class Frame:
    """A frame of the vehicle at rest in the world: origin [m], xyzw rotation; `side` -1 mirrors y."""

    builder: ModelBuilder
    name: str
    origin: Pose
    side: float = 1.0

    def at(self, point: Vec3) -> Array:
        """A point of the frame (of the left side) in the world [m]."""
        return self.origin.position + self.along(point)

    def along(self, vector: Vec3) -> Array:
        """A direction or offset of the frame in the world."""
        return rotate(self.origin.rotation, np.multiply(vector, (1.0, self.side, 1.0)))

    def turning(self, axis: Vec3) -> Array:
        """An axis of rotation in the world: mirrored, the left side's positive turn stays the right side's."""
        return rotate(self.origin.rotation, np.multiply(axis, (self.side, 1.0, self.side)))

    def add_body(self, name: str, part: RigidPart, axes: Array | None = None) -> int:
        """A body with axes parallel to the frame's; `axes` are those that its inertia is given in."""
        inertia = inertia_matrix(part)
        if axes is not None:
            inertia = axes @ inertia @ axes.T
        mirror = np.diag([1.0, self.side, 1.0])
        return self.builder.add_body(
            f"{self.name}.{name}", mass=part.mass, inertia=mirror @ inertia @ mirror,
            pose=pose(self.at(part.com), self.origin.rotation), strict=False,
        )  # fmt: skip

    def add_line(self, name: str, parent: int, child: int, line: ForceLine) -> int:
        """A spring, a damper or both between the chassis and a body of this side."""
        anchor0, anchor1 = self.at(line.chassis_point), self.at(line.arm_point)
        law = line_law(line, float(np.linalg.norm(anchor1 - anchor0)))
        return self.builder.add_spring(f"{self.name}.{name}", parent, child, anchor0=anchor0, anchor1=anchor1, **law)


def line_law(line: ForceLine, length: float, zero: float = 0.0) -> dict[str, Any]:
    """Fields of `Dof` for a coordinate that is the line's length less `zero` [m]; `length`: as built [m]."""
    rest = length if line.rest_length is None else line.rest_length
    law: dict[str, Any] = {"preload": line.preload, "rest": rest - zero}
    spring = spring_table(line, rest)
    law |= {"stiffness": line.stiffness} if spring is None else {"spring_table": spring}
    if line.damper_map is not None:
        lengths, rates, forces = line.damper_map
        return law | {"damper_map": ([place - zero for place in lengths], rates, forces)}
    return law | (
        {"damping": line.damping} if line.damper_curve is None else {"damper_table": table(line.damper_curve)}
    )


def merged_lines(lines: tuple[ForceLine, ...]) -> tuple[ForceLine, ...]:
    """A spring and a damper between the same two points as one line: one row of the solve less."""
    kept: list[ForceLine] = []
    for line in lines:
        for index, other in enumerate(kept):
            together = line.chassis_point == other.chassis_point and line.arm_point == other.arm_point
            if together and _no_spring(line) and _no_damper(other):
                kept[index] = _with_damper(other, line)
                break
            if together and _no_spring(other) and _no_damper(line):
                kept[index] = _with_damper(line, other)
                break
        else:
            kept.append(line)
    return tuple(kept)


def _no_spring(line: ForceLine) -> bool:
    stops = line.bump_curve is not None and (line.min_length is not None or line.max_length is not None)
    return line.stiffness == 0.0 and line.preload == 0.0 and line.spring_curve is None and not stops


def _no_damper(line: ForceLine) -> bool:
    return line.damping == 0.0 and line.damper_curve is None and line.damper_map is None


def _with_damper(spring: ForceLine, damper: ForceLine) -> ForceLine:
    return dataclasses.replace(
        spring, damping=damper.damping, damper_curve=damper.damper_curve, damper_map=damper.damper_map
    )


def table(points: Points) -> Table:
    """Abscissae and values."""
    return [float(x) for x, _ in points], [float(y) for _, y in points]


def spring_table(line: ForceLine, rest: float) -> Table | None:
    """Restoring force over deformation (length less rest length), with the bump stops; None if it is linear.

    Both ends of a stop's curve go on with its last slope.
    """
    stops = [stop for stop in (line.min_length, line.max_length) if stop is not None]
    if line.bump_curve is None or not stops:
        return None if line.spring_curve is None else table(line.spring_curve)
    bump_x, bump_y = (np.array(v) for v in zip(*line.bump_curve, strict=True))
    knots: set[float] = set()
    if line.spring_curve is not None:
        knots |= {float(x) for x, _ in line.spring_curve}
    if line.min_length is not None:
        knots |= {float(line.min_length - rest - x) for x in bump_x}
    if line.max_length is not None:
        knots |= {float(line.max_length - rest + x) for x in bump_x}
    x = np.array(sorted(knots))
    x = np.concatenate([[x[0] - 0.1], x, [x[-1] + 0.1]])
    y = (
        line.stiffness * x
        if line.spring_curve is None
        else extended(x, *(np.array(v) for v in table(line.spring_curve)))
    )
    if line.min_length is not None:
        y = y - np.where(x < line.min_length - rest, extended(line.min_length - rest - x, bump_x, bump_y), 0.0)
    if line.max_length is not None:
        y = y + np.where(x > line.max_length - rest, extended(x - line.max_length + rest, bump_x, bump_y), 0.0)
    return x.tolist(), y.tolist()


def spring_force(line: ForceLine, length: Array) -> Array:
    """(...,) force with which a spring and its bump stops push their ends apart at rest [N], at lengths (...,) [m]."""
    rest = math.dist(line.chassis_point, line.arm_point) if line.rest_length is None else line.rest_length
    found = spring_table(line, rest)
    if found is None:
        return np.asarray(line.preload - line.stiffness * (length - rest))
    return np.asarray(line.preload - extended(length - rest, *(np.array(values) for values in found)))


def extended(x: Array, knots: Array, values: Array) -> Array:
    """Piecewise linear interpolation that goes on with its end slopes."""
    y = np.interp(x, knots, values)
    slopes = np.diff(values) / np.diff(knots)
    y = np.where(x < knots[0], values[0] + slopes[0] * (x - knots[0]), y)
    return np.where(x > knots[-1], values[-1] + slopes[-1] * (x - knots[-1]), y)


@dataclasses.dataclass(frozen=True)
class AttachmentBodies:
    """Bodies of one side that other parts hang on."""

    carrier: int
    """Body that the spindle turns in."""
    bar: int
    """Body that the link of an anti-roll bar holds."""


def add_lines(frame: Frame, lines: tuple[ForceLine, ...], chassis: int, body: int) -> None:
    """Springs and dampers between the chassis and a body."""
    for index, line in enumerate(merged_lines(lines)):
        frame.add_line(f"spring{index}", chassis, body, line)


def add_rod(frame: Frame, name: str, body0: int, body1: int, point0: Vec3, point1: Vec3) -> None:
    """A massless link between two balls."""
    frame.builder.add_joint_distance(
        f"{frame.name}.{name}", body0, body1, anchor0=frame.at(point0), anchor1=frame.at(point1)
    )


def add_ball(frame: Frame, name: str, body0: int, body1: int, point: Vec3) -> None:
    """A ball joint."""
    frame.builder.add_joint_spherical(f"{frame.name}.{name}", body0, body1, anchor=frame.at(point))


def add_cross(frame: Frame, name: str, body: int, link: int, root: Vec3, tip: Vec3) -> None:
    """A universal joint at a link's root: the link swings both ways and does not spin about its length."""
    axis0, axis1 = (frame.along(axis) for axis in across(root, tip))
    frame.builder.add_joint_universal(
        f"{frame.name}.{name}", body, link, anchor=frame.at(root), axis0=axis0, axis1=axis1
    )


def add_hinge(
    frame: Frame, name: str, chassis: int, arm: int, front: Vec3, back: Vec3, bushing: Bushing | None = None
) -> None:
    """The hinge of an arm on the chassis, about the line of its two pivots.

    A bushing takes its place: it holds the arm by springs and dampers and leaves it free about that line.
    """
    builder, label = frame.builder, f"{frame.name}.{name}.hinge"
    f, b = frame.at(front), frame.at(back)
    anchor = 0.5 * (f + b)
    if bushing is None:
        builder.add_joint_revolute(label, chassis, arm, axis=f - b, anchor=anchor)
        return
    linear, angular = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.0])
    builder.add_bushing(
        label, chassis, arm, anchor=anchor, rotation=frame_from_axis(label, f - b),
        stiffness=(linear * bushing.stiffness_linear + angular * bushing.stiffness_rotational).tolist(),
        damping=(linear * bushing.damping_linear + angular * bushing.damping_rotational).tolist(),
    )  # fmt: skip
