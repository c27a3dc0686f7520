"""The convex friction law: the gap at which it slides, and how it throws off what begins to slide at a closed gap."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import Material

G = 9.81
RADIUS = 0.1
WIDTH = 0.4
"""Half of a box: friction up to 4 does not tip it."""
TANGENTIAL = {"box": 1.0, "ball": 3.5}
"""Mobility of the contact point along the plane, times the mass: a ball also turns, 1 + r² m / I."""


def slider(shape: str, speed: float, friction: float, gap: float, law: str, dt: float) -> sw.Simulation:
    """A body of 1 kg above a plane that starts with a speed, along a direction that no axis has."""
    builder = sw.ModelBuilder()
    material = Material(friction=friction)
    builder.add_shape_plane(material=material)
    course = np.array([0.6, 0.8, 0.0])
    inertia = 0.4 * RADIUS**2 if shape == "ball" else (WIDTH**2 + RADIUS**2) / 3.0
    body = builder.add_body(
        "body", mass=1.0, inertia=(inertia,) * 3, pose=sw.pose((0.0, 0.0, RADIUS + gap)), velocity=speed * course
    )
    if shape == "ball":
        builder.add_shape_sphere(body, radius=RADIUS, material=material)
    else:
        builder.add_shape_box(body, half=(WIDTH, WIDTH, RADIUS), material=material)
    return sw.Simulation(builder.finalize(1, "cpu"), dt, solver=sw.SolverOptions(friction_law=law))


def sliding(sim: sw.Simulation) -> float:
    """Speed of the body's lowest point along the plane; a box does not turn."""
    v, omega = sim.body_velocity("body"), sim.body_angular_velocity("body")
    return float(np.linalg.norm((v + np.cross(omega, (0.0, 0.0, -RADIUS)))[:2]))


def height(sim: sw.Simulation) -> float:
    return float(sim.body_position("body")[2]) - RADIUS


@pytest.mark.parametrize("shape", ["box", "ball"])
@pytest.mark.parametrize(("speed", "friction"), [(1.0, 0.2), (6.0, 0.5), (20.0, 0.8), (6.0, 2.0), (20.0, 1.5)])
@pytest.mark.parametrize("dt", [1e-3, 4e-3])
def test_what_slides_at_the_gap_of_the_law_stays_there(shape, speed, friction, dt):
    """mu |u| h: as the sliding slows down, so does the gap, and the friction is that of the weight."""
    sim = slider(shape, speed, friction, friction * speed * dt, "convex", dt)
    steps = min(50, int(0.5 * speed / (TANGENTIAL[shape] * friction * G * dt)))
    for _ in range(steps):
        sim.step()
        gap = friction * sliding(sim) * dt
        assert height(sim) == pytest.approx(gap, abs=2e-5 * dt + 2e-6 * gap + 1e-7)  # the solver's 1e-5 m/s, float32
    # sinking with the gap takes a share mu^2 off the weight that presses
    lost = TANGENTIAL[shape] * friction * G * dt * steps / (1.0 + TANGENTIAL[shape] * friction**2)
    assert speed - sliding(sim) == pytest.approx(lost, rel=TANGENTIAL[shape] * friction**2 + 1e-3)


@pytest.mark.parametrize("shape", ["box", "ball"])
@pytest.mark.parametrize(("speed", "friction"), [(1.0, 0.2), (6.0, 0.5), (6.0, 1.2)])
@pytest.mark.parametrize("dt", [5e-4, 4e-3])
def test_what_begins_to_slide_at_a_closed_gap_is_thrown_off(shape, speed, friction, dt):
    """The cone holds u_n = mu |u_t| in the first step: an impulse p along the normal and mu p against the sliding give
    p / m (1 + c mu^2) = mu v + g h, whatever the step; then the body flies.
    """
    sim = slider(shape, speed, friction, 0.0, "convex", dt)
    sim.step()
    c = TANGENTIAL[shape]
    left = (speed - c * friction * G * dt) / (1.0 + c * friction**2)
    assert sliding(sim) == pytest.approx(left, abs=1e-4)  # the solver's 1e-5 m/s by the curvature of the cone
    rise = float(sim.body_velocity("body")[2])
    assert rise == pytest.approx(friction * left, abs=1e-4)
    highest = 0.0
    for _ in range(int(rise / G / dt) + 2):
        sim.step()
        highest = max(highest, height(sim))
    # a parabola; the step's velocity belongs to its end: half a step more
    assert highest == pytest.approx(rise**2 / (2.0 * G) + 0.5 * rise * dt, abs=2e-3 * rise * dt + 1e-5 + G * dt**2)


@pytest.mark.parametrize("shape", ["box", "ball"])
def test_coulomb_s_law_does_neither(shape):
    sim = slider(shape, 6.0, 0.5, 0.0, "exact", 2e-3)
    for _ in range(20):
        sim.step()
        assert height(sim) == pytest.approx(0.0, abs=1e-6)
