"""skrl trains on a task: PPO, all worlds of one process; needs `pip install 'simwarp[skrl]'`.

Run: python examples/train_skrl.py --task pendulum --worlds 64 --steps 200000
"""

from __future__ import annotations

import argparse
from typing import Any

import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.resources.preprocessors.torch import RunningStandardScaler
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed
from torch import nn

from simwarp.tasks import TaskVectorEnv
from simwarp.tasks.adapters.skrl_adapter import FinalObservations


class TruePPO(FinalObservations, PPO):
    """PPO that values a time-out by the state it cut off."""


def layers(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, 64), nn.ELU(), nn.Linear(64, 64), nn.ELU(), nn.Linear(64, outputs))


class Policy(GaussianMixin, Model):
    """Mean action by a perceptron, one deviation per component."""

    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self, clip_actions=False)
        self.net = layers(self.num_observations, self.num_actions)
        self.log_std = nn.Parameter(torch.zeros(self.num_actions))

    def compute(self, inputs: dict[str, Any], role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        """Return (W, A) mean actions and their log deviation."""
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    """Value by a perceptron."""

    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = layers(self.num_observations, 1)

    def compute(self, inputs: dict[str, Any], role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        """Return (W, 1) values."""
        return self.net(inputs["observations"]), {}


def mean_return(agent: PPO, task: str, worlds: int) -> float:
    """Return the mean return of the first episodes of fresh worlds, with the mean action."""
    env = TaskVectorEnv(task, worlds)
    observations, _ = env.reset(seed=1_000_003)
    total, running = torch.zeros(worlds), torch.ones(worlds)
    while running.any():
        with torch.no_grad():
            _, outputs = agent.act(torch.as_tensor(observations), None, timestep=0, timesteps=0)
        observations, rewards, terminated, truncated, _ = env.step(outputs["mean_actions"].numpy())
        total += running * torch.as_tensor(rewards)
        running *= torch.as_tensor(~(terminated | truncated))
    return float(total.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pendulum")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--steps", type=int, default=200_000, help="environment steps of all worlds")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    set_seed(args.seed)
    env = wrap_env(TaskVectorEnv(args.task, args.worlds, seed=args.seed), verbose=False)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    config = PPO_CFG(
        rollouts=32,
        learning_epochs=5,
        mini_batches=4,
        time_limit_bootstrap=True,
        observation_preprocessor=RunningStandardScaler,
        observation_preprocessor_kwargs={"size": env.observation_space, "device": env.device},
        value_preprocessor=RunningStandardScaler,
        value_preprocessor_kwargs={"size": 1, "device": env.device},
    )
    config.experiment.write_interval = config.experiment.checkpoint_interval = 0
    agent = TruePPO(
        models={"policy": Policy(**spaces), "value": Value(**spaces)},
        memory=RandomMemory(memory_size=config.rollouts, num_envs=args.worlds, device=env.device),
        cfg=config,
        **spaces,
    )
    trainer_config = {"timesteps": args.steps // args.worlds, "headless": True, "disable_progressbar": True}
    trainer = SequentialTrainer(env=env, agents=agent, cfg=trainer_config)

    before = mean_return(agent, args.task, args.worlds)
    trainer.train()
    after = mean_return(agent, args.task, args.worlds)
    print(f"mean return before {before:.1f}, after {args.steps} steps {after:.1f}")


if __name__ == "__main__":
    main()
