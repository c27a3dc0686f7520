"""Springs and dampers by table where they fall, Stribeck's drag or a snap spring: their force alone counts there."""

from collections.abc import Callable

import numpy as np
import pytest

import simwarp as sw

DT = 1e-3
STRIBECK = ((-2.0, -0.05, 0.05, 2.0), (-1.0, -5.0, 5.0, 1.0))
"""Rises to 5 N at 5 cm/s, falls to 1 N at 2 m/s."""
SNAP = ((-0.5, -0.1, 0.1, 0.5), (-2.0, -10.0, 10.0, 2.0))


def slide(builder: sw.ModelBuilder, body: int, **law) -> int:
    return builder.add_joint_prismatic("j", sw.WORLD, body, axis=(1, 0, 0), **law)


def spring(builder: sw.ModelBuilder, body: int, **law) -> None:
    builder.add_spring("s", sw.WORLD, body, anchor0=(0, 0, 0), anchor1=(1, 0, 0), **law)


def spring_on_slide(builder: sw.ModelBuilder, body: int, **law) -> None:
    slide(builder, body)
    spring(builder, body, **law)


def combination(builder: sw.ModelBuilder, body: int, **law) -> None:
    builder.add_combination("c", [(slide(builder, body), 1.0)], **law)


def speed_after(attach: Callable[..., object], steps: int, speed: float, **law) -> float:
    builder = sw.ModelBuilder(gravity=(0, 0, 0))
    body = builder.add_body("a", mass=1.0, inertia=(0.1,) * 3, pose=sw.pose((1, 0, 0)), velocity=(speed, 0, 0))
    attach(builder, body, **law)
    simulation = sw.Simulation(builder.finalize(1, "cpu"), dt=DT)
    simulation.step(steps)
    assert simulation.problems() == []
    return float(simulation.state.body_v.numpy()[0, 0, 0])


@pytest.mark.parametrize("attach", [slide, spring, spring_on_slide, combination])
def test_drag_that_falls_with_the_speed_brakes_as_it_says(attach):
    speed = 1.0
    for _ in range(100):
        speed -= DT * float(np.interp(speed, *STRIBECK))  # kg; explicit, as the falling part is
    assert speed_after(attach, 100, 1.0, damper_table=STRIBECK) == pytest.approx(speed, rel=1e-4)


def test_a_map_that_falls_does_too():
    rates = (-2.0, -0.05, 0.05, 2.0)
    forces = tuple((value, value) for value in (-1.0, -5.0, 5.0, 1.0))
    wanted = speed_after(slide, 100, 1.0, damper_table=STRIBECK)
    assert speed_after(slide, 100, 1.0, damper_map=((-1.0, 1.0), rates, forces)) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize("attach", [slide, spring, combination])
def test_a_spring_that_falls_pulls_as_it_says(attach):
    """Over the rising part, which is implicit, to the falling one: 0.1 % of the rising part's share after 0.2 m."""
    place, speed = 0.0, 3.0
    for _ in range(10000):
        speed -= 1e-5 * float(np.interp(place, *SNAP))
        place += 1e-5 * speed
    assert speed_after(attach, 100, 3.0, spring_table=SNAP) == pytest.approx(speed, abs=0.01)


@pytest.mark.parametrize(
    ("law", "least"),
    [({"stiffness": 50.0, "preload": 3.0}, 0.0), ({"stiffness": 50.0, "rest": 0.1, "preload": -2.0}, 0.1)],
)
def test_energy_holds_what_a_preload_stores(law, least):
    builder = sw.ModelBuilder(gravity=(0, 0, 0))
    body = builder.add_body("a", mass=1.0, inertia=(0.1,) * 3, velocity=(1, 0, 0))
    slide(builder, body, **law)
    simulation = sw.Simulation(builder.finalize(1, "cpu"), dt=1e-4)
    found = []
    for _ in range(5):
        found.append(float(simulation.measure_energy().numpy()[0]))
        simulation.step(500)
    # first order: h omega / 2 of the energy that goes to and fro, 0.04 %
    assert found == pytest.approx([found[0]] * 5, abs=2e-3)


def test_a_table_stands_for_the_stiffness_beside_it():
    builder = sw.ModelBuilder(gravity=(0, 0, 0))
    body = builder.add_body("a", mass=1.0, inertia=(0.1,) * 3, pose=sw.pose((0.5, 0, 0)))
    slide(builder, body, stiffness=50.0, spring_table=((-1.0, 1.0), (-1.0, 1.0)))
    model = builder.finalize(1, "cpu")
    assert model.joint_stiffness.numpy().tolist() == [[1.0]]  # the table as it is
    simulation = sw.Simulation(model, dt=1e-4)
    simulation.set_joint_state(None, [[0.5]], [[0.0]])
    assert float(simulation.measure_energy().numpy()[0]) == pytest.approx(0.5 * 1.0 * 0.5**2, rel=1e-6)
