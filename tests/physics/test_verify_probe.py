"""The measures that the checks rely on, against answers that need no engine."""

import numpy as np
import pytest

from simwarp import scenes
from simwarp.verify import chain_problem
from simwarp.verify.probe import HingeRows, Probe, crossings, displaced
from tests.reference import planar


def test_energy_is_that_of_the_planar_formulas():
    probe = Probe(scenes.four_bar(), 1e-3)
    kinetic, potential = planar.four_bar_energy(scenes.FourBar(), 0.9, 12.0)
    # velocities are float32
    assert probe.kinetic_energy() == pytest.approx(kinetic, rel=1e-6)
    assert probe.potential_energy() == pytest.approx(potential, rel=1e-9)


def test_momentum_of_one_free_body():
    probe = Probe(scenes.dzhanibekov(), 1e-3)
    np.testing.assert_allclose(probe.angular_momentum(), [0.01, 10.0, 0.03], rtol=1e-6)


def test_rows_see_a_gap_and_a_sliding_joint():
    probe = Probe(scenes.double_pendulum(), 1e-3)
    rows = HingeRows(probe)
    at = rows.geometry()
    np.testing.assert_allclose(at.gap, 0.0, atol=1e-15)
    np.testing.assert_allclose(rows.speeds(at, 1e-3), 0.0, atol=1e-12)
    moved = probe.x
    moved[1, 2] += 2e-5
    probe.sim.state.body_x.assign(moved[None])
    at = rows.geometry()
    np.testing.assert_allclose(np.linalg.norm(at.gap, axis=1), [0.0, 2e-5], atol=1e-12)
    # not corrected by any velocity yet: C / h
    np.testing.assert_allclose(rows.speeds(at, 1e-3)[:, 0], [0.0, 2e-2], atol=1e-9)


def test_displaced_is_the_same_mechanism_elsewhere():
    offset = np.array([1.0, 2.0, 3.0])
    home, away = Probe(scenes.slider_crank(), 1e-3), Probe(displaced(scenes.slider_crank(), offset), 1e-3)
    np.testing.assert_allclose(away.x - offset, home.x, atol=1e-12)
    np.testing.assert_allclose(HingeRows(away).geometry().gap, 0.0, atol=1e-12)


def test_crossings_interpolate():
    t = np.arange(0.0, 7.0, 1e-3)
    np.testing.assert_allclose(crossings(np.cos(t), 1e-3), [0.5 * np.pi, 1.5 * np.pi], atol=1e-6)


def test_the_rebuilt_chain_is_the_given_problem():
    problem = chain_problem.load()
    probe = chain_problem.rebuild(problem)
    rows = int(problem["nb"])
    at, h = HingeRows(probe).geometry(), float(problem["h"])
    # velocities are float32 in the probe: a rounding of some 10 m/s and rad/s in the curvature
    np.testing.assert_allclose((at.gap / h + h / 6.0 * at.bend).reshape(-1), problem["b"][:rows], atol=1e-7)
    # the reference solution in float64, by elimination of the same matrices
    d, inverse = problem["D"][:, :rows], problem["Minv"]
    free = problem["vfree"] + inverse @ problem["D"][:, rows:] @ problem["gamma"][rows:]
    impulse = np.linalg.solve(d.T @ inverse @ d, -(d.T @ free + problem["b"][:rows]))
    np.testing.assert_allclose(free + inverse @ d @ impulse, problem["v_plus"], atol=1e-11)
