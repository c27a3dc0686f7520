"""Each law of an actuator, step by step, against MuJoCo's on the same state."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

import simwarp as sw
from simwarp.actuators import Activation, ActuatorSpec, Law, Target
from tests.unit.actuators.cart_and_wheel import HINGE, SLIDE, mjcf, run, start

DT = 2.0e-3
TENDON = (
    """<tendon><fixed name="t"><joint joint="slide" coef="0.7"/><joint joint="hinge" coef="-1.3"/></fixed></tendon>"""
)
GENERAL = 'gaintype="affine" gainprm="3 0.5 -0.2" biastype="affine" biasprm="0.4 -2 -0.3"'
LAW = {"gain": (3.0, 0.5, -0.2), "bias": (0.4, -2.0, -0.3)}
CASES: dict[str, Any] = {
    "motor": (
        '<motor joint="slide" gear="3"/>',
        {"terms": ((SLIDE, 3.0),)},
    ),
    "motor in its range": (
        '<motor joint="hinge" gear="-2" ctrlrange="-0.4 0.7" ctrllimited="true"/>',
        {"terms": ((HINGE, -2.0),), "ctrl_range": (-0.4, 0.7)},
    ),
    "affine": (
        f'<general joint="slide" gear="1.5" {GENERAL}/>',
        {"terms": ((SLIDE, 1.5),), **LAW},
    ),
    "within force range": (
        f'<general joint="slide" forcelimited="true" forcerange="-1 0.6" {GENERAL}/>',
        {"terms": ((SLIDE, 1.0),), "force_range": (-1.0, 0.6), **LAW},
    ),
    "two coordinates": (
        f'<general tendon="t" gear="2" {GENERAL}/>',
        {"terms": ((SLIDE, 1.4), (HINGE, -2.6)), **LAW},
    ),
    "filter": (
        f'<general joint="hinge" dyntype="filter" dynprm="0.02" {GENERAL}/>',
        {"terms": ((HINGE, 1.0),), "activation": Activation.FILTER, "time_constant": 0.02, **LAW},
    ),
    "exact filter": (
        f'<general joint="hinge" dyntype="filterexact" dynprm="0.003" {GENERAL}/>',
        {"terms": ((HINGE, 1.0),), "activation": Activation.FILTER_EXACT, "time_constant": 0.003, **LAW},
    ),
    "early filter": (
        f'<general joint="hinge" dyntype="filterexact" dynprm="0.003" actearly="true" {GENERAL}/>',
        {
            "terms": ((HINGE, 1.0),), "activation": Activation.FILTER_EXACT, "time_constant": 0.003, "early": True,
            **LAW,
        },
    ),
    "integrator": (
        f'<general joint="slide" dyntype="integrator" actlimited="true" actrange="-0.01 0.03" {GENERAL}/>',
        {
            "terms": ((SLIDE, 1.0),), "activation": Activation.INTEGRATOR, "activation_range": (-0.01, 0.03), **LAW,
        },
    ),
    "position": (
        '<position joint="slide" kp="40" kv="3"/>',
        {"terms": ((SLIDE, 1.0),), "gain": (40.0, 0.0, 0.0), "bias": (0.0, -40.0, -3.0)},
    ),
    "velocity": (
        '<velocity joint="hinge" kv="3"/>',
        {"terms": ((HINGE, 1.0),), "gain": (3.0, 0.0, 0.0), "bias": (0.0, 0.0, -3.0)},
    ),
    "integrated velocity": (
        '<intvelocity joint="slide" kp="40" actrange="-0.02 0.02"/>',
        {
            "terms": ((SLIDE, 1.0),), "gain": (40.0, 0.0, 0.0), "bias": (0.0, -40.0, 0.0),
            "activation": Activation.INTEGRATOR, "activation_range": (-0.02, 0.02),
        },
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_law_is_that_of_mujoco(case: str) -> None:
    line, spec = CASES[case]
    theirs = mjcf(line, dt=DT, tendon=TENDON)
    data = mujoco.MjData(theirs)
    sim, actuators = run([ActuatorSpec(name="a", **spec)], DT)
    start(sim, (0.1, -0.3), (0.8, -0.5))
    forces = []
    for k in range(40):
        ctrl = 1.2 * np.sin(0.3 * k)
        data.qpos[:], data.qvel[:] = sim.state.joint_q.numpy()[0], sim.state.joint_qd.numpy()[0]
        data.ctrl[:] = ctrl
        data.act[:] = actuators.activation.numpy()[0, : theirs.na]
        actuators.ctrl[:] = ctrl
        mujoco.mj_step(theirs, data)
        sim.step()
        # float32 sums of a few terms of order 10
        assert actuators.force.numpy()[0] == pytest.approx(data.actuator_force, abs=1e-5), k
        assert sim.control.element_joint_force.numpy()[0] == pytest.approx(data.qfrc_actuator, abs=2e-5), k
        # control and time constant have float32's digits
        assert actuators.activation.numpy()[0, : theirs.na] == pytest.approx(data.act, abs=1e-7), k
        forces.append(data.actuator_force[0])
    assert np.ptp(forces) > 0.1


SERVOS: dict[str, Any] = {
    "position": ('<position joint="slide" kp="200" kv="10"/>', 200.0, 10.0, SLIDE, 1.0, {}),
    "geared": ('<position joint="hinge" kp="50" kv="2" gear="-2"/>', 200.0, 8.0, HINGE, -2.0, {}),
    "velocity": ('<velocity joint="slide" kv="25"/>', 0.0, 25.0, SLIDE, 1.0, {"target": Target.VELOCITY}),
    "geared velocity": (
        '<velocity joint="hinge" kv="50" gear="0.5"/>', 0.0, 12.5, HINGE, 0.5, {"target": Target.VELOCITY}
    ),
    "integrated velocity": (
        '<intvelocity joint="slide" kp="200" kv="10" actrange="-1 1"/>', 200.0, 10.0, SLIDE, 1.0,
        {"activation": Activation.INTEGRATOR, "activation_range": (-1.0, 1.0)},
    ),
    "filtered position": (
        '<position joint="slide" kp="200" kv="10" timeconst="0.05"/>', 200.0, 10.0, SLIDE, 1.0,
        {"activation": Activation.FILTER_EXACT, "time_constant": 0.05},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SERVOS)
def test_a_servo_steps_as_mujocos_does(case: str) -> None:
    """The response to a step, of a frequency of 10 rad/s, within 2 % of its height."""
    line, stiffness, damping, column, coefficient, more = SERVOS[case]
    dt = 1.0e-3
    theirs = mjcf(line, dt=dt)
    data = mujoco.MjData(theirs)
    drive = sw.PositionDrive(stiffness=stiffness, damping=damping)
    spec = ActuatorSpec(name="a", terms=((column, coefficient),), law=Law.SERVO, **more)
    sim, actuators = run([spec], dt, drive=drive)
    # the other coordinate has the drive, too, and a target of zero
    data.ctrl[:] = 0.5
    actuators.ctrl[:] = 0.5
    paths = []
    for _ in range(600):
        mujoco.mj_step(theirs, data)
        sim.step()
        paths.append((data.qpos[column], sim.state.joint_q.numpy()[0, column]))
    wanted, found = np.array(paths).T
    assert np.abs(wanted).max() > 0.2
    # backward Euler against explicit stiffness: 10 rad/s · 1 ms
    assert np.abs(found - wanted).max() < 0.02 * np.abs(wanted).max()


def test_a_stiff_servo_stays_stable() -> None:
    """Where the same law as an explicit effort does not."""
    ends = []
    laws: list[tuple[Law, dict[str, Any]]] = [
        (Law.SERVO, {}),
        (Law.EFFORT, {"gain": (4.0e7, 0.0, 0.0), "bias": (0.0, -4.0e7, -4.0e4)}),
    ]
    for law, more in laws:
        drive = sw.PositionDrive(stiffness=4.0e7, damping=4.0e4) if law is Law.SERVO else None
        sim, actuators = run([ActuatorSpec(name="a", terms=((SLIDE, 1.0),), law=law, **more)], DT, drive=drive)
        actuators.ctrl[:] = 0.25
        for _ in range(60):
            sim.step()
        ends.append(float(sim.state.joint_q.numpy()[0, SLIDE]))
    # k dt² = 160 kg beside 2 kg: it is there after some steps, to float32
    assert ends[0] == pytest.approx(0.25, abs=1e-6)
    assert not abs(ends[1]) < 1.0
