"""What actuators keep from step to step, and how actions reach them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp.actuators import Activation, Actuators, ActuatorSpec, Law
from tests.unit.actuators.cart_and_wheel import HINGE, MASS, SLIDE, bodies, run

DT = 1.0e-3
SPECS = [
    ActuatorSpec(name="late", terms=((SLIDE, 1.0),), delay=5.0e-3, ctrl_range=(-2.0, 4.0)),
    ActuatorSpec(name="lag", terms=((HINGE, 1.0),), activation=Activation.FILTER_EXACT, time_constant=0.03),
    ActuatorSpec(name="sum", terms=((HINGE, 0.5),), activation=Activation.INTEGRATOR, ctrl_range=(0.0, 1.0)),
]


def play(sim: sw.Simulation, actuators: Actuators, first: int, count: int, worlds: list[int]) -> None:
    """Steps with controls that depend on the step and on who the world is."""
    for step in range(first, first + count):
        phases = np.array(worlds)[:, None] * 0.9 + np.arange(len(SPECS))
        actuators.ctrl.assign(np.sin(0.17 * step + phases).astype(np.float32))
        sim.step()


def words(sim: sw.Simulation, actuators: Actuators, world: int) -> bytes:
    """Everything of a world that the actuators move, bit by bit."""
    arrays = (sim.state.joint_x, sim.state.joint_qd, actuators.activation, actuators.force)
    return b"".join(np.ascontiguousarray(array.numpy()[world]).tobytes() for array in arrays)


def test_a_filter_is_an_exponential_and_an_integrator_a_ramp() -> None:
    sim, actuators = run(SPECS, DT)
    actuators.ctrl[:] = 0.75
    for _ in range(45):
        sim.step()
    lag, ramp = actuators.activation.numpy()[0, 1:]
    # a time constant in float32
    assert lag == pytest.approx(0.75 * -np.expm1(-45 * DT / 0.03), rel=1e-6)
    assert ramp == pytest.approx(0.75 * 45 * DT, rel=1e-6)


def test_small_rates_add_up() -> None:
    """1e-6 a step beside 100: float32 would lose them."""
    sim, actuators = run(SPECS, DT)
    actuators.activation[:, 2] = 100.0
    actuators.ctrl[:, 2] = 1.0e-3
    for _ in range(200):
        sim.step()
    assert actuators.activation.numpy()[0, 2] - 100.0 == pytest.approx(2.0e-4, rel=1e-6)


def test_a_delayed_push_arrives_whole() -> None:
    """5 ms late, clamped, and of its own length: the momentum is that of the push."""
    sim, actuators = run(SPECS[:1], DT)
    speeds = []
    for step in range(20):
        actuators.ctrl[:] = 10.0 if step < 3 else 0.0
        sim.step()
        speeds.append(float(sim.state.joint_qd.numpy()[0, SLIDE]))
    assert speeds[4] == 0.0
    assert speeds[5] == pytest.approx(4.0 * DT / MASS, rel=1e-6)
    assert speeds[-1] == pytest.approx(3 * 4.0 * DT / MASS, rel=1e-6)


def test_a_world_is_as_if_it_were_alone() -> None:
    """The same bits whoever is beside it, on one thread or two, and once more."""
    sims = []
    for worlds, threads in (([0, 1, 2, 3], 1), ([0, 1, 2, 3], 2), ([2], 1), ([0, 1, 2, 3], 1)):
        model = bodies().finalize(len(worlds), "cpu")
        actuators = Actuators(model, SPECS, dt=DT)
        sim = sw.Simulation(model, DT, elements=[actuators], threads=threads)
        play(sim, actuators, 0, 60, worlds)
        sims.append((sim, actuators))
    first = [words(*sims[0], world) for world in range(4)]
    assert len(set(first)) == 4
    assert [words(*sims[1], world) for world in range(4)] == first
    assert [words(*sims[3], world) for world in range(4)] == first
    assert words(*sims[2], 0) == first[2]


def test_a_snapshot_repeats_a_run(tmp_path: Path) -> None:
    sim, actuators = run(SPECS, DT, worlds=2)
    play(sim, actuators, 0, 33, [0, 1])
    sim.snapshot().save(tmp_path / "middle.npz")
    play(sim, actuators, 33, 20, [0, 1])
    ends = [words(sim, actuators, world) for world in range(2)]
    again, others = run(SPECS, DT, worlds=2)
    again.restore(sw.Snapshot.load(tmp_path / "middle.npz", again))
    play(again, others, 33, 20, [0, 1])
    assert [words(again, others, world) for world in range(2)] == ends


def test_a_reset_forgets_delays_and_activations_in_its_worlds_only() -> None:
    sim, actuators = run(SPECS, DT, worlds=2)
    play(sim, actuators, 0, 33, [0, 1])
    kept = words(sim, actuators, 0)
    sim.reset(np.array([False, True]))
    assert words(sim, actuators, 0) == kept
    assert not actuators.activation.numpy()[1].any()
    assert not actuators.ctrl.numpy()[1].any()
    sim.step()
    assert actuators.force.numpy()[1, 0] == 0.0  # nothing of before comes out of the line


def test_a_control_that_is_no_number_freezes_its_world_alone() -> None:
    sim, actuators = run([ActuatorSpec(name="m", terms=((SLIDE, 1.0),), ctrl_range=(-1.0, 1.0))], DT, worlds=2)
    actuators.ctrl.assign(np.array([[np.nan], [1.0]], np.float32))
    sim.step()
    assert (sim.state.world_status.numpy() & 1).tolist() == [1, 0]


ACTIONS = np.array([[-1.0, 0.3, 0.0], [1.0, -7.0, 0.5]], np.float32)
CONTROLS = [[-2.0, 0.3, 0.5], [4.0, -7.0, 0.75]]
"""-1 to 1 fills the range; a control without one is the action."""


@pytest.mark.parametrize("make", [np.asarray, torch.tensor, lambda a: wp.array(a, dtype=wp.float32, device="cpu")])
def test_actions_fill_the_ranges(make) -> None:
    _, actuators = run(SPECS, DT, worlds=2)
    actuators.set_from_action(make(ACTIONS))
    assert actuators.ctrl.numpy() == pytest.approx(np.array(CONTROLS), rel=1e-7)
    actuators.set_from_action(make(-ACTIONS))
    actuators.set_from_action(make(ACTIONS))
    assert actuators.ctrl.numpy() == pytest.approx(np.array(CONTROLS), rel=1e-7)


def test_actions_may_be_columns_of_a_larger_tensor() -> None:
    _, actuators = run(SPECS, DT, worlds=2)
    wide = torch.zeros(2, 5)
    wide[:, 1:4] = torch.tensor(ACTIONS)
    actuators.set_from_action(wide[:, 1:4])
    assert actuators.ctrl.numpy() == pytest.approx(np.array(CONTROLS), rel=1e-7)


def test_the_control_is_memory_that_torch_shares() -> None:
    sim, actuators = run([ActuatorSpec(name="m", terms=((SLIDE, MASS),))], DT, worlds=2)
    ctrl = sw.to_torch(actuators.ctrl)
    ctrl[1, 0] = 3.0
    sim.step()
    assert sim.state.joint_qd.numpy()[:, SLIDE] == pytest.approx([0.0, 3.0 * DT], rel=1e-6)


def test_a_servo_leaves_the_rate_to_whoever_writes_it() -> None:
    drive = sw.PositionDrive(stiffness=0.0, damping=1.0e6)
    spec = ActuatorSpec(name="s", terms=((SLIDE, 1.0),), law=Law.SERVO)
    sim, _ = run([spec], DT, drive=drive)
    sim.control.joint_target_qd[:, SLIDE] = 0.3
    sim.step()
    # 2 kg beside a damper of 1e6 N·s/m · 1 ms
    assert sim.state.joint_qd.numpy()[0, SLIDE] == pytest.approx(0.3, rel=3e-3)


def test_no_actuators_are_an_element_too() -> None:
    sim, actuators = run([], DT)
    actuators.set_from_action(np.zeros((1, 0)))
    sim.step()
    assert len(actuators) == 0
    assert sim.state.world_status.numpy()[0] == 0
