"""Motion functions at work: prescribed motions, drives, forces and inputs, with numbers per world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import vehicle
from simwarp.actuators import Actuators, ActuatorSpec
from simwarp.motions import (
    BodyWrench,
    Constant,
    CubicSpline,
    InputSignal,
    JointForce,
    JointMotion,
    Motions,
    MotionSequence,
    Polynomial345,
    Ramp,
    Repeat,
    Samples,
    Sine,
)

MASS, DT = 2.0, 0.001
SINE = Sine(amplitude=0.1, frequency=1.0)


def cart(drive: Any = None, *, loop: bool = False, worlds: int = 1) -> sw.Model:
    """A cart on a slide without weight; in a loop, a second slide carries the drive."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("cart", mass=MASS, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0), drive=None if loop else drive)
    if loop:
        builder.add_joint_prismatic("second", sw.WORLD, body, axis=(1.0, 0.0, 0.0), drive=drive)
    return builder.finalize(worlds, "cpu")


def simulated(model: sw.Model, motions: Sequence[Any], **options: Any) -> sw.Simulation:
    return sw.Simulation(model, DT, elements=[Motions(model, motions)], threads=1, **options)


def run(sim: sw.Simulation, steps: int, read: Any) -> np.ndarray:
    """What `read` gives after each step."""
    found = []
    for _ in range(steps):
        sim.step()
        found.append(np.array(read()))
    return np.array(found)


@pytest.mark.parametrize("loop", [False, True])
def test_the_reaction_of_a_prescribed_sine_is_m_a_omega_squared(loop):
    amplitude = np.array([0.1, 0.2])
    model = cart(sw.PrescribedPosition(), loop=loop, worlds=2)
    function = Sine(amplitude=amplitude, frequency=[1.0, 3.0])
    sim = simulated(model, [JointMotion(joint="second" if loop else "slide", function=function)], joint_reactions=True)
    omega = 2.0 * math.pi * np.array([1.0, 3.0])
    sim.set_joint_state(None, None, np.repeat((amplitude * omega)[:, None], model.dof_count, axis=1))
    force = run(sim, 1000, lambda: sim.diagnostics.joint_reaction_force.numpy().sum(axis=1))[:, :, 0]
    time = DT * np.arange(1000)[:, None]  # that at which each step began
    expected = MASS * amplitude * omega**2
    # (omega dt)² / 12 of the difference quotient is 3e-5 at 3 Hz; rates are float32: 6e-8 · 4 m/s / dt of 70 m/s²
    assert np.abs(np.abs(force).max(axis=0) / expected - 1.0).max() < 1e-3
    # the first step begins at the rate of a time, not of a step's middle
    assert np.abs(force / expected + np.sin(omega * time))[1:].max() < 1e-3
    q = sim.state.joint_q.numpy()[:, 0]
    assert np.allclose(q, amplitude * np.sin(omega * sim.time.numpy()), atol=2e-8)


def test_the_velocity_is_as_continuous_as_the_function():
    """Of a table it jumps at every point; of a sine it changes by a omega² dt in a step."""
    knots = np.linspace(0.0, 1.0, 11)
    table = sw.PrescribedPosition(table=(tuple(knots), tuple(0.1 * np.sin(2.0 * math.pi * knots))))
    of_table = sw.Simulation(cart(table), DT, threads=1)
    model = cart(sw.PrescribedPosition())
    of_function = simulated(model, [JointMotion(joint="slide", function=SINE)])
    smooth, broken = (
        np.diff(run(sim, 1000, lambda s=sim: s.state.joint_qd.numpy()[0, 0])) for sim in (of_function, of_table)
    )
    a_omega_squared = 0.1 * (2.0 * math.pi) ** 2
    assert np.abs(smooth).max() < 1.001 * a_omega_squared * DT
    assert np.abs(broken).max() > 50.0 * a_omega_squared * DT


def test_a_cam_moves_its_follower_at_late_times_too():
    """After an hour the time still counts in double precision."""
    rise = Polynomial345(rise=0.02, duration=0.1)
    back = Constant(value=0.02) + Polynomial345(rise=-0.02, duration=0.1)
    cam = Repeat(part=MotionSequence(parts=[(rise, 0.15), (back, 0.15)]), period=0.3)
    model = cart(sw.PrescribedPosition())
    sim = simulated(model, [JointMotion(joint="slide", function=cam)])
    sim.state.world_time.fill_(3600.0)
    found = run(
        sim, 600, lambda: (sim.time.numpy()[0], sim.state.joint_q.numpy()[0, 0], sim.state.joint_qd.numpy()[0, 0])
    )
    assert np.allclose(found[:, 1], cam.evaluate(found[:, 0]).value, atol=2e-8)  # float32 of 0.02
    # the quotient over a step is the rate of its middle; float32 of the target over dt
    assert np.allclose(found[:, 2], cam.evaluate(found[:, 0] - 0.5 * DT).rate, atol=1e-4)


