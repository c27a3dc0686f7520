"""The rsl-rl adapter: above all, that what it hands out is not overwritten by the next step."""

import contextlib
import io

import pytest
import torch
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

import simwarp.tasks as tasks
from simwarp.tasks import Sensing
from simwarp.train.algorithm.vec_env import TaskVecEnv
from simwarp.train.config import TrainConfig, rsl_rl_config

STEPS = 6


class NaiveVecEnv(TaskVecEnv):
    """What one writes first: hands out the task's own buffers."""

    def hand_out(self, groups):
        return TensorDict(dict(groups), batch_size=[self.num_envs])


def runner_over(env):
    config = TrainConfig(num_envs=env.num_envs, steps_per_iteration=STEPS)
    with contextlib.redirect_stdout(io.StringIO()):
        return OnPolicyRunner(env, rsl_rl_config(config, ["policy"]), log_dir=None)


def rollout(env):
    """Roll out as rsl-rl's runner does; what the policy saw, and what was stored."""
    torch.manual_seed(0)
    algorithm = runner_over(env).alg
    seen = []
    with torch.inference_mode():
        observations = env.get_observations()
        for _ in range(STEPS):
            seen.append(observations["policy"].clone())
            actions = algorithm.act(observations)
            observations, rewards, dones, extras = env.step(actions)
            algorithm.process_env_step(observations, rewards, dones, extras)
    return torch.stack(seen), algorithm.storage.observations["policy"]


def test_a_naive_adapter_stores_the_next_observation_in_place_of_this_one():
    # The fast task returns its own buffer, as tasks over simulation memory do: this is what our adapter is for.
    seen, stored = rollout(NaiveVecEnv(tasks.make("fast", 4)))
    assert not torch.equal(seen, stored)
    assert torch.equal(stored[:-1], seen[1:])


def test_our_adapter_stores_what_the_policy_saw():
    seen, stored = rollout(TaskVecEnv(tasks.make("fast", 4)))
    assert torch.equal(seen, stored)


def test_the_stock_runner_learns_through_the_adapter():
    torch.manual_seed(0)
    env = TaskVecEnv(tasks.make("fast", 32))
    runner = runner_over(env)
    before = [parameter.clone() for parameter in runner.alg.actor.parameters()]
    runner.learn(2, init_at_random_ep_len=True)
    after = list(runner.alg.actor.parameters())
    assert any(not torch.equal(a, b) for a, b in zip(before, after, strict=True))


def test_setting_the_episode_length_copies():
    env = TaskVecEnv(tasks.make("fast", 3, max_episode_steps=10))
    clock = env.task.episode_clock
    env.episode_length_buf = torch.tensor([9, 0, 4])
    assert env.episode_length_buf is clock
    assert clock.tolist() == [9, 0, 4]
    _, _, dones, extras = env.step(torch.zeros(3, 2))
    assert dones.tolist() == [True, False, False]
    assert extras["time_outs"].tolist() == [True, False, False]


def test_failures_are_no_time_outs():
    env = TaskVecEnv(tasks.make("fast", 2))
    env.task.load_extra_state({"position": torch.tensor([[5.0, 0.0], [0.0, 0.0]])})
    _, _, dones, extras = env.step(torch.zeros(2, 2))
    assert dones.tolist() == [True, False]
    assert extras["time_outs"].tolist() == [False, False]


def test_log_tensors_are_new_in_every_step():
    env = TaskVecEnv(tasks.make("fast", 2))
    first = env.step(torch.ones(2, 2))[3]["log"]
    kept = {name: float(value) for name, value in first.items()}
    env.step(-torch.ones(2, 2))
    assert {name: float(value) for name, value in first.items()} == kept
    assert set(kept) == {"/reward/near"}


@pytest.mark.parametrize("groups", [1, 2])
def test_every_group_is_a_copy(groups):
    from tests.tasks.framework.samples import counter

    env = TaskVecEnv(counter())
    handed = env.get_observations()
    before = {name: handed[name].clone() for name in ("policy", "camera")[:groups]}
    env.step(torch.zeros(3, 2))
    assert all(torch.equal(handed[name], value) for name, value in before.items())
    assert handed["camera"].dtype == torch.uint8


@pytest.mark.parametrize("name", ["ant", "fast", "pendulum"])
@pytest.mark.parametrize(
    "sensing", [{}, {"policy": Sensing(noise=0.1, bias=0.2, delay=(0, 3))}], ids=["exact", "noisy"]
)
def test_after_resuming_the_first_observation_is_that_of_the_state_taken_over(name, sensing):
    def build(seed):
        return TaskVecEnv(tasks.make(name, 5, seed=seed, max_episode_steps=7, sensing=sensing))

    torch.manual_seed(0)
    left, right = build(1), build(2)
    for _ in range(17):
        left.step(torch.rand(5, left.num_actions) * 2.0 - 1.0)
    expected = left.get_observations()["policy"].clone()
    right.task.load_state_dict(left.task.state_dict())
    right.refresh()
    assert torch.equal(right.get_observations()["policy"], expected)
    # And both go on alike
    actions = torch.rand(5, left.num_actions) * 2.0 - 1.0
    steps = left.step(actions), right.step(actions)
    assert torch.equal(steps[0][0]["policy"], steps[1][0]["policy"])
    assert torch.equal(steps[0][1], steps[1][1])
