"""Counts of what happened in finished episodes, kept on the device and read once in a while."""

from __future__ import annotations

import dataclasses

import torch


@dataclasses.dataclass(frozen=True)
class EpisodeSummary:
    """Sums over the episodes that ended since the last reading."""

    episodes: int
    return_sum: float
    length_sum: float
    terms: dict[str, float]
    """Sum of each reward term over those episodes."""
    end_reasons: dict[str, int]
    """Number of episodes that ended for each reason."""
    bad_values: dict[str, int]
    """Number of times that a reward term or an observation group held NaN or infinity while the physics was sound."""

    @property
    def mean_return(self) -> float:
        """Mean over the episodes of their summed rewards, dimensionless; NaN where no episode ended."""
        return self.return_sum / self.episodes if self.episodes else float("nan")


class EpisodeStatistics:
    """Accumulators of a batch of worlds; no method but :meth:`drain` reads the device.

    Args:
        num_worlds: W.
        terms: names of the reward terms.
        reasons: names of the reasons an episode ends for.
        groups: names of the observation groups.
        device: torch device.
    """

    def __init__(
        self, num_worlds: int, terms: list[str], reasons: list[str], groups: list[str], device: torch.device
    ) -> None:
        self.terms = terms
        self.reasons = reasons
        self.groups = groups
        self.running = torch.zeros(num_worlds, len(terms), device=device)
        """(W, T) float32: each reward term summed over the running episode."""
        self._term_sums = torch.zeros(len(terms), dtype=torch.float64, device=device)
        self._length_sum = torch.zeros((), dtype=torch.int64, device=device)
        self._reason_counts = torch.zeros(len(reasons), dtype=torch.int64, device=device)
        self._bad_terms = torch.zeros(len(terms), dtype=torch.int64, device=device)
        self._bad_groups = torch.zeros(len(groups), dtype=torch.int64, device=device)

    def add_rewards(self, terms: torch.Tensor, bad: torch.Tensor) -> None:
        """Add one step: (W, T) reward terms, and (W, T) bool where a term was not finite."""
        self.running += terms
        self._bad_terms += bad.sum(dim=0)

    def add_bad_observations(self, bad: torch.Tensor) -> None:
        """Add (groups,) int64, the number of worlds whose group was not finite."""
        self._bad_groups += bad

    def add_endings(self, ended: torch.Tensor, length: torch.Tensor, first_reason: torch.Tensor) -> None:
        """Add the episodes that end in this step and forget their running sums.

        Args:
            ended: (W,) bool.
            length: (W,) int64, control steps of the running episodes.
            first_reason: (W, R) bool, at most one set per world.
        """
        self._term_sums += torch.where(ended.unsqueeze(1), self.running, 0.0).sum(dim=0)
        self._length_sum += torch.where(ended, length, 0).sum()
        self._reason_counts += first_reason.sum(dim=0)
        self.running.masked_fill_(ended.unsqueeze(1), 0.0)

    def drain(self) -> EpisodeSummary:
        """Read and clear the sums. This waits for the device."""
        counts = self._reason_counts.tolist()
        sums = self._term_sums.tolist()
        bad = dict(zip((f"reward '{t}'" for t in self.terms), self._bad_terms.tolist(), strict=True))
        bad |= dict(zip((f"observation '{g}'" for g in self.groups), self._bad_groups.tolist(), strict=True))
        summary = EpisodeSummary(
            episodes=sum(counts),
            return_sum=sum(sums),
            length_sum=float(self._length_sum.item()),
            terms=dict(zip(self.terms, sums, strict=True)),
            end_reasons=dict(zip(self.reasons, counts, strict=True)),
            bad_values={name: count for name, count in bad.items() if count},
        )
        for tensor in (self._term_sums, self._length_sum, self._reason_counts, self._bad_terms, self._bad_groups):
            tensor.zero_()
        return summary