def test_speeds_and_motors_follow_their_functions():
    function = MotionSequence(parts=[(Ramp(rate=2.0), 0.3), (Constant(value=0.6), 1.0)])
    for drive in (sw.PrescribedSpeed(), sw.VelocityMotor(effort_limit=100.0)):
        sim = simulated(cart(drive), [JointMotion(joint="slide", function=function)])
        found = run(sim, 500, lambda s=sim: (s.time.numpy()[0], s.state.joint_qd.numpy()[0, 0]))
        assert np.allclose(found[:, 1], function.evaluate(found[:, 0]).value, atol=1e-5)


def test_a_position_drive_gets_value_and_rate_of_the_steps_end():
    """Stiff enough, it follows; its lag in time is m / d behind a rate, which the target's rate takes away."""
    model = cart(sw.PositionDrive(stiffness=1e5, damping=1e3), worlds=2)
    function = Sine(amplitude=[0.1, 0.05], frequency=1.0)
    sim = simulated(model, [JointMotion(joint="slide", function=function)])
    assert np.allclose(sim.control.joint_target_q.numpy()[:, 0], function.evaluate([DT]).value[:, 0], rtol=1e-6)
    sim.advance(700)
    time = float(sim.time.numpy()[0])
    assert np.allclose(sim.control.joint_target_q.numpy()[:, 0], function.evaluate([time]).value[:, 0], atol=1e-7)
    assert np.allclose(sim.control.joint_target_qd.numpy()[:, 0], function.evaluate([time]).rate[:, 0], atol=1e-6)
    # the spring gives way by m a omega² / k = 8e-5 m
    assert np.allclose(sim.state.joint_q.numpy()[:, 0], function.evaluate([time]).value[:, 0], atol=1e-4)


def test_forces_along_coordinates_and_on_bodies_add_up():
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    ball = builder.add_body("ball", mass=MASS, inertia=(0.5, 0.5, 0.5))
    body = builder.add_body("cart", mass=MASS, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0))
    model = builder.finalize(2, "cpu")
    half = Constant(value=[1.0, 2.0])
    sim = simulated(
        model,
        [
            JointForce(joint="slide", function=half), JointForce(joint="slide", function=Ramp(rate=0.0, start=3.0)),
            BodyWrench(body="ball", function=half, force=(0.0, 4.0, 0.0), torque=(0.0, 0.0, 0.3)),
            BodyWrench(body="ball", function=half, force=(0.0, 0.0, 1.0), point=(0.5, 0.0, 0.0)),
        ],
    )  # fmt: skip
    sim.step()
    factor = np.array([1.0, 2.0])
    assert np.allclose(sim.state.joint_qd.numpy()[:, 0], DT * (factor + 3.0) / MASS, rtol=1e-5)
    assert np.allclose(sim.control.element_force.numpy()[:, ball], factor[:, None] * [0.0, 4.0, 1.0])
    # r x F of the second wrench: (0.5, 0, 0) x (0, 0, 1)
    assert np.allclose(sim.control.element_torque.numpy()[:, ball], factor[:, None] * [0.0, -0.5, 0.3])
    assert np.allclose(sim.state.body_v.numpy()[:, ball], DT * factor[:, None] * [0.0, 4.0, 1.0] / MASS, rtol=1e-5)


