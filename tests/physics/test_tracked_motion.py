"""Laws of tracked vehicles: where they come to rest, straight ways, slopes, sprockets and tracks, energy, a minute."""

import dataclasses

import numpy as np
import pytest

import simwarp as sw
from simwarp.analysis import solve_static
from simwarp.vehicle import TRACK_SOLVER, SprocketContact, load_tracked_vehicle
from simwarp.verify.tracked_runs import RECORDED, Trial, trial

M113 = load_tracked_vehicle("m113")
ALIKE = dataclasses.replace(M113, right=M113.left)
PITCH_RADIUS = 10 * 0.154 / (2.0 * np.pi)
"""Ten teeth, one shoe each [m]."""


def driven(made: Trial, seconds: float, **pedals) -> Trial:
    made.run(1.0)
    made.pedals(**pedals)
    made.run(seconds)
    return made


@pytest.mark.slow
def test_the_static_solver_settles_chains_as_laid(monkeypatch):
    """Where waiting leads: height and pitch within 5 mm and 5 mrad of the recorded state at rest, tensions between the
    two recorded ones and 6 kN; in a fraction of its ten thousand steps."""
    monkeypatch.setattr("simwarp.verify.tracked_runs.TRACK_SOLVER", dataclasses.replace(TRACK_SOLVER, tolerance=5e-4))
    made = trial(M113, compliant=True)
    found = solve_static(made.simulation, max_steps=6000)
    assert found.by_contacts
    assert found.steps < 4000
    rest = RECORDED["rest"]
    assert made.vehicle.position.numpy()[0, 2] == pytest.approx(np.mean(rest["height [m]"]), abs=0.005)
    assert made.vehicle.angles.numpy()[0, 1] == pytest.approx(np.mean(rest["pitch [rad]"]), abs=0.005)
    for tension, side in zip(made.vehicle.tension.numpy()[0] / 1e3, ("left", "right"), strict=True):
        low, high = rest[f"pin force {side} [kN]"]
        assert low - 6.0 < tension < high + 6.0


@pytest.mark.slow
def test_a_vehicle_with_two_tracks_alike_stays_straight():
    """Corners of shoes alternate, so that the sides are not mirror images: a degree after some metres."""
    made = driven(trial(ALIKE, iterations=60), 3.0, throttle=1.0)
    x, y, _ = made.column("position")[-1] - made.column("position")[100]
    assert x > 2.0
    assert abs(y) < 0.02 * x
    assert np.abs(made.column("yaw_rate")[-100:]).mean() < 0.01


@pytest.mark.slow
def test_on_smooth_sprockets_it_drives_as_recorded():
    """Full throttle on the braked differential: 4 m/s after 2.9 s, 6.0 m/s after 10 s, of a model whose speeds its own
    step changes by 15 %. Smooth sprockets do not slide under dry friction, as recorded teeth hardly do under theirs."""
    made = driven(trial(M113, iterations=100, sprocket=SprocketContact.DRUM), 10.0, throttle=1.0)
    speed = made.speed[100:]
    assert 0.01 * np.flatnonzero(speed >= 4.0)[0] == pytest.approx(2.9, rel=0.15)
    assert speed.max() == pytest.approx(6.0, rel=0.15)


@pytest.mark.slow
def test_tracks_move_as_their_sprockets_turn():
    """One tooth a shoe: means of a second over many teeth agree with the speed of the hull; its shoes do not slide."""
    made = driven(trial(M113, iterations=60), 3.0, throttle=1.0)
    speed, sprockets = made.speed[-100:].mean(), made.column("sprocket")[-100:].mean(axis=0)
    np.testing.assert_allclose(PITCH_RADIUS * sprockets, speed, rtol=0.03)


@pytest.mark.slow
def test_brakes_hold_on_a_slope():
    """Sticking friction: on a slope of 0.3, brakes on, the shoes under the vehicle lie still, but for what a hundred
    iterations leave: less than 5 cm in a minute, by the seventh second."""
    spec = M113
    builder = sw.ModelBuilder(gravity=(-9.81 * 0.28735, 0.0, -9.81 * 0.95783))  # of a slope of 0.3
    parts = sw.vehicle.add_tracked_vehicle(builder, spec)
    builder.add_shape_plane(material=sw.Material(friction=0.9))
    model = builder.finalize(1, "cpu", per_world=sw.vehicle.per_world(), contact_capacity=400)
    vehicle = sw.vehicle.TrackedVehicle(parts, model)
    sim = sw.Simulation(model, 1e-3, elements=[vehicle], solver=TRACK_SOLVER, check_start=False)
    vehicle.input.assign(np.array([[0.0, 0.0, 1.0, 0.0]], np.float32))
    sim.step(6000)
    shoes = [body for side in parts.chains for body in side.shoes]
    low = [body for body in shoes if sim.state.body_x.numpy()[0, body, 2] < 0.05]
    assert len(low) > 10
    before = sim.state.body_x.numpy()[0, low].copy()
    sim.step(1000)
    crept = np.abs(sim.state.body_x.numpy()[0, low] - before)[:, 0].mean()
    assert 60.0 * crept < 0.05
    assert sim.diagnostics.position_error.numpy().max() < 1e-6
