"""A student that learns what a teacher does where the student leads (DAgger: Ross, Gordon and Bagnell 2011)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Final

import torch
from rsl_rl.algorithms import Distillation
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from simwarp.core.constraints import Count, Positive, Whole
from simwarp.tasks.framework.config_values import Settings

from ..config import AugmentationConfig
from ..networks.augmentation import augment_groups
from .learner_thread_pool import LearnerThreads
from .mini_batch_shares import Share, mini_batches_in_shares, share_bounds, share_count
from .threaded_ppo import apply_gradients, sum_in_order

ACTION_LIMIT: Final = 1.0
"""Tasks clip actions to this, so that a teacher that asks for more is not imitated beyond."""


@dataclasses.dataclass(frozen=True)
class DistillationConfig(Settings):
    """Hyperparameters of a student's lessons."""

    prefix: ClassVar[str] = "distillation"

    learning_rate: Positive = 1e-3
    """Step size of Adam at the start; it falls to zero along half a cosine."""
    epochs: Count = 2
    """Passes over each batch."""
    mini_batches: Count = 16
    """Parts of a batch, one optimiser step each."""
    guided: Whole = 10
    """Iterations at the start in which the teacher leads in some of the worlds: in all at first, in ever fewer."""
    max_grad_norm: Positive = 1.0
    """Bound of the gradient's norm."""
    augmentation: AugmentationConfig = dataclasses.field(default_factory=AugmentationConfig)
    """Random changes of the images that the student learns from."""


class ThreadedDistillation(Distillation):
    """rsl-rl's distillation, with mini-batches of a whole rollout shared among threads.

    The student's mean action is fitted in the least squares to what the teacher would have asked for, clipped as the
    task clips it; to ask for more than that limit where the teacher does is no error. Recurrent students learn as in
    rsl-rl, one step after the other, on one thread.
    """

    threads: LearnerThreads | None = None
    """Threads to learn on; None: the caller's alone."""
    guided: float = 0.0
    """Share of the worlds in which the teacher leads."""

    def __init__(
        self, *arguments: Any, num_mini_batches: int = 1, augmentation: AugmentationConfig | None = None,
        **options: Any,
    ) -> None:  # fmt: skip
        super().__init__(*arguments, **options)
        self.num_mini_batches = num_mini_batches
        self.augmentation = augmentation or AugmentationConfig()
        self._led: torch.Tensor | None = None

    def begin_rollout(self, guided: float, learning_rate: float) -> None:
        """Draw the worlds in which the teacher leads.

        Args:
            guided: share of the worlds.
            learning_rate: step size for what is learnt from the rollout.
        """
        self.learning_rate = learning_rate
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate
        # Drawn also where none is led: a resumed run then has the same numbers after it
        self._led = torch.rand(self.storage.num_envs, 1, device=self.device) < guided

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Return the student's actions, drawn, or the teacher's where it leads; keep what the teacher would do."""
        mean = self._in_shares(lambda part: self.student(part), obs)
        told = self._in_shares(lambda part: self.teacher(part), obs).clamp(-ACTION_LIMIT, ACTION_LIMIT)
        policy = self.student.distribution
        policy.update(mean)
        transition = self.transition
        transition.actions = policy.sample()
        if self._led is not None:
            transition.actions = torch.where(self._led, told, transition.actions)
        transition.privileged_actions = told
        transition.observations = obs
        return transition.actions

    def _in_shares(self, function: Callable[[TensorDict], torch.Tensor], obs: TensorDict) -> torch.Tensor:
        """Return a network's results for all rows, which threads share."""
        remembers = self.student.is_recurrent or self.teacher.is_recurrent
        if self.threads is None or remembers:
            return function(obs)
        bounds = share_bounds(len(obs), self._share_count(len(obs)))
        return torch.cat(self.threads.map(lambda first, end: function(obs[first:end]), *bounds))

    def _share_count(self, samples: int) -> int:
        """Return how many shares a batch has."""
        numbers = sum(group[0, 0].numel() for group in self.storage.observations.values())
        parameters = sum(parameter.numel() for parameter in self.student.parameters())
        return share_count(samples, numbers, parameters, 1 if self.threads is None else self.threads.count)

    def update(self) -> dict[str, float]:
        """Learn from the rollout in the storage, clear it, and return the mean squared error."""
        if self.student.is_recurrent:
            losses: dict[str, float] = super().update()
            return losses
        total, steps = 0.0, 0
        for shares in self._shared_batches():
            total += float(self._learn_shared(shares))
            steps += 1
        self.student.update_normalization(self.storage.observations.flatten(0, 1))
        self.storage.clear()
        return {"behavior": total / steps}

    def _shared_batches(self) -> Iterator[list[Share]]:
        storage, parts = self.storage, self.num_mini_batches
        count = self._share_count(storage.num_envs * storage.num_transitions_per_env // parts)
        return mini_batches_in_shares(storage, parts, self.num_learning_epochs, count, recurrent=False)

    def _learn_shared(self, shares: list[Share]) -> torch.Tensor:
        """Take one step on a mini-batch; return its loss."""
        # The deviation of the actions has no part in the squared error, and stays
        parameters = [one for name, one in self.student.named_parameters() if not name.startswith("distribution.")]

        def learn(share: Share, seed: int) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
            loss = share.weight * self._loss(self._changed(share.take(), seed))
            return loss.detach(), torch.autograd.grad(loss, parameters)

        # Drawn here, where the order is sure
        seeds = torch.randint(2**62, (len(shares),)).tolist() if self.augmentation.wanted else [0] * len(shares)
        found = list(map(learn, shares, seeds)) if self.threads is None else self.threads.map(learn, shares, seeds)
        self.optimizer.zero_grad()
        for parameter, *gradients in zip(parameters, *(each for _, each in found), strict=True):
            parameter.grad = sum_in_order(gradients)
        apply_gradients(self, parameters)
        return sum_in_order([loss for loss, _ in found])

    def _changed(self, batch: RolloutStorage.Batch, seed: int) -> RolloutStorage.Batch:
        """Return samples with images changed at random."""
        if self.augmentation.wanted:
            generator = torch.Generator(self.device).manual_seed(seed)
            batch.observations = augment_groups(batch.observations, generator, config=self.augmentation)
        return batch

    def _loss(self, batch: RolloutStorage.Batch) -> torch.Tensor:
        """Return the mean squared error over a share; none where both ask for more than the task grants."""
        asked, told = self.student(batch.observations), batch.privileged_actions
        beyond = asked * told > ACTION_LIMIT * ACTION_LIMIT
        loss: torch.Tensor = torch.where(beyond & (told.abs() == ACTION_LIMIT), 0.0, asked - told).square().mean()
        return loss

    def save(self) -> dict[str, Any]:
        """Return the state of student and optimiser, as a checkpoint of a policy names it."""
        return {
            "actor_state_dict": self._raw_student.state_dict(),
            "optimizer_state_dict": self.optimizer.state_dict(),
        }

    def load(self, loaded_dict: dict[str, Any], load_cfg: dict[str, Any] | None = None, strict: bool = True) -> bool:
        """Take back what `save` returned."""
        self._raw_student.load_state_dict(loaded_dict["actor_state_dict"], strict=strict)
        self.optimizer.load_state_dict(loaded_dict["optimizer_state_dict"])
        return True
