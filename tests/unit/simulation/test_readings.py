"""Numbers of one world by name, and several steps in one call."""

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.sensors import Imu, ImuConfig, Mount, Schedule

DT = 0.01
ANGLES = (0.0, 0.3, -1.2)
SLIDES = (0.0, 0.25, -0.5)


def mechanism() -> sw.Simulation:
    """In each of three worlds a cart on a slide with a hinged pole, a ball that falls, and a floating stone."""
    builder = sw.ModelBuilder()
    cart = builder.add_body("cart", mass=1.0, inertia=(1, 1, 1))
    pole = builder.add_body("pole", mass=1.0, inertia=(1, 1, 1), pose=sw.pose((0, 0, 1)))
    builder.add_body("ball", mass=2.0, inertia=(1, 1, 1), pose=sw.pose((5, 0, 3)), velocity=(1, 0, 0), omega=(0, 0, 2))
    stone = builder.add_body("stone", mass=2.0, inertia=(1, 1, 1), pose=sw.pose((0, 7, 0)))
    builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1, 0, 0))
    builder.add_joint_revolute("hinge", cart, pole, anchor=(0, 0, 0), axis=(0, 1, 0))
    builder.add_joint_spherical("socket", sw.WORLD, stone, anchor=(0, 7, 0))
    sensor = ImuConfig(schedule=Schedule(rate=40.0))
    model = builder.finalize(3, "cpu")
    return sw.Simulation(model, DT, substeps=2, sensors=[Imu(model, Mount("pole"), sensor)])


def posed() -> sw.Simulation:
    sim = mechanism()
    q, qd = np.zeros((3, 5)), np.zeros((3, 5))
    q[:, 0], q[:, 1] = SLIDES, ANGLES
    qd[:, 1] = 0.5
    sim.set_joint_state(None, q, qd)
    return sim


@pytest.mark.parametrize("world", [0, 1, 2])
def test_a_pose_that_was_set_is_read_back(world):
    sim, angle, travel = posed(), ANGLES[world], SLIDES[world]
    # angles are measured by a float32 arc tangent, to 2e-7 rad (docs/conventions.md), at lengths of 1 m
    assert sim.joint_position("slide", world) == pytest.approx(travel, abs=1e-6)
    assert sim.joint_position("hinge", world=world) == pytest.approx(angle, abs=1e-6)
    assert sim.joint_velocity("hinge", world) == pytest.approx(0.5, abs=1e-6)
    assert sim.body_position("pole", world) == pytest.approx([travel + math.sin(angle), 0.0, math.cos(angle)], abs=1e-6)
    half = 0.5 * angle
    rotation = sim.body_rotation("pole", world)
    assert rotation * np.sign(rotation[3]) == pytest.approx([0.0, math.sin(half), 0.0, math.cos(half)], abs=1e-6)
    assert sim.body_angular_velocity("pole", world) == pytest.approx([0.0, 0.5, 0.0], abs=1e-6)
    assert sim.body_velocity("pole", world) == pytest.approx(
        [0.5 * math.cos(angle), 0.0, -0.5 * math.sin(angle)], abs=1e-6
    )


def test_a_falling_ball_is_where_galilei_says():
    sim = mechanism()
    sim.step(50)
    time = 50 * DT
    # a sub-step h = DT / 2 goes on at its last speed: g h² (1 + 2 + ... + n) = g t (t + h) / 2
    fall = 0.5 * 9.81 * time * (time + 0.5 * DT)
    # float32 speeds of 5 m/s (3e-7) and steps (6e-8 of 0.5 s) over 0.5 s and 100 sub-steps
    assert sim.body_position("ball", 1) == pytest.approx([5.0 + time, 0.0, 3.0 - fall], abs=1e-5)
    assert sim.body_velocity("ball") == pytest.approx([1.0, 0.0, -9.81 * time], abs=1e-5)
    assert sim.body_angular_velocity("ball") == pytest.approx([0.0, 0.0, 2.0], abs=1e-6)
    assert sim.body_rotation("ball", 2) == pytest.approx([0.0, 0.0, math.sin(time), math.cos(time)], abs=1e-6)
    assert sim.world_time() == pytest.approx(time, abs=1e-7)
    sim.reset(np.array([False, True, False]))
    assert (sim.world_time(1), sim.world_time(2)) == (0.0, pytest.approx(time, abs=1e-7))


