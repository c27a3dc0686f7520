"""Worlds of several agents with the interface of PettingZoo's parallel environments; others refuse them."""

import numpy as np
import pytest
import torch

from simwarp.tasks import InputError, make
from simwarp.tasks.adapters.gym_env import TaskVectorEnv
from simwarp.tasks.adapters.parallel_env import TaskParallelEnv
from tests.tasks.framework.pair_task import pair


def parallel(**config):
    return TaskParallelEnv(pair(worlds=1, **config))


def test_agents_have_names_spaces_and_values_by_name():
    env = parallel()
    assert env.possible_agents == ["agent_0", "agent_1"]
    assert env.agents == []
    observations, infos = env.reset(seed=3)
    assert env.agents == env.possible_agents
    assert env.num_agents == env.max_num_agents == 2
    assert infos == {"agent_0": {}, "agent_1": {}}
    for agent in env.agents:
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.observation_space(agent).contains(observations[agent])
        assert env.action_space(agent).shape == (1,)
    again, _ = env.reset(seed=3)
    assert all(np.array_equal(observations[agent], again[agent]) for agent in env.agents)
    assert env.metadata["name"] == "pair"
    assert env.metadata["is_parallelizable"]
    assert env.unwrapped is env


def test_agents_leave_one_by_one_and_what_is_told_is_of_those_that_acted():
    env = parallel(start=0.0)
    env.reset(seed=1)
    while env.agents == env.possible_agents:
        told = env.step({"agent_0": [0.0], "agent_1": [1.0]})
    _, rewards, terminations, truncations, infos = told
    assert terminations == {"agent_0": False, "agent_1": True}
    assert truncations == {"agent_0": False, "agent_1": False}
    assert infos == {"agent_0": {}, "agent_1": {"end_reason": "fell"}}
    assert rewards == {"agent_0": 1.0, "agent_1": 1.0}
    while env.agents:
        assert env.agents == ["agent_0"]
        told = env.step({"agent_0": [0.0]})
        assert all(list(values) == ["agent_0"] for values in told)
    _, _, _, truncations, infos = told
    assert truncations == {"agent_0": True}
    assert infos == {"agent_0": {"end_reason": "time_limit"}}
    assert env.step({}) == ({}, {}, {}, {}, {})
    first, _ = env.reset()
    assert list(first) == env.possible_agents


def test_observations_are_copies_and_of_the_end_when_all_are_done():
    env = parallel(start=0.0)
    env.reset()
    kept = env.step({"agent_0": [1.0], "agent_1": [-1.0]})[0]
    before = kept["agent_0"].copy()
    while env.agents:
        last = env.step({agent: [1.0] for agent in env.agents})[0]
    assert np.array_equal(kept["agent_0"], before)
    assert abs(last[next(iter(last))][1]) > 0.4, "the pole that fell, not the one of the next episode"


def test_a_task_of_one_agent_has_one_name():
    env = TaskParallelEnv("pendulum", seed=2)
    observations, _ = env.reset()
    assert list(observations) == ["agent_0"]
    assert observations["agent_0"].shape == (4,)
    assert env.step({"agent_0": [0.5]})[1] == {"agent_0": 1.0}


def test_the_interface_of_pettingzoo_holds():
    testing = pytest.importorskip("pettingzoo.test")
    env = parallel()
    testing.parallel_api_test(env, num_cycles=100)  # it raises what it finds
    assert env.possible_agents == ["agent_0", "agent_1"]


def test_wrong_actions_worlds_and_runners_are_refused_in_one_line():
    env = parallel()
    env.reset()
    with pytest.raises(InputError, match=r"step needs actions of agent_0, agent_1, got no action of agent_1"):
        env.step({"agent_0": [0.0]})
    for wrong in ([0.0, 0.0], 0.0, "left", [None], None):
        with pytest.raises(InputError, match=r"step: action of agent_1 must be \(1,\) numbers in \[-1, 1\], got "):
            env.step({"agent_0": [0.0], "agent_1": wrong})
    with pytest.raises(InputError, match=r"got an action of 'agent_7'"):
        env.step({"agent_0": [0.0], "agent_1": [0.0], "agent_7": [0.0]})
    with pytest.raises(InputError, match=r"task 'pair' has 3 worlds; make it with num_worlds=1"):
        TaskParallelEnv(pair(worlds=3))
    with pytest.raises(InputError, match=r"task 'pair' has 2 agents in each world, and Gymnasium .*TaskParallelEnv"):
        TaskVectorEnv(pair())
    assert TaskVectorEnv(make("pendulum", 2)).num_envs == 2


def test_actions_reach_their_agents():
    env = parallel(start=0.0)
    env.reset()
    env.step({"agent_1": np.array([0.5], np.float32), "agent_0": torch.tensor([-0.25])})
    assert env.task.action.flatten().tolist() == [-0.25, 0.5]
