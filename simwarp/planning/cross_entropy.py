"""The cross-entropy method (Rubinstein 1999; de Boer et al. 2005): mean and spread of the samples move to those of the
best few, over a few rounds.
"""

from __future__ import annotations

import dataclasses

import torch

from simwarp.core.constraints import Count, Fraction, NotNegative
from simwarp.core.types import ModelError
from simwarp.planning.imagination import Cost, EndCost, Imagination
from simwarp.planning.sampled_plans import SampledPlan, SamplingConfig, weighted


@dataclasses.dataclass(frozen=True, kw_only=True)
class CrossEntropyConfig(SamplingConfig):
    """Configuration of `CrossEntropy`; horizon, noise and others are those of every planner that samples.

    Attributes:
        iterations: rounds of samples for one plan.
        elites: best samples of a round, by which the next one goes.
        smoothing: share of the old mean and spread that each round keeps.
        least_noise: least standard deviation of samples, in units of the action.
    """

    iterations: Count = 4
    elites: Count = 8
    smoothing: Fraction = 0.1
    least_noise: NotNegative = 0.02


class CrossEntropy(SampledPlan):
    """Plans by the best few of its samples.

    Args:
        imagination: worlds that try the samples.
        cost: of a control step: takes the imagined task or simulation and the action (N, A), returns (N,).
        config: its numbers.
        end_cost: of where the horizon ends; None: none.

    Raises:
        ModelError: there are fewer samples than elites.
    """

    config: CrossEntropyConfig

    def __init__(
        self, imagination: Imagination, cost: Cost, config: CrossEntropyConfig | None = None, *,
        end_cost: EndCost | None = None,
    ) -> None:  # fmt: skip
        super().__init__(imagination, cost, config or CrossEntropyConfig(), end_cost=end_cost)
        if self.config.elites > imagination.samples:
            raise ModelError(
                f"elites must be at most the {imagination.samples} samples of a plan, got {self.config.elites}; "
                "take fewer"
            )

    def _begin(self) -> None:
        self._std = self._noise.expand_as(self.knots).clone()

    def _spread(self) -> torch.Tensor:
        return self._std[:, None]

    def _update(self, samples: torch.Tensor, costs: torch.Tensor) -> None:
        config = self.config
        order = torch.argsort(costs, dim=1, stable=True)[:, : config.elites]
        rank = torch.zeros_like(costs).scatter_(1, order, 1.0)
        # samples that broke down are no elites; where all did, the plan stays
        rank = torch.where(torch.isfinite(costs), rank, 0.0)
        rank[:, 0] += (rank.amax(dim=1) == 0.0).to(rank.dtype)
        shares = rank / rank.cumsum(dim=1)[:, -1:]
        mean = weighted(samples, shares)
        std = weighted((samples - mean[:, None]) ** 2, shares).sqrt()
        self.knots.copy_(config.smoothing * self.knots + (1.0 - config.smoothing) * mean)
        self._std = (config.smoothing * self._std + (1.0 - config.smoothing) * std.float()).clamp(config.least_noise)