def test_a_turning_wrench_stays_with_its_body():
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    turned = sw.pose((0.0, 0.0, 0.0), (0.0, 0.0, math.sin(0.5), math.cos(0.5)))
    builder.add_body("ball", mass=MASS, inertia=(0.5, 0.5, 0.5), pose=turned)
    model = builder.finalize(1, "cpu")
    wrench = BodyWrench(
        body="ball", function=Constant(value=2.0), force=(3.0, 0.0, 0.0), torque=(0.0, 1.0, 0.0),
        point=(0.0, 0.0, 0.1), turning=True,
    )  # fmt: skip
    sim = simulated(model, [wrench])
    sim.step()
    axes = np.array([[math.cos(1.0), -math.sin(1.0), 0.0], [math.sin(1.0), math.cos(1.0), 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(sim.control.element_force.numpy()[0, 0], axes @ [6.0, 0.0, 0.0], atol=1e-6)
    assert np.allclose(sim.control.element_torque.numpy()[0, 0], axes @ [0.0, 2.0 + 0.6, 0.0], atol=1e-6)


def test_inputs_of_actuators_follow_functions():
    """The element that reads them comes behind; forces on one body of the two add up."""
    model = cart(worlds=2)
    actuators = Actuators(model, [ActuatorSpec(name="motor", terms=((0, 1.0),), ctrl_range=(-5.0, 5.0))])
    function = Sine(amplitude=[1.0, 2.0], frequency=5.0, phase=0.3)
    motions = Motions(model, [InputSignal(array=actuators.ctrl, column=0, function=function, name="throttle")])
    sim = sw.Simulation(model, DT, substeps=2, elements=[motions, actuators], threads=1)
    sim.advance(50)
    last = function.evaluate([50 * DT - DT / 2]).value[:, 0]
    assert np.allclose(actuators.ctrl.numpy()[:, 0], last, atol=1e-6)
    assert np.allclose(sim.control.element_joint_force.numpy()[:, 0], last, atol=1e-6)
    assert motions.number_names == ("throttle.amplitude", "throttle.frequency", "throttle.phase")


def test_a_wrench_adds_to_elements_before_it_and_refuses_those_behind():
    model = cart(worlds=1)
    push = [BodyWrench(body="cart", function=Constant(value=1.0), force=(1.0, 0.0, 0.0))]
    sim = sw.Simulation(model, DT, elements=[Motions(model, push), Motions(model, push)], threads=1)
    sim.advance(3)
    assert np.allclose(sim.control.element_force.numpy()[0, 0], [2.0, 0.0, 0.0])

    class Other(sw.ForceElement):
        @property
        def assigned_bodies(self):
            return (0,)

    with pytest.raises(sw.ModelError, match="must be written after those of Other"):
        sw.Simulation(model, DT, elements=[Motions(model, push), Other()], threads=1)


AMPLITUDES = (0.1, 0.2, 0.3)


def slid(worlds: Sequence[int], *, steps: int, at_once: bool = False, threads: int = 1) -> np.ndarray:
    """Coordinates and rates of some worlds that follow a mixture of functions."""
    sine = Sine(amplitude=[AMPLITUDES[world] for world in worlds], frequency=2.0)
    function = MotionSequence(parts=[(sine, 0.5), (sine, 9.0)])
    function_sum = function + CubicSpline(times=(0.0, 0.2, 0.5), values=(0.0, 0.1, 0.0))
    model = cart(sw.PrescribedPosition(), worlds=len(worlds))
    motions = Motions(model, [JointMotion(joint="slide", function=function_sum)])
    sim = sw.Simulation(model, DT, elements=[motions], threads=threads)
    for _ in range(1 if at_once else steps):
        sim.step(steps if at_once else 1)
    return np.concatenate([sim.state.joint_x.numpy(), sim.state.joint_qd.numpy()], axis=1)


def test_a_world_does_not_depend_on_others_nor_on_threads_or_graphs():
    together = slid([0, 1, 2], steps=300)
    assert np.array_equal(slid([0, 1, 2], steps=300, at_once=True), together)
    assert np.array_equal(slid([0, 1, 2], steps=300, threads=2), together)
    for world in range(3):
        assert np.array_equal(slid([world], steps=300)[0], together[world])


def test_a_reset_begins_again_and_a_snapshot_continues():
    model = cart(sw.PrescribedPosition(), worlds=2)
    sim = simulated(model, [JointMotion(joint="slide", function=SINE)])
    sim.advance(100)
    snapshot = sim.snapshot()
    first = run(sim, 50, lambda: sim.state.joint_x.numpy())
    sim.restore(snapshot)
    assert np.array_equal(run(sim, 50, lambda: sim.state.joint_x.numpy()), first)
    sim.reset([True, False])
    assert sim.control.joint_target_q.numpy()[0, 0] == 0.0
    sim.advance(100)
    q, time = sim.state.joint_q.numpy()[:, 0], sim.time.numpy()
    assert np.allclose(q, SINE.evaluate(time).value, atol=1e-7)
    assert time[0] != time[1]


def test_numbers_are_randomised_by_name():
    model = cart(sw.PrescribedPosition(), worlds=3)
    motions = Motions(model, [JointMotion(joint="slide", function=SINE + Ramp(rate=0.0))], per_world=True)
    assert motions.numbers.shape == (3, len(motions.number_names))
    sim = sw.Simulation(model, DT, elements=[motions], threads=1)
    motions.numbers[:, motions.number("slide.parts[0].amplitude")] = [0.1, 0.2, 0.0]
    sim.advance(200)
    q = sim.state.joint_q.numpy()[:, 0]
    assert np.allclose(q, np.array([0.1, 0.2, 0.0]) * math.sin(2.0 * math.pi * 0.2), atol=1e-7)
    with pytest.raises(sw.ModelError, match=r"no number 'slide.parts\[0\].amplitud'; did you mean"):
        motions.number("slide.parts[0].amplitud")
    shared = Motions(model, [JointMotion(joint="slide", function=SINE)])
    with pytest.raises(IndexError, match=r"per_world=True"):
        shared.numbers[1, 0] = 1.0


def test_no_functions_do_nothing():
    model = cart()
    sim = sw.Simulation(model, DT, elements=[Motions(model, [])], threads=1)
    sim.step()
    assert sim.time.numpy()[0] > 0.0


PRESCRIBED = sw.PrescribedPosition()
WRONG: dict[str, tuple[Any, Any]] = {
    "model has no joint 'slid'; did you mean 'slide'?": (PRESCRIBED, JointMotion(joint="slid", function=SINE)),
    "joint 'slide' has 1 coordinates, got index 1": (
        PRESCRIBED, JointMotion(joint="slide", function=SINE, coordinate=1)),
    "no body 'car'; did you mean 'cart'?": (None, BodyWrench(body="car", function=SINE, force=(1, 0, 0))),
    "needs a function with a second derivative, hence a continuous rate, got Samples whose rate jumps": (
        PRESCRIBED, JointMotion(joint="slide", function=Samples(values=[0.0, 0.1, 0.0], interval=0.1))),
    "got MotionSequence whose value jumps": (
        PRESCRIBED, JointMotion(joint="slide", function=MotionSequence(parts=[(SINE, 0.3), (SINE, 1.0)]))),
    "a prescribed speed needs a function with a continuous value": (
        sw.PrescribedSpeed(), JointMotion(joint="slide", function=Repeat(part=Ramp(rate=1.0), period=1.0))),
    "its coordinate must have a drive": (None, JointMotion(joint="slide", function=SINE)),
    "its drive follows a table; leave the table out": (
        sw.PrescribedPosition(table=((0.0, 1.0), (0.0, 1.0))), JointMotion(joint="slide", function=SINE)),
    "its motion is prescribed, which no force changes": (PRESCRIBED, JointForce(joint="slide", function=SINE)),
    "slide.amplitude: must have one number, or 2, one for each world, got 3": (
        PRESCRIBED, JointMotion(joint="slide", function=Sine(amplitude=[1.0, 2.0, 3.0], frequency=1.0))),
    "array must be float32(2, n), got float32(3, 2)": (
        None, InputSignal(array=wp.zeros((3, 2), dtype=float, device="cpu"), column=0, function=SINE)),
    "column must be an integer >= 0": (
        None, InputSignal(array=wp.zeros((2, 2), dtype=float, device="cpu"), column=2, function=SINE)),
    "motions must be a list of motions, got ": (None, SINE),
}  # fmt: skip


@pytest.mark.parametrize("message", WRONG)
def test_a_mistake_is_one_line_that_names_it(message):
    drive, motion = WRONG[message]
    with pytest.raises(sw.ModelError) as caught:
        Motions(cart(drive, worlds=2), [motion])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_coordinate_has_one_function_and_a_wrench_acts():
    twice = [JointMotion(joint="slide", function=SINE)] * 2
    with pytest.raises(sw.ModelError, match="JointMotion of joint 'slide': has two functions; add them"):
        Motions(cart(sw.PrescribedPosition()), twice)
    with pytest.raises(sw.ModelError, match="force and torque must not both be zero"):
        BodyWrench(body="cart", function=SINE)
    other = cart(sw.PrescribedPosition())
    with pytest.raises(sw.ModelError, match="they are of another model than the Simulation"):
        sw.Simulation(cart(), DT, elements=[Motions(other, twice[:1])], threads=1)


def test_a_driver_steers_each_world_by_numbers_of_its_own():
    builder = sw.ModelBuilder()
    parts = vehicle.add_vehicle(builder, vehicle.load("artcar"))
    builder.add_shape_plane()
    model = builder.finalize(2, "cpu", per_world=vehicle.per_world())
    car = vehicle.Vehicle(parts, model)
    steering, throttle = Sine(amplitude=[0.2, -0.4], frequency=0.5), Polynomial345(rise=[0.3, 0.6], duration=0.2)
    signals = [
        InputSignal(array=car.input, column=column, function=function, name=name)
        for column, (name, function) in enumerate({"steering": steering, "throttle": throttle}.items())
    ]
    motions = Motions(model, signals)
    sim = sw.Simulation(model, DT, elements=[motions, car], threads=1)
    sim.advance(101)
    time = [float(sim.time.numpy()[0]) - DT]
    for column, motion in enumerate(motions.motions):
        assert np.allclose(car.input.numpy()[:, column], motion.function.evaluate(time).value[:, 0], atol=1e-6)
    assert car.input.numpy()[1, 1] == pytest.approx(0.3, rel=1e-3)  # half of its throttle after half its time
