"""Relaxation lengths: slips that follow over a way, at any speed and step, and wheels that stand as they do without."""

import math

import numpy as np
import pytest

from simwarp.vehicle.tires.parameter_vector_kernels import Common, Pac02
from tests.unit.vehicle.tires.tire_bench import (
    DT,
    PARKED_MASS,
    TEMPLATES,
    States,
    bench,
    check_held,
    damped,
    properties,
    row_of,
    run,
    steady,
)

LAGGING = [name for name in TEMPLATES if name != "lugre"]
LENGTHS = (0.2, 0.5)


def lagging(template, **changes):
    return row_of(template, relaxation_length=LENGTHS, **changes)


def reversed_motion(states):
    return States(states.x, states.q, -states.v, -states.omega)


@pytest.mark.parametrize("template", LAGGING)
def test_in_the_end_nothing_lags(template):
    """After 40 m, 80 lengths, the force is that of the law without."""
    states = steady(row_of(template), slip=[0.05, -0.2, 0.0, 0.3], angle=[0.0, 0.1, -0.05, 0.4])
    plain, late = run(row_of(template), states, 100), run(lagging(template), states, 2000)
    scale = np.abs(plain.force_w.numpy()).max()
    assert np.abs(plain.force_w.numpy() - late.force_w.numpy()).max() < 1e-5 * scale
    assert np.abs(plain.torque_w.numpy() - late.torque_w.numpy()).max() < 1e-5 * np.abs(plain.torque_w.numpy()).max()


@pytest.mark.parametrize("template", LAGGING)
@pytest.mark.parametrize("dt", [1e-3, 2e-2])
def test_slips_follow_over_their_lengths(template, dt):
    """Of a step of the slip 1 - exp(-way / length) has arrived, whatever the time step is."""
    states = steady(row_of(template), slip=0.02, angle=0.03, speed=20.0)
    tires = bench(lagging(template), 1)
    arrays = states.arrays()
    found = []
    for _ in range(round(0.04 / dt)):
        tires.apply(dt, arrays)
        found.append(tires.state.numpy()[0, 0, 2:4].copy())
    for _ in range(3000):
        tires.apply(dt, arrays)
    whole = tires.state.numpy()[0, 0, 2:4]
    # TMeasy and TMsimple take the wheel's speed, 2 % more; Pacejka 2002 has 0.1 m/s more than the road's
    speed = 20.0 * math.cos(0.03) * (1.02 if template.startswith("tm") else 1.0)
    speed += {"tmeasy": 0.01, "tmsimple": 0.01, "pacejka2002": 0.1}.get(template, 0.0)
    way = speed * dt * np.arange(1, len(found) + 1)
    expected = 1.0 - np.exp(-way[:, None] / np.array(LENGTHS))
    assert np.abs(np.array(found) / whole - expected).max() < 1e-5


@pytest.mark.parametrize("template", [name for name in LAGGING if name != "pacejka2002"])
def test_in_reverse_the_force_is_reversed(template):
    """Pacejka 2002 tells forwards from backwards without a lag, too."""
    row = lagging(template)
    states = steady(row, slip=[0.05, -0.1, 0.02], angle=[0.03, 0.0, -0.2], speed=4.0)
    ahead, back = run(row, states, 60), run(row, reversed_motion(states), 60)
    # 60 ms at 4 m/s are half a length: the force is still on its way
    assert np.abs(ahead.force_w.numpy()[..., :2] + back.force_w.numpy()[..., :2]).max() < 1e-5 * 8000.0
    late = run(row, states, 3000).force_w.numpy()[0, 0, 0]
    assert 0.2 < ahead.force_w.numpy()[0, 0, 0] / late < 0.95


@pytest.mark.parametrize("template", LAGGING)
def test_no_step_carries_a_slip_too_far(template):
    """Steps of 1 s: slips end where they should, and never beyond."""
    states = steady(row_of(template), slip=0.05, angle=0.05)
    plain = run(row_of(template), states, 300).force_w.numpy()[0, 0]
    tires = bench(lagging(template), 1)
    for _ in range(3):
        tires.apply(1.0, states.arrays())
        assert np.abs(tires.force_w.numpy()[0, 0] - plain).max() < 1e-4 * np.abs(plain).max()


def test_a_property_file_gives_lengths_of_the_load():
    """R Fz / Fz0 (PTX1 + PTX2 d) exp(-PTX3 d) LSGKP along, R PTY1 sin(2 atan(Fz / (PTY2 Fz0))) LFZO LSGAL across."""
    tir = properties(USE_MODE=14.0, PTX1=0.5, PTX2=0.2, PTX3=0.3, PTY1=1.4, PTY2=1.6, LSGKP=0.9, LSGAL=1.1)
    row = row_of("pacejka2002", tir=tir)
    load, nominal, radius = 8000.0, 35000.0 * 0.580904846, 0.4699
    d = load / nominal - 1.0
    x = radius * load / nominal * (0.5 + 0.2 * d) * math.exp(-0.3 * d) * 0.9
    y = radius * 1.4 * math.sin(2.0 * math.atan(load / (1.6 * nominal))) * 0.580904846 * 1.1
    states = steady(row, slip=-0.02, angle=0.03, load=load)
    tires = bench(row, 1)
    tires.apply(DT, states.arrays())
    first = tires.state.numpy()[0, 0, 2:4].copy()
    for _ in range(3000):
        tires.apply(DT, states.arrays())
    whole = tires.state.numpy()[0, 0, 2:4]
    way = (20.0 * math.cos(0.03) + 0.1) * DT
    # one step is a tenth of the slip: its float32 has 1e-6 of it
    assert -way / np.log1p(-first / whole) == pytest.approx([x, y], rel=1e-4)
    assert row.values[Pac02.TRANSIENT] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("template", LAGGING)
