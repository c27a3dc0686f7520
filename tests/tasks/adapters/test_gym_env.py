"""Gymnasium over a task: ids, spaces and true final observations."""

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode

from simwarp.tasks import TaskEnv, TaskVectorEnv
from tests.tasks.framework.samples import counter


def test_make_vec_gives_a_same_step_batch():
    env = gym.make_vec("simwarp/Fast-v0", num_envs=3, max_episode_steps=4)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.observation_space.shape == (3, 2)
    assert env.action_space.shape == (3, 2)
    first, info = env.reset(seed=5)
    assert info == {}
    assert first.dtype == np.float32
    assert env.observation_space.contains(first)
    for _ in range(3):
        _, rewards, terminated, truncated, info = env.step(np.zeros((3, 2), np.float32))
        assert not (terminated | truncated).any()
        assert info == {}
    after, rewards, terminated, truncated, info = env.step(np.zeros((3, 2), np.float32))
    assert rewards.shape == (3,)
    assert truncated.all()
    assert not terminated.any()
    assert info["_final_obs"].tolist() == [True] * 3
    # Nothing moved: the true last observation is the first one; what came back belongs to the next episode
    np.testing.assert_array_equal(np.stack(info["final_obs"]), first)
    assert not np.array_equal(after, first)
    assert info["final_info"]["length"].tolist() == [4, 4, 4]
    assert list(info["final_info"]["end_reason"]) == ["time_limit"] * 3
    np.testing.assert_allclose(info["final_info"]["return"], 4 * (1 - np.linalg.norm(first, axis=1)), rtol=1e-5)


def test_final_obs_only_where_an_episode_ended():
    env = TaskVectorEnv("fast", 3)
    env.reset(seed=0)
    env.task.load_extra_state({"position": torch.tensor([[0.0, 0.0], [4.0, 4.0], [0.0, 0.0]])})
    _, _, terminated, truncated, info = env.step(np.zeros((3, 2), np.float32))
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert info["_final_obs"].tolist() == [False, True, False]
    assert info["final_obs"][0] is None
    assert info["final_obs"][1].tolist() == [4.0, 4.0]
    assert bool(info["final_info"]["_return"][1])


def test_kept_observations_do_not_change():
    env = TaskVectorEnv("fast", 2)
    kept, _ = env.reset(seed=0)
    copy = kept.copy()
    env.step(np.ones((2, 2), np.float32))
    np.testing.assert_array_equal(kept, copy)


def test_several_groups_become_a_dict_with_their_dtypes():
    env = TaskVectorEnv(counter())
    observation, _ = env.reset(seed=0)
    assert isinstance(env.single_observation_space, gym.spaces.Dict)
    assert observation["camera"].dtype == np.uint8
    assert env.observation_space.contains(observation)


def test_the_same_seed_gives_the_same_start_and_no_seed_another():
    env = TaskVectorEnv("fast", 4)
    first, _ = env.reset(seed=3)
    second, _ = env.reset()
    again, _ = env.reset(seed=3)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, second)


def test_a_single_world_shows_its_last_observation_and_waits_for_reset():
    env = TaskEnv("fast", max_episode_steps=2)
    start, _ = env.reset(seed=1)
    env.step(np.zeros(2, np.float32))
    last, _, terminated, truncated, info = env.step(np.zeros(2, np.float32))
    assert (terminated, truncated) == (False, True)
    assert info["end_reason"] == "time_limit"
    np.testing.assert_array_equal(last, start)
