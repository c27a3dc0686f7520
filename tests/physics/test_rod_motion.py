"""Rods in motion: the float64 reference against theory, recorded runs and finer elements."""

from __future__ import annotations

import csv
import dataclasses
import gzip
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from tests.physics import rod_cases, rod_motion_cases as cases
from tests.reference import rods
from tests.reference.rod_models import rods_of, supports_of, together, with_mass
from tests.reference.rod_steps import Motion, Rule, at_distance, below, coincident
from tests.reference.rods import Array

RECORDED = Path(__file__).parents[3] / "shared/reference/chrono/flexible"
"""Runs of Project Chrono beside the checkout."""


def _motion(beam: rod_cases.Beam, rule: Rule, gravity: rod_cases.Vector = rod_cases.ZERO) -> Motion:
    model, pose = rods_of(beam)
    return Motion(model, pose, rule, supports=supports_of(beam), gravity=gravity)


def _observed(motion: Motion, count: int, node: int, component: int) -> tuple[Array, Array]:
    """Times and a velocity after each step."""
    values = np.zeros(count)
    for k in range(count):
        motion.step()
        values[k] = motion.velocity[node, component]
    return np.array(motion.rule.h * np.arange(count), np.float64), values


def _vibrating(beam: rod_cases.Beam, rule: Rule, velocities: Array) -> Motion:
    motion = _motion(beam, rule)
    motion.velocity = np.where(motion.fixed.reshape(-1, 6), 0.0, velocities)
    return motion


@pytest.mark.parametrize("case", cases.vibration_cases(), ids=lambda case: case.name)
def test_frequency(case: cases.VibrationCase) -> None:
    parts = np.linspace(0.0, 1.0, len(case.beam.points))
    motion = _vibrating(case.beam, Rule(case.step, 0.0), case.velocities(parts))
    count = round((case.periods - 1) / case.frequency / case.step)
    found = cases.mean_frequency(*_observed(motion, count, case.node, case.component))
    assert found == pytest.approx(case.frequency, rel=case.tolerance)


@pytest.mark.parametrize("law", cases.DECAYS)
def test_decay(law: tuple[float, float, float]) -> None:
    """zeta h w^2 / 2 + tau w^2 / 2 to 3 %, of the first mode of the cantilever."""
    zeta, step, damping_time = law
    beam = dataclasses.replace(cases.CANTILEVER, points=rod_cases.straight(1.0, 10))
    velocities = cases.cantilever_mode(cases.CANTILEVER_ROOTS[0])(np.linspace(0.0, 1.0, 11))
    frequency = 14.43  # of ten elements
    motion = _vibrating(beam, Rule(step, zeta, damping_time), velocities)
    found = cases.decay_rate(*_observed(motion, round(6.0 / frequency / step), -1, 2))
    assert found == pytest.approx(cases.decay(zeta, step, frequency, damping_time), rel=0.03)


def test_bands_and_the_full_matrix_agree() -> None:
    beam = dataclasses.replace(cases.CANTILEVER, points=rod_cases.straight(1.0, 6), start=rod_cases.End.HINGE)
    banded, full = (_motion(beam, Rule(1e-3), cases.GRAVITY) for _ in range(2))
    full.chain = False
    banded.step(30)
    full.step(30)
    assert np.abs(banded.velocity - full.velocity).max() < 1e-10 * np.abs(full.velocity).max()


@pytest.mark.parametrize("zeta", [0.1, 1.0])
def test_a_free_rod_keeps_its_momentum(zeta: float) -> None:
    """To rounding without the term of tension, which is no force between two nodes along their distance; one turn."""
    beam = dataclasses.replace(cases.CANTILEVER, start=rod_cases.End.LOOSE)
    for tension, bound in ((False, 1e-12), (True, 2e-4)):
        motion = _motion(beam, Rule(1e-3, zeta, tension=tension))
        motion.set_spin((0.0, 0.0, cases.FREE_SPIN_RATE), (0.5, 0.0, 0.0))
        linear, angular = motion.momentum()
        motion.step(round(2.0 * math.pi / cases.FREE_SPIN_RATE / motion.rule.h))
        assert np.abs(motion.momentum()[0] - linear).max() < 1e-11
        assert np.abs(motion.momentum()[1] / angular[2] - [0.0, 0.0, 1.0]).max() < bound


