"""Suspension templates: from a description to bodies, joints and springs of one side of an axle.

Each template builds the linkage and returns what carries the spindle; `add_side` then adds the spindle itself with its
wheel and tire, the hinge with the brake, and the turn that a driveline couples to.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from simwarp.rotation import quat_multiply, rotate
from simwarp.types import pose
from simwarp.vehicle.corner import Array, Frame, arm_axes, link_axes
from simwarp.vehicle.spec import (
    Axle,
    DoubleWishbone,
    DoubleWishboneReduced,
    ForceLine,
    RigidSuspension,
    SingleWishbone,
    SpecError,
    Suspension,
    Vec3,
)


@dataclasses.dataclass(frozen=True)
class Side:
    """Indices of one wheel's parts: bodies and joints of the builder."""

    name: str
    axle: int
    side: float
    carrier: int
    """Body that the spindle turns in."""
    spindle: int
    spin: int
    """Hinge of the spindle; its dry friction is the brake."""
    turn: int
    """Rotation of the wheel seen from the chassis: the driveline's axle shaft."""


def add_side(frame: Frame, index: int, axle: Axle, chassis: int, tierod_body: int) -> Side:
    """One side of an axle.

    Args:
        frame: of the axle, with the side's mirror.
        index: of the axle, from the front.
        chassis: body.
        tierod_body: steering link, or the chassis.
    """
    carrier = _carrier(frame, axle.suspension, chassis, tierod_body)
    builder = frame.builder
    rotation, axis = _wheel_axis(frame, axle.suspension)
    part = axle.suspension.spindle
    inertia = np.diag(part.inertia) + np.diag(axle.wheel.inertia) + np.diag(axle.tire.inertia)
    inertia[1, 1] += axle.suspension.axle_inertia
    center = (part.com[0], part.com[1] + axle.wheel.offset, part.com[2])
    mass = part.mass + axle.wheel.mass + axle.tire.mass
    spindle = builder.add_body(
        f"{frame.name}.spindle", mass=mass, inertia=inertia, pose=pose(frame.at(center), rotation), strict=False
    )
    brake = 0.0 if axle.brake is None else axle.brake.max_torque
    spin = builder.add_joint_revolute(f"{frame.name}.spin", carrier, spindle, axis=axis, friction=brake)
    turn = builder.add_turn(f"{frame.name}.axle", chassis, spindle, axis=axis)
    return Side(frame.name, index, frame.side, carrier, spindle, spin, turn)


def _wheel_axis(frame: Frame, suspension: Suspension) -> tuple[Array, Array]:
    """Orientation (xyzw) of the spindle and its axis of rotation in the world, with toe and camber as built.

    Positive toe turns the front of the left wheel inwards; positive camber leans its top outwards.
    """
    toe = -frame.side * getattr(suspension, "toe", 0.0)
    camber = -frame.side * getattr(suspension, "camber", 0.0)
    about_z = np.array([0.0, 0.0, np.sin(toe / 2.0), np.cos(toe / 2.0)])
    about_x = np.array([np.sin(camber / 2.0), 0.0, 0.0, np.cos(camber / 2.0)])
    rotation = quat_multiply(frame.origin.rotation, quat_multiply(about_z, about_x))
    return rotation, rotate(rotation, np.array([0.0, 1.0, 0.0]))


def _carrier(frame: Frame, suspension: Suspension, chassis: int, tierod_body: int) -> int:
    match suspension:
        case DoubleWishbone():
            return _double_wishbone(frame, suspension, chassis, tierod_body)
        case DoubleWishboneReduced():
            return _double_wishbone_reduced(frame, suspension, chassis, tierod_body)
        case SingleWishbone():
            return _single_wishbone(frame, suspension, chassis, tierod_body)
        case RigidSuspension():
            return chassis
    raise SpecError(f"suspension: template '{suspension.template}' cannot be assembled yet")


def _middle(a: Array, b: Array) -> Array:
    return 0.5 * (a + b)


def _add_lines(frame: Frame, lines: tuple[ForceLine, ...], chassis: int, body: int) -> None:
    for index, line in enumerate(lines):
        frame.add_line(f"spring{index}", chassis, body, line)


def _add_rod(frame: Frame, name: str, body0: int, body1: int, point0: Vec3, point1: Vec3) -> None:
    """A massless link between two balls."""
    frame.builder.add_joint_distance(
        f"{frame.name}.{name}", body0, body1, anchor0=frame.at(point0), anchor1=frame.at(point1)
    )


def _add_arm(frame: Frame, name: str, arm: int, chassis: int, front: Vec3, back: Vec3) -> None:
    """The hinge of an A-arm on the chassis."""
    f, b = frame.at(front), frame.at(back)
    frame.builder.add_joint_revolute(f"{frame.name}.{name}.hinge", chassis, arm, axis=f - b, anchor=_middle(f, b))


def _double_wishbone(frame: Frame, spec: DoubleWishbone, chassis: int, tierod_body: int) -> int:
    builder, name = frame.builder, frame.name
    own = spec.inertia_axes == "arm"
    upper_axes = arm_axes(spec.upper_arm_front, spec.upper_arm_back, spec.upper_arm_upright) if own else None
    lower_axes = arm_axes(spec.lower_arm_front, spec.lower_arm_back, spec.lower_arm_upright) if own else None
    upright = frame.add_body("upright", spec.upright)
    lower = frame.add_body("lower_arm", spec.lower_arm, lower_axes)
    upper = frame.add_body("upper_arm", spec.upper_arm, upper_axes)
    _add_arm(frame, "lower_arm", lower, chassis, spec.lower_arm_front, spec.lower_arm_back)
    _add_arm(frame, "upper_arm", upper, chassis, spec.upper_arm_front, spec.upper_arm_back)
    builder.add_joint_spherical(f"{name}.lower_ball", lower, upright, anchor=frame.at(spec.lower_arm_upright))
    builder.add_joint_spherical(f"{name}.upper_ball", upper, upright, anchor=frame.at(spec.upper_arm_upright))
    _add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    _add_lines(frame, spec.springs, chassis, lower)
    return upright


def _double_wishbone_reduced(frame: Frame, spec: DoubleWishboneReduced, chassis: int, tierod_body: int) -> int:
    upright = frame.add_body("upright", spec.upright)
    upper, lower = spec.upper_arm_upright, spec.lower_arm_upright
    _add_rod(frame, "upper_front", chassis, upright, spec.upper_arm_front, upper)
    _add_rod(frame, "upper_back", chassis, upright, spec.upper_arm_back, upper)
    _add_rod(frame, "lower_front", chassis, upright, spec.lower_arm_front, lower)
    _add_rod(frame, "lower_back", chassis, upright, spec.lower_arm_back, lower)
    _add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    _add_lines(frame, spec.springs, chassis, upright)
    return upright


def _single_wishbone(frame: Frame, spec: SingleWishbone, chassis: int, tierod_body: int) -> int:
    builder, name = frame.builder, frame.name
    axes = link_axes(spec.arm_chassis, spec.arm_upright) if spec.inertia_axes == "arm" else None
    upright = frame.add_body("upright", spec.upright)
    arm = frame.add_body("arm", spec.arm, axes)
    builder.add_joint_revolute(
        f"{name}.arm.hinge", chassis, arm, axis=frame.turning(spec.arm_axis), anchor=frame.at(spec.arm_chassis)
    )
    builder.add_joint_revolute(
        f"{name}.kingpin", arm, upright, axis=frame.turning(spec.kingpin_axis), anchor=frame.at(spec.arm_upright)
    )
    _add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    _add_lines(frame, spec.springs, chassis, arm)
    return upright
