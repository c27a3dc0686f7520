"""Kinematics of suspensions from their hardpoints alone: Newton's method on loop equations in NumPy, float64.

Nothing here knows how simwarp builds a suspension. An arm between two pivots and a ball is two distances; a body that
moves freely has a displacement and a rotation vector as unknowns, one that turns about a line has an angle. Points are
those of a template's description by name, left side, in the frame of the axle; results are in the vehicle's frame.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Points = Mapping[str, Any]
STEP = 0.02
"""Travel between two solutions on the way to the one asked for [m]."""
PIVOTS = {
    "double-wishbone": (
        ("upper_arm_front", "upper_arm_upright"), ("upper_arm_back", "upper_arm_upright"),
        ("lower_arm_front", "lower_arm_upright"), ("lower_arm_back", "lower_arm_upright"),
    ),
    "multi-link": (
        ("upper_arm_front", "upper_arm_upright"), ("upper_arm_back", "upper_arm_upright"),
        ("lateral_chassis", "lateral_upright"), ("trailing_link_chassis", "trailing_link_upright"),
    ),
    "macpherson-strut": (("lower_arm_front", "lower_arm_upright"), ("lower_arm_back", "lower_arm_upright")),
}  # fmt: skip
"""Points whose distance the arms keep: on the chassis, on the upright."""
PIVOTS["double-wishbone-reduced"] = PIVOTS["double-wishbone"]


class Wheel(NamedTuple):
    """Heading to the left [rad], lean of its top outwards [rad], centre in the vehicle's frame [m]."""

    steer: float
    camber: float
    center: Array


class Motion(NamedTuple):
    """A rigid displacement: x -> pivot + shift + rotation (x - pivot)."""

    pivot: Array
    shift: Array
    rotation: Array

    def __call__(self, point: Array) -> Array:
        return self.pivot + self.shift + self.rotation @ (point - self.pivot)


def exponential(vector: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-9:
        return np.eye(3) + cross + 0.5 * cross @ cross
    return np.eye(3) + np.sin(angle) / angle * cross + (1.0 - np.cos(angle)) / angle**2 * cross @ cross


def turning(point: Array, axis: Array, angle: float) -> Motion:
    """Rotation about a line."""
    return Motion(point, np.zeros(3), exponential(angle * axis / np.linalg.norm(axis)))


def newton(residual: Callable[[Array], Array], start: Array) -> Array:
    """Root of a square system near `start`; derivatives by central differences.

    Raises:
        ArithmeticError: no root there.
    """
    x = np.array(start, dtype=np.float64)
    for _ in range(30):
        r = residual(x)
        if np.abs(r).max() < 1e-13:
            return x
        columns = [(residual(x + e) - residual(x - e)) / 2e-6 for e in 1e-6 * np.eye(len(x))]
        x = x - np.linalg.solve(np.stack(columns, axis=1), r)
        if np.abs(x).max() > 3.0:
            break
    if np.abs(residual(x)).max() < 1e-11:
        return x
    raise ArithmeticError("the linkage does not reach this state")


def distance(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b))


def quaternion(q: tuple[float, float, float, float]) -> Array:
    """Rotation matrix of an xyzw quaternion."""
    vector, w = np.array(q[:3]), q[3]
    length = float(np.linalg.norm(vector))
    return np.eye(3) if length == 0.0 else exponential(vector / length * 2.0 * np.arctan2(length, w))


# ---- steerings -------------------------------------------------------------------------------------------------------


def steering_motion(points: Points, location: Any, rotation: Any, steering: float) -> Motion:
    """Displacement of the steering's link, in the vehicle's frame; `steering` -1 to 1.

    A turn to the left moves the link to the right: tie rods lie behind the wheels' steering axes.
    """
    turn, origin = quaternion(rotation), np.array(location, float)

    def at(name: str) -> Array:
        return origin + turn @ np.array(points[name])

    if points["template"] == "rack-pinion":
        shift = -steering * points["pinion_radius"] * points["max_angle"]
        return Motion(origin, turn @ np.array([0.0, shift, 0.0]), np.eye(3))
    arm_axis = turn @ np.array(points["arm_axis"])
    if points["template"] == "rotary-arm":
        return turning(at("arm_chassis"), arm_axis, -steering * points["max_angle"])
    joint, idler, ball = at("arm_link"), at("idler_chassis"), at("idler_link")
    across, idler_axis = turn @ np.array(points["universal_axis_link"]), turn @ np.array(points["idler_axis"])
    upright = turn @ np.array(points["universal_axis_arm"])
    found = np.zeros(6)
    for share in np.linspace(0.0, 1.0, 5):
        arm = turning(at("arm_chassis"), arm_axis, -share * steering * points["max_angle"])

        def residual(x: Array, arm: Motion = arm) -> Array:
            link = Motion(joint, x[:3], exponential(x[3:]))
            hang = link(ball) - idler
            return np.array(
                [
                    *(link(joint) - arm(joint)),
                    (arm.rotation @ upright) @ (link.rotation @ across),
                    np.linalg.norm(hang) - distance(ball, idler),
                    hang @ idler_axis,
                ]
            )

        found = newton(residual, found)
    return Motion(joint, found[:3], exponential(found[3:]))