def test_acting_forces_are_those_of_the_rotation() -> None:
    """The pose alone would say 55 times as much: the stretch that steps add is no force."""
    motion = _motion(dataclasses.replace(cases.CANTILEVER, start=rod_cases.End.LOOSE), Rule(1e-3, 0.1))
    motion.set_spin((0.0, 0.0, cases.FREE_SPIN_RATE), (0.5, 0.0, 0.0))
    motion.step(1000)
    line = cases.DENSITY * cases.ROD_AREA
    expected = line * cases.FREE_SPIN_RATE**2 / 2.0 * (0.25 - 0.05**2 / 4.0)  # masses lumped beside the middle
    assert motion.acting[10, 0] == pytest.approx(expected, rel=0.01)
    bias = cases.stretch_bias(0.1, 1e-3, cases.FREE_SPIN_RATE) * motion.model.stiffness[0, 0]
    assert rods.stresses(motion.model, motion.pose)[10, 0] - expected == pytest.approx(bias, rel=0.01)


def test_a_turned_rod_stretches() -> None:
    """To 1 %: rho w^2 L^3 / 3 E, with the large strain's part; 0.2 s."""
    beam = cases.SPINNING
    model, pose = rods_of(beam)
    pose = rods.Pose(cases.spinning_positions(np.linspace(0.0, 1.0, model.nodes)), pose.rotation)
    spin = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, cases.SPINNING_RATE], (model.nodes, 1))
    motion = Motion(model, pose, Rule(2e-4, 0.1), supports=supports_of(beam), driven=lambda t: spin)
    motion.set_spin((0.0, 0.0, cases.SPINNING_RATE))
    found = []
    for _ in range(1000):
        motion.step()
        found.append(float(np.linalg.norm(motion.pose.position[-1])) - 1.0)
    assert np.mean(found) == pytest.approx(cases.SPINNING_EXTENSION, rel=0.01)
    assert np.abs(np.array(found) / cases.SPINNING_EXTENSION - 1.0).max() < 0.03


def test_spin_up() -> None:
    """At 2 ms the steps add two thirds of the extension; the sum is right to 2 % (theory and law)."""
    case, h = cases.SPIN_UP, 2e-3
    model, pose = rods_of(case.beam)

    def driven(t: float) -> Array:
        out = np.zeros((model.nodes, 6))
        out[0, 5] = (case.angle(t) - case.angle(t - h)) / h
        return out

    motion = Motion(model, pose, Rule(h), supports=supports_of(case.beam), driven=driven)
    tips = []
    for _ in range(round(18.0 / h)):
        motion.step()
        angle, (x, y, _) = case.angle(motion.time), motion.pose.position[-1]
        along, across = math.cos(angle) * x + math.sin(angle) * y, math.cos(angle) * y - math.sin(angle) * x
        tips.append((along - 10.0, across))
    found = np.array(tips)
    bias = 10.0 * cases.stretch_bias(0.1, h, case.rate)
    assert found[-1000:, 0].mean() == pytest.approx(case.extension + bias, rel=0.02)
    assert found[:, 1].min() == pytest.approx(-case.deflection, rel=0.01)


def _pendulum(elements: int, step: float, zeta: float, duration: float, every: float) -> Array:
    """Positions of the tip, from the start on."""
    beam = dataclasses.replace(cases.PENDULUM, points=rod_cases.straight(1.0, elements))
    motion = _motion(beam, Rule(step, zeta), cases.GRAVITY)
    out = [motion.pose.position[-1]]
    for _ in range(round(duration / every)):
        motion.step(round(every / step))
        out.append(motion.pose.position[-1])
    return np.array(out)


def test_flexible_pendulum() -> None:
    """20 elements at 1 ms beside 160 at 0.1 ms: 1 % of the length until the tip whips, 0.5 s."""
    found = _pendulum(20, 1e-3, 0.1, 0.5, 0.1)[1:]
    assert np.abs(found[:, (0, 2)] - np.array(cases.PENDULUM_TIPS[:5])).max() < 0.01


@pytest.mark.slow
def test_flexible_pendulum_of_many_elements() -> None:
    """The table of the case, half of it."""
    found = _pendulum(160, 1e-4, 0.1, 0.5, 0.1)[1:]
    assert np.abs(found[:, (0, 2)] - np.array(cases.PENDULUM_TIPS[:5])).max() < 2e-6


