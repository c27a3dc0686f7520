"""Combinations against MuJoCo's fixed tendons, closed forms, and the laws of energy and momentum."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

import simwarp as sw
from simwarp.actuators import Actuators, ActuatorSpec, Law
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ModelError
from tests.unit.actuators.cart_and_wheel import HINGE, INERTIA, MASS, SLIDE, bodies, mjcf, start

TERMS = ((SLIDE, 0.7), (HINGE, -1.3))
SUM = 2
"""Its column."""
JOINTS = '<joint joint="slide" coef="0.7"/><joint joint="hinge" coef="-1.3"/>'
INVERSE = 0.7**2 / MASS + 1.3**2 / INERTIA
"""Of the mass along the combination [1/kg]."""


def combined(dt: float, worlds: int = 1, *, joint: dict[str, Any] | None = None, **options: Any) -> sw.Simulation:
    """Cart and wheel with a combination."""
    builder = bodies(**(joint or {}))
    builder.add_combination("sum", TERMS, **options)
    return sw.Simulation(builder.finalize(worlds, "cpu"), dt, threads=1)


def put(sim: sw.Simulation, q: tuple[float, float], qd: tuple[float, float]) -> None:
    both: Any = ((*q, 0.0), (*qd, 0.0))
    start(sim, *both)


def sums(q: np.ndarray) -> np.ndarray:
    return 0.7 * q[..., SLIDE] - 1.3 * q[..., HINGE]


TENDONS: dict[str, Any] = {
    "spring": ('stiffness="30" springlength="0.2"', {"stiffness": 30.0, "rest": 0.2}),
    "damper": ('damping="0.5"', {"damping": 0.5}),
    "both": ('stiffness="30" springlength="-0.1" damping="0.2"', {"stiffness": 30.0, "rest": -0.1, "damping": 0.2}),
    # MuJoCo's friction is soft and lets the rest creep by some mm/s: it is compared while it slides
    "friction": ('frictionloss="0.3"', {"friction": 0.3}),
}


@pytest.mark.parametrize("case", TENDONS)
def test_a_combination_moves_as_a_fixed_tendon_does(case: str) -> None:
    attributes, options = TENDONS[case]
    dt = 1.0e-4
    theirs = mjcf("", dt=dt, tendon=f'<tendon><fixed name="t" {attributes}>{JOINTS}</fixed></tendon>')
    data = mujoco.MjData(theirs)
    sim = combined(dt, **options)
    data.qpos[:], data.qvel[:] = (0.3, -0.1), (0.5, -0.8)
    put(sim, (0.3, -0.1), (0.5, -0.8))
    steps = 1000 if case == "friction" else 3000
    paths = []
    for step in range(steps):
        mujoco.mj_step(theirs, data)
        sim.step()
        if step % 50 == 49:
            ours = (sim.state.joint_q.numpy()[0, :2].copy(), sim.state.joint_qd.numpy()[0, :2].copy())
            paths.append((data.qpos.copy(), data.qvel.copy(), *ours))
    q, qd, our_q, our_qd = (np.array(part) for part in zip(*paths, strict=True))
    # of motions of order 0.5: w² dt t / 2 of an implicit spring with w = 13 rad/s comes to 0.3 % after 0.3 s
    assert np.abs(our_q - q).max() < 3e-3
    assert np.abs(our_qd - qd).max() < 2e-2
    assert sums(our_q)[-1] == pytest.approx(sim.state.joint_q.numpy()[0, SUM], abs=1e-6)
    assert sim.state.joint_qd.numpy()[0, SUM] == pytest.approx(sums(our_qd)[-1], abs=1e-5)


def test_armature_slows_the_swing() -> None:
    """q'' = -k q / (m + a), in closed form: between bodies of two trees MuJoCo leaves out a part of the inertia."""
    sim = combined(1e-4, stiffness=30.0, armature=0.4)
    put(sim, (0.3, -0.1), (0.0, 0.0))
    frequency = np.sqrt(30.0 / (1.0 / INVERSE + 0.4))
    found = []
    for _ in range(5000):
        sim.step()
        found.append(float(sim.state.joint_x.numpy()[0, SUM]))
    wanted = (0.3 * 0.7 + 0.13) * np.cos(frequency * 1e-4 * np.arange(1, 5001))
    # w² dt t / 2 of backward Euler
    assert np.abs(np.array(found) - wanted).max() < 0.34 * frequency**2 * 1e-4 * 0.5 / 2
    assert found[-1] < -0.1


def test_a_stop_holds_as_that_of_a_tendon() -> None:
    """A force pushes the sum against its stop, springs hold both coordinates: the same place as in MuJoCo."""
    springs = 'stiffness="50" damping="8"'
    limited = 'limited="true" range="-0.05 0.04" solreflimit="0.002 1" solimplimit="0.9999 0.9999 0.001"'
    theirs = mjcf("", dt=1e-3, joint=springs, tendon=f'<tendon><fixed name="t" {limited}>{JOINTS}</fixed></tendon>')
    data = mujoco.MjData(theirs)
    sim = combined(1e-3, joint={"stiffness": 50.0, "damping": 8.0}, limit=(-0.05, 0.04))
    for sign in (1.0, -1.0):
        data.qfrc_applied[:] = (sign * 6.0, 0.0)
        sim.control.joint_force[:, SLIDE] = sign * 6.0
        for _ in range(3000):
            mujoco.mj_step(theirs, data)
            sim.step()
        q = sim.state.joint_q.numpy()[0]
        # the solver's 1e-5 m/s is 1.4e-6 N·s of the stop, 1.4 mN in a step of 1 ms; MuJoCo's gives way by as much
        assert q[:2] == pytest.approx(data.qpos, abs=5e-5)
        assert q[SUM] == pytest.approx(0.04 if sign > 0 else -0.05, abs=1e-6)
        # in closed form: k q_i = f_i - c_i gamma, with the sum at its stop
        gamma = (0.7 * sign * 6.0 / 50.0 - q[SUM]) * 50.0 / (0.7**2 + 1.3**2)
        assert q[HINGE] == pytest.approx(1.3 * gamma / 50.0, abs=4e-5)


def test_a_servo_on_a_tendon_steps_as_mujocos() -> None:
    theirs = mjcf(
        '<position tendon="t" kp="40" kv="3"/>', dt=1e-3, tendon=f'<tendon><fixed name="t">{JOINTS}</fixed></tendon>'
    )
    data = mujoco.MjData(theirs)
    builder = bodies()
    builder.add_combination("sum", TERMS, drive=sw.PositionDrive(stiffness=40.0, damping=3.0))
    model = builder.finalize(1, "cpu")
    spec = ActuatorSpec(name="a", terms=((model.dof("sum"), 1.0),), law=Law.SERVO)
    actuators = Actuators(model, [spec])
    sim = sw.Simulation(model, 1e-3, elements=[actuators], threads=1)
    data.ctrl[:] = actuators.ctrl[:] = 0.4
    for _ in range(500):
        mujoco.mj_step(theirs, data)
        sim.step()
        assert np.abs(sim.state.joint_q.numpy()[0, :2] - data.qpos).max() < 0.02 * 0.4
    assert sim.state.joint_q.numpy()[0, SUM] == pytest.approx(0.4, abs=0.02)


@pytest.mark.parametrize("options", [{}, {"stiffness": 1.0e-3}, {"limit": (-9.0, 9.0)}], ids=["silent", "row", "limit"])
def test_a_force_along_a_combination_moves_its_terms(options: dict[str, Any]) -> None:
    """By the user, and by an actuator: q_i'' = c_i f / m_i."""
    builder = bodies()
    builder.add_combination("sum", TERMS, **options)
    model = builder.finalize(2, "cpu")
    actuators = Actuators(model, [ActuatorSpec(name="a", terms=((SUM, 2.0),))])
    sim = sw.Simulation(model, 1e-3, elements=[actuators], threads=1)
    sim.control.joint_force.assign(np.array([[0, 0, 3.0], [0, 0, 0]], np.float32))
    actuators.ctrl.assign(np.array([[0.0], [1.5]], np.float32))
    for _ in range(50):
        sim.step()
    rates = sim.state.joint_qd.numpy()
    # a spring of 1 mN/m beside it does nothing; 50 roundings
    wanted = [0.7 * 3.0 / MASS * 0.05, -1.3 * 3.0 / INERTIA * 0.05]
    assert rates[0, :2] == pytest.approx(wanted, rel=1e-5)
    assert rates[1, :2] == pytest.approx(wanted, rel=1e-5)
    assert rates[0, SUM] == pytest.approx(INVERSE * 3.0 * 0.05, rel=1e-5)


def test_friction_of_a_combination_stops_it_in_its_own_time() -> None:
    """t = v m / f along the sum; what is across it goes on."""
    sim = combined(1e-3, friction=0.3)
    put(sim, (0.0, 0.0), (0.5, 0.2))
    speed = 0.7 * 0.5 - 1.3 * 0.2
    ends = speed / (INVERSE * 0.3)
    across = MASS * 0.5 / 0.7 + INERTIA * 0.2 / 1.3  # a momentum that the sum's impulses leave alone
    for step in range(1, 200):
        sim.step()
        wanted = max(speed - INVERSE * 0.3 * step * 1e-3, 0.0)
        # the solver's tolerance
        assert sim.state.joint_qd.numpy()[0, SUM] == pytest.approx(wanted, abs=3e-5)
    assert ends < 0.2
    rates = sim.state.joint_qd.numpy()[0]
    assert MASS * rates[SLIDE] / 0.7 + INERTIA * rates[HINGE] / 1.3 == pytest.approx(across, rel=1e-5)


def test_a_prescribed_combination_follows_its_motion() -> None:
    motion = sw.PrescribedPosition(table=((0.0, 0.1, 0.3), (0.0, 0.05, -0.1)))
    sim = combined(1e-3, drive=motion)
    for _ in range(300):
        sim.step()
    assert sim.state.joint_x.numpy()[0, SUM] == pytest.approx(-0.1, abs=1e-6)
    # the least motion that does it: q_i along c_i / m_i
    q = sim.state.joint_x.numpy()[0]
    assert q[SLIDE] / q[HINGE] == pytest.approx((0.7 / MASS) / (-1.3 / INERTIA), rel=1e-5)


def energy_left(dt: float) -> float:
    sim = combined(dt, stiffness=30.0)
    put(sim, (0.3, -0.1), (0.5, -0.8))
    before = float(sim.measure_energy().numpy()[0])
    for _ in range(round(0.2 / dt)):
        sim.step()
    return float(sim.measure_energy().numpy()[0]) / before


def test_a_spring_loses_energy_only_to_the_step() -> None:
    lost = [1.0 - energy_left(dt) for dt in (1e-4, 5e-5)]
    assert 0.0 < lost[0] < 0.03
    assert lost[1] == pytest.approx(0.5 * lost[0], rel=0.1)


def floating(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Momenta of three floating bodies after a tendon with spring, friction, stop and force has worked for 0.3 s."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    inertias = [(0.2, 0.3, 0.4), (0.1, 0.2, 0.15), (0.05, 0.06, 0.07)]
    for k, inertia in enumerate(inertias):
        builder.add_body(f"b{k}", mass=2.0 - 0.5 * k, inertia=inertia, pose=sw.pose((0.5 * k, 0.0, 0.1 * k)))
    first = builder.add_joint_revolute("first", 0, 1, axis=(0, 1, 0.3), anchor=(0.25, 0, 0))
    second = builder.add_joint_prismatic("second", 1, 2, axis=(1, 0, 0.5))
    builder.add_combination(
        "sum", [(first, 0.8), (second, -1.5)], stiffness=200.0, rest=0.3, friction=0.5, limit=(-0.05, 0.2)
    )
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt, threads=1)
    sim.control.joint_force.assign(np.array([[1.0, 0.0, 4.0]], np.float32))
    for _ in range(round(0.3 / dt)):
        sim.step()
    linear, angular = np.zeros(3), np.zeros(3)
    assert np.abs(sim.state.body_v.numpy()).max() > 0.1
    for k, inertia in enumerate(inertias):
        axes = matrix_of(sim.state.body_rot.numpy()[0, k])
        v, omega = (array.numpy()[0, k].astype(float) for array in (sim.state.body_v, sim.state.body_omega))
        linear += (2.0 - 0.5 * k) * v
        angular += axes @ np.diag(inertia) @ axes.T @ omega
        angular += (2.0 - 0.5 * k) * np.cross(sim.state.body_x.numpy()[0, k], v)
    return linear, angular


def test_a_combination_is_internal_to_the_bodies() -> None:
    (linear, coarse), (_, fine) = floating(1e-3), floating(5e-4)
    # of impulses of some 1 N·s; what the step itself loses is of first order in it
    assert np.abs(linear).max() < 1e-5
    assert np.abs(coarse).max() < 5e-3
    assert np.abs(fine).max() < max(0.6 * np.abs(coarse).max(), 1e-5)


def test_a_set_state_measures_the_sum() -> None:
    """What is given for it does not count; every world has its own coefficients."""
    builder = bodies()
    builder.add_combination("sum", TERMS, stiffness=5.0, limit=(-9.0, 9.0))
    model = builder.finalize(3, "cpu", per_world=["coupling_coefficient"])
    model.coupling_coefficient[2] = [[2.0, 3.0]]
    sim = sw.Simulation(model, 1e-3, threads=1)
    sim.set_joint_state([False, True, True], np.full((3, 3), 0.1), np.full((3, 3), [[0.4, 0.2, -7.0]]))
    q, qd = sim.state.joint_q.numpy(), sim.state.joint_qd.numpy()
    assert q[:, SUM] == pytest.approx([0.0, 0.1 * (0.7 - 1.3), 0.5], abs=1e-6)
    assert qd[:, SUM] == pytest.approx([0.0, 0.7 * 0.4 - 1.3 * 0.2, 2 * 0.4 + 3 * 0.2], abs=1e-6)
    assert qd[1, :2] == pytest.approx([0.4, 0.2], abs=1e-6)  # its spring is no part of a set state
    sim.state.body_x.assign(sim.state.body_x.numpy() + np.array([0.2, 0.0, 0.0]))
    sim.measure()
    assert sim.state.joint_q.numpy()[1, SUM] == pytest.approx(0.3 * 0.7 - 0.13, abs=1e-6)


def test_a_shafts_position_counts_from_the_start() -> None:
    builder = sw.ModelBuilder()
    shafts = [builder.add_shaft(f"s{k}", inertia=1.0, position=0.3 + k, speed=2.0) for k in range(2)]
    first = builder.add_combination("first", [(shafts[0], 2.0), (shafts[1], 1.0)])
    second = builder.add_combination("second", [(first, -1.0), (shafts[1], 0.5)])
    model = builder.finalize(1, "cpu")
    sim = sw.Simulation(model, 1e-3)
    assert sim.state.joint_q.numpy()[0, 2:] == pytest.approx([1.9, -1.9 + 0.65], abs=1e-6)
    assert sim.state.joint_qd.numpy()[0, 2:] == pytest.approx([6.0, -5.0], abs=1e-6)
    assert builder.joints[second].terms == ((0, -2.0), (1, -1.0), (1, 0.5))


def test_wrong_combinations_are_told() -> None:
    builder = bodies()
    with pytest.raises(ModelError, match=r"combination 's': needs 1 to 12 terms, got 13; add up fewer coordinates"):
        builder.add_combination("s", [(SLIDE, 1.0)] * 13)
    with pytest.raises(ModelError, match=r"combination 's': unknown option 'stifness' \(did you mean 'stiffness'\?\)"):
        builder.add_combination("s", TERMS, stifness=1.0)  # type: ignore[call-arg]
    builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0))
    ball = builder.add_joint_spherical("socket", 0, 2, anchor=(0.0, 0.0, 0.0))
    builder.add_combination("s", [(ball, 1, 1.0)])
    with pytest.raises(ModelError, match="combination 's': joint 'socket' is SPHERICAL, whose angles"):
        builder.finalize(1, "cpu")
    turned = bodies()
    turn = turned.add_joint_relative_rotation("turn", 0, 1, axis=(0.0, 0.0, 1.0))
    turned.add_combination("s", [(turn, 1.0)])
    with pytest.raises(ModelError, match="combination 's': joint 'turn' is a RELATIVE_ROTATION, which only couplings"):
        turned.finalize(1, "cpu")


def test_twelve_terms_add_up() -> None:
    builder = sw.ModelBuilder()
    shafts = [builder.add_shaft(f"s{k}", inertia=0.5 + 0.1 * k) for k in range(12)]
    factors = 1.0 + 0.25 * np.arange(12)
    builder.add_combination("sum", [(s, float(f)) for s, f in zip(shafts, factors, strict=True)], limit=(-9.0, 0.0))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.control.joint_force[:, :12] = 1.0
    for _ in range(20):
        sim.step()
    rates = sim.state.joint_qd.numpy()[0]
    # the stop takes away what is along the factors, in the metric of the inertias
    inertias = 0.5 + 0.1 * np.arange(12)
    free = 0.02 / inertias
    wanted = free - factors / inertias * (factors @ free) / (factors**2 / inertias).sum()
    # the solver's tolerance
    assert rates[:12] == pytest.approx(wanted, abs=2e-5)
    assert abs(rates[12]) < 1e-4


def test_a_set_state_keeps_its_rates_under_a_prescribed_sum() -> None:
    """The motion comes with the first step: what is set is what is there."""
    sim = combined(1e-3, drive=sw.PrescribedSpeed())
    put(sim, (0.1, 0.2), (0.4, 0.2))
    assert sim.state.joint_qd.numpy()[0] == pytest.approx([0.4, 0.2, 0.7 * 0.4 - 1.3 * 0.2], abs=1e-6)
    sim.step()
    assert sim.state.joint_qd.numpy()[0, SUM] == pytest.approx(0.0, abs=1e-6)
