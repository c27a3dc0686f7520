"""PPO with a penalty on the KL divergence in place of the clipped ratio.

The policy minimises -E[A r] + beta KL + hinge max(0, KL - 2 target)^2, with the advantage A, the probability ratio r
and the mean KL divergence of the old policy from the new one. After each update beta follows the divergence that came
out; where beta reaches its bounds, the step size follows too (Schulman et al. 2017, section 4; P. Coady's rule for
the step size). The policy stops learning for the rest of an update once the divergence exceeds four times the target;
the critic goes on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import torch
from rsl_rl.storage import RolloutStorage

from simwarp.core.constraints import Positive
from simwarp.tasks import config_from_plain
from simwarp.tasks.framework.config_values import Settings

from .mini_batch_shares import Share
from .threaded_ppo import DIVERGENCE, ENTROPY, SURROGATE, VALUE, ThreadedPPO, apply_gradients, sum_in_order

_BETA_BOUND = 35.0
_BETA_FACTOR = 1.5
_EDGE = 30.0
_STEP_BOUND = 10.0
_STOP = 4.0


@dataclasses.dataclass(frozen=True)
class Penalty(Settings):
    """Weight of the penalty, and the factor on the learning rate."""

    beta: Positive
    multiplier: Positive = 1.0

    def after(self, divergence: float, target: float) -> Penalty:
        """Return the penalty after an update that moved the policy by ``divergence``."""
        beta, multiplier = self.beta, self.multiplier
        if divergence > 2.0 * target:
            beta = min(_BETA_BOUND, _BETA_FACTOR * beta)
            if beta > _EDGE and multiplier > 1.0 / _STEP_BOUND:
                multiplier /= _BETA_FACTOR
        elif divergence < 0.5 * target:
            beta = max(1.0 / _BETA_BOUND, beta / _BETA_FACTOR)
            if beta < 1.0 / _EDGE and multiplier < _STEP_BOUND:
                multiplier *= _BETA_FACTOR
        return Penalty(beta, multiplier)


class KLPenaltyPPO(ThreadedPPO):
    """PPO with another objective.

    Args:
        arguments: of rsl-rl's PPO; ``desired_kl`` is the target.
        beta: weight of the penalty at the start.
        hinge: weight of the squared excess over twice the target.
        options: of rsl-rl's PPO.
    """

    def __init__(self, *arguments: Any, beta: float = 1.0, hinge: float = 50.0, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.penalty = Penalty(beta)
        self.hinge = hinge
        self.base_learning_rate = float(options.get("learning_rate", 1e-3))

    def _divergence(self, batch: RolloutStorage.Batch) -> torch.Tensor:
        """Return the mean KL divergence of the old policy from the one that just ran on ``batch``."""
        # Made under inference_mode, as the advantages are: autograd takes copies only
        old = tuple(parameter.clone() for parameter in batch.old_distribution_params or ())
        return self.actor.get_kl_divergence(old, self.actor.output_distribution_params).mean()

    def _act_again(self, batch: RolloutStorage.Batch) -> None:
        hidden = batch.hidden_states[0]
        self.actor(batch.observations, masks=batch.masks, hidden_state=hidden, stochastic_output=True)

    @torch.no_grad()
    def _divergence_now(self) -> float:
        """Return the divergence over the whole rollout, the same number in all processes."""
        parts = []
        if self.threads is None:
            for batch in self.batches(1):
                self._act_again(batch)
                parts.append(self._divergence(batch))
        else:
            for shares in self.shared_batches(1):
                parts.append(sum_in_order(self.threads.map(self._divergence_of_share, shares)))
        mean = torch.stack(parts).mean()
        if self.is_multi_gpu:
            torch.distributed.all_reduce(mean)
            mean /= self.gpu_world_size
        return float(mean)

    def _divergence_of_share(self, share: Share) -> torch.Tensor:
        """Return what a share adds to the mean divergence of its mini-batch."""
        batch = share.take()
        return share.weight * self.divergence(self.policy(batch), batch)

    def update(self) -> dict[str, float]:
        """Learn from the rollout in the storage, clear it, and return the mean losses."""
        target = self.desired_kl
        divergence, policy_learns, policy_epochs = 0.0, True, 0
        sums = torch.zeros(3, device=self.device)
        for _ in range(self.num_learning_epochs):
            policy_epochs += policy_learns
            for report in self._steps(policy_learns):
                sums += report
            if policy_learns:
                divergence = self._divergence_now()
                policy_learns = divergence <= _STOP * target
        self.penalty = self.penalty.after(divergence, target)
        self.learning_rate = self.base_learning_rate * self.penalty.multiplier
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate
        self.end_update()
        value, surrogate, entropy = (sums / (self.num_learning_epochs * self.num_mini_batches)).tolist()
        return {
            "value": value,
            "surrogate": surrogate,
            "entropy": entropy,
            "kl": divergence,
            "kl_beta": self.penalty.beta,
            "policy_epochs": float(policy_epochs),
        }

    def _steps(self, policy_learns: bool) -> Iterator[torch.Tensor]:
        """Learn from the rollout once; yield value loss, surrogate and entropy of each mini-batch, (3,)."""
        if self.threads is None:
            for batch in self.batches(1):
                yield self._learn(batch, policy_learns)
            return
        for shares in self.shared_batches(1):
            if policy_learns:
                yield self._learn_shared(shares)[[VALUE, SURROGATE, ENTROPY]]
            else:
                report = torch.zeros(3)
                report[0] = self.learn_values(shares, self.value_loss, self.value_loss_coef)
                yield report

    def _learn(self, batch: RolloutStorage.Batch, policy_learns: bool) -> torch.Tensor:
        """Take one step on a mini-batch; return its value loss, surrogate and entropy."""
        values = self.critic(batch.observations, masks=batch.masks, hidden_state=batch.hidden_states[1])
        value_loss = self.value_loss(batch, values)
        loss = self.value_loss_coef * value_loss
        report = torch.zeros(3, device=self.device)
        report[0] = value_loss.detach()
        if policy_learns:
            self._act_again(batch)
            ratio = torch.exp(self.actor.get_output_log_prob(batch.actions) - batch.old_actions_log_prob.squeeze(-1))
            surrogate = -(batch.advantages.clone().squeeze(-1) * ratio).mean()
            divergence = self._divergence(batch)
            entropy = self.actor.output_entropy.mean()
            excess = torch.relu(divergence - 2.0 * self.desired_kl)
            loss = loss + surrogate + self.penalty.beta * divergence + self.hinge * excess.square()
            loss = loss - self.entropy_coef * entropy
            report[1], report[2] = surrogate.detach(), entropy.detach()
        self.optimizer.zero_grad()
        loss.backward()
        apply_gradients(self, self.actor.parameters(), self.critic.parameters())
        return report

    def _learn_shared(self, shares: list[Share]) -> torch.Tensor:
        """Take one step on a mini-batch; return its terms.

        The weight of a divergence beyond twice the target depends on all of it: all shares go forwards, then all back.
        """
        assert self.threads is not None
        terms = self.threads.map(lambda share: share.weight * self.terms(share.take()), shares)
        totals = sum_in_order([term.detach() for term in terms])
        excess = torch.relu(totals[DIVERGENCE] - 2.0 * self.desired_kl)
        weights = torch.empty_like(totals)
        weights[VALUE], weights[SURROGATE], weights[ENTROPY] = self.value_loss_coef, 1.0, -self.entropy_coef
        weights[DIVERGENCE] = self.penalty.beta + 2.0 * self.hinge * excess
        parameters = [*self.actor.parameters(), *self.critic.parameters()]
        self.descend(parameters, self.threads.map(lambda term: torch.autograd.grad(term, parameters, weights), terms))
        return totals

    def surrogate(self, ratio: torch.Tensor, advantages: torch.Tensor) -> torch.Tensor:
        """Return the negative gain: nothing bounds the ratio."""
        return -(advantages * ratio).mean()

    def divergence(self, policy: Any, batch: RolloutStorage.Batch) -> torch.Tensor:
        """Return the mean KL divergence of the old policy, which is learnt from."""
        mean: torch.Tensor = policy.kl_divergence(batch.old_distribution_params, policy.params).mean()
        return mean

    def save(self) -> dict[str, Any]:
        """Return networks, optimiser and the state of the penalty."""
        saved: dict[str, Any] = super().save()
        return saved | {"kl_penalty": dataclasses.asdict(self.penalty)}

    def load(self, loaded_dict: dict[str, Any], load_cfg: dict[str, bool] | None, strict: bool) -> bool:
        """Take back what :meth:`save` returned; a checkpoint of a clipped run has no penalty, which then starts."""
        done: bool = super().load(loaded_dict, load_cfg, strict)
        if load_cfg is None and "kl_penalty" in loaded_dict:
            self.penalty = config_from_plain(Penalty, loaded_dict["kl_penalty"], "kl_penalty")
        return done
