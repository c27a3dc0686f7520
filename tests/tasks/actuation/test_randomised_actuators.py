"""`randomise` of actuators: what each name does to a motor, that worlds and episodes differ, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from simwarp.tasks import InputError, Range, make
from tests.tasks.actuation.hinge_task import DAMPING, LIMIT, STIFFNESS, hinges


def rows(task, name):
    return getattr(task.motors, name).numpy().copy()


def test_strength_scales_the_whole_law():
    task = hinges(50, randomise={"actuator_strength": Range(0.5, 1.5)})
    factor = rows(task, "gain")[:, :, 0] / STIFFNESS
    assert 0.5 <= factor.min() < 0.55
    assert 1.45 < factor.max() <= 1.5
    assert not np.allclose(factor[:, 0], factor[:, 1])
    np.testing.assert_allclose(rows(task, "bias")[:, :, 1], -STIFFNESS * factor, rtol=1e-6)
    np.testing.assert_allclose(rows(task, "bias")[:, :, 2], -DAMPING * factor, rtol=1e-6)
    np.testing.assert_allclose(rows(task, "force_range")[:, :, 1], LIMIT * factor, rtol=1e-6)
    np.testing.assert_allclose(rows(task, "stall_force")[:, 1], 4.0 * factor[:, 1], rtol=1e-6)
    assert np.all(rows(task, "stall_force")[:, 0] >= 1e30), "no bound stays none"


def test_gains_and_delays_are_drawn_by_themselves():
    task = hinges(50, randomise={
        "actuator_stiffness": Range(0.8, 1.2, only="left"), "actuator_damping": Range(0.0, 0.0),
        "actuator_delay": Range(0.0, 0.006, mode="set"),
    })  # fmt: skip
    gain, bias = rows(task, "gain"), rows(task, "bias")
    assert np.all(gain[:, 1, 0] == np.float32(STIFFNESS))
    assert np.ptp(gain[:, 0, 0]) > 3.0
    np.testing.assert_allclose(bias[:, 0, 1], -gain[:, 0, 0], rtol=1e-6)
    assert np.all(bias[:, :, 2] == 0.0)
    delay = rows(task, "delay")
    assert np.all(delay[:, 1] == 0.0)
    assert 0.0 <= delay[:, 0].min() < 0.001 < 0.005 < delay[:, 0].max() <= 0.006
    assert task.motors.force_range.shape[0] == 1, "what is not drawn is shared"


def test_they_are_drawn_anew_where_an_episode_begins_and_come_back_with_the_seed():
    spec = {"actuator_strength": Range(0.5, 1.5), "actuator_stiffness": Range(0.8, 1.2, when="step")}
    task = hinges(3, seed=4, randomise=spec)
    first = rows(task, "force_range")
    task.episode_clock[1] = task.config.max_episode_steps
    before = rows(task, "gain")
    task.step(torch.zeros(3, 2))
    assert (rows(task, "force_range") != first).any(axis=(1, 2)).tolist() == [False, True, False]
    task.step(torch.zeros(3, 2))  # the first step of an episode has the numbers that it began with
    assert (rows(task, "gain") != before).any(axis=(1, 2)).all()
    task.restart(seed=4)
    assert np.array_equal(rows(task, "force_range"), first)


def test_a_resumed_task_repeats_bit_by_bit():
    spec = {"actuator_strength": Range(0.5, 1.5), "actuator_delay": Range(0.0, 0.006, mode="set")}
    task = hinges(3, seed=4, randomise=spec)
    actions = torch.rand(20, 3, 2) * 2 - 1
    for action in actions[:8]:
        task.step(action)
    state = task.state_dict()
    expected = [task.step(action).observations["policy"].clone() for action in actions[8:]]
    other = hinges(3, seed=9, randomise=spec)
    other.load_state_dict(state)
    got = [other.step(action).observations["policy"].clone() for action in actions[8:]]
    assert all(torch.equal(a, b) for a, b in zip(expected, got, strict=True))


def test_weaker_motors_move_less_and_other_worlds_are_as_without():
    plain, drawn = hinges(40, seed=1), hinges(40, seed=1, randomise={"actuator_strength": Range(0.2, 1.0, shared=True)})
    for task in (plain, drawn):
        task.restart(seed=1)
        start = task.views.joint_q.clone()
        for _ in range(4):
            task.step(torch.ones(40, 2))
        task.moved = (task.views.joint_q - start)[:, 1]
    strength = torch.from_numpy(rows(drawn, "gain")[:, 1, 0] / STIFFNESS)
    assert torch.corrcoef(torch.stack([drawn.moved / plain.moved, strength]))[0, 1] > 0.95


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (
            {"actuator_strenght": Range(0.5, 1.5)},
            "no model parameter 'actuator_strenght'; did you mean actuator_strength",
        ),
        ({"actuator_strength": Range(0.5, 1.5, only="middle")}, "there is no 'middle'"),
        (
            {"actuator_delay": Range(0.0, 0.01, mode="set")},
            "must be from 0 to 0.006 s, the longest built, got 0 to 0.01",
        ),
        ({"actuator_delay": Range(-0.01, 0.0, mode="add")}, "must be from 0 to 0.006 s"),
        (
            {"actuator_delay": Range(0.5, 1.0, only="right")},
            "cannot act on 'right': only actuators that are built with",
        ),
    ],
)
def test_ranges_that_cannot_act(spec, words):
    with pytest.raises(InputError, match=words) as caught:
        hinges(2, randomise=spec)
    assert "\n" not in str(caught.value)


def test_tasks_without_actuators_are_told_apart():
    with pytest.raises(InputError, match="must have one group of actuators, got 0"):
        make("pendulum", 2, randomise={"actuator_strength": Range(0.5, 1.5)})
