"""Motors by their data sheets against the float64 laws that they tell: PD, its delay, and the curve of a DC motor."""

from __future__ import annotations

import itertools
import math
from typing import Any, cast

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.actuators import Actuators, Law, dc_motor, pd_actuator, servo_actuator, torque_actuator
from tests.unit.actuators.cart_and_wheel import HINGE, INERTIA, SLIDE, bodies, run, start

DT = 1.0e-3
STALL, FREE, CORNER, LIMIT = 12.0, 8.0, 2.0, 10.0


def dc_law(torque: float, speed: float, corner: float = 0.0) -> float:
    """The curve in four quadrants: what drives is below the line, what brakes below the limit alone."""
    share = 1.0 if abs(speed) <= corner else max(0.0, (FREE - abs(speed)) / (FREE - corner))
    most = min(LIMIT, STALL * share)
    upper, lower = (most, -LIMIT) if speed > 0.0 else (LIMIT, -most) if speed < 0.0 else (most, -most)
    return float(np.clip(torque, lower, upper))


def force_of(specs, u, q, qd):
    """Force of the first actuator in a sub-step from a state; both coordinates have it."""
    sim, actuators = run(specs, DT)
    start(sim, (q, q), (qd, qd))
    actuators.ctrl[0] = [u] * len(specs)
    sim.step()
    return float(actuators.force.numpy()[0, 0]), sim, actuators


@pytest.mark.parametrize(("u", "q", "qd"), [(0.3, -0.2, 1.0), (2.0, 0.0, 0.0), (-1.0, 0.4, -3.0), (0.1, 0.1, 0.5)])
def test_a_pd_actuator_is_its_law(u, q, qd):
    spec = pd_actuator("pd", HINGE, stiffness=20.0, damping=0.7, effort_limit=6.0)
    force, sim, _ = force_of([spec], u, q, qd)
    expected = float(np.clip(20.0 * (u - q) - 0.7 * qd, -6.0, 6.0))
    assert force == pytest.approx(expected, rel=1e-6, abs=1e-6)
    # and the hinge feels it: nothing else acts
    assert sim.state.joint_qd.numpy()[0, HINGE] == pytest.approx(qd + DT * expected / INERTIA, rel=1e-5, abs=1e-6)


def test_without_a_limit_nothing_is_cut():
    force, _, _ = force_of([pd_actuator("pd", HINGE, stiffness=2000.0, damping=0.0)], 1.0, -1.0, 0.0)
    assert force == pytest.approx(4000.0)


@pytest.mark.parametrize("corner", [0.0, CORNER])
def test_a_dc_motor_in_four_quadrants(corner):
    """A world for each pair of torque and speed."""
    torques, speeds = (-20.0, -9.5, -3.0, 3.0, 9.5, 20.0), (-9.0, -7.0, -4.0, -1.0, 1.0, 4.0, 7.0, 9.0)
    pairs = list(itertools.product(torques, speeds))
    motor = dc_motor(
        "motor", HINGE, stall_torque=STALL, free_speed=FREE, corner_speed=corner, effort_limit=LIMIT
    )  # fmt: skip
    sim, actuators = run([motor], DT, len(pairs))
    sim.set_joint_state(None, np.zeros((len(pairs), 2)), np.array([(speed, speed) for _, speed in pairs]))
    actuators.ctrl[:, 0] = torch.tensor([torque for torque, _ in pairs])
    sim.step()
    found = dict(zip(pairs, actuators.force.numpy()[:, 0].tolist(), strict=True))
    expected = {pair: dc_law(*pair, corner) for pair in pairs}
    assert found == pytest.approx(expected, rel=2e-6, abs=1e-6)


def test_a_dc_motor_behind_a_controller():
    gains: dict[str, Any] = {
        "stiffness": 30.0,
        "damping": 0.5,
        "stall_torque": STALL,
        "free_speed": FREE,
        "effort_limit": LIMIT,
    }
    for u, q, qd in ((0.8, 0.0, 5.0), (-0.8, 0.0, 5.0), (0.1, 0.0, -2.0)):
        force, _, _ = force_of([dc_motor("motor", HINGE, **gains)], u, q, qd)
        assert force == pytest.approx(dc_law(30.0 * (u - q) - 0.5 * qd, qd), rel=2e-6)


@pytest.mark.parametrize("delay", [0.0, 1.0e-3, 3.4e-3, 3.6e-3, 8.0e-3])
def test_a_delay_is_whole_steps(delay):
    steps = 12
    sim, actuators = run([torque_actuator("late", SLIDE, delay=delay, effort_limit=40.0)], DT)
    given = np.random.default_rng(3).uniform(-30.0, 30.0, steps).astype(np.float32)
    found = []
    for value in given:
        actuators.ctrl[0, 0] = float(value)
        sim.step()
        found.append(float(actuators.force.numpy()[0, 0]))
    ago = round(delay / DT)
    np.testing.assert_array_equal(found, [*([0.0] * ago), *given[: steps - ago]])


def test_a_servo_is_the_target_of_its_drive():
    drive = sw.PositionDrive(stiffness=50.0, damping=2.0, effort_limit=30.0)
    spec = servo_actuator("servo", HINGE, delay=2.0e-3, target_range=(-0.5, 0.5))
    assert spec.law is Law.SERVO
    sim, actuators = run([spec], DT, drive=drive)
    seen = []
    for _ in range(4):
        actuators.ctrl[0, 0] = 0.9
        sim.step()
        seen.append(float(sim.control.joint_target_q.numpy()[0, HINGE]))
    assert seen == [0.0, 0.0, 0.5, 0.5]


