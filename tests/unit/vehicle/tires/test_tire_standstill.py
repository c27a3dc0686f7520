"""Wheels that stand: held on slopes, without creep or chatter."""

import math

import numpy as np
import pytest

from simwarp.vehicle.tires.parameter_vector_kernels import Common
from simwarp.vehicle.tires.tires import tire_vector
from tests.reference.tires import Wheel, plane, tire
from tests.unit.vehicle.tires.tire_bench import (
    DT,
    PARKED_MASS,
    TEMPLATES,
    States,
    bench,
    check_held,
    damped,
    parked,
    row_of,
    spec,
    values,
)


@pytest.mark.long("0.001-fiala", "0.001-lugre", "0.001-pacejka2002", "0.001-tmeasy", "0.001-tmsimple")
@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.parametrize("dt", [1e-3, 4e-3])
def test_a_parked_wheel_does_not_creep(template, dt):
    check_held(row_of(template, **damped(template)), dt)


@pytest.mark.slow
def test_the_reference_parks_at_the_same_place():
    row = row_of("tmeasy", **damped("tmeasy"))
    angle = math.atan(0.2)
    kernel = parked(row, 2, angle, DT, 4.0)[:, 0]
    normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    axis = np.array([0.0, 1.0, 0.0])
    x, v, z = (row.values[Common.RADIUS] - 0.02) * normal, np.zeros(3), np.zeros(2)
    path = []
    for _ in range(4000):
        force = tire(
            row.model, Wheel(x, axis, v, np.zeros(3)), row.contact, values(row), plane(normal), 0.8, z, DT
        ).force
        v = v + DT * (force / PARKED_MASS + [0.0, 0.0, -9.81])
        x = x + DT * v
        path.append(x)
    # 1e-4 of 20 mm, by which the wheel sinks and slides
    assert np.abs(np.array(path) - kernel).max() < 2e-6
    # 22 mm of swing fade at s1 / 2 m = 2.7 /s: 7e-6 m are left after 3 s
    assert np.abs(path[-1] - path[3000]).max() < 1e-5


def test_too_steep_a_slope_slides():
    """The same bench tells holding from sliding: friction 0.8 against tan = 1."""
    path = parked(row_of("tmeasy"), 3, math.atan(1.0), 1e-3, 1.0)
    assert np.linalg.norm(path[-1] - path[0], axis=-1).min() > 0.3


def test_light_wheels_stay_stable():
    """A model car's wheel of 0.2 kg on the bristle of a truck: its force must not flip from step to step."""
    tire_spec = spec("tmeasy", load=148.2, rim_radius=0.0515)
    small = tire_vector(
        type(tire_spec)(
            template="tmeasy", mass=0.2, inertia=(8e-4, 1e-3, 8e-4), radius=0.085, width=0.0855,
            parameters=tire_spec.parameters,
        )
    )  # fmt: skip
    tires = bench(small, 1, friction=0.8)
    spin, inertia = 1.0, 1.1e-3
    states = States(
        np.array([[0.0, 0.0, 0.083]]), np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 3)), np.zeros((1, 3))
    )  # fmt: skip
    spins = []
    for _ in range(2000):
        states.omega = np.array([[0.0, spin, 0.0]])
        tires.apply(DT, states.arrays())
        spin += DT * float(tires.torque.numpy()[0, 0, 1]) / inertia
        spins.append(spin)
    assert np.abs(spins[-200:]).max() < 1e-3