# ---- suspensions -----------------------------------------------------------------------------------------------------


class Geometry(NamedTuple):
    """One side of an axle as built, in the vehicle's frame."""

    points: Points
    location: Array
    side: float
    wheel_offset: float

    def at(self, name: str) -> Array:
        return self.location + np.array(self.points[name]) * (1.0, self.side, 1.0)

    @property
    def center(self) -> Array:
        middle = np.add(self.points["spindle"].com, (0.0, self.wheel_offset, 0.0))
        return self.location + middle * (1.0, self.side, 1.0)

    @property
    def axis(self) -> Array:
        """Of the wheel, to the left."""
        toe, camber = (-self.side * self.points.get(name, 0.0) for name in ("toe", "camber"))
        about_z, about_x = exponential(np.array([0.0, 0.0, toe])), exponential(np.array([camber, 0.0, 0.0]))
        return about_z @ about_x @ np.array([0.0, 1.0, 0.0])

    def line(self, name: str) -> Array:
        """Direction of an axis; mirrored like a point's, which leaves the line of a hinge where it belongs."""
        return np.array(self.points[name]) * (1.0, self.side, 1.0)


Linkage = Callable[[Array], tuple[Array, Motion]]
"""From unknowns to the equations that close the linkage and the displacement of what carries the wheel."""


def free_upright(geometry: Geometry, link: Motion) -> tuple[Linkage, int]:
    """Six unknowns of the upright; distances to the chassis and the steering link, and a strut's line."""
    template = geometry.points["template"]
    rods = [(geometry.at(a), geometry.at(b), distance(geometry.at(a), geometry.at(b))) for a, b in PIVOTS[template]]
    inner, outer = geometry.at("tierod_chassis"), geometry.at("tierod_upright")
    rods.append((link(inner), outer, distance(inner, outer)))
    center = geometry.center

    def linkage(x: Array) -> tuple[Array, Motion]:
        upright = Motion(center, x[:3], exponential(x[3:]))
        equations = [distance(chassis, upright(ball)) - length for chassis, ball, length in rods]
        if template == "macpherson-strut":
            # the strut's upper pivot stays on a line of the upright
            top, bottom = geometry.at("strut_chassis"), geometry.at("strut_upright")
            along = (top - bottom) / np.linalg.norm(top - bottom)
            first = np.cross(along, (1.0, 0.0, 0.0))
            back = upright.rotation.T @ (top - upright(bottom))
            equations += [float(back @ first), float(back @ np.cross(along, first))]
        return np.array(equations), upright

    return linkage, 6


def wishbone_and_kingpin(geometry: Geometry, link: Motion) -> tuple[Linkage, int]:
    """Two angles: of the arm on the chassis, of the upright on the arm; the tie rod's length closes the loop."""
    inner, outer = geometry.at("tierod_chassis"), geometry.at("tierod_upright")
    root, tip = geometry.at("arm_chassis"), geometry.at("arm_upright")

    def linkage(x: Array) -> tuple[Array, Motion]:
        arm = turning(root, geometry.line("arm_axis"), x[0])
        kingpin = turning(tip, geometry.line("kingpin_axis"), x[1])
        rotation = arm.rotation @ kingpin.rotation
        upright = Motion(tip, arm(tip) - tip, rotation)
        return np.array([distance(link(inner), upright(outer)) - distance(inner, outer)]), upright

    return linkage, 2


def trailing(geometry: Geometry, _link: Motion) -> tuple[Linkage, int]:
    """One angle."""

    def linkage(x: Array) -> tuple[Array, Motion]:
        return np.zeros(0), turning(geometry.at("pivot"), geometry.line("pivot_axis"), x[0])

    return linkage, 1


LINKAGES: dict[str, Callable[[Geometry, Motion], tuple[Linkage, int]]] = {
    **dict.fromkeys(PIVOTS, free_upright),
    "single-wishbone": wishbone_and_kingpin,
    "trailing-arm": trailing,
}


