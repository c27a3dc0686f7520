"""Massless bodies: several joints in a row between two bodies, against MuJoCo; parallel axes; what is refused."""

import numpy as np
import pytest

import simwarp as sw

START = np.array([0.1, 0.2, 0.3, 0.4, 0.5, -0.3])
RATES = np.array([1.0, 0.5, 2.0, -1.0, 1.0, 0.5])
AXES = {"x": (1, 0, 0), "z": (0, 0, 1), "r": (0, 1, 0), "h1": (1, 0, 0), "h2": (0, 1, 0), "h3": (0, 0, 1)}


def walker() -> sw.ModelBuilder:
    """A body on two slides and a hinge, and another that hangs on three hinges through one point."""
    builder = sw.ModelBuilder()
    p1, p2 = (builder.add_massless_body(name, pose=sw.pose((0, 0, 1.0))) for name in ("p1", "p2"))
    a = builder.add_body("a", mass=2.0, inertia=(0.1, 0.12, 0.05), pose=sw.pose((0, 0, 1.2)))
    q1, q2 = (builder.add_massless_body(name, pose=sw.pose((0, 0, 1.4))) for name in ("q1", "q2"))
    b = builder.add_body("b", mass=1.0, inertia=(0.02, 0.03, 0.01), pose=sw.pose((0.1, 0.05, 1.6)))
    builder.add_joint_prismatic("x", sw.WORLD, p1, axis=AXES["x"])
    builder.add_joint_prismatic("z", p1, p2, axis=AXES["z"])
    builder.add_joint_revolute("r", p2, a, axis=AXES["r"], anchor=(0, 0, 1.0))
    for name, parent, child in (("h1", a, q1), ("h2", q1, q2), ("h3", q2, b)):
        builder.add_joint_revolute(name, parent, child, axis=AXES[name], anchor=(0, 0, 1.4))
    return builder


MJCF = """<mujoco><option timestep="5e-4" integrator="RK4"/><worldbody><body name="a" pos="0 0 1">
<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/><joint name="r" axis="0 1 0"/>
<inertial pos="0 0 0.2" mass="2" diaginertia="0.1 0.12 0.05"/><body name="b" pos="0 0 0.4">
<joint name="h1" axis="1 0 0"/><joint name="h2" axis="0 1 0"/><joint name="h3" axis="0 0 1"/>
<inertial pos="0.1 0.05 0.2" mass="1"
diaginertia="0.02 0.03 0.01"/></body></body></worldbody></mujoco>"""


def test_several_joints_between_two_bodies_swing_as_those_of_mujoco():
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = START, RATES
    for _ in range(600):
        mujoco.mj_step(model, data)
    errors = []
    mine = walker().finalize(1, "cpu")
    for dt in (2e-3, 1e-3):
        sim = sw.Simulation(mine, dt)
        sim.set_joint_state(np.array([True]), START[None], RATES[None])
        for _ in range(round(0.3 / dt)):
            sim.step()
        errors.append(np.abs(sim.state.joint_q.numpy()[0] - data.qpos))
    # first order: g dt t / 2 = 1.5e-3 m in the fall at 1 ms, and half of that at half the step
    assert errors[1].max() < 1.05 * 0.5 * 9.81 * 1e-3 * 0.3
    assert errors[1].max() == pytest.approx(0.5 * errors[0].max(), rel=0.05)


def test_unit_efforts_find_the_inverse_mass_matrix():
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[:] = START
    mujoco.mj_forward(model, data)
    mass = np.zeros((6, 6))
    mujoco.mj_fullM(model, data, mass)
    builder = walker()
    builder.gravity = np.zeros(3)
    sim = sw.Simulation(builder.finalize(6, "cpu"), 1e-3)
    sim.set_joint_state(np.ones(6, bool), np.tile(START, (6, 1)), np.zeros((6, 6)))
    sim.control.joint_force[:] = np.eye(6, dtype=np.float32)
    sim.step()
    inverse = sim.state.joint_qd.numpy().T.astype(float) / 1e-3
    # in the energy norm: a light coordinate may not hide behind a heavy one; float32 leaves some 1e-6
    root = np.linalg.cholesky(mass)
    assert np.abs(root.T @ inverse @ root - np.eye(6)).max() < 1e-5


