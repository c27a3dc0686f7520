"""An anti-roll bar: two arms in line across the vehicle, a torsion spring between them, a drop link on each."""

from __future__ import annotations

from simwarp.vehicle.spec.vehicle_spec import AntirollBar, RigidPart, SpecError, Vec3
from simwarp.vehicle.suspensions.corner import Frame


def add_antiroll_bar(frame: Frame, spec: AntirollBar, chassis: int, left: int, right: int) -> int:
    """Bodies, hinges and drop links of a bar; returns the joint that twists it, whose angle is the right arm's
    against the left one's [rad].

    Args:
        frame: of the bar, its origin in the middle.
        chassis: body that the left arm turns in.
        left: body that the left drop link holds.
        right: the same of the right one.

    Raises:
        SpecError: the axle's wheels do not move against the chassis.
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
        arms.append(arm)
    builder.add_joint_revolute(f"{name}.hinge", chassis, arms[0], axis=axis, anchor=frame.at((0.0, length / 2.0, 0.0)))
    return builder.add_joint_revolute(
        f"{name}.torsion", arms[0], arms[1], axis=axis, anchor=frame.origin.position, stiffness=spec.stiffness,
        damping=spec.damping,
    )  # fmt: skip