def path(travel: float) -> Array:
    """Travels on the way, the last one asked for."""
    return np.linspace(0.0, travel, 1 + max(1, int(np.ceil(abs(travel) / STEP))))


def wheel(geometry: Geometry, motion: Motion) -> Wheel:
    """Angles and place of the wheel that moves with a displacement."""
    axis = motion.rotation @ geometry.axis
    steer = float(np.arctan2(-axis[0], axis[1]))
    return Wheel(steer, -geometry.side * float(np.arcsin(axis[2])), motion(geometry.center))


def side_wheel(geometry: Geometry, travel: float, link: Callable[[float], Motion], steering: float) -> Wheel:
    """One side of an axle: the steering goes first, then the travel."""
    heights = [0.0] * 5 + list(path(travel))
    inputs = [*np.linspace(0.0, steering, 5), *([steering] * len(path(travel)))]
    motion, found = None, None
    for height, value in zip(heights, inputs, strict=True):
        linkage, size = LINKAGES[geometry.points["template"]](geometry, link(float(value)))

        def residual(x: Array, linkage: Linkage = linkage, height: float = height) -> Array:
            equations, moved = linkage(x)
            return np.append(equations, moved(geometry.center)[2] - geometry.center[2] - height)

        found = newton(residual, np.zeros(size) if found is None else found)
        motion = linkage(found)[1]
    assert motion is not None
    return wheel(geometry, motion)


def solid_axle_wheels(
    left: Geometry, right: Geometry, travels: tuple[float, float], link: Callable[[float], Motion], steering: float
) -> tuple[Wheel, Wheel]:
    """Eight unknowns: displacement of the tube, angles of both knuckles on it."""
    sides, center = (left, right), left.location
    rods = [
        (side.at(f"{name}_chassis"), side.at(f"{name}_axle"))
        for side, name in itertools.product(sides, ("upper_link", "lower_link"))
    ]
    steered = left.points.get("draglink_chassis") is not None
    found = np.zeros(8)
    motions: list[Motion] = []
    for share in np.linspace(0.0, 1.0, 11):
        moved_link = link(share * steering)

        def knuckles(x: Array) -> tuple[Motion, list[Motion]]:
            tube = Motion(center, x[:3], exponential(x[3:6]))
            turned = []
            for side, angle in zip(sides, x[6:], strict=True):
                bottom = side.at("knuckle_lower")
                kingpin = turning(bottom, side.at("knuckle_upper") - bottom, angle)
                turned.append(Motion(bottom, tube(bottom) - bottom, tube.rotation @ kingpin.rotation))
            return tube, turned

        def residual(x: Array, moved_link: Motion = moved_link, share: float = share) -> Array:
            tube, turned = knuckles(x)
            lengths = [distance(tube(axle), chassis) - distance(axle, chassis) for chassis, axle in rods]
            heights = [
                motion(side.center)[2] - side.center[2] - share * travel
                for motion, side, travel in zip(turned, sides, travels, strict=True)
            ]
            if not steered:
                return np.array([*lengths, *heights, *x[6:]])
            ends = [side.at("tierod_knuckle") for side in sides]
            tierod = distance(turned[0](ends[0]), turned[1](ends[1])) - distance(*ends)
            inner, outer = left.at("draglink_chassis"), left.at("draglink_knuckle")
            draglink = distance(moved_link(inner), turned[0](outer)) - distance(inner, outer)
            return np.array([*lengths, *heights, tierod, draglink])

        found = newton(residual, found)
        motions = knuckles(found)[1]
    return wheel(left, motions[0]), wheel(right, motions[1])


def axle_wheels(
    points: Points, location: Any, travels: tuple[float, float], steering: float = 0.0, *, wheel_offset: float = 0.0,
    mount: tuple[Points, Any, Any] | None = None,
) -> tuple[Wheel, Wheel]:  # fmt: skip
    """Left and right wheel of an axle.

    Args:
        points: the suspension's description by name.
        location: of the axle in the vehicle's frame.
        travels: of the wheels' centres upwards [m].
        mount: description, location and orientation (xyzw) of the steering that holds the tie rods.
    """
    place = np.array(location, float)
    left, right = (Geometry(points, place, side, wheel_offset) for side in (1.0, -1.0))
    known: dict[float, Motion] = {}

    def link(value: float) -> Motion:
        if mount is None:
            return Motion(np.zeros(3), np.zeros(3), np.eye(3))
        if value not in known:
            known[value] = steering_motion(mount[0], mount[1], mount[2], value)
        return known[value]

    if points["template"] == "solid-axle":
        return solid_axle_wheels(left, right, travels, link, steering)
    return side_wheel(left, travels[0], link, steering), side_wheel(right, travels[1], link, steering)
