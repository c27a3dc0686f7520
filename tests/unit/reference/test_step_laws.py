"""The reference's laws along a degree of freedom, couplings, box constraints and reactions, against closed forms."""

import numpy as np
import pytest

from simwarp.core.types import WORLD, PositionDrive, PrescribedPosition, PrescribedSpeed, VelocityMotor, pose
from simwarp.model.builder import ModelBuilder
from tests.reference.mechanisms import random_mechanism
from tests.reference.step import ReferenceStep, gyroscopic
from tests.reference.step_solve import solve_boxes

H = 1e-3


def slide(gravity=(0.0, 0.0, 0.0), velocity=0.0, **options) -> ModelBuilder:
    """A 2 kg block on a slide along +X."""
    builder = ModelBuilder(gravity=gravity)
    block = builder.add_body("block", mass=2.0, inertia=(1, 1, 1), velocity=(velocity, 0, 0))
    builder.add_joint_prismatic("slide", WORLD, block, axis=(1, 0, 0), **options)
    return builder


def run(builder, steps, h=H, **controls):
    reference = ReferenceStep(builder, h)
    for _ in range(steps):
        reference.step(**controls)
    return reference


def test_implicit_spring_damper_and_armature():
    options = {"stiffness": 300.0, "damping": 7.0, "rest": 0.1, "preload": 2.0, "armature": 0.5}
    reference = run(slide(velocity=1.0, **options), 1, joint_force=[3.0])
    m, k, d = 2.5, 300.0, 7.0
    expected = (m * 1.0 + H * (3.0 + 2.0 + k * 0.1)) / (m + H * d + H * H * k)
    np.testing.assert_allclose(reference.joint_qd, [expected], rtol=1e-13)
    np.testing.assert_allclose(reference.joint_q, [H * expected], rtol=1e-13)
    np.testing.assert_allclose(reference.dof_impulse, [2.0 * (expected - 1.0)], rtol=1e-10)


def test_tables_of_a_linear_law_are_the_linear_law():
    linear = run(slide(velocity=1.0, stiffness=300.0, damping=7.0, rest=0.1), 20)
    x = (-1.0, 0.3, 2.0)
    tables = {"spring_table": (x, [300.0 * v for v in x]), "damper_table": (x, [7.0 * v for v in x])}
    table = run(slide(velocity=1.0, rest=0.1, **tables), 20)
    np.testing.assert_allclose(table.joint_q, linear.joint_q, rtol=1e-12)


def test_bent_damper_table_settles_where_it_says():
    # 2 kg pushed by 10 N against 4 N per m/s up to 1 m/s, then 1 N per m/s: 4 + (v - 1) = 10
    reference = run(slide(damper_table=((-1.0, 1.0, 2.0), (-4.0, 4.0, 5.0))), 1000, h=5e-2, joint_force=[10.0])
    np.testing.assert_allclose(reference.joint_qd, [7.0], rtol=1e-9)


def test_drive_with_a_wide_limit_is_the_drive_without():
    drive = {"stiffness": 500.0, "damping": 20.0}
    free = run(slide(drive=PositionDrive(**drive)), 50, target_q=[0.2], target_qd=[0.5])
    wide = run(slide(drive=PositionDrive(**drive, effort_limit=1e6)), 50, target_q=[0.2], target_qd=[0.5])
    np.testing.assert_allclose(wide.joint_q, free.joint_q, rtol=1e-10)
    tight = run(slide(drive=PositionDrive(**drive, effort_limit=5.0)), 10, target_q=[0.2])
    np.testing.assert_allclose(tight.joint_qd, [10 * H * 5.0 / 2.0], rtol=1e-12)


def test_velocity_motor_saturates_then_holds():
    reference = run(slide(drive=VelocityMotor(effort_limit=4.0)), 100, target_qd=[1.0])
    np.testing.assert_allclose(reference.joint_qd, [0.1 * 4.0 / 2.0], rtol=1e-12)
    reference = run(slide(drive=VelocityMotor(effort_limit=4.0)), 600, target_qd=[1.0])
    np.testing.assert_allclose(reference.joint_qd, [1.0], rtol=1e-12)


def test_friction_stops_and_holds():
    reference = run(slide(velocity=1.0, friction=4.0), 499)
    np.testing.assert_allclose(reference.joint_qd, [1.0 - 499 * H * 2.0], rtol=1e-9)
    reference = run(slide(velocity=1.0, friction=4.0), 700, joint_force=[3.9])
    assert reference.joint_qd[0] > 0.9
    reference = run(slide(friction=4.0), 100, joint_force=[3.9])
    assert abs(reference.joint_qd[0]) < 1e-13


def test_limit_stops_inelastically_at_the_stop():
    reference = run(slide(velocity=1.0, limit=(-0.1, 0.0205)), 100)
    np.testing.assert_allclose(reference.joint_q, [0.0205], rtol=1e-12)
    np.testing.assert_allclose(reference.joint_qd, [0.0], atol=1e-12)
    # violated from the start: recovers at 0.6 m/s, no faster
    reference = run(slide(limit=(0.03, 1.0)), 20)
    np.testing.assert_allclose(reference.joint_q, [20 * H * 0.6], rtol=1e-12)