def test_brakes_hold_on_a_slope(template):
    check_held(lagging(template, **damped(template)), 1e-3)


@pytest.mark.parametrize("template", LAGGING)
@pytest.mark.parametrize("direction", [0.0, 1.0, math.pi / 2.0, math.pi])
def test_energy_does_not_grow_at_standstill(template, direction):
    """A mass on a locked wheel, pushed: its energy and that of the bristle fall to nothing."""
    row = lagging(template)
    s0 = row.values[Common.BRISTLE_STIFFNESS]
    states = steady(row, slip=-1.0, load=8000.0, speed=1.0)
    v = 0.05 * np.array([math.cos(direction), math.sin(direction), 0.0])
    x = states.x.copy()
    tires = bench(row, 1)
    energies = []
    for _ in range(3000):
        at = States(x, states.q, v[None], np.zeros((1, 3)))
        tires.apply(DT, at.arrays())
        v = v + DT * tires.force.numpy()[0, 0] * [1.0, 1.0, 0.0] / PARKED_MASS
        x = x + DT * v
        z = tires.state.numpy()[0, 0, :2]
        energies.append(0.5 * PARKED_MASS * v @ v + 0.5 * s0 * float(z @ z))
    energy = np.array(energies)
    # steps of h swap the two energies with an error of (omega h)² / 2, omega² = s0 / m
    growth = s0 / PARKED_MASS * DT**2
    assert np.all(np.diff(energy) <= growth * energy[0])
    assert energy[-1] < 1e-3 * energy[0]


@pytest.mark.parametrize("template", LAGGING)
@pytest.mark.parametrize("dt", [1e-3, 2e-3])
def test_a_free_wheel_gains_no_energy(template, dt):
    """A wheel with its load on it, rolling, spinning or locked at first, forwards and backwards, through the speeds at
    which the bristle takes over.
    """
    row = lagging(template)
    mass, inertia, radius = 300.0, row.values[Common.PATCH_MASS_X] * row.values[0] ** 2, row.values[0]
    starts = np.array([[6.0, 6.0], [6.0, 0.0], [0.0, 6.0], [-4.0, 0.0], [2.0, -2.0], [0.5, 2.0]])
    v, spin = starts[:, 0].copy(), starts[:, 1] / radius
    count = len(v)
    states = steady(row, slip=np.zeros(count), load=3000.0)
    tires = bench(row, count)
    start = 0.5 * mass * v**2 + 0.5 * inertia * spin**2
    for _ in range(round(3.0 / dt)):
        at = States(states.x, states.q, v[:, None] * [1.0, 0.0, 0.0], spin[:, None] * [0.0, 1.0, 0.0])
        tires.apply(dt, at.arrays())
        v = v + dt * tires.force.numpy()[:, 0, 0] / mass
        spin = spin + dt * tires.torque.numpy()[:, 0, 1] / inertia
        energy = 0.5 * mass * v**2 + 0.5 * inertia * spin**2
        # float32 forces of 3 kN over 1500 to 3000 steps; nothing else may add but the error of steps of h with a spring
        # k, (omega h)² of the energy F² / 2 k that it holds: F is 3.5 kN at most, the wheel's patch 30 kg
        assert np.all(energy < start * (1.0 + 1e-3) + 3500.0**2 * dt**2 / (2.0 * 30.0))
    # the first one rolls on: the property file has no rolling resistance
    assert np.all(energy[1:] < 0.999 * start[1:])


def test_worlds_lag_by_themselves():
    """Bitwise: a world's slips do not depend on the others."""
    row = lagging("tmeasy")
    states = steady(row, slip=np.linspace(-0.5, 0.5, 9), angle=np.linspace(0.4, -0.4, 9))
    many = run(row, states, 20)
    for w in (0, 4, 8):
        part = States(*(a[w : w + 1] for a in (states.x, states.q, states.v, states.omega)))
        one = run(row, part, 20)
        assert np.array_equal(one.force_w.numpy()[0], many.force_w.numpy()[w])
        assert np.array_equal(one.state.numpy()[0], many.state.numpy()[w])


@pytest.mark.parametrize("template", LAGGING)
def test_lengths_written_later_have_no_room_and_count_for_nothing(template):
    """Bitwise: the state of wheels that were built without them ends where that of the next wheel begins."""
    row = row_of(template)
    states = steady(row, slip=[0.05, -0.02, 0.1], angle=[0.03, 0.1, -0.05])
    plain, written = bench(row, 3, randomised=True), bench(row, 3, randomised=True)
    values = written.parameter.numpy()
    values[0, :, [Common.RELAXATION_X, Common.RELAXATION_Y]] = 0.5
    written.parameter.assign(values)
    for tires in (plain, written):
        for _ in range(3):
            tires.apply(DT, states.arrays())
    assert np.array_equal(written.force_w.numpy(), plain.force_w.numpy())
    assert np.array_equal(written.state.numpy(), plain.state.numpy())


def test_without_lengths_no_state_is_kept():
    assert row_of("tmeasy").state_size == 2
    assert lagging("tmeasy").state_size == 4
    assert lagging("pacejka2002").values[Pac02.TRANSIENT] == 0.0
