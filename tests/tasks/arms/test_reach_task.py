"""Reaching arms: what they observe, do and are paid for, where episodes end, what a success is, that they learn."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.scenes import IRB120, RACER3
from simwarp.tasks import InputError, make
from simwarp.tasks.arms.reaching import Racer3ReachTask, ReachActions, ReachConfig, ReachReward
from simwarp.train.config import default_config
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import SHIPPED, find_policy, network_policy
from simwarp.train.runs.training import train

ARMS = {"racer3-reach": RACER3, "irb120-reach": IRB120}
NAMES = tuple(ARMS)


def place(task, q=None, qd=None):
    """Put every arm somewhere, as built unless ``q`` says otherwise."""
    zero = torch.zeros(task.num_worlds, 6, device=task.device)
    every = torch.ones(task.num_worlds, dtype=torch.bool, device=task.device)
    task.simulation.set_joint_state(every, zero if q is None else q, zero if qd is None else qd)
    if task._aiming is not None:
        task._aiming.rest.on(every)


def idle(task):
    return torch.zeros(task.num_worlds, task.action_size)


def still(name="racer3-reach", worlds=1, **options):
    return make(name, worlds, start_angle=0.0, **options)


def handed_out(result):
    return torch.cat([result.rewards[:, None], result.observations["policy"]], dim=1)


def homing(task):
    """Displacements straight towards the target, by a fifth of what is left: drives lag by two control steps."""
    seen = task.observe()["policy"]
    return (0.2 * (seen[:, 12:15] - seen[:, 15:18]) / task.config.displacement).clamp(-1.0, 1.0)


# ---- observations and actions ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_observation_has_its_eighteen_entries_in_order(name):
    task = still(name, 2)
    q, qd = torch.linspace(-0.4, 0.3, 6).repeat(2, 1), torch.linspace(1.0, -1.0, 6).repeat(2, 1)
    seen = task.observe()["policy"][0]
    assert seen.shape == (18,)
    assert seen[15:18].tolist() == pytest.approx(list(ARMS[name].grip), abs=1e-6)
    place(task, q, qd)
    seen = task.observe()["policy"][0]
    assert seen[0:6].tolist() == pytest.approx(q[0].tolist(), abs=1e-6)
    assert seen[6:12].tolist() == pytest.approx(qd[0].tolist(), abs=1e-4)
    hand = task.simulation.state.body_q.numpy()[0, task.simulation.model.body("hand")]
    away = np.asarray(ARMS[name].grip) - np.asarray(ARMS[name].links[-1].centre)
    assert math.dist(seen[15:18].tolist(), hand[:3]) == pytest.approx(np.linalg.norm(away), abs=1e-6)


@pytest.mark.parametrize(("name", "centre"), [("racer3-reach", -0.52), ("irb120-reach", 0.40)])
def test_targets_fill_their_range_and_the_cube_stands_there(name, centre):
    task = make(name, 400, seed=1)
    target = task.observe()["policy"][:, 12:15]
    for column, middle in ((0, centre), (1, 0.0)):
        away = target[:, column] - middle
        assert 0.048 < away.max() <= 0.05 + 1e-6
        assert -0.05 - 1e-6 <= away.min() < -0.048
    assert target[:, 2].tolist() == pytest.approx([0.015] * 400)
    cube = task.simulation.model.shape_names.index("target")
    np.testing.assert_allclose(task.simulation.model.shape_x.numpy()[:, cube], target, atol=1e-7)
    fixed = make(name, 4, seed=1, fixed_target=True).observe()["policy"][:, 12:15]
    assert torch.allclose(fixed, torch.tensor([centre, 0.0, 0.015]).expand(4, 3))


@pytest.mark.parametrize("name", NAMES)
def test_an_action_is_a_share_of_the_torque_and_cut_beyond_the_speed(name):
    task = still(name, 3)
    arm = ARMS[name]
    speed = arm.joints[3].speed
    qd = torch.zeros(3, 6, device=task.device)
    qd[:, 3] = torch.tensor([0.99, 1.01, -1.01]) * speed
    place(task, qd=qd)
    task.apply(torch.full((3, 6), 0.5, device=task.device))
    force = task.views.joint_force
    torque = [0.5 * joint.torque for joint in arm.joints]
    assert force[0].tolist() == pytest.approx(torque)
    assert force[:, 3].tolist() == pytest.approx([torque[3], 0.0, torque[3]])  # it may still brake


def test_torque_is_cut_anew_in_every_physics_step():
    task = still()
    place(task, torch.tensor([[0.0, 0.5, 0.0, 0.0, 0.0, 0.0]]))
    # 4.41 N·m turn 0.0004 kg·m2 beyond 15.7 rad/s in two steps of a millisecond
    result = task.step(torch.tensor([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]))
    speed = float(result.observations["policy"][0, 11])
    limit = RACER3.joints[5].speed
    # one step beyond the limit at the most: without a cut it would be 200 rad/s
    assert limit - 1.0 < speed < limit + 4.41 / 0.00035 * 1e-3


def test_a_displacement_moves_the_grip_along_the_axes():
    task = still(worlds=3, actions=ReachActions.DISPLACEMENT)
    assert task.action_size == 3
    place(task, torch.tensor([[0.0, -0.5, -0.5, 0.0, -0.5, 0.0]]).repeat(3, 1))
    before = task.observe()["policy"][:, 15:18].clone()
    action = torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    for _ in range(6):
        moved = task.step(action).observations["policy"][:, 15:18] - before
    way = moved.norm(dim=1)
    # 12 cm, from which drives lag by some tens of milliseconds at 1 m/s, and give way under the weight by millimetres
    assert way.min() > 0.08
    assert way.max() < 0.13
    along = (moved * action).sum(dim=1)
    assert (along / way).min() > 0.98


def test_without_displacements_the_grip_stays():
    task = still(worlds=2, actions=ReachActions.DISPLACEMENT)
    before = task.observe()["policy"][:, 15:18].clone()
    for _ in range(90):
        result = task.step(idle(task))
    # drives give their whole torque at 0.02 rad: a sixth of that at the shoulder, a third at the elbow, over 0.6 m
    assert (result.observations["policy"][:, 15:18] - before).norm(dim=1).max() < 0.01


# ---- rewards and ends ------------------------------------------------------------------------------------------


def test_the_shaped_reward_is_bounded_and_highest_at_the_target():
    task = still(worlds=64, seed=3)
    generator = torch.Generator().manual_seed(0)
    for _ in range(30):
        result = task.step(2.0 * torch.rand(64, 6, generator=generator) - 1.0)
        assert result.rewards.max() <= 2.0
        assert result.rewards.min() >= -1.4
    reach = task.reach
    task.simulation.set_joint_state(None, np.zeros((64, 6), np.float32), None)
    grip = torch.tensor(RACER3.grip, dtype=torch.float64)
    away = torch.linspace(0.0, 0.5, 64, dtype=torch.float64)
    to_torch(reach.target).copy_(grip + away[:, None] * torch.tensor([0.0, 0.6, 0.8], dtype=torch.float64))
    near = task.rewards()["near"]
    assert near[0] == pytest.approx(2.0, abs=1e-5)
    assert (near[1:] < near[:-1]).all()
    expected = 1.0 - torch.tanh(away / 0.3) + 1.0 / (1.0 + (away / 0.02) ** 2)
    assert near.tolist() == pytest.approx(expected.tolist(), abs=1e-4)


def test_the_thesis_reward_is_as_printed():
    task = still(reward=ReachReward.THESIS)
    action = torch.tensor([[0.1, -0.2, 0.3, 0.05, -0.02, 0.01]])
    result = task.step(action)
    terms = dict(zip(task.reward_terms, result.reward_terms[0].tolist(), strict=True))
    after = result.final_observations["policy"][0]
    d = float((after[12:15] - after[15:18]).norm())
    assert terms["near"] == pytest.approx(1.0 / (d + 1e-4), rel=1e-5)
    assert terms["contact"] == 0.0
    assert terms["fingers"] == 0.0
    assert terms["energy"] == pytest.approx(-0.001 * float((action[0] * after[6:12]).norm()), rel=1e-5)
    assert terms["joint_pos_limits"] == 0.0
    q = torch.zeros(1, 6)
    q[0, 3], q[0, 5] = math.radians(178.5), math.radians(-178.5)
    place(task, q)
    assert task.rewards()["joint_pos_limits"].tolist() == pytest.approx([-4.0])


def test_a_forearm_on_the_ground_ends_the_episode_as_a_failure():
    for reward, price in ((ReachReward.THESIS, -1000.0), (ReachReward.SHAPED, -1.0)):
        task = still(worlds=2, reward=reward)
        q = torch.zeros(2, 6)
        q[0, [1, 2, 4]] = torch.deg2rad(torch.tensor([-94.9, 5.0, 90.0]))
        place(task, q)
        result = task.step(idle(task))
        assert result.terminated.tolist() == [True, False]
        assert not result.success.any()
        assert task.end_reasons[result.end_reason[0]] == "contact"
        terms = dict(zip(task.reward_terms, result.reward_terms[0].tolist(), strict=True))
        assert terms["contact"] == price


def test_fingers_feel_the_cube_and_do_not_end_the_episode():
    task = still(reward=ReachReward.THESIS, actions=ReachActions.DISPLACEMENT)
    for _ in range(70):
        result = task.step(homing(task))
    force = task.simulation.contacts.shape_contact_force
    finger = task.simulation.model.shape_names.index("finger_1")
    pressed = []
    # pushed sideways, a finger meets the cube
    for _ in range(12):
        result = task.step(torch.tensor([[0.0, 0.6, 0.0]]))
        terms = dict(zip(task.reward_terms, result.reward_terms[0].tolist(), strict=True))
        pressed.append((terms["fingers"], float(np.linalg.norm(force.numpy()[0, finger]))))
        assert not result.terminated.any()
    assert min(cost for cost, _ in pressed) < -1.0
    assert pressed[-1][1] > 1.0 or pressed[-1][0] < -1.0


def test_success_is_to_be_near_through_the_last_fifth_of_a_second():
    task = still(worlds=4, actions=ReachActions.DISPLACEMENT, max_episode_steps=80)
    away = torch.tensor([[0.0, 0.0, 1.0]])
    for step in range(80):
        action = homing(task)
        # the second leaves 5 steps before the end, the third is back in time, the fourth never goes
        if step >= 75:
            action[1] = away
        if 45 <= step < 50:
            action[2] = away
        action[3] = 0.0
        result = task.step(action)
    assert result.truncated.all()
    assert result.success.tolist() == [True, False, True, False]
    assert result.metrics["distance"][0] < 0.02
    assert result.metrics["distance"][1] > 0.02
    assert result.metrics["distance"][3] > 0.4


@pytest.mark.parametrize("name", NAMES)
def test_straight_displacements_reach_every_target(name):
    task = make(name, 32, seed=5, actions=ReachActions.DISPLACEMENT)
    for _ in range(100):
        result = task.step(homing(task))
    assert result.success.all()


# ---- worlds ----------------------------------------------------------------------------------------------------


def test_start_is_random_within_its_range():
    task = make("racer3-reach", 300, seed=1)
    seen = task.restart(seed=1)["policy"].clone()
    assert 0.049 < seen[:, 0:6].abs().max() <= 0.05 + 1e-6
    assert not seen[:, 6:12].any()
    assert torch.equal(task.restart(seed=1)["policy"], seen)
    assert torch.equal(make("racer3-reach", 3, seed=1).restart(seed=1)["policy"], seen[:3])


@pytest.mark.parametrize("actions", list(ReachActions))
def test_worlds_do_not_depend_on_how_many_there_are(actions):
    def roll(worlds):
        task = make("racer3-reach", worlds, seed=1, max_episode_steps=10, actions=actions)
        noise = torch.rand(15, 5, task.action_size, generator=torch.Generator().manual_seed(0)) * 2 - 1
        return torch.stack([task.step(a[:worlds]).observations["policy"].clone() for a in noise])

    assert torch.equal(roll(5)[:, :2], roll(2))


@pytest.mark.parametrize("actions", list(ReachActions))
def test_state_dict_continues_exactly(actions):
    task = make("racer3-reach", 3, seed=2, max_episode_steps=20, actions=actions)
    noise = torch.rand(30, 3, task.action_size, generator=torch.Generator().manual_seed(0)) * 0.4 - 0.2
    for action in noise[:13]:
        task.step(action)
    state = task.state_dict()
    expected = [handed_out(task.step(action)) for action in noise[13:]]
    other = make("racer3-reach", 3, seed=9, max_episode_steps=20, actions=actions)
    other.load_state_dict(state)
    for action, before in zip(noise[13:], expected, strict=True):
        assert torch.equal(handed_out(other.step(action)), before)


def test_wrong_settings_are_named():
    with pytest.raises(InputError, match="hold-time must be"):
        make("racer3-reach", hold_time=-0.1)
    with pytest.raises(InputError, match=r"displacement must be .*0\.2.*got 1\.0"):
        make("racer3-reach", displacement=1.0)
    with pytest.raises(InputError, match=r"action-rise-time must be 0 where actions are displacements, got 0\.1"):
        make("irb120-reach", actions=ReachActions.DISPLACEMENT, action_rise_time=0.1)
    with pytest.raises(InputError, match="near must be positive"):
        make("racer3-reach", near=0.0)


# ---- learning --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_policy_reaches(name):
    task = make(name, 32, seed=21)
    source = find_policy(name, SHIPPED / f"{name}.pt")
    result = evaluate(task, network_policy(source.content, task), 32, seed=21)
    assert result.success_rate >= 0.9
    assert result.metrics["distance"] < 0.02


@pytest.mark.slow
def test_it_learns_to_reach_in_minutes(tmp_path):
    run = train("racer3-reach", default_config(Racer3ReachTask), ReachConfig(), root=tmp_path)
    task = make("racer3-reach", 256, seed=11)
    source = find_policy("racer3-reach", Path(run.checkpoint))
    result = evaluate(task, network_policy(source.content, task), 256, seed=11)
    assert result.success_rate >= 0.9


@pytest.mark.slow
def test_what_is_trained_on_one_target_misses_others(tmp_path):
    config = dataclasses.replace(default_config(Racer3ReachTask), iterations=80)
    run = train("racer3-reach", config, ReachConfig(fixed_target=True), root=tmp_path)
    rates = {}
    for fixed in (True, False):
        task = make("racer3-reach", 256, seed=11, fixed_target=fixed)
        source = find_policy("racer3-reach", Path(run.checkpoint))
        rates[fixed] = evaluate(task, network_policy(source.content, task), 256, seed=11).success_rate
    assert rates[True] >= 0.9
    assert rates[False] < 0.5
