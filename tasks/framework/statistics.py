"""Counts of what happened in finished episodes, kept on the device for every world and added up once in a while."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import torch

from simwarp.core.object_repr import ReadableFields

from .control_step_kernels import FirstBad, Tally
from .recorded_launches import filled


@dataclasses.dataclass(frozen=True)
class BadValue:
    """The first value of a task that was NaN or infinite while the physics was sound.

    Attributes:
        name: of the reward term or the observation group.
        row: index of the world; of several agents, W * N rows, those of a world beside each other.
        step: control step since the task was built, the first is 1.
        episode: number of the world's episode, the first is 0.
        episode_step: control step of the episode, the first is 1; 0 right after a reset.
    """

    name: str
    row: int
    step: int
    episode: int
    episode_step: int


@dataclasses.dataclass(frozen=True)
class EpisodeSummary(ReadableFields):
    """Sums over the episodes that ended since the last reading."""

    episodes: int
    return_sum: float
    length_sum: float
    terms: dict[str, float]
    """Sum of each reward term over those episodes."""
    end_reasons: dict[str, int]
    """Number of episodes that ended for each reason."""
    successes: int
    """Number of episodes that count as a success."""
    bad_values: dict[str, int]
    """Number of times that a reward term or an observation group held NaN or infinity while the physics was sound."""
    first_bad: BadValue | None = None
    """The first of them."""
    by_model: Mapping[str, EpisodeSummary] = dataclasses.field(default_factory=dict)
    """Those of each model of a mixed batch; empty where there is one model."""

    @property
    def mean_return(self) -> float:
        """Mean over the episodes of their summed rewards, dimensionless; NaN where no episode ended."""
        return self.return_sum / self.episodes if self.episodes else float("nan")


def summed(by_model: Mapping[str, EpisodeSummary]) -> EpisodeSummary:
    """Return the sums over several models, which have the same terms and reasons, with those of each."""
    each = list(by_model.values())

    def added(counts: str) -> dict[str, Any]:
        names = dict.fromkeys(name for one in each for name in getattr(one, counts))
        return {name: sum(getattr(one, counts).get(name, 0) for one in each) for name in names}

    return EpisodeSummary(
        episodes=sum(one.episodes for one in each),
        return_sum=sum(one.return_sum for one in each),
        length_sum=sum(one.length_sum for one in each),
        terms=added("terms"),
        end_reasons=added("end_reasons"),
        successes=sum(one.successes for one in each),
        bad_values=added("bad_values"),
        by_model=dict(by_model),
    )


class EpisodeStatistics:
    """Accumulators of a batch of worlds; no method but :meth:`drain` reads the device.

    Args:
        num_worlds: number of worlds W; of rows of agents, where a world has several.
        terms: names of the reward terms.
        reasons: names of the reasons an episode ends for.
        groups: names of the observation groups.
        device: torch device.

    Attributes:
        running: (W, T) float32, each reward term summed over the running episode.
        bad_groups: (W, groups) int64, steps in which an observation was not finite.
        tally: the accumulators, for the kernel that judges a step.
        bad: the first value that was not finite, for the kernels that look at values.
        values: names of all values that are looked at: terms, then groups.
    """

    def __init__(
        self, num_worlds: int, terms: list[str], reasons: list[str], groups: list[str], device: torch.device
    ) -> None:
        self.terms = terms
        self.reasons = reasons
        self.groups = groups

        def sums(*width: int, dtype: torch.dtype = torch.int64) -> torch.Tensor:
            return torch.zeros(num_worlds, *width, dtype=dtype, device=device)

        self.running = sums(len(terms), dtype=torch.float32)
        self._term_sums = sums(len(terms), dtype=torch.float64)
        self._length_sums = sums()
        self._reason_counts = sums(len(reasons))
        self._successes = sums()
        self._bad_terms = sums(len(terms))
        self.bad_groups = sums(len(groups))
        self.values = [*(f"reward '{term}'" for term in terms), *(f"observation '{group}'" for group in groups)]
        self._seen = torch.zeros(1, dtype=torch.int32, device=device)
        self._bad = {name: sums() for name in ("count", "at", "episode", "steps")} | {"value": sums(dtype=torch.int32)}
        self._bad["at"].fill_(-1)
        self.bad = filled(FirstBad, seen=self._seen, **self._bad)
        self.tally = filled(
            Tally,
            running=self.running,
            term_sums=self._term_sums,
            length_sums=self._length_sums,
            reason_counts=self._reason_counts,
            successes=self._successes,
            bad_terms=self._bad_terms,
        )

    def any_bad(self) -> bool:
        """Return True if a value was not finite since the last :meth:`drain`. This reads one number of the device."""
        return bool(self._seen.item())

    def drain(self) -> EpisodeSummary:
        """Read and clear the sums. This waits for the device."""
        kept = (self._term_sums, self._reason_counts, self._bad_terms, self.bad_groups)
        sums, counts, bad_terms, bad_groups = (each.sum(dim=0).tolist() for each in kept)
        bad = dict(zip(self.values, [*bad_terms, *bad_groups], strict=True))
        summary = EpisodeSummary(
            episodes=sum(counts),
            return_sum=sum(sums),
            length_sum=float(self._length_sums.sum()),
            terms=dict(zip(self.terms, sums, strict=True)),
            end_reasons=dict(zip(self.reasons, counts, strict=True)),
            successes=int(self._successes.sum()),
            bad_values={name: count for name, count in bad.items() if count},
            first_bad=self._first_bad(),
        )
        for tensor in (*kept, self._length_sums, self._successes):
            tensor.zero_()
        return summary

    def _first_bad(self) -> BadValue | None:
        """Read and clear the first value that was not finite."""
        if not self.any_bad():
            return None
        at, episode, steps, value = (self._bad[name].cpu() for name in ("at", "episode", "steps", "value"))
        row = int(torch.where(at < 0, at.max() + 1, at).argmin())
        found = BadValue(self.values[value[row]], row, int(at[row]), int(episode[row]), int(steps[row]))
        self._seen.zero_()
        self._bad["at"].fill_(-1)
        return found
