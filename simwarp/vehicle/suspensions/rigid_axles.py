"""Axles whose wheels share a body: solid axles, beams, and the axle on a longitudinal pin. Both sides at once."""

from __future__ import annotations

from simwarp.core.types import Dof
from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.vehicle_spec import PinnedAxle, SolidAxle
from simwarp.vehicle.suspensions.corner import (
    AttachmentBodies,
    Frame,
    add_ball,
    add_cross,
    add_lines,
    add_rod,
    plane_axes,
)


def solid_axle(
    frame: Frame, left: Frame, right: Frame, spec: SolidAxle, chassis: int, tierod_body: int
) -> tuple[AttachmentBodies, AttachmentBodies]:
    """The tube on four links; knuckles turn on it. A drag link moves the left one, a tie rod the right one by it;
    without a drag link both are fixed to the tube, and the tie rod has nothing to do.
    """
    tube = frame.add_body("tube", spec.axle_tube)
    knuckles = []
    for side in (left, right):
        knuckle = side.add_body("knuckle", spec.knuckle)
        knuckles.append(knuckle)
        upper_axes = plane_axes(spec.upper_link_axle, spec.upper_link_chassis, spec.lower_link_axle)
        lower_axes = plane_axes(spec.lower_link_chassis, spec.lower_link_axle, spec.upper_link_axle)
        upper = side.add_body("upper_link", spec.upper_link, upper_axes)
        lower = side.add_body("lower_link", spec.lower_link, lower_axes)
        add_cross(side, "upper_link.cross", chassis, upper, spec.upper_link_chassis, spec.upper_link_axle)
        add_cross(side, "lower_link.cross", chassis, lower, spec.lower_link_chassis, spec.lower_link_axle)
        add_ball(side, "upper_link.ball", upper, tube, spec.upper_link_axle)
        add_ball(side, "lower_link.ball", lower, tube, spec.lower_link_axle)
        top, bottom = side.at(spec.knuckle_upper), side.at(spec.knuckle_lower)
        name, middle = f"{side.name}.kingpin", 0.5 * (top + bottom)
        if spec.draglink_chassis is None or spec.draglink_knuckle is None:
            side.builder.add_joint_fixed(name, tube, knuckle, anchor=middle)
        else:
            side.builder.add_joint_revolute(name, tube, knuckle, axis=top - bottom, anchor=middle)
        add_lines(side, spec.springs, chassis, tube)
    if spec.draglink_chassis is not None and spec.draglink_knuckle is not None:
        add_rod(left, "draglink", tierod_body, knuckles[0], spec.draglink_chassis, spec.draglink_knuckle)
        frame.builder.add_joint_distance(
            f"{frame.name}.tierod", knuckles[0], knuckles[1],
            anchor0=left.at(spec.tierod_knuckle), anchor1=right.at(spec.tierod_knuckle),
        )  # fmt: skip
    return AttachmentBodies(knuckles[0], tube), AttachmentBodies(knuckles[1], tube)


def pinned_axle(frame: Frame, spec: PinnedAxle, chassis: int) -> tuple[AttachmentBodies, AttachmentBodies]:
    """The tube turns on the chassis about x through the pin; the spindles turn in the tube."""
    tube = frame.add_body("tube", spec.axle_tube)
    frame.builder.add_joint_revolute(
        f"{frame.name}.pin", chassis, tube, axis=frame.along((1.0, 0.0, 0.0)), anchor=frame.at(spec.pin)
    )
    return AttachmentBodies(tube, tube), AttachmentBodies(tube, tube)


def beam_axle(
    frame: Frame, left: Frame, right: Frame, spec: BeamAxle, chassis: int, tierod_body: int
) -> tuple[AttachmentBodies, AttachmentBodies]:
    """The tube with what leads it; its knuckles, or the tube itself, carry the spindles."""
    tube = frame.add_body("tube", spec.axle_tube)
    _lead(frame, left, right, spec, chassis, tube)
    for side in (left, right):
        add_lines(side, spec.springs, chassis, tube)
    if spec.knuckle is None:
        return AttachmentBodies(tube, tube), AttachmentBodies(tube, tube)
    knuckles = []
    for side in (left, right):
        knuckle = side.add_body("knuckle", spec.knuckle)
        assert spec.knuckle_upper is not None  # the description says so
        assert spec.knuckle_lower is not None
        top, bottom = side.at(spec.knuckle_upper), side.at(spec.knuckle_lower)
        side.builder.add_joint_revolute(
            f"{side.name}.kingpin", tube, knuckle, axis=top - bottom, anchor=0.5 * (top + bottom)
        )
        knuckles.append(knuckle)
    _steer(left, right, spec, tube, tierod_body, (knuckles[0], knuckles[1]))
    return AttachmentBodies(knuckles[0], tube), AttachmentBodies(knuckles[1], tube)


