"""The ant: what it observes and is paid for, where an episode ends, what counts as success, and that it learns."""

import dataclasses
import math
from pathlib import Path

import pytest
import torch
from rich.console import Console

from simwarp.core.interop import to_torch
from simwarp.tasks import InputError, make
from simwarp.tasks.locomotion.ant import AntConfig, AntReward, AntTask, Orientation
from simwarp.train.config import default_config
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import find_policy, network_policy
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.training import train


def place(task, *, x=0.0, y=0.0, height=0.45, rotation=(0.0, 0.0, 0.0, 1.0), q=None, velocity=(0.0, 0.0, 0.0)):
    """Put every ant somewhere, its joints as built unless ``q`` says otherwise."""
    state, every = task.simulation.state, torch.ones(task.num_worlds, dtype=torch.bool)
    to_torch(state.body_x)[:, 0] = torch.tensor([x, y, height], dtype=torch.float64)
    to_torch(state.body_rot)[:, 0] = torch.tensor(rotation, dtype=torch.float64)
    zero = torch.zeros(task.num_worlds, 8)
    task.simulation.set_joint_state(every, zero if q is None else q, zero)
    for index in range(task.simulation.model.body_count):
        to_torch(state.body_v)[:, index] = torch.tensor(velocity)
    task.simulation.measure(every)


def idle(task):
    return torch.zeros(task.num_worlds, 8)


