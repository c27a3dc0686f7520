"""`ModelBuilder.set_drive`: the same model as one that was built with the drive."""

import pytest

import simwarp as sw
from simwarp.core.types import Dof


def arm(drive, **options):
    builder = sw.ModelBuilder()
    body = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1))
    builder.add_joint_revolute("hinge", sw.WORLD, body, axis=(0, 1, 0), damping=0.5, limit=(-1, 1), drive=drive)
    other = builder.add_body("other", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((1, 0, 0)))
    builder.add_joint_universal("cross", body, other, anchor=(0.5, 0, 0), axis0=(1, 0, 0), axis1=(0, 1, 0), **options)
    return builder


def test_a_drive_set_later_is_that_given_at_once():
    servo, motor = sw.PositionDrive(stiffness=3.0, effort_limit=2.0), sw.VelocityMotor(effort_limit=1.0)
    wanted = arm(servo, dofs=[Dof(), Dof(drive=motor, armature=0.1)])
    builder = arm(motor, dofs=[Dof(drive=servo), Dof(armature=0.1)])
    builder.set_drive(0, servo)
    builder.set_drive(1, None)
    builder.set_drive(1, motor, dof=1)
    assert [joint.dofs for joint in builder.joints] == [joint.dofs for joint in wanted.joints]
    assert builder.finalize(1, "cpu").identity.digest == wanted.finalize(1, "cpu").identity.digest


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((5, None), {}, "set_drive: joint must be in 0..1, got 5"),
        ((0, None), {"dof": 1}, "joint 'hinge', which has 1 coordinates, must be below that, got 1"),
        ((0, "servo"), {}, "joint 'hinge': drive must be None or a PositionDrive"),
        ((0, sw.PositionDrive(stiffness=-1.0)), {}, "drive.stiffness must be zero or positive"),
    ],
)
def test_mistakes(arguments, options, message):
    with pytest.raises(sw.ModelError, match=message):
        arm(None).set_drive(*arguments, **options)


def test_a_floating_body_has_drives_without_bounds():
    builder = sw.ModelBuilder()
    builder.add_joint_free("float", builder.add_body("body", mass=1.0, inertia=(0.1, 0.1, 0.1)))
    builder.set_drive(0, sw.PositionDrive(stiffness=1.0), dof=4)
    assert builder.joints[0].dofs[4].drive == sw.PositionDrive(stiffness=1.0)
    for drive in (sw.PositionDrive(stiffness=1.0, effort_limit=2.0), sw.VelocityMotor(effort_limit=1.0)):
        with pytest.raises(sw.ModelError, match="a FREE joint has springs, dampers and PositionDrives without effort"):
            builder.set_drive(0, drive)
