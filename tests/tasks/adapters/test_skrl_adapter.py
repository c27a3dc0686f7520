"""skrl over a task: its agents record the true final observations, and value time-outs by them."""

import numpy as np
import pytest
import torch

from simwarp.tasks import TaskVectorEnv
from tests.tasks.framework.samples import counter

pytest.importorskip("skrl", reason="the extra skrl is not installed")

from skrl.envs.wrappers.torch import wrap_env

from simwarp.tasks.adapters.skrl_adapter import FinalObservations, true_next


class Recorder:
    """Stands for an agent of skrl."""

    def __init__(self, space):
        self.observation_space = space
        self.recorded: list = []

    def record_transition(self, *, next_observations, infos, **rest):
        self.recorded.append((next_observations, infos, rest))


class TrueRecorder(FinalObservations, Recorder):
    pass


def test_the_wrapper_tells_time_outs_from_failures():
    env = wrap_env(TaskVectorEnv("fast", 3, max_episode_steps=2), verbose=False)
    env.reset()
    env.step(torch.zeros(3, 2))
    task = env._env.task
    task.load_extra_state({"position": torch.tensor([[0.5, 0.0], [4.0, 4.0], [0.25, 0.0]])})
    task.episode_clock[2] = 0
    observations, rewards, terminated, truncated, infos = env.step(torch.zeros(3, 2))
    assert rewards.shape == (3, 1)
    assert terminated.flatten().tolist() == [False, True, False]
    assert truncated.flatten().tolist() == [True, False, False]
    agent = TrueRecorder(env.observation_space)
    agent.record_transition(next_observations=observations, infos=infos, rewards=rewards)
    true, _, rest = agent.recorded[0]
    assert true.tolist() == [[0.5, 0.0], [4.0, 4.0], [0.25, 0.0]]
    assert rest == {"rewards": rewards}
    # What the agent acts on next stays the new episodes' first observation
    np.testing.assert_array_equal(observations.numpy(), task.position.numpy())
    assert not torch.equal(observations[0], true[0])


def test_nothing_is_replaced_while_episodes_run():
    env = wrap_env(TaskVectorEnv("fast", 2), verbose=False)
    observations, *_, infos = env.step(torch.zeros(2, 2))
    assert true_next(env.observation_space, observations, infos) is observations


def test_several_groups_are_flattened_as_skrl_does():
    env = wrap_env(TaskVectorEnv(counter()), verbose=False)
    env.reset()
    for _ in range(4):
        running, *_ = env.step(torch.zeros(3, 2))
    observations, _, _, truncated, infos = env.step(torch.zeros(3, 2))
    assert truncated.all()
    assert observations.abs().max() == 0.0
    true = true_next(env.observation_space, observations, infos)
    # Count and every pixel grow by one per step; skrl scales pixels to [0, 1]
    np.testing.assert_allclose(true.numpy(), 1.25 * running.numpy(), rtol=1e-6)


def test_ppo_values_a_time_out_by_the_state_it_cut_off():
    from skrl.agents.torch.ppo import PPO, PPO_CFG
    from skrl.memories.torch import RandomMemory
    from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
    from skrl.trainers.torch import SequentialTrainerCfg

    class TruePPO(FinalObservations, PPO):
        pass

    class Still(GaussianMixin, Model):
        def __init__(self, **spaces):
            Model.__init__(self, **spaces)
            GaussianMixin.__init__(self)
            self.log_std = torch.nn.Parameter(torch.zeros(2))

        def compute(self, inputs, role=""):
            return torch.zeros(len(inputs["observations"]), 2), {"log_std": self.log_std}

    class SumOfObservation(DeterministicMixin, Model):
        def __init__(self, **spaces):
            Model.__init__(self, **spaces)
            DeterministicMixin.__init__(self)
            self.weight = torch.nn.Parameter(torch.ones(1))

        def compute(self, inputs, role=""):
            return self.weight * inputs["observations"].sum(dim=1, keepdim=True), {}

    env = wrap_env(TaskVectorEnv("fast", 2, max_episode_steps=1), verbose=False)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    config = PPO_CFG(rollouts=1, time_limit_bootstrap=True, discount_factor=0.5)
    config.experiment.write_interval = config.experiment.checkpoint_interval = 0
    memory = RandomMemory(memory_size=1, num_envs=2, device=env.device)
    models = {"policy": Still(**spaces), "value": SumOfObservation(**spaces)}
    agent = TruePPO(models=models, memory=memory, cfg=config, **spaces)
    agent.init(trainer_cfg=SequentialTrainerCfg(timesteps=1))
    agent.enable_training_mode(True)
    observations, _ = env.reset()
    with torch.no_grad():
        actions, _ = agent.act(observations, None, timestep=0, timesteps=1)
        after, rewards, terminated, truncated, infos = env.step(actions)
        paid = rewards.clone()
        agent.record_transition(
            observations=observations, states=None, actions=actions, rewards=rewards, next_observations=after,
            next_states=None, terminated=terminated, truncated=truncated, infos=infos, timestep=0, timesteps=1,
        )  # fmt: skip
    assert truncated.all()
    final = torch.as_tensor(np.stack(list(infos["final_obs"])))
    stored = memory.get_tensor_by_name("rewards").view(2, 1)
    torch.testing.assert_close(stored, paid + 0.5 * final.sum(dim=1, keepdim=True))
