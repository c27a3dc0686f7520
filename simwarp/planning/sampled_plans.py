"""What planners that sample have in common: a plan that is kept, shifted, sampled around and tried."""

from __future__ import annotations

import abc
import dataclasses
from typing import Annotated, Any

import torch

from simwarp.core.constraints import As, Count, Positive, Whole
from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError
from simwarp.model.rules import Configuration
from simwarp.planning.action_splines import ActionSpline, Spline
from simwarp.planning.imagination import Cost, EndCost, Imagination


@dataclasses.dataclass(frozen=True, kw_only=True)
class SamplingConfig(Configuration):
    """What planners that sample have in common.

    Attributes:
        horizon: control steps that a plan looks ahead.
        noise: standard deviation of samples, in units of the action: of all actions, or of each.
        knots: numbers by which each action is described over the horizon; None: one per control step.
        spline: of actions between the knots: "hold", "linear" or "cubic".
        iterations: rounds of samples for one plan.
        seed: of the samples.
    """

    horizon: Count = 20
    noise: Positive | tuple[Positive, ...] = 0.5
    knots: Count | None = None
    spline: Annotated[Spline | str, As(Spline)] = Spline.LINEAR
    iterations: Count = 1
    seed: Whole = 0


class SampledPlan(Readable, abc.ABC):
    """A plan for each of R real worlds, improved by samples around it. A subclass has `_update`.

    Args:
        imagination: worlds that try the samples.
        cost: of a control step: takes the imagined task or simulation and the action (N, A), returns (N,).
        end_cost: of where the horizon ends; None: none.
        config: see its class.

    Attributes:
        knots: (R, knots, A) float32, the plan.
        best_cost: (R,) float64, of the best sample of the last round.
    """

    def __init__(
        self, imagination: Imagination, cost: Cost, config: SamplingConfig, *, end_cost: EndCost | None = None
    ) -> None:
        self.imagination, self.config = imagination, config
        self._cost, self._end_cost = cost, end_cost
        device, size = imagination.device, imagination.action_size
        self.spline = ActionSpline(config.horizon, config.knots, Spline(config.spline), device)
        noise = torch.as_tensor(config.noise, dtype=torch.float32, device=device).flatten()
        if len(noise) not in (1, size):
            raise ModelError(f"noise must be one number or {size}, one for each action, got {len(noise)}; name each")
        if imagination.samples < 2:
            raise ModelError(f"samples must be 2 or more, got {imagination.samples}; give the imagination more worlds")
        self._noise = noise.expand(size)
        self._generator = torch.Generator(device)
        self.knots = torch.zeros(imagination.plans, self.spline.knots, size, device=device)
        self.best_cost = torch.zeros(imagination.plans, dtype=torch.float64, device=device)
        self.reset()

    def _readable_title(self) -> str:
        return f": {self.config.horizon} control steps ahead, {self.imagination.samples} samples for each real world"

    @property
    def actions(self) -> torch.Tensor:
        """(R, horizon, A) float32 actions of the plan, within bounds."""
        return self._bounded(self.spline.actions(self.knots))

    def reset(self, knots: torch.Tensor | None = None) -> None:
        """Forgets the plan, and begins the samples anew.

        Args:
            knots: (R, knots, A) or less, to begin with; None: the middle of the bounds.
        """
        middle = 0.5 * (self.imagination.low + self.imagination.high)
        self.knots.copy_(middle if knots is None else knots)
        self._generator.manual_seed(self.config.seed)
        self._fresh = True

    def plan(self) -> torch.Tensor:
        """Plans from the present state of the real worlds, beginning with the last plan one control step on.

        Returns:
            (R, A) float32: what to do in this control step.
        """
        if not self._fresh:
            self.knots.copy_(self.spline.shifted(self.knots))
        self._fresh = False
        self._begin()
        for _ in range(self.config.iterations):
            samples = self._samples()
            costs = self.imagination.costs(self._bounded(self.spline.actions(samples)), self._cost, self._end_cost)
            self.best_cost.copy_(costs.amin(dim=1))
            self._update(samples, costs)
        return self.actions[:, 0].clone()

    def _begin(self) -> None:
        """Called before the rounds of a plan."""

    @abc.abstractmethod
    def _update(self, samples: torch.Tensor, costs: torch.Tensor) -> None:
        """Moves `knots` towards what was good: (R, samples, knots, A) samples and their (R, samples) costs."""

    def _spread(self) -> torch.Tensor:
        """Standard deviations of samples, (..., knots, A)."""
        return self._noise

    def _samples(self) -> torch.Tensor:
        """(R, samples, knots, A) within bounds; the first of each is the plan itself. All plans have the same draws."""
        shape = (1, self.imagination.samples, self.spline.knots, self.imagination.action_size)
        drawn: Any = torch.randn(shape, generator=self._generator, device=self.imagination.device)
        drawn[:, 0] = 0.0
        return self._bounded(self.knots[:, None] + drawn * self._spread())

    def _bounded(self, actions: torch.Tensor) -> torch.Tensor:
        return torch.clamp(actions, self.imagination.low, self.imagination.high)


def weighted(samples: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """(R, knots, A) sums of (R, samples, knots, A) by (R, samples), one after the other: the same bits for any number
    of threads.
    """
    total = torch.zeros_like(samples[:, 0], dtype=torch.float64)
    for sample in range(samples.shape[1]):
        total += weights[:, sample, None, None] * samples[:, sample]
    return total