def test_indices_stand_for_names_and_local_for_a_coordinate():
    sim = posed()
    assert sim.body_position(1, 1).tolist() == sim.body_position("pole", 1).tolist()
    assert sim.joint_position(1, 1) == sim.joint_position("hinge", 1) != 0.0
    q = np.zeros((3, 5))
    q[1, 2:] = 0.1, -0.2, 0.3
    sim.set_joint_state(None, q, None)
    found = [sim.joint_position("socket", 1, local=local) for local in range(3)]
    # float32 rotation vector
    assert found == pytest.approx([0.1, -0.2, 0.3], abs=1e-6)


def test_a_reading_is_a_copy():
    sim = mechanism()
    before = sim.body_position("ball")
    kept = before.tolist()
    sim.step(10)
    assert before.tolist() == kept
    before[2] = 100.0
    assert sim.body_position("ball")[2] < 3.0
    assert type(sim.joint_position("hinge")) is type(sim.world_time()) is float


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda s: s.body_position("pol"), "model has no body 'pol'; did you mean 'pole'?"),
        (lambda s: s.joint_position("hing"), "model has no joint 'hing'; did you mean 'hinge'?"),
        (
            lambda s: s.body_velocity(4),
            "body_velocity: body must be a name or an index below 4, got 4; see model.body_names",
        ),
        (
            lambda s: s.body_rotation(-1),
            "body_rotation: body must be a name or an index below 4, got -1; see model.body_names",
        ),
        (
            lambda s: s.joint_velocity(True),
            "joint_velocity: joint must be a name or an index below 3, got True; see model.joint_names",
        ),
        (
            lambda s: s.joint_position("hinge", 3),
            "joint_position: world must be an integer >= 0 and <= 2, got 3; there are 3 worlds",
        ),
        (
            lambda s: s.joint_position("socket", local=3),
            "model: joint 'socket' has 3 coordinates, got index 3; count from 0",
        ),
        (lambda s: s.world_time(-1), "world_time: world must be an integer >= 0, got -1; there are 3 worlds"),
        (lambda s: s.step(-1), "step: steps must be an integer >= 0, got -1; give the number of steps"),
        (lambda s: s.step(2.0), "step: steps must be an integer >= 0, got 2.0; give the number of steps"),
        (lambda s: s.advance(True), "step: steps must be an integer >= 0, got True; give the number of steps"),
        (
            lambda s: s.step(2**30),
            "step: steps must be an integer >= 0 and <= 1073741823, got 1073741824; give the number of steps",
        ),
    ],
)
def test_a_wrong_argument_is_told_in_one_line(call, text):
    sim = mechanism()
    with pytest.raises(sw.ModelError) as caught:
        call(sim)
    assert str(caught.value) == text
    assert sim.world_time() == 0.0


@pytest.mark.parametrize("steps", [0, 1, 2, 7, np.int64(20)])
def test_several_steps_in_one_call_are_as_many_calls_bit_by_bit(steps):
    at_once, one_by_one = posed(), posed()
    at_once.step(steps)
    for _ in range(steps):
        one_by_one.step()
    found, wanted = (sim.snapshot().arrays() for sim in (at_once, one_by_one))
    assert any(name.startswith("memory") for name in wanted)  # the sensor's clock and frames are compared too
    for name, array in wanted.items():
        assert found[name].numpy().tobytes() == array.numpy().tobytes(), name
    for name in ("cone_residual", "iterations", "position_error"):
        mine, other = (getattr(sim.diagnostics, name).numpy() for sim in (at_once, one_by_one))
        assert mine.tobytes() == other.tobytes(), name