def test_parallel_axes_hold_a_rate_and_tell():
    """The second hinge brings the third one's axis into that of the first."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    q1, q2 = (builder.add_massless_body(name) for name in ("q1", "q2"))
    body = builder.add_body("b", mass=1.0, inertia=(0.02, 0.03, 0.01))
    for name, parent, child, axis in (("h1", sw.WORLD, q1, 0), ("h2", q1, q2, 1), ("h3", q2, body, 2)):
        builder.add_joint_revolute(name, parent, child, axis=tuple(np.eye(3)[axis]), anchor=(0, 0, 0))
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    sim.set_joint_state(np.ones(2, bool), np.array([[0, 0.5 * np.pi, 0], [0, 0.2, 0]]), np.zeros((2, 3)))
    sim.control.joint_force[:] = (0.0, 0.0, 0.1)
    sim.step()
    assert sim.state.world_status.numpy().tolist() == [sw.WorldStatus.SINGULAR, sw.WorldStatus.OK]
    rates = sim.state.joint_qd.numpy()
    assert np.isfinite(rates).all()
    # about the common axis the body turns as if it had one hinge: torque dt / inertia
    assert rates[0] == pytest.approx([0.0, 0.0, 0.1 * 1e-3 / 0.01], abs=1e-6)


def test_a_fast_frame_without_mass_stays_finite():
    """Its gyroscopic torque would divide by its inertia."""
    builder = walker()
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.set_joint_state(np.array([True]), START[None], np.array([[0, 0, 0, 0, 0, 400.0]]))
    for _ in range(5):
        sim.step()
    assert np.isfinite(sim.state.joint_qd.numpy()).all()
    assert sim.state.world_status.numpy()[0] == sw.WorldStatus.OK


def test_bodies_tied_through_frames_do_not_collide():
    builder = walker()
    shapes = [builder.add_shape_sphere(builder_body, radius=0.4) for builder_body in (2, 5)]
    model = builder.finalize(1, "cpu")
    assert len(shapes) == 2
    assert not model.shapes_that_meet.any()


def hang(builder, child, name="h"):
    return builder.add_joint_revolute(name, sw.WORLD, child, axis=(1, 0, 0))


def test_what_massless_bodies_must_not_do_is_told():
    builder = sw.ModelBuilder()
    hang(builder, builder.add_massless_body("leaf"))
    with pytest.raises(sw.ModelError, match=r"body 'leaf': a massless body must hang .* but it carries none"):
        builder.finalize(1, "cpu")
    builder = sw.ModelBuilder()
    builder.add_massless_body("loose")
    with pytest.raises(sw.ModelError, match=r"body 'loose': .* but it floats; give it mass"):
        builder.finalize(1, "cpu")
    builder = walker()
    builder.add_joint_distance("rod", 2, 3, anchor0=(0, 0, 0), anchor1=(1, 0, 0))
    with pytest.raises(sw.ModelError, match=r"body 'q1': is massless, but joint 'rod' closes a loop"):
        builder.finalize(1, "cpu")
    builder = walker()
    builder.add_shape_sphere(0, radius=0.1)
    with pytest.raises(sw.ModelError, match=r"body 'p1': a massless body must have no shape"):
        builder.finalize(1, "cpu")


def test_only_bodies_with_mass_can_be_given_one():
    model = walker().finalize(2, "cpu", per_world=("body_mass", "body_inertia_b"))
    assert model.has_mass.tolist() == [False, False, True, False, False, True]
    model.body_mass[1, 2] = 3.0
    model.body_inertia_b[1, 5] = np.diag([0.1, 0.1, 0.1])
    with pytest.raises(sw.ModelError, match="massless bodies keep 0"):
        model.body_mass[1, 0] = 1.0
    with pytest.raises(sw.ModelError):
        model.body_mass[0, 2] = 0.0
