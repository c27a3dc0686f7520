"""The hand: not there while it holds nothing, one body of one world while it does, and a spring that settles."""

from __future__ import annotations

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes, tasks
from simwarp.core.types import ModelError
from simwarp.viewer.live.hand import MOST, STIFFNESS, Hand, connected, hand_of, with_hand

DT = 2e-3
WORLDS = 3


def ball(mass: float = 2.0, gravity: float = 0.0) -> sw.ModelBuilder:
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, -gravity))
    builder.add_body("ball", mass=mass, inertia=np.eye(3) * 0.4 * mass * 0.01)
    return builder


def bits(simulation: sw.Simulation) -> list[bytes]:
    """The whole state, world by world."""
    state = simulation.state
    return [b"".join(getattr(state, name).numpy()[world].tobytes() for name in state.NAMES) for world in range(WORLDS)]


def run(builder: sw.ModelBuilder, steps: int, *, hand: bool, drag: bool = False) -> tuple[sw.Simulation, list[bytes]]:
    model = builder.finalize(world_count=WORLDS, device="cpu")
    simulation = sw.Simulation(model, DT, elements=with_hand(model) if hand else ())
    held = hand_of(simulation.elements)
    for step in range(steps):
        if drag and held is not None and step == 5:
            held.grab(1, 0, (0.0, 0.0, 0.1), simulation.state.body_x.numpy()[1, 0] + (0.0, 0.0, 0.5))
        if drag and held is not None and step == steps - 5:
            held.release()
        simulation.step()
    return simulation, bits(simulation)


def test_without_a_hold_no_bit_differs():
    _, plain = run(scenes.ant(), 60, hand=False)
    _, handed = run(scenes.ant(), 60, hand=True)
    assert plain == handed


def test_a_drag_moves_one_world_and_no_bit_of_another():
    _, plain = run(scenes.ant(), 60, hand=True)
    simulation, dragged = run(scenes.ant(), 60, hand=True, drag=True)
    assert dragged[0] == plain[0]
    assert dragged[2] == plain[2]
    assert dragged[1] != plain[1]
    height = simulation.state.body_x.numpy()[:, 0, 2]
    assert height[1] > height[0] + 0.01
    assert not simulation.control.element_force.numpy().any()  # nothing of it is left


def test_a_body_follows_the_closed_form():
    """Critically damped: x = d (1 - (1 + w t) exp(-w t)) with w = sqrt(k / m), to the order of the step."""
    model = ball().finalize(world_count=1, device="cpu")
    simulation = sw.Simulation(model, DT, elements=with_hand(model))
    hand = hand_of(simulation.elements)
    assert hand is not None
    hand.grab(0, 0, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0))
    rate = math.sqrt(STIFFNESS)
    for step in range(1, 401):
        simulation.step()
        if step % 100 == 0:
            time = step * DT
            expected = 0.1 * (1.0 - (1.0 + rate * time) * math.exp(-rate * time))
            # half a step of the fastest speed, d w / e
            assert simulation.state.body_x.numpy()[0, 0, 0] == pytest.approx(expected, abs=0.1 * rate / math.e * DT)


def test_the_force_is_held_to_five_weights():
    model = ball(gravity=9.81).finalize(world_count=1, device="cpu")
    simulation = sw.Simulation(model, DT, elements=with_hand(model))
    hand = hand_of(simulation.elements)
    assert hand is not None
    hand.grab(0, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 1000.0))
    simulation.step()
    # upwards at 5 g, less 1 g of weight
    assert simulation.state.body_v.numpy()[0, 0, 2] == pytest.approx((MOST - 1.0) * 9.81 * DT, rel=1e-5)


def test_a_point_off_the_centre_turns_the_body():
    model = ball().finalize(world_count=1, device="cpu")
    simulation = sw.Simulation(model, DT, elements=with_hand(model))
    hand = hand_of(simulation.elements)
    assert hand is not None
    hand.grab(0, 0, (0.1, 0.0, 0.0), (0.1, 0.0, 0.2))
    simulation.step()
    assert simulation.state.body_omega.numpy()[0, 0, 1] < 0.0  # x upwards: about -y
    place, turn = (getattr(simulation.state, name).numpy()[0, 0] for name in ("body_x", "body_rot"))
    assert hand.grabbed(place, turn) == pytest.approx([0.1, 0.0, 0.0], abs=1e-3)


def test_a_light_part_of_a_heavy_robot_stays_calm():
    """The damper of 1000 kg on 10 g would diverge within a few steps."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    heavy = builder.add_body("heavy", mass=1000.0, inertia=np.eye(3) * 100.0)
    light = builder.add_body("light", mass=0.01, inertia=np.eye(3) * 1e-6, pose=sw.pose((1.0, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", heavy, light, anchor=(1.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0))
    model = builder.finalize(world_count=1, device="cpu")
    simulation = sw.Simulation(model, DT, elements=with_hand(model))
    hand = hand_of(simulation.elements)
    assert hand is not None
    hand.grab(0, light, (0.05, 0.0, 0.0), (1.05, 0.1, 0.0))
    for _ in range(500):
        simulation.step()
    assert np.abs(simulation.state.body_omega.numpy()).max() < 50.0
    assert np.isfinite(simulation.state.body_x.numpy()).all()


def test_what_hangs_together():
    model = scenes.ant().finalize(world_count=1, device="cpu")
    assert len(set(connected(model).tolist())) == 1
    arm = scenes.bouncing_balls().finalize(world_count=1, device="cpu")
    assert len(set(connected(arm).tolist())) == arm.body_count


def test_refusals():
    model = ball().finalize(world_count=1, device="cpu")
    hand = Hand(model)
    with pytest.raises(ModelError, match="Hand: it must be the last"):
        sw.Simulation(model, DT, elements=[hand, Hand(model)])
    with pytest.raises(ModelError, match="Hand: world and body must be below 1 and 1, got 0 and 7"):
        hand.grab(0, 7, (0, 0, 0), (0, 0, 0))


def test_a_task_takes_further_elements():
    """Its own come first, and its worlds stay the same bit by bit."""
    plain, handed = (tasks.make("ant", WORLDS, seed=3, elements=more) for more in (None, with_hand))
    assert hand_of(plain.simulation.elements) is None
    assert hand_of(handed.simulation.elements) is handed.simulation.elements[-1]
    for task in (plain, handed):
        for _ in range(3):
            task.step(0.3 * task.action.new_ones(task.action.shape))
    assert bits(plain.simulation) == bits(handed.simulation)