def matrix(angles):
    """Rx(a) Ry(b) Rz(c), written out factor by factor."""
    a, b, c = angles
    x = torch.tensor([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    y = torch.tensor([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    z = torch.tensor([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    return x @ y @ z


def turn(angles):
    """The same as a quaternion xyzw, as a product of half-angle quaternions."""

    def product(p, q):
        (a, b, c, d), (e, f, g, h) = p, q
        return (d*e + a*h + b*g - c*f, d*f - a*g + b*h + c*e, d*g + a*f - b*e + c*h, d*h - a*e - b*f - c*g)  # fmt: skip

    parts = []
    for axis, angle in enumerate(angles):
        part = [0.0, 0.0, 0.0, math.cos(0.5 * angle)]
        part[axis] = math.sin(0.5 * angle)
        parts.append(tuple(part))
    return product(product(parts[0], parts[1]), parts[2])


def test_observation_has_its_thirty_entries_in_order():
    task = make("ant", 2, start_angle=0.0, start_rate=0.0)
    angles = (0.2, -0.1, 0.5)
    q = torch.linspace(-0.4, 0.3, 8).repeat(2, 1)
    place(task, y=0.3, height=0.8, rotation=turn(angles), q=q, velocity=(1.0, 2.0, 0.5))
    seen = task.observations()["policy"][0]
    assert seen.shape == (30,)
    assert seen[0] == pytest.approx(0.8)
    assert seen[1:4].tolist() == pytest.approx(angles, abs=1e-5)
    assert seen[4:7].tolist() == pytest.approx((matrix(angles).T @ torch.tensor([1.0, 2.0, 0.5])).tolist(), abs=1e-5)
    assert seen[10:18].tolist() == pytest.approx(q[0].tolist(), abs=1e-4)
    assert seen[26:30].tolist() == [0.0] * 4


def test_observation_options():
    for orientation, size in ((Orientation.EULER, 30), (Orientation.QUATERNION, 31)):
        plain = make("ant", 1, orientation=orientation)
        scaled = make("ant", 1, scaled=True, orientation=orientation)
        assert plain.observation_shapes == {"policy": (size,)}
        for task in (plain, scaled):
            place(task, velocity=(1.0, 0.0, 0.0))
        ratio = plain.observations()["policy"][0, size - 26] / scaled.observations()["policy"][0, size - 26]
        assert ratio == pytest.approx(1.0)
        assert plain.observations()["policy"][0, 0] == pytest.approx(0.4 * scaled.observations()["policy"][0, 0])
    odd = make("ant", 1, lateral=True)
    place(odd, y=-0.7)
    assert odd.observations()["policy"][0, 0] == pytest.approx(-0.7)


def test_feet_feel_the_ground_up_to_the_clip():
    task = make("ant", 1, start_angle=0.0, start_rate=0.0)
    felt = []
    for _ in range(10):
        felt.append(task.step(idle(task)).observations["policy"][0, 26:30].clone())
    forces = torch.stack(felt)
    assert forces.max() == 5.0  # 10 kg on four feet is more than the clip
    assert forces.min() >= 0.0


def test_torso_contact_ends_the_episode_as_a_failure():
    task = make("ant", 2)
    legs_up = torch.tensor([0.0] * 4 + [-1.5] * 4).repeat(2, 1)
    place(task, height=0.249, q=legs_up)
    result = task.step(idle(task))
    assert result.terminated.all()
    assert not result.success.any()
    assert {task.end_reasons[index] for index in result.end_reason} == {"torso_contact"}
    terms = dict(zip(task.reward_terms, result.reward_terms[0].tolist(), strict=True))
    assert terms["alive"] < 0.0


@pytest.mark.parametrize("name", ["walk", "code", "thesis"])
def test_rewards_are_those_of_the_option(name):
    task = make("ant", 1, reward=AntReward(name), start_angle=0.0, start_rate=0.0)
    place(task, height=0.8, velocity=(1.2, 0.5, 0.0))
    action = torch.tensor([[0.2, -0.1, 0.05, 0.0, 0.1, -0.2, 0.05, 0.0]])
    result = task.step(action)
    terms = dict(zip(task.reward_terms, result.reward_terms[0].tolist(), strict=True))
    speed = 1.2
    assert result.final_observations is not None
    power = action * result.final_observations["policy"][:, 18:26]
    if name == "walk":
        assert terms["progress"] == pytest.approx(2.0 * speed, rel=0.1)
        assert terms["alive"] == 0.5
        assert terms["lin_vel_y_l1"] == pytest.approx(-0.25, rel=0.2)
        return
    assert terms["progress"] == pytest.approx(speed, rel=0.1)
    assert terms["alive"] == 1.0
    effort = power.abs().mean() if name == "code" else 30.0 * power.sum()
    assert terms["energy"] == pytest.approx(-0.2 * float(effort), rel=1e-4)


def test_joints_at_their_limits_cost():
    task = make("ant", 1, reward=AntReward.CODE)
    q = torch.zeros(1, 8)
    q[0, 0], q[0, 5] = math.pi / 3.0, -math.pi / 2.0
    place(task, height=0.8, q=q)
    assert task.rewards()["joint_pos_limits"].tolist() == pytest.approx([-1.2])


def test_success_needs_distance_time_line_and_feet():
    task = make("ant", 4, max_episode_steps=5, goal_time=10.0)
    place(task, height=0.6)
    torso = to_torch(task.simulation.state.body_x)
    shift = torch.tensor([[10.5, 0.0], [9.0, 0.0], [10.5, 1.2], [10.5, 0.0]], dtype=torch.float64)
    torso[:, :, :2] += shift.unsqueeze(1)
    torso[3, :, 2] -= 0.36
    to_torch(task.simulation.state.body_v)[3, :, 2] = -2.0
    task.simulation.measure()
    for _ in range(5):
        result = task.step(idle(task))
        if result.terminated[3]:
            assert not result.success[3]
    assert result.truncated[:3].all()
    assert result.success[:3].tolist() == [True, False, False]
    assert result.metrics["distance"][:2].tolist() == pytest.approx([10.5, 9.0], abs=0.05)
    assert result.metrics["lateral_error"][2] == pytest.approx(1.2, abs=0.05)
    late = make("ant", 1, max_episode_steps=5, goal_time=0.02)
    for _ in range(4):
        late.step(idle(late))
    place(late, x=11.0, height=0.6)
    assert not late.step(idle(late)).success.any()


def test_start_is_random_within_its_range_and_above_the_ground():
    task = make("ant", 500, seed=1)
    seen = task.restart(seed=1)["policy"].clone()
    assert 0.09 < seen[:, 3].abs().max() <= 0.1 + 1e-5
    assert 0.09 < seen[:, 10:14].abs().max() <= 0.1 + 1e-5
    assert seen[:, 14:18].max() <= 1e-5
    task.step(idle(task))
    assert to_torch(task.simulation.contacts.penetration).max() < 0.02
    assert torch.equal(task.restart(seed=1)["policy"], seen)
    assert torch.equal(make("ant", 3, seed=1).restart(seed=1)["policy"], seen[:3])


def test_worlds_do_not_depend_on_how_many_there_are():
    def roll(worlds):
        task = make("ant", worlds, seed=1, max_episode_steps=15)
        generator = torch.Generator().manual_seed(0)
        actions = torch.rand(25, 5, 8, generator=generator) * 2 - 1
        return torch.stack([task.step(a[:worlds]).observations["policy"].clone() for a in actions])

    assert torch.equal(roll(5)[:, :2], roll(2))


def test_state_dict_continues_exactly():
    task = make("ant", 3, seed=2, max_episode_steps=20)
    actions = torch.rand(40, 3, 8, generator=torch.Generator().manual_seed(0)) * 2 - 1
    for action in actions[:17]:
        task.step(action)
    state = task.state_dict()
    expected = [task.step(action).observations["policy"].clone() for action in actions[17:]]
    other = make("ant", 3, seed=9, max_episode_steps=20)
    other.load_state_dict(state)
    got = [other.step(action).observations["policy"].clone() for action in actions[17:]]
    assert all(torch.equal(a, b) for a, b in zip(expected, got, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("reward", list(AntReward))
def test_every_reward_can_be_learnt_from(reward, tmp_path):
    config = dataclasses.replace(default_config(AntTask), iterations=16, num_envs=128, device="cpu")
    run = train("ant", config, AntConfig(reward=reward), root=tmp_path, console=Console(quiet=True))
    returns = [float(row["mean_reward"]) for row in read_progress(RunFolder(Path(run.run)).progress)]
    assert sum(returns[-4:]) > sum(returns[:4]) + 8.0


@pytest.mark.slow
def test_it_learns_to_walk_ten_metres_in_minutes(tmp_path):
    run = train("ant", default_config(AntTask), AntConfig(), root=tmp_path)
    task = make("ant", 256, seed=11)
    source = find_policy("ant", Path(run.checkpoint))
    result = evaluate(task, network_policy(source.content, task), 256, seed=11)
    assert result.success_rate >= 0.9
    assert result.metrics["distance"] >= 10.0


def test_wrong_settings_are_named():
    with pytest.raises(InputError, match="torque must be positive"):
        make("ant", torque=0.0)
    with pytest.raises(InputError, match=r"start-angle must be in \[0, 0.5\]"):
        make("ant", start_angle=1.0)
