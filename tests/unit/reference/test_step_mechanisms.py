"""The reference against published numbers and independent integrations; the shipped scenes stay assembled."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from simwarp import scenes
from simwarp.core.types import JointType
from tests.reference import planar
from tests.reference.mechanisms import NAMED, random_mechanism
from tests.reference.step import ReferenceStep

DATA = Path(__file__).parents[2] / "reference" / "data"


def run(truth: ReferenceStep, duration: float) -> float:
    """Steps for `duration` [s]; the largest violation seen."""
    worst = 0.0
    for _ in range(round(duration / truth.dt)):
        truth.step()
        worst = max(worst, truth.violation())
    return worst


def zero_crossings(values: list[float], dt: float) -> np.ndarray:
    w = np.array(values)
    i = np.flatnonzero(w[1:] * w[:-1] < 0)
    return (i + 1 + w[i] / (w[i] - w[i + 1])) * dt


def test_references_agree_with_each_other():
    assert planar.pendulum_period() == pytest.approx(scenes.PENDULUM_PERIOD, abs=1e-6)
    assert planar.pendulum_period_quadrature() == pytest.approx(planar.pendulum_period(), rel=1e-13)
    flips = np.diff(planar.flip_times((1.0, 2.0, 3.0), (0.01, 5.0, 0.01), 20.0))
    np.testing.assert_allclose(flips, scenes.FLIP_INTERVAL, atol=1e-6)
    recorded = np.genfromtxt(DATA / "double_pendulum_rk4.csv", delimiter=",", names=True)
    row = recorded[recorded["t_s"] == 2.0]
    expected = [row["theta1_rad_below_x"][0], row["theta2_rad_below_x"][0]]
    np.testing.assert_allclose(planar.double_pendulum_rk4(2.0, 2e-3)[:2], expected, atol=1e-6)


def test_free_body_reference_keeps_its_momentum():
    inertia, omega = np.array([1.0, 2.0, 3.0]), np.array([0.3, 2.0, -0.5])
    q, w = planar.free_body(inertia, omega, np.linspace(0.0, 3.0, 4))
    axes = np.array([np.eye(3)] * 4)
    rotated = [planar_rotate(qk, axes[k]) for k, qk in enumerate(q)]
    momentum = np.array([r @ np.diag(inertia) @ r.T @ wk for r, wk in zip(rotated, w, strict=True)])
    np.testing.assert_allclose(momentum, np.tile(inertia * omega, (4, 1)), atol=1e-9)


def planar_rotate(q: np.ndarray, axes: np.ndarray) -> np.ndarray:
    v = np.asarray(axes)
    t = 2.0 * np.cross(q[:3], v)
    return (v + q[3] * t + np.cross(q[:3], t)).T


def test_pendulum_period():
    truth = ReferenceStep(scenes.pendulum(), 2e-3)
    speeds = []
    for _ in range(650):
        truth.step()
        speeds.append(truth.joint_qd[0])
    # at rest again after half a period
    assert 2.0 * zero_crossings(speeds, 2e-3)[0] == pytest.approx(scenes.PENDULUM_PERIOD, abs=2e-3)


def test_dzhanibekov_flips():
    truth = ReferenceStep(scenes.dzhanibekov(), 5e-3)
    rates = []
    for _ in range(1600):
        truth.step()
        rates.append((truth.rotation[0].T @ truth.omega[0])[1])
    assert np.diff(zero_crossings(rates, 5e-3))[0] == pytest.approx(scenes.FLIP_INTERVAL, abs=2e-4)
    assert truth.energy() == pytest.approx(25.0002, rel=1e-9)


def test_free_body_orientation_converges():
    def error(dt: float) -> float:
        truth = ReferenceStep(scenes.dzhanibekov(), dt)
        q, _ = planar.free_body(np.array([1.0, 2.0, 3.0]), np.array([0.01, 5.0, 0.01]), np.array([0.0, 2.0]))
        run(truth, 2.0)
        return 1.0 - abs(float(q[-1] @ truth.rot[0]))

    coarse, fine = error(1e-2), error(5e-3)
    assert fine < 1e-4
    assert fine < 0.4 * coarse  # squared angle: a quarter


@pytest.mark.slow
def test_double_pendulum_converges_to_the_recorded_run():
    recorded = np.genfromtxt(DATA / "double_pendulum_rk4.csv", delimiter=",", names=True)
    row = recorded[recorded["t_s"] == 1.0][0]
    expected = np.array([row["x1_m"], row["z1_m"], row["x2_m"], row["z2_m"]])
    errors = []
    for dt in (8e-3, 4e-3, 2e-3):
        truth = ReferenceStep(scenes.double_pendulum(), dt)
        assert run(truth, 1.0) < 3.0 * dt**2 * 20.0
        errors.append(np.linalg.norm(truth.x[:, [0, 2]].reshape(-1) - expected))
    assert errors[2] < 8e-3
    assert 1.7 < errors[0] / errors[1] < 2.3
    assert 1.7 < errors[1] / errors[2] < 2.3


def test_slider_crank_position_and_motor_torque():
    recorded = np.genfromtxt(DATA / "slider_crank_chrono.csv", delimiter=",", names=True)[1:21]
    truth = ReferenceStep(scenes.slider_crank(), 1e-3)
    torque = []
    for _ in recorded:
        run(truth, 0.05)
        assert truth.x[2, 0] == pytest.approx(planar.slider_position(2.0 * np.pi * truth.time), abs=2e-5)
        torque.append(truth.prescribed_effort[0])
    # Chrono reports the torque with the opposite sign
    np.testing.assert_allclose(torque, -recorded["motor_torque_Nm"], atol=1e-3)


@cache
def andrews_angles(dt: float) -> np.ndarray:
    truth = ReferenceStep(scenes.andrews(), dt)
    assert run(truth, 0.03) < 5e3 * dt**2 * 3
    return truth.joint_q[:7] + scenes.ANDREWS_INITIAL


@pytest.mark.slow
def test_andrews_converges_to_the_published_angles():
    coarse, fine = andrews_angles(5e-5), andrews_angles(2.5e-5)
    reference = np.array(scenes.ANDREWS_REFERENCE)
    e0, e1 = coarse - reference, fine - reference
    assert np.abs(e1).max() < 0.25
    assert 1.8 < e0[0] / e1[0] < 2.2
    # what is left after Richardson is of second order
    np.testing.assert_allclose(2.0 * fine - coarse, reference, atol=0.02)


def test_four_bar_follows_its_energy_and_stays_assembled():
    errors = []
    for dt in (2e-3, 1e-3):
        truth = ReferenceStep(scenes.four_bar(), dt)
        assert truth.rank == 17
        assert run(truth, 1.0) < 40.0 * dt**2
        expected = planar.four_bar_crank(scenes.FourBar(), 0.9, 12.0, np.array([0.0, 1.0]))[-1]
        errors.append(0.9 + truth.joint_q[0] - expected)
        assert sum(planar.four_bar_energy(scenes.FourBar(), 0.9, 12.0)) == pytest.approx(truth.energy(), rel=2e-3)
    assert expected > 2 * np.pi
    assert abs(errors[1]) < 0.03
    assert abs(errors[1]) < 0.6 * abs(errors[0])


@pytest.mark.slow
def test_bricard_moves_with_one_degree_of_freedom():
    truth = ReferenceStep(scenes.bricard(), 2e-3)
    assert truth.mobility == 1
    start = truth.energy()
    assert run(truth, 2.0) < 2e-4
    assert truth.energy() == pytest.approx(start, abs=0.2)
    assert np.abs(truth.joint_q).min() > 0.5
    # opposite hinges of the threefold symmetric linkage move alike
    np.testing.assert_allclose(np.abs(truth.joint_q[[0, 2, 4]]), np.abs(truth.joint_q[0]), atol=2e-4)
    np.testing.assert_allclose(np.abs(truth.joint_q[[1, 3, 5]]), np.abs(truth.joint_q[1]), atol=2e-4)


def test_linkage_has_the_promised_size_and_keeps_its_momentum():
    builder = scenes.linkage()
    truth = ReferenceStep(builder, 1e-3)
    assert (len(builder.bodies), len(builder.joints)) == (20, 28)
    assert truth.rows.bilateral + len(truth.prescribed) == 106
    assert truth.rank == 106
    # the tree takes one joint per body but the free chassis: 9 of the 28 close loops
    closing = [j for j in builder.joints if j.type == JointType.ROD or j.name.endswith(("upper_ball", "idler_link"))]
    assert len(closing) == 9
    linear, angular = truth.linear_momentum(), truth.angular_momentum()
    assert run(truth, 0.1) < 1e-4
    np.testing.assert_allclose(truth.linear_momentum(), linear, atol=1e-7)
    np.testing.assert_allclose(truth.angular_momentum(), angular, rtol=5e-3, atol=5.0)
    assert np.abs(truth.joint_qd[:1]).max() < 1e-9


@pytest.mark.parametrize("name", sorted(NAMED))
def test_scenes_start_assembled_with_velocities_that_fit(name):
    truth = ReferenceStep(NAMED[name](), 1e-3)
    assert truth.violation() < 1e-14
    rates = truth.rows.jacobian[: truth.rows.bilateral] @ truth.velocity
    assert np.abs(rates).max(initial=0.0) < 1e-12


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.sweep
def test_random_mechanisms_stay_assembled(seed):
    truth = ReferenceStep(random_mechanism(seed, bounds=seed % 2 == 0, couplings=seed % 3 == 0), 1e-3)
    assert truth.violation() < 1e-13
    assert truth.mobility > 0
    assert run(truth, 0.03) < 3e-4


def test_free_floating_tree_conserves_momentum_and_nearly_energy():
    builder = random_mechanism(4, 6, 0, laws=False, floating=True)
    builder.gravity = np.zeros(3)
    changes = []
    for dt in (1e-3, 5e-4):
        truth = ReferenceStep(builder, dt)
        before = (truth.linear_momentum(), truth.angular_momentum(), truth.energy())
        run(truth, 0.1)
        np.testing.assert_allclose(truth.linear_momentum(), before[0], atol=1e-11)
        changes.append(
            (np.abs(truth.angular_momentum() - before[1]).max(), abs(truth.energy() - before[2]) / before[2])
        )
    assert changes[1][1] < 0.01
    assert changes[1][0] < 0.7 * changes[0][0] + 1e-9


def test_a_state_handed_over_continues_the_run():
    builder = random_mechanism(3, bounds=True, couplings=True)
    whole, part = ReferenceStep(builder, 1e-3), ReferenceStep(builder, 1e-3)
    run(whole, 0.02)
    part.set_state(whole.x, whole.rot, whole.v, whole.omega, whole.shaft_q, whole.shaft_qd, whole.omega_last)
    np.testing.assert_allclose(part.joint_q, whole.joint_q, atol=1e-12)
    run(whole, 0.01)
    run(part, 0.01)
    np.testing.assert_allclose(part.x, whole.x, atol=1e-10)