def _lead(frame: Frame, left: Frame, right: Frame, spec: BeamAxle, chassis: int, tube: int) -> None:
    """Rods, arm and guide."""
    center = frame.at(spec.axle_tube.com)
    if spec.guide != "links":
        ahead, aside = frame.along((1.0, 0.0, 0.0)), frame.along((0.0, 1.0, 0.0))
        roll = Dof(stiffness=spec.roll_stiffness, damping=spec.roll_damping)
        frame.builder.add_joint_planar(
            f"{frame.name}.guide", chassis, tube, normal=ahead, direction=aside, anchor=center,
            dofs=(Dof(), Dof(), roll),
        )  # fmt: skip
        if spec.guide == "leaf-springs":
            frame.builder.add_joint_point_on_plane(f"{frame.name}.leaves", chassis, tube, anchor=center, normal=aside)
    for index, rod in enumerate(spec.rods):
        for side in (left, right) if rod.mirrored else (frame,):
            add_rod(side, f"rod{index}", chassis, tube, rod.chassis_point, rod.axle_point)
    if spec.ball is not None:
        add_ball(frame, "ball", chassis, tube, spec.ball)
    if spec.watt is not None:
        across_chassis = frame.along((0.0, 1.0, 0.0))
        frame.builder.add_joint_point_on_plane(
            f"{frame.name}.watt", chassis, tube, anchor=frame.at(spec.watt), normal=across_chassis
        )
    if spec.arm is not None:
        frame.builder.add_joint_revolute_spherical(
            f"{frame.name}.arm", chassis, tube, anchor0=frame.at(spec.arm.chassis_point),
            axis=frame.along((0.0, 1.0, 0.0)), anchor1=frame.at(spec.arm.axle_point),
        )  # fmt: skip


def _steer(left: Frame, right: Frame, spec: BeamAxle, tube: int, tierod_body: int, knuckles: tuple[int, int]) -> None:
    """Drag link, bell crank and tie rods."""
    assert spec.tierod_knuckle is not None  # the description says so
    if spec.tierod_chassis is not None:
        for side, knuckle in zip((left, right), knuckles, strict=True):
            add_rod(side, "tierod", tierod_body, knuckle, spec.tierod_chassis, spec.tierod_knuckle)
        return
    assert spec.draglink_chassis is not None
    if spec.bell_crank is None:
        # the drag link lies where it is described, whichever knuckle it holds
        assert spec.draglink_knuckle is not None
        held = knuckles[0 if spec.draglink_knuckle[1] >= 0.0 else 1]
        add_rod(left, "draglink", tierod_body, held, spec.draglink_chassis, spec.draglink_knuckle)
    else:
        crank = spec.bell_crank
        lever = left.add_body("bell_crank", crank.part)
        left.builder.add_joint_revolute(
            f"{left.name}.bell_crank.hinge", tube, lever, axis=left.along(crank.axis), anchor=left.at(crank.pivot)
        )
        add_rod(left, "draglink", tierod_body, lever, spec.draglink_chassis, crank.draglink)
        add_rod(left, "tierod", lever, knuckles[0], crank.tierod, spec.tierod_knuckle)
        if spec.crossed_tierods:
            add_rod(right, "tierod", lever, knuckles[1], crank.tierod, spec.tierod_knuckle)
            return
    left.builder.add_joint_distance(
        f"{left.name}.track_rod", knuckles[0], knuckles[1], anchor0=left.at(spec.tierod_knuckle),
        anchor1=right.at(spec.tierod_knuckle),
    )  # fmt: skip