@pytest.mark.skipif(not RECORDED.is_dir(), reason="recorded runs of Chrono are not beside the checkout")
def test_recorded_pendulum() -> None:
    """10 ANCF cables with HHT at 0.25 ms, whose own two steps differ by 3 mm: 6 mm until 0.5 s, 12 mm until 0.9 s."""
    path = RECORDED / "fea_c_pendulum_HHT0.05_dt0.00025.csv.gz"
    with gzip.open(path, "rt", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    recorded = np.array([(float(row["tip_x"]), float(row["tip_z"])) for row in rows[:91]])
    found = _pendulum(20, 1e-3, 0.1, 0.9, 0.01)[:, (0, 2)]
    off = np.linalg.norm(found - recorded, axis=1)
    assert off[:51].max() < 0.006
    assert off.max() < 0.012


def _slider_crank(case: cases.SliderCrank, step: float, zeta: float, duration: float) -> tuple[Array, Array]:
    """Deflection of the rod's middle, and the slider's distance from that of a rigid rod, after each step."""
    model, pose = rods_of(case.beam)
    model = with_mass(model, -1, case.slider)

    def driven(t: float) -> Array:
        out = np.zeros((model.nodes, 6))
        out[0, :3] = (np.array(case.pin(t)) - np.array(case.pin(t - step))) / step
        return out

    motion = Motion(model, pose, Rule(step, zeta), supports=supports_of(case.beam), driven=driven)
    motion.velocity = case.velocities()
    deflection, slider = [], []
    for _ in range(round(duration / step)):
        motion.step()
        first, last = motion.pose.position[0], motion.pose.position[-1]
        along = (last - first) / np.linalg.norm(last - first)
        middle = motion.pose.position[model.nodes // 2] - first
        deflection.append(along[0] * middle[1] - along[1] * middle[0])
        slider.append(last[0] - case.rigid_slider(motion.time))
    return np.array(deflection), np.array(slider)


def test_slider_crank_with_a_flexible_rod() -> None:
    """40 elements beside 160, two turns of the crank: 1 % of the largest deflection (20 elements: 1.2 %)."""
    wanted = np.ravel(cases.SLIDER_CRANK_DEFLECTIONS)
    found, _ = _slider_crank(cases.slider_crank(elements=40), 1e-4, 0.1, 0.08)
    assert np.abs(found[19::20] - wanted).max() < 0.01 * np.abs(wanted).max()


def test_slider_crank_with_a_stiff_rod() -> None:
    """The rigid mechanism to 1e-4 of the rod's length."""
    _, off = _slider_crank(cases.slider_crank(2e15, 8), 1e-4, 0.1, 0.042)
    assert np.abs(off).max() < 1e-4 * 0.3


@pytest.mark.parametrize("body", [10.0, 100.0])
@pytest.mark.parametrize("step", [1e-3, 5e-3])
def test_a_body_on_a_cable_swings(body: float, step: float) -> None:
    """Period of the rigid pendulum to 0.1 %, and no growth; from rest without tension, as if let go."""
    case = cases.cable_case(body)
    model, pose = rods_of(case.beam)
    motion = Motion(
        with_mass(model, -1, body), pose, Rule(step), supports=supports_of(case.beam), gravity=cases.GRAVITY
    )
    start = motion.energy()
    times, speed = _observed(motion, round(7.0 / step), -1, 0)
    assert 1.0 / cases.mean_frequency(times, speed) == pytest.approx(case.period, rel=1e-3)
    early, late = (np.abs(part).max() for part in np.split(speed, 2))
    assert late < 1.001 * early
    assert motion.energy() <= start


@pytest.mark.parametrize(
    ("angle", "body", "step"), [(0.1, 500.0, 5e-3), (0.3, 2000.0, 2e-3), (0.5 * math.pi, 1.0, 2e-3)]
)
def test_a_bent_wire_stays_in_its_plane(angle: float, body: float, step: float) -> None:
    """A wire of 4 mm, let go with a body of 0.1 m radius of gyration: of 10 um/s aside nothing grows, nor energy.

    Twist, which shear and moments tie to motion aside, grew without end where the step had no margin for it.
    The wire that is level is clamped.
    """
    level = body == 1.0
    along = np.array([math.sin(angle), 0.0, -math.cos(angle)])
    points = np.linspace(0.0, 1.0 if level else 2.0, 21)[:, None] * along
    section = rod_cases.Section(rod_cases.Shape.ROUND, (0.002,))
    end = rod_cases.End.CLAMP if level else rod_cases.End.HINGE
    beam = rod_cases.Beam(tuple(map(tuple, points)), section, 2.1e11, density=7850.0, up=(0.0, 1.0, 0.0), start=end)
    model, pose = rods_of(beam)
    inertia = model.inertia.copy()
    inertia[-1] += 0.01 * body
    model = dataclasses.replace(with_mass(model, -1, body), inertia=inertia)
    motion = Motion(model, pose, Rule(step), supports=supports_of(beam), gravity=cases.GRAVITY)
    motion.velocity[1:, 1] = 1e-5 * np.random.default_rng(1).normal(size=20)
    start = motion.energy()
    for _ in range(round(2.0 / step / 10)):
        motion.step(10)
        assert motion.energy() - start < (0.01 if level else 1e-3) * body * 9.81
        assert np.abs(motion.pose.position[:, 1]).max() < 1e-5


def test_a_bar_leaves_a_wall() -> None:
    """After 2 L / c to 10 %, with its speed."""
    case, h = cases.WALL, 1e-5
    model, pose = rods_of(case.beam)
    wall = below(model.nodes - 1, 0, case.beam.length + case.gap)
    motion = Motion(model, pose, Rule(h, 0.0), rows=[wall])
    motion.velocity[:, 0] = case.speed
    touching = []
    for _ in range(60):
        motion.step()
        touching.append(motion.impulses[0][0] > 0.0)
        assert wall.value(motion.pose)[0] > -1e-12
    at = np.flatnonzero(touching)
    assert (at[-1] - at[0] + 1) * h == pytest.approx(case.contact_time, rel=0.1)
    assert motion.momentum()[0][0] / model.mass.sum() == pytest.approx(-case.speed, rel=0.1)


def test_four_bar_of_rods() -> None:
    """Pins stay together to rounding; the coupler moves as that of rigid bars, to a millimetre of 0.3 m."""
    case = cases.FourBar()
    elements = 4
    joints = [np.array(joint) for joint in case.joints]
    parts = []
    for a, b in itertools.pairwise(joints):
        points = tuple((x, y, 0.0) for x, y in (a + np.outer(np.linspace(0.0, 1.0, elements + 1), b - a))[:, :2])
        parts.append(rods_of(rod_cases.Beam(points, case.section, case.young)))
    model, pose = together(parts)
    each = elements + 1
    crank = np.zeros((model.nodes, 6))
    crank[0, 5] = case.rate
    pins = [coincident(each - 1, each), coincident(2 * each - 1, 2 * each)]
    motion = Motion(
        model,
        pose,
        Rule(1e-3),
        supports={0: rods.CLAMP, -1: (0, 1, 2, 3, 4)},
        driven=lambda t: crank,
        rows=pins,
    )
    motion.velocity[:each, :3] = np.cross([0.0, 0.0, case.rate], pose.position[:each])
    motion.velocity[:each, 5] = case.rate
    for _ in range(500):
        motion.step()
        assert max(float(np.abs(pin.value(motion.pose)).max()) for pin in pins) < 1e-12
        assert np.linalg.norm(motion.pose.position[2 * each - 1] - case.coupler_end(motion.time)) < 1e-3
    assert np.linalg.norm(motion.pose.position[2 * each - 1] - case.coupler_end(motion.time)) < 1e-5


def test_leaf_spring_with_a_shackle() -> None:
    """The sag of a beam on two supports to 1 %; the shackle keeps its length."""
    case = cases.leaf_spring()
    model, pose = rods_of(case.beam)
    shackle = at_distance(model.nodes - 1, case.shackle, 0.1)
    supports = {0: (0, 1, 2, 3, 5), -1: (1,)}
    motion = Motion(model, pose, Rule(2e-3, 1.0, 2e-3), supports=supports, rows=[shackle])
    motion.loads.dead[model.nodes // 2, 2] = -case.force
    motion.step(700)
    assert -motion.pose.position[model.nodes // 2, 2] == pytest.approx(case.sag, rel=0.01)
    assert abs(shackle.value(motion.pose)[0]) < 1e-9


def _after(step: float, zeta: float) -> Array:
    """A soft pendulum after 0.2 s. Velocities belong to the middle of steps: half a step leads back to one instant."""
    beam = dataclasses.replace(cases.PENDULUM, points=rod_cases.straight(1.0, 5))
    model, pose = rods_of(beam)
    model = dataclasses.replace(model, stiffness=model.stiffness * [0.05, 0.05, 0.05, 20.0, 20.0, 20.0])
    motion = Motion(model, pose, Rule(step, zeta), supports=supports_of(beam), gravity=cases.GRAVITY)
    motion.step(round(0.2 / step))
    return motion.pose.position - 0.5 * step * motion.velocity[:, :3]


@pytest.mark.parametrize(("zeta", "order"), [(1.0, 1.0), (0.1, 1.0), (0.0, 2.0)])
def test_order_in_time(zeta: float, order: float) -> None:
    """Errors at 1.6, 0.8 ms against 0.05 ms."""
    fine = _after(5e-5, zeta)
    errors = [float(np.abs(_after(step, zeta) - fine).max()) for step in (1.6e-3, 8e-4)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)
