"""The cart-pole: its dynamics against the textbook equations, its limits, its start, and `legacy_compat`."""

import math

import pytest
import torch

from simwarp.tasks import InputError, make, replace_fields
from simwarp.tasks.pendulum import CartPoleConfig
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import random_policy, zero_policy

CART, POLE, INERTIA, ARM, GRAVITY = 0.1, 0.785398, 0.262290, 1.0, 9.81


def textbook(q, qd, force, dt, steps):
    """Cart-pole in float64 by small explicit-midpoint steps; q = (x, angle); as observed."""
    q, qd = list(q), list(qd)

    def accelerations(q, qd):
        sine, cosine = math.sin(q[1]), math.cos(q[1])
        a, b, c = CART + POLE, POLE * ARM * cosine, INERTIA + POLE * ARM * ARM
        r0 = force + POLE * ARM * sine * qd[1] ** 2
        r1 = POLE * GRAVITY * ARM * sine
        determinant = a * c - b * b
        return [(c * r0 - b * r1) / determinant, (a * r1 - b * r0) / determinant]

    parts = 20
    h = dt / parts
    for _ in range(steps * parts):
        k = accelerations(q, qd)
        middle_q = [q[i] + 0.5 * h * qd[i] for i in range(2)]
        middle_qd = [qd[i] + 0.5 * h * k[i] for i in range(2)]
        k = accelerations(middle_q, middle_qd)
        q = [q[i] + h * middle_qd[i] for i in range(2)]
        qd = [qd[i] + h * k[i] for i in range(2)]
    return [q[0], qd[0], q[1], qd[1]]


def place(task, q, qd):
    worlds = torch.ones(task.num_worlds, dtype=torch.bool)
    rows = torch.tensor([q] * task.num_worlds), torch.tensor([qd] * task.num_worlds)
    task.simulation.set_joint_state(worlds, *rows)


@pytest.mark.parametrize("force", [0.0, 1.0, -0.5])
def test_motion_follows_the_equations_of_a_cart_pole(force):
    dt, steps = 0.001, 300
    task = make("pendulum", 2, dt=dt, max_angle=1.5, max_position=10.0)
    place(task, [0.3, 0.05], [0.1, -0.1])
    for _ in range(steps):
        result = task.step(torch.full((2, 1), force))
    expected = textbook((0.3, 0.05), (0.1, -0.1), force, dt, steps)
    # First-order stepping: half a step of acceleration (some 2 m/s2), which the falling pole doubles in 0.3 s
    assert result.observations["policy"][0].tolist() == pytest.approx(expected, abs=2.0 * dt)


def test_force_gain_scales_the_force():
    task = make("pendulum", 1, force_gain=3.0)
    task.step(torch.tensor([[0.5]]))
    assert task.views.joint_force[0].tolist() == [1.5, 0.0]


@pytest.mark.parametrize(
    ("q", "reason"),
    [([2.01, 0.0], "off_track"), ([-2.01, 0.0], "off_track"), ([0.0, 0.21], "fell"), ([0.0, -0.21], "fell")],
)
def test_limits_end_an_episode_as_a_failure(q, reason):
    task = make("pendulum", 2)
    place(task, q, [0.0, 0.0])
    result = task.step(torch.zeros(2, 1))
    assert result.terminated.all()
    assert [task.end_reasons[index] for index in result.end_reason] == [reason] * 2
    assert result.rewards.tolist() == [1.0, 1.0]
    assert result.final_observations is not None
    assert result.final_observations["policy"][0, [0, 2]].tolist() == pytest.approx(q, abs=2e-3)
    assert (result.observations["policy"][:, 2].abs() <= 0.05).all()


def test_just_inside_the_limits_the_episode_goes_on():
    task = make("pendulum", 1)
    place(task, [1.98, 0.19], [0.0, 0.0])
    assert not task.step(torch.zeros(1, 1)).terminated.any()


def test_starts_fill_their_ranges():
    task = make("pendulum", 4096, seed=3)
    x, v, angle, omega = task.restart(seed=3)["policy"].clone().unbind(dim=1)
    for values, half in ((x, 0.5), (angle, 0.05), (v, 0.02), (omega, 0.02)):
        assert values.abs().max() <= half + 1e-6
        assert values.max() > 0.99 * half
        assert values.min() < -0.99 * half
        assert abs(float(values.mean())) < 5 * half / math.sqrt(3 * 4096)


