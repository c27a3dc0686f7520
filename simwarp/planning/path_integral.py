"""Model predictive path integral control (Williams, Aldrich and Theodorou, 2017, equations 20 to 27): the plan moves to
the mean of its samples, each weighted by exp(-cost / temperature).
"""

from __future__ import annotations

import dataclasses

import torch

from simwarp.core.constraints import Positive
from simwarp.planning.imagination import Cost, EndCost, Imagination
from simwarp.planning.sampled_plans import SampledPlan, SamplingConfig, weighted


@dataclasses.dataclass(frozen=True, kw_only=True)
class MppiConfig(SamplingConfig):
    """Configuration of `Mppi`; horizon, noise and others are those of every planner that samples.

    Attributes:
        temperature: difference in cost by which a sample counts e times less: small ones follow the best sample alone.
    """

    temperature: Positive = 1.0


class Mppi(SampledPlan):
    """Plans by weighted means of samples.

        planner = Mppi(Imagination(real, imagined), cost, MppiConfig(horizon=40, temperature=0.1))
        real.step(planner.plan())

    Args:
        imagination: worlds that try the samples.
        cost: of a control step: takes the imagined task or simulation and the action (N, A), returns (N,).
        config: its numbers.
        end_cost: of where the horizon ends; None: none.
    """

    config: MppiConfig

    def __init__(
        self, imagination: Imagination, cost: Cost, config: MppiConfig | None = None, *, end_cost: EndCost | None = None
    ) -> None:
        super().__init__(imagination, cost, config or MppiConfig(), end_cost=end_cost)

    def _update(self, samples: torch.Tensor, costs: torch.Tensor) -> None:
        best = costs.amin(dim=1, keepdim=True)
        shares = torch.exp((best - costs) / self.config.temperature)
        # where every sample broke down the plan stays, which is the first of them
        stay = torch.zeros_like(shares)
        stay[:, 0] = 1.0
        shares = torch.where(torch.isfinite(best), shares, stay)
        self.knots.copy_(weighted(samples, shares / shares.cumsum(dim=1)[:, -1:]))
