"""Double wishbones with massive and with massless arms, and the single wishbone: one side each."""

from __future__ import annotations

from simwarp.vehicle.spec.vehicle_spec import DoubleWishbone, DoubleWishboneReduced, SingleWishbone
from simwarp.vehicle.suspensions.corner import Frame, arm_axes, link_axes
from simwarp.vehicle.suspensions.linkage import AttachmentBodies, add_ball, add_hinge, add_lines, add_rod


def double_wishbone(frame: Frame, spec: DoubleWishbone, chassis: int, tierod_body: int) -> AttachmentBodies:
    """Two A-arms hinged on the chassis, balls to the upright; the anti-roll bar holds the lower arm."""
    own = spec.inertia_axes == "arm"
    upper_axes = arm_axes(spec.upper_arm_front, spec.upper_arm_back, spec.upper_arm_upright) if own else None
    lower_axes = arm_axes(spec.lower_arm_front, spec.lower_arm_back, spec.lower_arm_upright) if own else None
    upright = frame.add_body("upright", spec.upright)
    lower = frame.add_body("lower_arm", spec.lower_arm, lower_axes)
    upper = frame.add_body("upper_arm", spec.upper_arm, upper_axes)
    add_hinge(frame, "lower_arm", chassis, lower, spec.lower_arm_front, spec.lower_arm_back, spec.lower_arm_bushing)
    add_hinge(frame, "upper_arm", chassis, upper, spec.upper_arm_front, spec.upper_arm_back, spec.upper_arm_bushing)
    add_ball(frame, "lower_ball", lower, upright, spec.lower_arm_upright)
    add_ball(frame, "upper_ball", upper, upright, spec.upper_arm_upright)
    add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    add_lines(frame, spec.springs, chassis, lower)
    return AttachmentBodies(upright, lower)


def double_wishbone_reduced(
    frame: Frame, spec: DoubleWishboneReduced, chassis: int, tierod_body: int
) -> AttachmentBodies:
    """Each arm is two massless rods from the chassis to the upright."""
    upright = frame.add_body("upright", spec.upright)
    upper, lower = spec.upper_arm_upright, spec.lower_arm_upright
    add_rod(frame, "upper_front", chassis, upright, spec.upper_arm_front, upper)
    add_rod(frame, "upper_back", chassis, upright, spec.upper_arm_back, upper)
    add_rod(frame, "lower_front", chassis, upright, spec.lower_arm_front, lower)
    add_rod(frame, "lower_back", chassis, upright, spec.lower_arm_back, lower)
    add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    add_lines(frame, spec.springs, chassis, upright)
    return AttachmentBodies(upright, upright)


def single_wishbone(frame: Frame, spec: SingleWishbone, chassis: int, tierod_body: int) -> AttachmentBodies:
    """An arm hinged on the chassis, the upright hinged on it; the anti-roll bar holds the arm."""
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
    add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    add_lines(frame, spec.springs, chassis, arm)
    return AttachmentBodies(upright, arm)