def test_worlds_do_not_depend_on_how_many_there_are():
    def roll(worlds):
        task = make("pendulum", worlds, seed=1, max_episode_steps=15)
        generator = torch.Generator().manual_seed(0)
        actions = torch.rand(40, 17, 1, generator=generator) * 2 - 1
        return torch.stack([task.step(a[:worlds]).observations["policy"].clone() for a in actions])

    many = roll(17)
    assert torch.equal(many[:, :2], roll(2))
    assert torch.equal(many[:, :1], roll(1))
    assert torch.equal(many, roll(17))


def test_a_world_that_breaks_is_reset_and_counted_and_its_neighbours_do_not_notice():
    def roll(bad):
        task = make("pendulum", 3, seed=1)
        rewards, observations = [], []
        for step in range(6):
            action = torch.zeros(3, 1)
            if bad and step == 2:
                action[1] = torch.nan
            result = task.step(action)
            rewards.append(result.rewards.clone())
            observations.append(result.observations["policy"].clone())
            assert result.final_observations is not None
            assert all(torch.isfinite(group).all() for group in result.final_observations.values())
        return task, torch.stack(rewards), torch.stack(observations)

    task, rewards, broken = roll(bad=True)
    _, _, sound = roll(bad=False)
    assert torch.equal(broken[:, [0, 2]], sound[:, [0, 2]])
    assert torch.isfinite(broken).all()
    assert torch.isfinite(rewards).all()
    summary = task.drain_statistics()
    assert summary.end_reasons["non_finite"] == 1
    assert task.episode_index.tolist() == [0, 1, 0]


def test_state_dict_continues_exactly():
    task = make("pendulum", 4, seed=2, max_episode_steps=25)
    generator = torch.Generator().manual_seed(0)
    actions = torch.rand(60, 4, 1, generator=generator) * 2 - 1
    for action in actions[:31]:
        task.step(action)
    state = task.state_dict()
    expected = [task.step(action).observations["policy"].clone() for action in actions[31:]]
    other = make("pendulum", 4, seed=9, max_episode_steps=25)
    other.load_state_dict(state)
    got = [other.step(action).observations["policy"].clone() for action in actions[31:]]
    assert all(torch.equal(a, b) for a, b in zip(expected, got, strict=True))


def test_doing_nothing_or_anything_falls_soon():
    task = make("pendulum", 64)
    for policy in (zero_policy(task), random_policy(task)):
        result = evaluate(task, policy, 64, seed=0)
        assert 30.0 < result.mean_episode_length < 200.0
        assert result.success_rate == 0.0


def test_quirks_of_the_original_are_behind_their_option():
    plain, odd = make("pendulum", 1), make("pendulum", 1, legacy_compat=True)
    assert odd.restart(seed=0)["policy"].tolist() == [[0.0, 0.0, 0.0, 0.0]]
    for task in (plain, odd):
        place(task, [-0.5, 0.05], [0.25, -0.1])
    before = float(odd.views.joint_qd[0, 1])
    seen = {task: task.step(torch.zeros(1, 1)).observations["policy"][0].tolist() for task in (plain, odd)}
    x, v, angle, omega = seen[plain]
    assert x < 0.0 < v
    assert omega < 0.0
    # Position and rate as distances; the angular speed without its sign, as it was before the step
    assert seen[odd] == pytest.approx([-x, -v, angle, abs(before)])
    assert abs(before) != abs(omega)


def test_order_of_quirky_observation_is_the_original_order():
    task = make("pendulum", 1, legacy_compat=True)
    place(task, [0.4, 0.1], [0.3, 0.2])
    x, rate, angle, speed = task.step(torch.zeros(1, 1)).observations["policy"][0].tolist()
    assert x == pytest.approx(0.4, abs=0.01)
    assert rate > 0.0
    assert angle == pytest.approx(0.1, abs=0.01)
    assert speed == pytest.approx(0.2, abs=1e-5)


@pytest.mark.parametrize("field", ["max_angle", "max_position", "force_gain"])
def test_limits_must_be_positive(field):
    with pytest.raises(InputError, match=field.replace("_", "-")):
        make("pendulum", config=replace_fields(CartPoleConfig(), {field: -1.0}))


def test_a_start_outside_the_limits_is_refused():
    with pytest.raises(InputError, match=r"start-angle must be in \[0, max-angle\), got 0.3"):
        make("pendulum", start_angle=0.3)


def test_the_drawing_marks_how_far_the_cart_may_go():
    ends = [line.points for line in make("pendulum", 2, max_position=1.5).drawing().lines]
    assert [end.shape for end in ends] == [(2, 2, 3)] * 2
    assert [float(end[1, 0, 0]) for end in ends] == [-1.5, 1.5]
