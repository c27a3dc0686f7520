"""Axles whose wheels share a body: the solid axle on links, and the axle on a longitudinal pin. Both sides at once."""

from __future__ import annotations

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
