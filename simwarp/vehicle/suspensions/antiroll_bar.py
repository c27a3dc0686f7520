"""An anti-roll bar: two arms in line across the vehicle, a torsion spring between them, a drop link on each."""

from __future__ import annotations

from typing import Final

import numpy as np

from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import WORLD, JointType, pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.spec.parts import Array
from simwarp.vehicle.spec.vehicle_spec import AntirollBar, RigidPart, SpecError, Vec3
from simwarp.vehicle.suspensions.corner import Frame

LEAST_LEVER: Final = 0.02
"""Of a drop link on the suspension's arm, as a share of the bar's own arm: below, a bar twists by less than a fiftieth
of the angle that the suspension turns."""


def _lever(builder: ModelBuilder, chassis: int, body: int, foot: Array, link: Array) -> float:
    """How far a link is pushed along itself per angle that its body turns on the chassis [m/rad]; infinite where no
    hinge or its bushing holds the body there.
    """
    for joint in builder.joints:
        if joint.parent == chassis and joint.child == body and joint.type in (JointType.REVOLUTE, JointType.BUSHING):
            held = pose() if chassis == WORLD else builder.bodies[chassis].pose
            turn = quat_multiply(held.rotation, joint.frame0.rotation)
            axis = rotate(turn, np.array([0.0, 0.0, 1.0]))
            arm = foot - held.position - rotate(held.rotation, joint.frame0.position)
            return abs(float(np.cross(axis, arm) @ link)) / float(np.linalg.norm(link))
    return np.inf


def add_antiroll_bar(frame: Frame, spec: AntirollBar, chassis: int, left: int, right: int) -> int:
    """Bodies, hinges and drop links of a bar; returns the joint that twists it, whose angle is the right arm's
    against the left one's [rad].

    Args:
        frame: of the bar, its origin in the middle.
        chassis: body that the left arm turns in, or WORLD for an axle on a bench.
        left: body that the left drop link holds.
        right: the same of the right one.

    Raises:
        SpecError: the axle's wheels do not move against the chassis, or their travel does not move the drop links.
    """
    if chassis in (left, right):
        raise SpecError("antiroll_bar: must be on an axle with springs; rigid wheels would hold the bar still")
    builder, name = frame.builder, frame.name
    length, width, drop = spec.arm_length, spec.arm_width, spec.droplink_height
    axis, arms = frame.along((0.0, 1.0, 0.0)), []
    for label, sign, body in (("left", 1.0, left), ("right", -1.0, right)):
        part = RigidPart(mass=spec.arm_mass, com=(0.0, sign * length / 2.0, 0.0), inertia=spec.arm_inertia)
        arm = frame.add_body(f"{label}_arm", part)
        top: Vec3 = (width, sign * length, 0.0)
        bottom: Vec3 = (width, sign * length, drop)
        builder.add_joint_distance(
            f"{name}.{label}_droplink", arm, body, anchor0=frame.at(top), anchor1=frame.at(bottom)
        )
        lever = _lever(builder, chassis, body, frame.at(bottom), frame.at(top) - frame.at(bottom))
        if lever < LEAST_LEVER * width:
            raise SpecError(
                f"antiroll_bar: its drop links must stand away from the line about which '{builder.bodies[body].name}' "
                f"turns, got a lever of {1e3 * lever:.2g} mm on it: the bar would not twist; change location, "
                "arm_length or arm_width"
            )
        arms.append(arm)
    builder.add_joint_revolute(f"{name}.hinge", chassis, arms[0], axis=axis, anchor=frame.at((0.0, length / 2.0, 0.0)))
    return builder.add_joint_revolute(
        f"{name}.torsion", arms[0], arms[1], axis=axis, anchor=frame.origin.position, stiffness=spec.stiffness,
        damping=spec.damping,
    )  # fmt: skip
