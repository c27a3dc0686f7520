"""Shared by the suspension templates: rods, hinges of arms with or without bushings, and their common result."""

from __future__ import annotations

import dataclasses

import numpy as np

from simwarp.core.rotation import frame_from_axis
from simwarp.vehicle.spec.vehicle_spec import Bushing, ForceLine, Vec3
from simwarp.vehicle.suspensions.corner import Frame, across, merged_lines


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
