"""PPO on a task."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import torch
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from rsl_rl.utils import resolve_callable
from tensordict import TensorDict

from simwarp.tasks import InputError, Task

from ..config import CriticSees, TrainConfig
from ..networks.group_checks import check_groups
from ..networks.symmetric import task_settings
from .acting_rows import ActingRows
from .distributed import Processes
from .kl_penalty import KLPenaltyPPO
from .learner import Learner
from .symmetry import privileged_group, symmetry_settings
from .threaded_ppo import ThreadedPPO, apply_gradients
from .vec_env import TaskVecEnv


class Trainer(Learner):
    """Worlds, an actor, a critic and their optimiser: proximal policy optimisation.

    Args:
        task: the worlds of this process.
        config: the training configuration.
        group: the processes that train together; this one alone by default. They must be connected.
    """

    rate_option: ClassVar[str] = "ppo.learning-rate"
    algorithm: ThreadedPPO

    def __init__(self, task: Task[Any], config: TrainConfig, group: Processes | None = None) -> None:
        torch.manual_seed(config.seed)
        check_groups(
            config.network, task.name, task.observation_shapes, task.observation_dtypes, task.observation_kinds
        )
        task.contract.on_iteration(0)  # the first episodes are as easy as a curriculum begins
        seen = config.network.critic is CriticSees.PRIVILEGED
        env = TaskVecEnv(task, privileged=seen, reward_scale=config.ppo.reward_scale)
        self._acting = ActingRows(config.steps_per_iteration, env.num_envs, env.device) if task.agents > 1 else None
        super().__init__(task, config, env, group)
        if self._acting is not None and (self.algorithm.actor.is_recurrent or self.algorithm.critic.is_recurrent):
            raise InputError(
                f"--network.kind {config.network.kind.value}: task '{task.name}' has {task.agents} agents in each "
                "world, which recurrent networks do not learn from; use a feed-forward one such as mlp"
            )

    def _make_algorithm(self, observations: TensorDict) -> ThreadedPPO:
        settings = task_settings(self.task, self.config, privileged_group(self.task, self.config))
        settings["multi_gpu"] = self.group.rsl_rl()
        settings["algorithm"]["symmetry_cfg"] = symmetry_settings(self.task, self.config)
        kind: Any = resolve_callable(settings["algorithm"]["class_name"])
        made: ThreadedPPO = kind.construct_algorithm(observations, self.env, settings, self.device)
        return made

    @property
    def networks(self) -> Mapping[str, MLPModel]:
        """Actor and critic."""
        return {"actor": self.algorithm.actor, "critic": self.algorithm.critic}

    def _after_step(self, step: int) -> None:
        if self._acting is not None and self.env.acting is not None:
            self._acting.record(step, self.env.acting)

    def _learn(self) -> dict[str, float]:
        rate = self.config.ppo.scheduled_rate(self.iteration / self.config.iterations)
        if rate is not None:
            self.algorithm.learning_rate = rate
            for group in self.algorithm.optimizer.param_groups:
                group["lr"] = rate
        warming = self.iteration < self.config.critic_warmup
        with self._of_acting_agents():
            losses: dict[str, float] = self._warm_critic() if warming else self.algorithm.update()
        return losses

    def _of_acting_agents(self) -> contextlib.AbstractContextManager[None]:
        """Context in which the rollout has no rows of agents that were done before others of their world."""
        if self._acting is None:
            return contextlib.nullcontext()
        return self._acting.alone(self.algorithm, standardise=not self.algorithm.normalize_advantage_per_mini_batch)

    def _warm_critic(self) -> dict[str, float]:
        """Let only the critic learn from the rollout; the actor and its normaliser stay as they are."""
        algorithm, ppo = self.algorithm, self.config.ppo
        total = sum(float(loss) for loss in self._critic_steps())
        algorithm.critic.update_normalization(self.storage.observations.flatten(0, 1))
        self.storage.clear()
        losses = {"value": total / (ppo.mini_batches * ppo.epochs), "surrogate": 0.0, "entropy": 0.0}
        if isinstance(algorithm, KLPenaltyPPO):
            losses |= {"kl": 0.0, "kl_beta": algorithm.penalty.beta, "policy_epochs": 0.0}
        return losses

    def _critic_steps(self) -> Iterator[torch.Tensor]:
        """Let the critic learn from each mini-batch; yield its loss there."""
        algorithm, ppo = self.algorithm, self.config.ppo
        if algorithm.threads is not None:
            for shares in algorithm.shared_batches(ppo.epochs):
                yield algorithm.learn_values(shares, _squared_error)
            return
        for batch in algorithm.batches(ppo.epochs):
            values = algorithm.critic(batch.observations, masks=batch.masks, hidden_state=batch.hidden_states[1])
            loss = _squared_error(batch, values)
            algorithm.optimizer.zero_grad()
            loss.backward()
            apply_gradients(algorithm, algorithm.critic.parameters())
            yield loss.detach()


def _squared_error(batch: RolloutStorage.Batch, values: torch.Tensor) -> torch.Tensor:
    """Return the mean squared error of the critic's values."""
    return (values - batch.returns).square().mean()
