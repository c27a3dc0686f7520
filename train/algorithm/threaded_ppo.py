"""rsl-rl's PPO with its mini-batches shared among threads.

Each thread goes forwards and backwards over a share of a mini-batch. Losses are means over samples: those of the
shares, weighted by their samples and summed, are those of the mini-batch, and so are their gradients. One step of the
optimiser follows. Shares are summed in their order, so that learning is reproducible for a given number of threads.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import nn

from .learner_thread_pool import LearnerThreads
from .mini_batch_shares import Share, mini_batches_in_shares, share_bounds, share_count

VALUE, SURROGATE, DIVERGENCE, ENTROPY, MIRROR = range(5)
"""Places in what :meth:`ThreadedPPO.terms` returns; the last one only where a symmetry is used."""
_SMALLEST_RATE: Final = 1e-5
_LARGEST_RATE: Final = 1e-2
_RATE_FACTOR: Final = 1.5
"""Of rsl-rl's adaptive schedule of the learning rate."""

Gradients = tuple[torch.Tensor, ...]


class ThreadedPPO(PPO):
    """PPO on one thread as rsl-rl does it, or on several."""

    threads: LearnerThreads | None = None
    """Threads to learn on; None: the caller's alone."""
    learning_rate: float
    """Step size of Adam, as it is now."""

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Draw actions, and keep what learning needs of them; large observations are shared among the threads too."""
        if self.threads is None or self._remembers():
            actions: torch.Tensor = super().act(obs)
            return actions
        bounds = share_bounds(len(obs), self._share_count(len(obs)))
        found = self.threads.map(lambda first, end: (self.actor(obs[first:end]), self.critic(obs[first:end])), *bounds)
        policy, transition = self.actor.distribution, self.transition
        policy.update(torch.cat([mean for mean, _ in found]))
        transition.actions, transition.values = policy.sample(), torch.cat([values for _, values in found])
        transition.actions_log_prob, transition.distribution_params = policy.log_prob(transition.actions), policy.params
        transition.observations = obs
        return transition.actions

    def _remembers(self) -> bool:
        """True if a network is recurrent."""
        return bool(self.actor.is_recurrent or self.critic.is_recurrent)

    def update(self) -> dict[str, float]:
        """Learn from the rollout in the storage, clear it, and return the mean losses."""
        if self.threads is None:
            losses: dict[str, float] = super().update()
            return losses
        sums = torch.zeros(4 if self.symmetry is None else 5)
        for shares in self.shared_batches(self.num_learning_epochs):
            sums += self._learn_shared(shares)
        self.end_update()
        value, surrogate, _, entropy, *mirror = (sums / (self.num_learning_epochs * self.num_mini_batches)).tolist()
        found = {"value": value, "surrogate": surrogate, "entropy": entropy}
        return found | ({"symmetry": mirror[0]} if mirror else {})

    def end_update(self) -> None:
        """Let the normalisers see the rollout, and clear it."""
        observations = self.storage.observations.flatten(0, 1)
        self.actor.update_normalization(observations)
        self.critic.update_normalization(observations)
        self.storage.clear()

    def batches(self, epochs: int) -> Any:
        """Return the mini-batches of the rollout, as rsl-rl cuts it, over some epochs."""
        if self._remembers():
            return self.storage.recurrent_mini_batch_generator(self.num_mini_batches, epochs)
        return self.storage.mini_batch_generator(self.num_mini_batches, epochs)

    def shared_batches(self, epochs: int) -> Iterator[list[Share]]:
        """Yield the shares of each mini-batch."""
        storage, mini_batches = self.storage, self.num_mini_batches
        count = self._share_count(storage.num_envs * storage.num_transitions_per_env // mini_batches)
        return mini_batches_in_shares(storage, mini_batches, epochs, count, recurrent=self._remembers())

    def _share_count(self, samples: int) -> int:
        """Return how many shares a batch has."""
        assert self.threads is not None
        numbers = sum(group[0, 0].numel() for group in self.storage.observations.values())
        parameters = sum(parameter.numel() for parameter in (*self.actor.parameters(), *self.critic.parameters()))
        return share_count(samples, numbers, parameters, self.threads.count)

    def _learn_shared(self, shares: list[Share]) -> torch.Tensor:
        """Take one step on a mini-batch; return its terms."""
        parameters = [*self.actor.parameters(), *self.critic.parameters()]

        def learn(share: Share) -> tuple[torch.Tensor, Gradients]:
            terms = share.weight * self.terms(share.take())
            weights = terms.new_tensor([self.value_loss_coef, 1.0, 0.0, -self.entropy_coef, *self._mirror_weight()])
            return terms.detach(), torch.autograd.grad(terms, parameters, weights)

        assert self.threads is not None
        found = self.threads.map(learn, shares)
        totals = sum_in_order([terms for terms, _ in found])
        self._follow_divergence(totals[DIVERGENCE])
        self.descend(parameters, [gradients for _, gradients in found])
        return totals

    def _mirror_weight(self) -> list[float]:
        """Return the weight of the mirror loss, where a symmetry is used."""
        if self.symmetry is None:
            return []
        return [self.symmetry.mirror_loss_coeff if self.symmetry.use_mirror_loss else 0.0]

    def learn_values(
        self,
        shares: list[Share],
        loss: Callable[[RolloutStorage.Batch, torch.Tensor], torch.Tensor],
        coefficient: float = 1.0,
    ) -> torch.Tensor:
        """Take one step of the critic alone; return its mean loss over the mini-batch.

        Args:
            shares: shares of the mini-batch.
            loss: function of a share and the critic's values there; it returns the mean over its samples.
            coefficient: weight of the loss.
        """
        parameters = list(self.critic.parameters())

        def learn(share: Share) -> tuple[torch.Tensor, Gradients]:
            batch = share.take()
            error = share.weight * loss(batch, self._values(batch))
            return error.detach(), torch.autograd.grad(coefficient * error, parameters)

        assert self.threads is not None
        found = self.threads.map(learn, shares)
        self.descend(parameters, [gradients for _, gradients in found])
        return sum_in_order([error for error, _ in found])

    def descend(self, parameters: Sequence[nn.Parameter], gradients: Sequence[Gradients]) -> None:
        """Take one step of the optimiser.

        Args:
            parameters: those that learn; the others stay.
            gradients: by share, of each of them.
        """
        self.optimizer.zero_grad()
        for parameter, *shares in zip(parameters, *gradients, strict=True):
            parameter.grad = sum_in_order(shares)
        apply_gradients(self, self.actor.parameters(), self.critic.parameters())

    def terms(self, batch: RolloutStorage.Batch) -> torch.Tensor:
        """Return the means over a share of (4,): value loss, surrogate, divergence of the old policy, entropy.

        (5,) where a symmetry is used: the mirror loss, too. Divergence and entropy are those of the samples as drawn,
        without their mirror images, as in rsl-rl.
        """
        count = batch.observations.batch_size[0]
        if self.symmetry is not None:
            self.symmetry.augment_batch(batch, count)
        value_loss = self.value_loss(batch, self._values(batch))
        policy = self.policy(batch)
        log_ratio = policy.log_prob(batch.actions) - batch.old_actions_log_prob.squeeze(-1)
        surrogate = self.surrogate(torch.exp(log_ratio), batch.advantages.squeeze(-1))
        drawn = batch.old_distribution_params[0].shape[0]
        divergence = self.divergence(policy, batch)
        mirror = [] if self.symmetry is None else [self._mirror_loss(batch, count)]
        return torch.stack([value_loss, surrogate, divergence, policy.entropy[:drawn].mean(), *mirror])

    def _mirror_loss(self, batch: RolloutStorage.Batch, count: int) -> torch.Tensor:
        """Return rsl-rl's mirror loss of a share with ``count`` samples as drawn."""
        loss: torch.Tensor = self.symmetry.compute_loss(self.actor, batch, count)
        return loss

    def policy(self, batch: RolloutStorage.Batch) -> Any:
        """Return the distribution of actions on a share, one of its own: the actor's remembers what it saw last."""
        mean = self.actor(batch.observations, masks=batch.masks, hidden_state=batch.hidden_states[0])
        distribution = copy.copy(self.actor.distribution)
        distribution.update(mean)
        return distribution

    def _values(self, batch: RolloutStorage.Batch) -> torch.Tensor:
        values: torch.Tensor = self.critic(batch.observations, masks=batch.masks, hidden_state=batch.hidden_states[1])
        return values

    def surrogate(self, ratio: torch.Tensor, advantages: torch.Tensor) -> torch.Tensor:
        """Return what stands for the negative gain: the worse of the ratio and the bounded one, times the advantage."""
        bounded = ratio.clamp(1.0 - self.clip_param, 1.0 + self.clip_param)
        return torch.max(-advantages * ratio, -advantages * bounded).mean()

    def divergence(self, policy: Any, batch: RolloutStorage.Batch) -> torch.Tensor:
        """Return the mean KL divergence of the old policy; only the learning rate follows it."""
        with torch.no_grad():
            old = batch.old_distribution_params
            new = tuple(parameter[: len(old[0])] for parameter in policy.params)
            mean: torch.Tensor = policy.kl_divergence(old, new).mean()
        return mean

    def value_loss(self, batch: RolloutStorage.Batch, values: torch.Tensor) -> torch.Tensor:
        """Return the mean squared error of the critic; values may be held near those of before."""
        error = (values - batch.returns).square()
        if self.use_clipped_value_loss:
            near = batch.values + (values - batch.values).clamp(-self.clip_param, self.clip_param)
            error = torch.maximum(error, (near - batch.returns).square())
        return error.mean()

    def _follow_divergence(self, divergence: torch.Tensor) -> None:
        """Move the learning rate by the divergence of the whole mini-batch, in all processes alike."""
        if self.schedule != "adaptive" or self.desired_kl is None:
            return
        mean = divergence.clone()
        if self.is_multi_gpu:
            torch.distributed.all_reduce(mean)
            mean /= self.gpu_world_size
        if mean > 2.0 * self.desired_kl:
            self.learning_rate = max(_SMALLEST_RATE, self.learning_rate / _RATE_FACTOR)
        elif 0.0 < mean < 0.5 * self.desired_kl:
            self.learning_rate = min(_LARGEST_RATE, self.learning_rate * _RATE_FACTOR)
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate


def apply_gradients(algorithm: Any, *parameters: Iterable[nn.Parameter]) -> None:
    """Take one step of an algorithm's optimiser by the gradients that its parameters have, of all processes.

    Args:
        algorithm: of rsl-rl.
        parameters: of one network each: its gradients are bounded together.
    """
    if algorithm.is_multi_gpu:
        algorithm.reduce_parameters()
    for one in parameters:
        nn.utils.clip_grad_norm_(one, algorithm.max_grad_norm)
    algorithm.optimizer.step()


def sum_in_order(terms: Sequence[torch.Tensor]) -> torch.Tensor:
    """Return the sum in the order of the terms."""
    total, *others = terms
    for term in others:
        total = total + term
    return total
