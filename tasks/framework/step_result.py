"""Results of a control step, and the one block of memory in which the device writes the small ones."""

from __future__ import annotations

import dataclasses
import math

import torch

from simwarp.core.object_repr import Readable, array_text, plural


@dataclasses.dataclass(frozen=True, repr=False)
class StepResult(Readable):
    """Result of one control step. ``W`` worlds; worlds that ended have already been reset.

    Attributes:
        observations: group name -> (W, ...), of the new episode where one ended. May share memory with the
            simulation: the next step overwrites it, also those before a reset. The adapters hand out clones.
        rewards: (W,) float32, the sum of the terms.
        terminated: (W,) bool, ended by failure or goal: no future reward.
        truncated: (W,) bool, cut off by the clock: the future is unknown, not empty. Never with ``terminated``.
        end_reason: (W,) int64, index into ``Task.end_reasons``; -1 while the episode runs.
        success: (W,) bool, the episode ended and counts as a success.
        non_finite: (W,) bool, the physics of the world broke down in this step.
        reward_terms: (W, T) float32 in the order of ``Task.reward_terms``.
        metrics: name -> (W,), what ``Task.metrics`` said before the reset.
        final_observations: like ``observations``, before the reset; only where ``keep_final_observations``.
        acting: (W, N) bool, of several agents those that were not done before this step; None of single ones.

    Where a world has N > 1 agents, ``(W,)`` above is (W, N). An agent that is done is judged no more: its rewards are
    0 and its ``end_reason`` is -1, until all of its world are done and the world begins anew.
    """

    observations: dict[str, torch.Tensor]
    rewards: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor
    end_reason: torch.Tensor
    success: torch.Tensor
    non_finite: torch.Tensor
    reward_terms: torch.Tensor
    metrics: dict[str, torch.Tensor]
    final_observations: dict[str, torch.Tensor] | None
    acting: torch.Tensor | None = None

    def _readable_title(self) -> str:
        return f": {plural(len(self.rewards), 'world')} on {self.rewards.device}"

    def _readable_rows(self) -> dict[str, str]:
        """Numbers on the CPU; of a GPU, which would have to be waited for, shapes."""
        groups = {"observations": self.observations, "metrics": self.metrics, "before reset": self.final_observations}
        return {
            **self._numbers(),
            **{
                label: ", ".join(f"{name} {array_text(tensor)}" for name, tensor in (group or {}).items())
                for label, group in groups.items()
            },
        }

    def _numbers(self) -> dict[str, str]:
        rewards = self.rewards
        if rewards.device.type != "cpu" or not len(rewards):
            return {"rewards": array_text(rewards), "terms": array_text(self.reward_terms)}
        counts = {
            "terminated": self.terminated, "truncated": self.truncated, "successful": self.success,
            "non-finite": self.non_finite,
        }  # fmt: skip
        return {
            "rewards": f"mean {rewards.mean():.4g}, from {rewards.min():.4g} to {rewards.max():.4g}",
            "ended": ", ".join(f"{int(flags.sum())} {word}" for word, flags in counts.items()),
        }


@dataclasses.dataclass(frozen=True)
class VerdictViews:
    """Views of a block of bytes; see :class:`StepResult` for what they are, in its shapes."""

    end_reason: torch.Tensor
    rewards: torch.Tensor
    reward_terms: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor
    success: torch.Tensor
    non_finite: torch.Tensor

    @classmethod
    def of(cls, block: torch.Tensor, lead: tuple[int, ...], terms: int) -> VerdictViews:
        """Return the views, of first dimensions ``lead``, of a block of :func:`block_size` bytes."""
        worlds = math.prod(lead)
        kinds = [torch.int64, torch.float32, torch.float32] + [torch.bool] * 4
        counts = [worlds, worlds, worlds * terms] + [worlds] * 4
        parts: list[torch.Tensor] = []
        start = 0
        for kind, count in zip(kinds, counts, strict=True):
            after = start + count * kind.itemsize
            parts.append(block[start:after].view(kind).view(lead if len(parts) != 2 else (*lead, terms)))
            start = after
        return cls(*parts)


def block_size(worlds: int, terms: int) -> int:
    """Return the bytes of the small results of all worlds, or of all rows of agents."""
    return worlds * (torch.int64.itemsize + (1 + terms) * torch.float32.itemsize + 4 * torch.bool.itemsize)
