"""Actuators of all kinds, several on a coordinate, against the float64 reference, in worlds that differ."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.actuators import PER_WORLD, Activation, Actuators, ActuatorSpec
from tests.reference.actuators import ReferenceActuator
from tests.unit.actuators.cart_and_wheel import HINGE, SLIDE, bodies, start

DT = 1.0e-3
WORLDS = 3
SPECS = [
    ActuatorSpec(name="push", terms=((SLIDE, 2.0),), gain=(1.0, 0.2, -0.1), bias=(0.3, -1.0, -0.2), length_offset=0.4),
    ActuatorSpec(name="both", terms=((SLIDE, -0.5), (HINGE, 1.5)), ctrl_range=(-0.5, 0.8), force_range=(-0.6, 0.7)),
    ActuatorSpec(name="late", terms=((HINGE, 1.0),), delay=4.0e-3),
    ActuatorSpec(name="later", terms=((SLIDE, 1.0),), delay=7.0e-3, activation=Activation.FILTER, time_constant=0.02),
    ActuatorSpec(name="motor", terms=((HINGE, 2.0),), gain=(5.0, 0.0, 0.0), torque_speed=(3.0, 4.0), corner_speed=1.0),
    ActuatorSpec(name="sum", terms=((SLIDE, 1.0),), activation=Activation.INTEGRATOR, activation_range=(-0.004, 0.002)),
    ActuatorSpec(
        name="quick", terms=((HINGE, -1.0),), activation=Activation.FILTER_EXACT, time_constant=2.0e-3, early=True
    ),
]


def controls(step: int, world: int) -> np.ndarray:
    """(A,) controls that no two worlds share."""
    phase = np.arange(len(SPECS)) + 0.7 * world
    return (1.1 * np.sin(0.21 * step + phase)).astype(np.float32)


def randomised(world: int) -> list[ActuatorSpec]:
    """The actuators of a world whose numbers are its own."""
    factor = 1.0 + 0.25 * world
    changed = []
    for spec in SPECS:
        new: dict[str, Any] = {
            "gain": tuple(factor * value for value in spec.gain),
            "bias": tuple(factor * value for value in spec.bias),
            "time_constant": factor * spec.time_constant,
            "delay": spec.delay - 1.0e-3 * world if spec.delay else 0.0,
        }
        if spec.force_range is not None:
            new["force_range"] = tuple(factor * value for value in spec.force_range)
        if spec.torque_speed is not None:
            new["torque_speed"] = tuple(factor * value for value in spec.torque_speed)
            new["corner_speed"] = factor * spec.corner_speed
        changed.append(dataclasses.replace(spec, **new))
    return changed


def write(actuators: Actuators, world: int, specs: list[ActuatorSpec]) -> None:
    """The numbers of a world's actuators into its rows."""
    actuators.gain[world] = [spec.gain for spec in specs]
    actuators.bias[world] = [spec.bias for spec in specs]
    actuators.delay[world] = [spec.delay for spec in specs]
    for column, spec in enumerate(specs):
        if spec.force_range is not None:
            actuators.force_range[world, column] = spec.force_range
        if spec.time_constant:
            actuators.time_constant[world, column] = spec.time_constant
        if spec.torque_speed is not None:
            actuators.stall_force[world, column], actuators.free_speed[world, column] = spec.torque_speed
            actuators.corner_speed[world, column] = spec.corner_speed


def test_every_world_has_the_actuators_that_were_written_for_it() -> None:
    model = bodies().finalize(WORLDS, "cpu")
    actuators = Actuators(model, SPECS, per_world=PER_WORLD, dt=DT)
    sim = sw.Simulation(model, DT, elements=[actuators], threads=1)
    start(sim, (0.2, -0.4), (1.5, -2.0))
    specs = [randomised(world) for world in range(WORLDS)]
    for world in range(WORLDS):
        write(actuators, world, specs[world])
    references = [[ReferenceActuator(spec, DT) for spec in each] for each in specs]
    for step in range(120):
        q, qd = sim.state.joint_x.numpy().copy(), sim.state.joint_qd.numpy().astype(float)
        actuators.ctrl.assign(np.array([controls(step, world) for world in range(WORLDS)]))
        sim.step()
        for world, each in enumerate(references):
            efforts = np.zeros(2)
            for actuator, ctrl in zip(each, controls(step, world), strict=True):
                for column, effort in actuator.step(float(ctrl), q[world], qd[world]).items():
                    efforts[column] += effort
            # float32 sums of seven terms of some 10 N
            found = sim.control.element_joint_force.numpy()[world]
            assert found == pytest.approx(efforts, abs=2e-5), (step, world)
            wanted = [actuator.force for actuator in each]
            assert actuators.force.numpy()[world] == pytest.approx(wanted, abs=1e-5), (step, world)
            states = [actuator.activation for actuator in each]
            # time constants in float32
            assert actuators.activation.numpy()[world] == pytest.approx(states, abs=1e-7), (step, world)


def test_a_motor_coasts_at_its_free_speed() -> None:
    """Torque falls with the speed: w = w0 (1 - exp(-t stall / (J w0))), in closed form."""
    model = bodies().finalize(1, "cpu")
    spec = ActuatorSpec(name="m", terms=((HINGE, 1.0),), gain=(100.0, 0.0, 0.0), torque_speed=(6.0, 40.0))
    actuators = Actuators(model, [spec])
    sim = sw.Simulation(model, DT, elements=[actuators], threads=1)
    actuators.ctrl[:] = 1.0
    rate = 6.0 / (0.3 * 40.0)  # of the exponential [1/s]
    for step in range(1, 3001):
        sim.step()
        if step % 500 == 0:
            wanted = 40.0 * -np.expm1(-rate * step * DT)
            # explicit Euler lags by half a step of the decay: rate dt / 2 of what is left
            assert sim.state.joint_qd.numpy()[0, HINGE] == pytest.approx(wanted, rel=1e-3)


def test_a_motor_brakes_with_all_its_force() -> None:
    model = bodies().finalize(1, "cpu")
    spec = ActuatorSpec(name="m", terms=((HINGE, 1.0),), torque_speed=(6.0, 40.0))
    actuators = Actuators(model, [spec])
    sim = sw.Simulation(model, DT, elements=[actuators], threads=1)
    forces = []
    for ctrl in (9.0, -9.0):
        start(sim, (0.0, 0.0), (0.0, 30.0))
        actuators.ctrl[:] = ctrl
        sim.step()
        forces.append(float(actuators.force.numpy()[0, 0]))
    assert forces == pytest.approx([6.0 * 0.25, -9.0], rel=1e-6)