def test_worlds_with_motors_of_their_own_do_not_meet():
    specs = [
        pd_actuator("pd", SLIDE, stiffness=20.0, damping=0.5, effort_limit=8.0, delay=4.0e-3),
        dc_motor("motor", HINGE, stall_torque=STALL, free_speed=FREE, stiffness=15.0, effort_limit=LIMIT),
    ]
    histories = []
    for weaker in (False, True):
        model = bodies().finalize(4, "cpu")
        actuators = Actuators(model, specs, per_world=["gain", "bias", "stall_force", "delay"], dt=DT)
        sim = sw.Simulation(model, DT, elements=[actuators])
        if weaker:
            actuators.gain[3, 0] = (10.0, 0.0, 0.0)
            actuators.bias[3, 0] = (0.0, -10.0, -0.5)
            actuators.stall_force[3, 1] = 1.0
            actuators.delay[3, 0] = 1.0e-3
        rows = []
        for step in range(40):
            actuators.ctrl[...] = math.sin(0.3 * step)
            sim.step()
            rows.append(sim.state.joint_q.numpy().copy())
        histories.append(np.stack(rows))
    same, other = histories
    assert np.array_equal(same[:, :3], other[:, :3])
    assert np.array_equal(same[:, 0], same[:, 3])
    assert np.all(np.abs(same[-1, 3] - other[-1, 3]) > 0.05 * np.abs(same[-1, 3]))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: pd_actuator("m", 0, stiffness=-1.0, damping=0.0), "actuator 'm': stiffness"),
        (lambda: pd_actuator("m", 0, stiffness=1.0, damping=math.nan), "actuator 'm': damping"),
        (
            lambda: pd_actuator("m", 0, stiffness=1.0, damping=0.0, effort_limit=0.0),
            "effort_limit must be positive, got 0",
        ),
        (
            lambda: pd_actuator("m", 0, stiffness=1.0, damping=0.0, effort_limit=cast(Any, "big")),
            "effort_limit must be a number, got .big.; give N·m or N",
        ),
        (lambda: pd_actuator("", 0, stiffness=1.0, damping=0.0), "name must be a non-empty string"),
        (lambda: dc_motor("m", 0, stall_torque=0.0, free_speed=1.0), "stall_torque must be"),
        (lambda: dc_motor("m", 0, stall_torque=1.0, free_speed=-1.0), "free_speed must be"),
        (lambda: torque_actuator("m", 0, delay=-1.0), "delay"),
        (lambda: servo_actuator("m", 0, delay=math.inf), "delay"),
    ],
)
def test_numbers_that_no_motor_has(make, words):
    with pytest.raises(sw.ModelError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_corner_beyond_the_free_speed_is_refused_with_the_model():
    model = bodies().finalize(1, "cpu")
    motor = dc_motor("motor", HINGE, stall_torque=1.0, free_speed=2.0, corner_speed=2.0)
    with pytest.raises(sw.ModelError, match="corner_speed must be below the free speed"):
        Actuators(model, [motor])


@pytest.mark.parametrize("limit", [(-1.0, 8.0), (-1.0, math.inf), (-math.inf, 2.0), 3.0])
@pytest.mark.parametrize("target", [-1.0, 1.0])
def test_a_servo_reports_what_its_drive_exerts(limit, target):
    builder = sw.ModelBuilder(gravity=(0, 0, 0))
    body = builder.add_body("a", mass=1.0, inertia=(0.1,) * 3)
    drive = sw.PositionDrive(stiffness=100.0, effort_limit=limit)
    builder.add_joint_prismatic("j", sw.WORLD, body, axis=(1, 0, 0), drive=drive)
    model = builder.finalize(1, "cpu")
    actuators = Actuators(model, [servo_actuator("s", 0)])
    simulation = sw.Simulation(model, dt=1e-4, elements=[actuators])
    actuators.ctrl[0, 0] = target
    simulation.step()
    applied = float(simulation.state.body_v.numpy()[0, 0, 0]) / 1e-4
    # the drive is implicit: h² k / m = 1e-6 of it
    assert float(actuators.force.numpy()[0, 0]) == pytest.approx(applied, rel=1e-4)


def test_half_a_substep_of_delay_is_a_whole_one_whatever_other_actuators_have():
    late = []
    for other in (0.0, 0.02):
        builder = sw.ModelBuilder(gravity=(0, 0, 0))
        for name in "ab":
            body = builder.add_body(name, mass=1.0, inertia=(0.1,) * 3)
            builder.add_joint_prismatic(f"{name}_slide", sw.WORLD, body, axis=(1, 0, 0))
        model = builder.finalize(1, "cpu")
        specs = [torque_actuator("s", 0, delay=2.5 / 1024), torque_actuator("t", 1, delay=other)]
        actuators = Actuators(model, specs, dt=1 / 1024)
        simulation = sw.Simulation(model, dt=1 / 1024, elements=[actuators])
        actuators.ctrl[0, 0] = 1.0
        steps = 0
        while float(actuators.force.numpy()[0, 0]) == 0.0:
            simulation.step()
            steps += 1
        late.append(steps - 1)
    assert late == [3, 3]
