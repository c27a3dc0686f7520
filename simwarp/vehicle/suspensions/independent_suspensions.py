"""Independent suspensions, one side each: wishbones, MacPherson strut, multi-link suspension and trailing arm."""

from __future__ import annotations

import numpy as np

from simwarp.core.types import Dof
from simwarp.vehicle.spec.vehicle_spec import (
    DoubleWishbone,
    DoubleWishboneReduced,
    ForceLine,
    MacPhersonStrut,
    MultiLink,
    SingleWishbone,
    ThreeLink,
    TrailingArm,
)
from simwarp.vehicle.suspensions.corner import (
    AttachmentBodies,
    Frame,
    add_ball,
    add_cross,
    add_hinge,
    add_lines,
    add_rod,
    arm_axes,
    line_law,
    link_axes,
    merged_lines,
    plane_axes,
)


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


def macpherson_strut(frame: Frame, spec: MacPhersonStrut, chassis: int, tierod_body: int) -> AttachmentBodies:
    """The strut swings on the chassis and slides along the upright; the anti-roll bar holds the lower arm.

    A spring on the strut's own line acts on the coordinate of the slide and costs no row; any other is a line.
    """
    builder, name = frame.builder, frame.name
    own = spec.inertia_axes == "arm"
    axes = arm_axes(spec.lower_arm_front, spec.lower_arm_back, spec.lower_arm_upright) if own else None
    upright = frame.add_body("upright", spec.upright)
    strut = frame.add_body("strut", spec.strut)
    lower = frame.add_body("lower_arm", spec.lower_arm, axes)
    add_hinge(frame, "lower_arm", chassis, lower, spec.lower_arm_front, spec.lower_arm_back)
    add_cross(frame, "strut.cross", chassis, strut, spec.strut_chassis, spec.strut_upright)
    top, bottom = frame.at(spec.strut_chassis), frame.at(spec.strut_upright)
    lines = merged_lines(spec.springs)
    own_line, others = _split(lines, spec)
    slide = Dof()
    if own_line is not None:
        length = float(np.linalg.norm(bottom - top))
        slide = Dof(**line_law(own_line, length, zero=length))
    builder.add_joint_cylindrical(
        f"{name}.strut.slide", strut, upright, axis=bottom - top, anchor=bottom, dofs=(slide, Dof())
    )
    add_ball(frame, "lower_ball", lower, upright, spec.lower_arm_upright)
    add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    add_lines(frame, others, chassis, upright)
    return AttachmentBodies(upright, lower)


def _split(lines: tuple[ForceLine, ...], spec: MacPhersonStrut) -> tuple[ForceLine | None, tuple[ForceLine, ...]]:
    """The line that lies on the strut, and the others."""
    for index, line in enumerate(lines):
        if line.chassis_point == spec.strut_chassis and line.arm_point == spec.strut_upright:
            return line, lines[:index] + lines[index + 1 :]
    return None, lines


def multi_link(frame: Frame, spec: MultiLink, chassis: int, tierod_body: int) -> AttachmentBodies:
    """An A-arm above; lateral and trailing link with a cross on the chassis and a ball on the upright, so that none
    spins about its length. The anti-roll bar holds the trailing link.
    """
    arm = lateral = trailing = None
    if spec.inertia_axes == "arm":
        below = spec.trailing_link_upright
        arm = arm_axes(spec.upper_arm_front, spec.upper_arm_back, spec.upper_arm_upright)
        lateral = plane_axes(spec.lateral_upright, spec.lateral_chassis, below)
        trailing = plane_axes(below, spec.trailing_link_chassis, spec.springs[0].arm_point)
    upright = frame.add_body("upright", spec.upright)
    upper = frame.add_body("upper_arm", spec.upper_arm, arm)
    side = frame.add_body("lateral", spec.lateral, lateral)
    behind = frame.add_body("trailing_link", spec.trailing_link, trailing)
    add_hinge(frame, "upper_arm", chassis, upper, spec.upper_arm_front, spec.upper_arm_back)
    add_cross(frame, "lateral.cross", chassis, side, spec.lateral_chassis, spec.lateral_upright)
    add_cross(frame, "trailing_link.cross", chassis, behind, spec.trailing_link_chassis, spec.trailing_link_upright)
    add_ball(frame, "upper_ball", upper, upright, spec.upper_arm_upright)
    add_ball(frame, "lateral.ball", side, upright, spec.lateral_upright)
    add_ball(frame, "trailing_link.ball", behind, upright, spec.trailing_link_upright)
    add_rod(frame, "tierod", tierod_body, upright, spec.tierod_chassis, spec.tierod_upright)
    add_lines(frame, spec.springs, chassis, behind)
    return AttachmentBodies(upright, behind)


def trailing_arm(frame: Frame, spec: TrailingArm, chassis: int, tierod_body: int) -> AttachmentBodies:
    """An arm hinged on the chassis carries the spindle itself; nothing steers it."""
    arm = frame.add_body("arm", spec.arm)
    frame.builder.add_joint_revolute(
        f"{frame.name}.arm.hinge", chassis, arm, axis=frame.turning(spec.pivot_axis), anchor=frame.at(spec.pivot)
    )
    add_lines(frame, spec.springs, chassis, arm)
    return AttachmentBodies(arm, arm)


def three_link(frame: Frame, spec: ThreeLink, chassis: int, tierod_body: int) -> AttachmentBodies:
    """The arm swings about its ball as far as both rods let it; nothing steers it."""
    arm = frame.add_body("arm", spec.arm)
    add_ball(frame, "arm.ball", chassis, arm, spec.arm_chassis)
    add_rod(frame, "upper_rod", chassis, arm, spec.upper_rod_chassis, spec.upper_rod_arm)
    add_rod(frame, "lower_rod", chassis, arm, spec.lower_rod_chassis, spec.lower_rod_arm)
    add_lines(frame, spec.springs, chassis, arm)
    return AttachmentBodies(arm, arm)
