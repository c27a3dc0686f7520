"""Steering templates: from a description to the body that holds the tie rods and the coordinate that moves it."""

from __future__ import annotations

import dataclasses
from typing import Final

from simwarp.core.types import PrescribedPosition
from simwarp.vehicle.spec.vehicle_spec import PitmanArm, RackPinion, RotaryArm, SpecError, Steering
from simwarp.vehicle.suspensions.corner import Frame

HANDWHEEL: Final = 540.0
"""Turn of a steering wheel at full steering that rates and limits of the standards are taken by [deg]."""


@dataclasses.dataclass(frozen=True)
class SteeringParts:
    """The steering's link, its moved joint, and that joint's travel at full steering to the left [rad or m]."""

    link: int
    joint: int
    travel: float


def add_steering(frame: Frame, steering: Steering, chassis: int) -> SteeringParts:
    """Bodies and joints of a steering; positive input turns to the left where the tie rods lie behind the axle, as
    they do in vehicles that are described for this sign.
    """
    match steering:
        case PitmanArm():
            return _pitman_arm(frame, steering, chassis)
        case RackPinion():
            return _rack_pinion(frame, steering, chassis)
        case RotaryArm():
            return _rotary_arm(frame, steering, chassis)
    raise SpecError(f"steering: template '{steering.template}' is not known")


def _pitman_arm(frame: Frame, spec: PitmanArm, chassis: int) -> SteeringParts:
    builder, name = frame.builder, frame.name
    link = frame.add_body("link", spec.link)
    arm = frame.add_body("arm", spec.arm)
    joint = builder.add_joint_revolute(
        f"{name}.arm.hinge", chassis, arm, axis=frame.along(spec.arm_axis), anchor=frame.at(spec.arm_chassis),
        drive=PrescribedPosition(),
    )  # fmt: skip
    builder.add_joint_universal(
        f"{name}.universal", arm, link, anchor=frame.at(spec.arm_link), axis0=frame.along(spec.universal_axis_arm),
        axis1=frame.along(spec.universal_axis_link),
    )  # fmt: skip
    builder.add_joint_revolute_spherical(
        f"{name}.idler", chassis, link, anchor0=frame.at(spec.idler_chassis), axis=frame.along(spec.idler_axis),
        anchor1=frame.at(spec.idler_link),
    )  # fmt: skip
    return SteeringParts(link, joint, -spec.max_angle)


def _rack_pinion(frame: Frame, spec: RackPinion, chassis: int) -> SteeringParts:
    link = frame.add_body("rack", spec.link)
    joint = frame.builder.add_joint_prismatic(
        f"{frame.name}.slide", chassis, link, axis=frame.along((0.0, 1.0, 0.0)), drive=PrescribedPosition()
    )
    return SteeringParts(link, joint, -spec.pinion_radius * spec.max_angle)


def _rotary_arm(frame: Frame, spec: RotaryArm, chassis: int) -> SteeringParts:
    arm = frame.add_body("arm", spec.arm)
    joint = frame.builder.add_joint_revolute(
        f"{frame.name}.hinge", chassis, arm, axis=frame.along(spec.arm_axis), anchor=frame.at(spec.arm_chassis),
        drive=PrescribedPosition(),
    )  # fmt: skip
    return SteeringParts(arm, joint, -spec.max_angle)
