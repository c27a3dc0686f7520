"""Rods that bend under heavy loads: no step gives them energy, and what moves in a plane stays in it.

Shear and bending moments tie twist to the motion out of the plane of bending. The light nodes of a rod twist faster
than any step, so that a step which leaves that tie without a margin lets the smallest disturbance grow.
"""

import math

import numpy as np
import pytest

import simwarp as sw

STEEL = sw.flex.Elastic(young=2.1e11, density=7850.0)
WIRE = sw.flex.Round(diameter=0.004)
ELEMENTS = 20
KICK = 1e-5
"""Speed of the disturbance out of the plane [m/s]."""


def loaded(masses, points, step, *, section=WIRE, material=STEEL, start=None):
    """A rod with a body of these masses [kg] and a radius of gyration of 0.1 m at its end, one a world, and a small
    disturbance along Y.
    """
    builder = sw.ModelBuilder()
    rod = builder.add_rod("rod", points, section=section, material=material, start=start or sw.flex.Hinge())
    load = builder.add_body("load", mass=1.0, inertia=(0.01,) * 3, pose=sw.pose(points[-1]))
    builder.add_joint_fixed("hook", rod.bodies[-1], load)
    model = builder.finalize(len(masses), "cpu", per_world=["body_mass", "body_inertia_b"])
    for array in (model.body_mass, model.body_inertia_b):
        numbers = np.repeat(array.numpy()[:1], len(masses), axis=0)
        for world, mass in enumerate(masses):
            numbers[world, load] *= mass
        array.assign(numbers)
    sim = sw.Simulation(model, step)
    speed = sim.state.body_v.numpy()
    speed[:, rod.bodies[1:], 1] = KICK * np.random.default_rng(1).normal(size=len(rod.bodies) - 1)
    sim.state.body_v.assign(speed)
    return sim, rod, load


def hanging(angle, length=2.0, elements=ELEMENTS):
    """Points of a straight line from the origin down, at an angle from the vertical in the XZ plane."""
    return np.linspace(0.0, length, elements + 1)[:, None] * [math.sin(angle), 0.0, -math.cos(angle)]


def watched(sim, duration):
    """(W,) the most energy above that of the start [J], and the farthest place out of the plane [m]."""
    start = sim.measure_energy().numpy().astype(float)
    gained, aside = np.full(len(start), -np.inf), np.zeros(len(start))
    for _ in range(round(duration / sim.dt / 10)):
        sim.step(10)
        energy = sim.measure_energy().numpy() - start
        assert np.isfinite(energy).all()
        gained = np.maximum(gained, energy)
        aside = np.maximum(aside, np.abs(sim.state.body_x.numpy()[..., 1]).max(axis=1))
    return gained, aside


@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("angle", [0.1, 0.3, 0.6])
def test_a_wire_that_a_load_jerks_taut_gains_no_energy(angle, step):
    """100 kg to 2 t on a wire of 4 mm, let go unstretched: 1e-3 of what its weight could do along the wire."""
    masses = np.array([100.0, 500.0, 1000.0, 2000.0])
    sim, _, _ = loaded(masses, hanging(angle), step)
    gained, aside = watched(sim, 6.0)
    assert (gained < 1e-3 * masses * 9.81 * 2.0).all()
    assert aside.max() < 0.1 * KICK


@pytest.mark.slow
@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3])
def test_a_wire_with_half_a_tonne_swings_for_half_a_minute(step):
    masses = np.array([150.0, 300.0, 500.0])
    sim, _, _ = loaded(masses, hanging(0.1), step)
    gained, aside = watched(sim, 30.0)
    assert (gained < 1e-3 * masses * 9.81 * 2.0).all()
    assert aside.max() < 0.1 * KICK


@pytest.mark.parametrize("angle", [0.1, 0.3])
@pytest.mark.parametrize("softer", [1.0, 10.0, 100.0])
def test_a_rope_of_little_bending_stiffness_gains_no_energy(softer, angle):
    """E A of 1.1 MN, E I of 0.11 N m^2 and less: bends of ropes are within an element."""
    section = sw.flex.Section(
        area=1e-5, inertia_y=1e-12 / softer, inertia_z=1e-12 / softer, torsion=2e-12 / softer, shear_y=0.9, shear_z=0.9
    )
    masses = np.array([50.0, 100.0, 300.0])
    material = sw.flex.Elastic(young=1.13e11, density=7900.0)
    sim, _, _ = loaded(masses, hanging(angle), 2e-3, section=section, material=material)
    gained, aside = watched(sim, 4.0)
    assert (gained < 1e-3 * masses * 9.81 * 2.0).all()
    assert aside.max() < 0.1 * KICK


@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3])
def test_a_wire_that_bends_sideways_gains_no_energy(step):
    """Level and clamped, with up to 1 kg at its end: it bends by a right angle, without tension at first."""
    masses = np.array([0.1, 0.3, 1.0])
    points = np.linspace(0.0, 1.0, ELEMENTS + 1)[:, None] * [1.0, 0.0, 0.0]
    sim, _, _ = loaded(masses, points, step, start=sw.flex.Clamp())
    gained, aside = watched(sim, 4.0)
    assert (gained < 0.01 * masses * 9.81).all()
    assert aside.max() < KICK


@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3])
def test_a_load_that_swings_around_gains_no_energy(step):
    """1.5 m/s out of the plane: the tension changes by half within steps."""
    masses = np.array([100.0, 500.0, 2000.0])
    sim, rod, load = loaded(masses, hanging(0.3), step)
    speed = sim.state.body_v.numpy()
    speed[:, rod.bodies, 1] += 1.5 * np.linspace(0.0, 1.0, ELEMENTS + 1)
    speed[:, load, 1] += 1.5
    sim.state.body_v.assign(speed)
    gained, _ = watched(sim, 6.0)
    assert (gained < 0.02 * masses * 9.81 * 2.0).all()