def test_prescribed_motion_is_where_its_table_says():
    t, q = (0.0, 0.05, 0.1), (0.0, 0.2, -0.1)
    reference = run(slide(gravity=(3.0, 0, 0), drive=PrescribedPosition(table=(t, q))), 80)
    np.testing.assert_allclose(reference.joint_q, np.interp(0.08, t, q), rtol=1e-9)
    assert reference.prescribed_effort[0] == pytest.approx(-6.0)
    reference = run(slide(drive=PrescribedSpeed(table=((0.0, 1.0), (0.0, 2.0)))), 100)
    np.testing.assert_allclose(reference.joint_qd, [0.2], rtol=1e-12)
    # a target at rest, 0.1 away: the correction is clamped, the motion is not
    reference = run(slide(drive=PrescribedPosition()), 10, target_q=[0.1])
    np.testing.assert_allclose(reference.joint_q, [10 * H * 0.6], rtol=1e-12)


def test_gear_train_of_shafts_and_a_rack():
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    motor = builder.add_shaft("motor", inertia=0.1, speed=3.0)
    pinion = builder.add_shaft("pinion", inertia=0.4, position=1.0, speed=-1.5)
    rack = builder.add_body("rack", mass=5.0, inertia=(1, 1, 1), velocity=(0.3, 0, 0))
    slider = builder.add_joint_prismatic("slide", WORLD, rack, axis=(1, 0, 0))
    builder.add_gear("gear", motor, pinion, ratio=-0.5)
    builder.add_rack("rack", pinion, slider, radius=-0.2)
    reference = run(builder, 50, joint_force=[2.0, 0.0, 0.0])
    reflected = 0.1 + 0.25 * 0.4 + 5.0 * 0.1**2
    speed = 3.0 + 50 * H * 2.0 / reflected
    np.testing.assert_allclose(reference.joint_qd, [speed, -0.5 * speed, 0.1 * speed], rtol=1e-12)
    np.testing.assert_allclose(-0.5 * reference.joint_q[0] - reference.joint_q[1], -1.0, atol=1e-13)


def test_reaction_of_hanging_bodies():
    builder = ModelBuilder()
    top = builder.add_body("top", mass=3.0, inertia=(1, 1, 1), pose=pose((0, 0, -1)))
    low = builder.add_body("low", mass=2.0, inertia=(1, 1, 1), pose=pose((0.5, 0, -2)))
    builder.add_joint_spherical("ceiling", WORLD, top, anchor=(0.2, 0, 0))
    builder.add_joint_fixed("weld", top, low, anchor=(0, 0, -2))
    # the ball is above the common centre of mass: in balance
    reference = run(builder, 5)
    force, torque = reference.reaction(0)
    np.testing.assert_allclose(force, [0, 0, 5.0 * 9.81], atol=1e-10)
    np.testing.assert_allclose(torque, 0.0, atol=1e-10)
    force, torque = reference.reaction(1)
    np.testing.assert_allclose(force, [0, 0, 2.0 * 9.81], atol=1e-10)
    # on the lower body, whose weight acts 0.5 m beside the anchor
    np.testing.assert_allclose(torque, [0, -2.0 * 9.81 * 0.5, 0], atol=1e-10)


def test_body_forces_and_torques():
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("body", mass=2.0, inertia=(1, 2, 2.5), pose=pose(rotation=(0, 0, 1, 1)))
    reference = run(builder, 1, body_force=[[1.0, 0, 0]], body_torque=[[3.0, 0, 0]])
    np.testing.assert_allclose(reference.v, [[H * 0.5, 0, 0]], rtol=1e-12)
    # a quarter turn about z: world x is the body's -y
    np.testing.assert_allclose(reference.omega, [[H * 1.5, 0, 0]], atol=1e-15)


@pytest.mark.parametrize("h", [1e-3, 5e-2])
def test_gyroscopic_step_keeps_energy_and_momentum(h):
    inertia = np.array([[2.0, 0.3, -0.1], [0.3, 1.0, 0.2], [-0.1, 0.2, 1.5]])
    w0 = np.array([4.0, -6.0, 3.0])
    w1 = gyroscopic(inertia, w0, h)
    assert w1 @ inertia @ w1 == pytest.approx(w0 @ inertia @ w0, rel=1e-13)
    assert np.linalg.norm(inertia @ w1) == pytest.approx(np.linalg.norm(inertia @ w0), rel=1e-13)


@pytest.mark.parametrize("seed", range(8))
def test_boxes_are_complementary(seed):
    rng = np.random.default_rng(seed)
    size = 8
    a = rng.normal(size=(size, 5 if seed % 2 else 12))
    n, r = a @ a.T, a @ rng.normal(size=a.shape[1])
    low = np.where(rng.random(size) < 0.5, 0.0, -0.1)
    high = np.where(low < 0.0, 0.1, np.inf)
    gamma = solve_boxes(n, r, low, high)
    u = n @ gamma + r
    assert ((gamma >= low) & (gamma <= high)).all()
    assert np.all(u[(gamma > low) & (gamma < high)] > -1e-9)
    assert np.all(np.abs(u[(gamma > low + 1e-12) & (gamma < high - 1e-12)]) < 1e-9)
    assert np.all(u[gamma == low] > -1e-9)
    assert np.all(u[gamma == high] < 1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_box_constraints_of_random_mechanisms_are_complementary(seed):
    reference = run(random_mechanism(100 + seed, bounds=True, couplings=True), 20)
    assert len(reference.box_impulse) > 0
    inside = np.abs(reference.box_speed) < 1e-9
    assert (inside | (np.sign(reference.box_speed) * reference.box_impulse <= 1e-12)).all()
