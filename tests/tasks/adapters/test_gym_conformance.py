"""What Gymnasium asks of environments and of vector environments, for every task by its id.

Gymnasium has a checker for single environments. For vector environments it has none: the rules of its own ones
(`gymnasium.vector.SyncVectorEnv` with same-step autoreset) are held to one by one, and its vector wrappers run on top.
"""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from simwarp.tasks import TaskVectorEnv, task_names
from simwarp.tasks.adapters.gym_env import env_id

ARMS = ("irb120-reach", "racer3-reach")
NAMES = [name for name in ("ant", "crane", "fast", "hexapod", "pendulum", *ARMS) if name in task_names()]
WORLDS = 4


@pytest.fixture(autouse=True)
def strict():
    """Warnings of the checkers are failures; that observations have no bounds is meant."""
    with warnings.catch_warnings():
        warnings.filterwarnings("error", category=UserWarning)
        warnings.filterwarnings("error", category=DeprecationWarning, module="gymnasium")
        warnings.filterwarnings("ignore", message=".*Box observation space (min|max)imum value is.*infinity.*")
        yield


def vector(name, **options):
    env = gym.make_vec(env_id(name), num_envs=WORLDS, **options)
    env.action_space.seed(0)
    return env


@pytest.mark.parametrize("name", NAMES)
def test_the_single_world_passes_the_checker(name):
    check_env(gym.make(env_id(name)).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", NAMES)
def test_the_single_world_passes_the_passive_checker_and_the_order_of_calls(name):
    env = gym.make(env_id(name), max_episode_steps=6)
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(20):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            env.reset()
    env.close()


@pytest.mark.parametrize("name", NAMES)
def test_spaces_and_metadata_of_a_vector(name):
    env = vector(name)
    assert isinstance(env.unwrapped, VectorEnv)
    assert env.num_envs == WORLDS
    assert env.spec.id == env_id(name)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.observation_space == batch_space(env.single_observation_space, WORLDS)
    assert env.action_space == batch_space(env.single_action_space, WORLDS)
    single = gym.make(env_id(name))
    assert env.single_observation_space == single.observation_space
    assert env.single_action_space == single.action_space
    env.close()


@pytest.mark.parametrize("name", NAMES)
def test_steps_of_a_vector(name):
    env = vector(name, max_episode_steps=5)
    observation, info = env.reset(seed=1)
    ends = 0
    for _ in range(12):
        assert env.observation_space.contains(observation)
        assert isinstance(info, dict)
        observation, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        assert (rewards.shape, terminated.shape, truncated.shape) == ((WORLDS,),) * 3
        assert np.issubdtype(rewards.dtype, np.floating)
        assert np.isfinite(rewards).all()
        assert (terminated.dtype, truncated.dtype) == (np.bool_, np.bool_)
        assert not (terminated & truncated).any()
        done = terminated | truncated
        ends += done.sum()
        for key in ("final_obs", "final_info"):
            assert (key in info) == done.any()
            if done.any():
                np.testing.assert_array_equal(info[f"_{key}"], done)
        for world in np.flatnonzero(done):
            assert env.single_observation_space.contains(info["final_obs"][world])
    assert ends >= 2 * WORLDS
    env.close()
    env.close()  # twice is allowed


def trajectory(env, seed, actions):
    seen = [env.reset(seed=seed)]
    seen += [env.step(action) for action in actions]
    return seen


@pytest.mark.parametrize("name", NAMES)
def test_a_vector_is_deterministic(name):
    env, other = vector(name, max_episode_steps=5), vector(name, max_episode_steps=5)
    actions = [env.action_space.sample() for _ in range(12)]
    first = trajectory(env, 3, actions)
    assert data_equivalence(first, trajectory(other, 3, actions), exact=True)
    assert data_equivalence(first, trajectory(env, 3, actions), exact=True)  # the seed alone decides, not the past
    assert not data_equivalence(first, trajectory(env, 4, actions))
    start, _ = env.reset(seed=3)
    assert not np.array_equal(start[0], start[1])  # worlds start differently


@pytest.mark.parametrize("name", NAMES)
def test_the_first_world_of_a_vector_is_the_single_one(name):
    single, batch = gym.make(env_id(name)), vector(name)
    actions = [batch.action_space.sample() for _ in range(8)]
    alone = trajectory(single, 7, [action[0] for action in actions])
    together = trajectory(batch, 7, actions)
    np.testing.assert_array_equal(alone[0][0], together[0][0][0])
    for left, right in zip(alone[1:], together[1:], strict=True):
        if left[2] or left[3]:  # the batch shows the next episode from here on
            np.testing.assert_array_equal(left[0], right[4]["final_obs"][0])
            break
        np.testing.assert_array_equal(left[0], right[0][0])
        assert left[1] == right[1][0]
        assert left[2:4] == (right[2][0], right[3][0])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.sweep
def test_gymnasiums_vector_wrappers_run_on_top(name):
    env = RecordEpisodeStatistics(vector(name, max_episode_steps=5))
    env.action_space.seed(0)
    env.reset(seed=0)
    recorded = []
    for _ in range(10):
        *_, info = env.step(env.action_space.sample())
        if "episode" in info:
            facts = info["final_info"]
            mask = info["_episode"]
            np.testing.assert_array_equal(info["episode"]["l"][mask], facts["length"][mask])
            np.testing.assert_allclose(info["episode"]["r"][mask], facts["return"][mask], rtol=1e-5, atol=1e-5)
            recorded.append(mask.sum())
    assert sum(recorded) >= 2 * WORLDS


def test_a_vector_from_a_task_needs_no_registration():
    env = TaskVectorEnv("fast", WORLDS)
    assert env.reset(seed=0)[0].shape == (WORLDS, 2)
