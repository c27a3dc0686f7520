"""Joint angles count turns, however fast, and whatever sets the state."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import WORLD, JointType, PrescribedSpeed, pose
from simwarp.model.builder import ModelBuilder

TURN = 2.0 * np.pi
KINDS = [JointType.REVOLUTE, JointType.CYLINDRICAL, JointType.PLANAR, JointType.UNIVERSAL]


def wheel(kind: JointType, speed: float, *, carried: bool = False) -> tuple[ModelBuilder, int]:
    """A wheel that spins at `speed` about the angle of a joint of the given kind; returns the angle's dof too."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    parent = WORLD
    if carried:  # on a body that turns itself
        parent = builder.add_body("carrier", mass=5.0, inertia=(1, 1, 1), omega=(0.3, 0.0, 0.0))
    body = builder.add_body("wheel", mass=1.0, inertia=(0.1, 0.1, 0.2), omega=(0.3 * carried, 0.0, speed))
    axis = (0.0, 0.0, 1.0)
    ends = ("joint", parent, body)
    if kind == JointType.REVOLUTE:
        builder.add_joint_revolute(*ends, axis=axis)
        return builder, 0
    if kind == JointType.CYLINDRICAL:
        builder.add_joint_cylindrical(*ends, axis=axis)
        return builder, 1
    if kind == JointType.PLANAR:
        builder.add_joint_planar(*ends, normal=axis)
        return builder, 2
    builder.add_joint_universal(*ends, anchor=(0, 0, 0), axis0=axis, axis1=(0, 1, 0))
    return builder, 0


SPINNING = [pytest.param(kind, n, id=f"{kind.name}-{n}") for kind in KINDS for n in (1, 4)]


@pytest.mark.parametrize(("kind", "substeps"), SPINNING)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_fifty_turns(kind, direction, substeps):
    speed, dt = direction * 10.0 * TURN, 0.02
    builder, dof = wheel(kind, speed)
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt, substeps=substeps)
    for _ in range(250):
        sim.step()
    # 10 turns/s for 5 s; the speed drifts by the rounding of 1000 sub-steps at most: 1e-7 * sqrt(1000) of itself
    assert sim.state.joint_x.numpy()[0, dof] == pytest.approx(direction * 50.0 * TURN, rel=1e-5)
    assert sim.state.joint_q.numpy()[0, dof] == pytest.approx(direction * 50.0 * TURN, rel=1e-5)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("step", [0.6, 0.999, 1.0, 1.3, 7.25])
def test_more_than_half_a_turn_per_step(kind, step):
    """The measured angle is taken where the speed says, so that no turn is lost. A few steps only: an explicit hinge
    on the world turns its tilt away once per step, which grows from rounding above 2.33 rad per step (reference.py)."""
    dt, steps = 0.05, 8
    builder, dof = wheel(kind, step * TURN / dt)
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt, solver=sw.SolverOptions(gyroscopic=False))
    for _ in range(steps):
        sim.step()
    assert sim.state.joint_x.numpy()[0, dof] == pytest.approx(step * steps * TURN, abs=1e-3)


def test_a_shaft_turns_for_ever():
    """A million turns in float64: the coordinate of record stays exact where the float32 view cannot be."""
    builder = ModelBuilder()
    speed = 1e4 * TURN
    builder.add_shaft("turbine", inertia=0.1, speed=speed)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 0.5)
    for _ in range(200):
        sim.step()
    rate = float(np.float32(speed))
    assert sim.state.joint_x.numpy()[0, 0] == pytest.approx(100.0 * rate, rel=1e-9)
    assert sim.state.joint_q.numpy()[0, 0] == pytest.approx(100.0 * rate, rel=1e-7)


def test_turns_on_a_carried_wheel_and_a_loop():
    """The wheel's own turns against a body that turns too; a second hinge closes a loop and counts the same."""
    builder, dof = wheel(JointType.REVOLUTE, 4.0 * TURN, carried=True)
    second = builder.add_joint_revolute("twin", 0, 1, axis=(0, 0, 1), anchor=(0.0, 0.0, 0.2))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    turned = 0.0
    for _ in range(1500):
        sim.step()
        turned += 1e-3 * float(sim.state.joint_qd.numpy()[0, dof])
    q = sim.state.joint_x.numpy()[0]
    assert abs(turned) > 4.0 * TURN
    # the sum of the rates is the angle, to h times the change of rate and the rounding of 1500 terms
    assert q[dof] == pytest.approx(turned, abs=0.02)
    assert q[builder.dof_start(second)] == pytest.approx(q[dof], abs=1e-3)


def test_prescribed_turns():
    builder = ModelBuilder()
    body = builder.add_body("rotor", mass=1.0, inertia=(0.1, 0.1, 0.2), pose=pose((0.1, 0.0, 0.0)))
    builder.add_joint_revolute(
        "motor", WORLD, body, axis=(0, 0, 1), anchor=(0, 0, 0), drive=PrescribedSpeed(table=((0.0, 1.0), (0.0, 50.0)))
    )
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    for _ in range(2000):
        sim.step()
    # the ramp goes on past its end: 25 t², summed at the end of each step: + h/2 of the last speed
    assert sim.state.joint_q.numpy()[0, 0] == pytest.approx(25.0 * 4.0 + 0.5e-3 * 100.0, rel=1e-4)


def test_turns_survive_snapshot_and_reset():
    builder, dof = wheel(JointType.REVOLUTE, 20.0 * TURN)
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-2)
    for _ in range(100):
        sim.step()
    saved = sim.snapshot()
    before = sim.state.joint_x.numpy()[0, dof]
    assert before == pytest.approx(20.0 * TURN, rel=1e-4)
    sim.reset([True, False])
    assert sim.state.joint_x.numpy()[0, dof] == 0.0
    assert sim.state.joint_x.numpy()[1, dof] == before
    sim.restore(saved)
    sim.step()
    assert sim.state.joint_x.numpy()[0, dof] == pytest.approx(20.2 * TURN, rel=1e-4)
