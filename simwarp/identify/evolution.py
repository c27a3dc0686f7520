"""CMA-ES for rough problems, with least squares from the best point on.

The strategy is that of the library `cmaes` (extra `fit`); Hansen 2016, "The CMA evolution strategy: a tutorial". It
needs costs only, so that jumps do not mislead it; the Jacobian that intervals need comes from the least squares behind.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.identify.fit_error import FitError
from simwarp.identify.levenberg_marquardt import LevenbergMarquardt, SearchSpace, cost_of

Array = npt.NDArray[np.float64]


class EvolutionThenLeastSquares:
    """A search by CMA-ES, then by Levenberg and Marquardt.

    Args:
        space: where; the least squares have as many iterations as the evolution.
        seed: of the candidates.
        population: candidates of an iteration; None: the library's choice.

    Attributes: as those of `LevenbergMarquardt`.

    Raises:
        FitError: the library is not installed.
    """

    def __init__(self, space: SearchSpace, *, seed: int, population: int | None) -> None:
        try:
            import cmaes
        except ImportError:
            raise FitError(
                "search.method: cma needs the library cmaes, found none; pip install 'simwarp[fit]', or take lm"
            ) from None
        self.space = space
        start = space.inside(np.array(space.start, float))
        # in scales; bounds that are not there are far away
        bounds = np.stack([(space.low - start) / space.scale, (space.high - start) / space.scale], axis=1)
        self._start, self._bounds = start, np.clip(bounds, -1e6, 1e6)
        self._strategy = cmaes.CMA(
            mean=np.zeros(len(start)), sigma=1.0, bounds=self._bounds, seed=seed, population_size=population
        )  # fmt: skip
        self._rounds: list[Array] = []
        """Costs of the candidates of every iteration: with the seed they tell the strategy's whole state."""
        self._asked: list[Array] = []
        self._polish = LevenbergMarquardt(space)
        self._best, self._best_cost = start, float("inf")
        self._diverged = 0

    @property
    def _evolving(self) -> bool:
        return len(self._rounds) < self.space.iterations and not self._strategy.should_stop()

    @property
    def point(self) -> Array:
        """(P,) best one so far."""
        return self._polish.point if np.isfinite(self._polish.cost) else self._best

    @property
    def cost(self) -> float:
        """At the best point."""
        return min(self._polish.cost, self._best_cost)

    @property
    def residuals(self) -> Array:
        """At the best point, once the least squares have begun."""
        return self._polish.residuals

    @property
    def jacobian(self) -> Array:
        """Of the least squares."""
        return self._polish.jacobian

    @property
    def iteration(self) -> int:
        """Batches so far."""
        return len(self._rounds) + self._polish.iteration

    @property
    def diverged(self) -> int:
        """Points whose residuals were not finite."""
        return self._diverged + self._polish.diverged

    @property
    def done(self) -> bool:
        """Whether the least squares are over."""
        return self._polish.done

    @property
    def reason(self) -> str:
        """Why."""
        return self._polish.reason

    def ask(self) -> Array:
        """Points of the next batch."""
        if not self._evolving:
            return self._polish.ask()
        self._asked = [self._strategy.ask() for _ in range(self._strategy.population_size)]
        points = [self._start + self.space.scale * each for each in self._asked]
        # the start itself is the first candidate to beat
        return np.array([self._best, *points])

    def tell(self, residuals: Array) -> None:
        """Take the residuals of what was asked."""
        if not self._evolving:
            self._polish.tell(residuals)
            return
        costs = cost_of(residuals, self.space.huber)
        self._diverged += int(np.isinf(costs).sum())
        if costs[0] < self._best_cost:
            self._best_cost = float(costs[0])
        self._update(costs[1:])
        best = int(np.argmin(costs[1:]))
        if costs[1 + best] < self._best_cost:
            self._best_cost = float(costs[1 + best])
            self._best = np.asarray(self._start + self.space.scale * self._asked[best])
        if not self._evolving:
            self._polish.point = self._best.copy()

    def _update(self, costs: Array) -> None:
        """Tell the strategy; what diverged is worse than all that did not."""
        finite = costs[np.isfinite(costs)]
        worst = 10.0 * float(finite.max()) + 1.0 if finite.size else 1e30
        self._strategy.tell(
            [(each, cost if np.isfinite(cost) else worst) for each, cost in zip(self._asked, costs, strict=True)]
        )
        self._rounds.append(costs)

    def state(self) -> dict[str, Any]:
        """All that a search needs to go on, as arrays and plain values."""
        inner = {f"polish.{name}": value for name, value in self._polish.state().items()}
        own = {"rounds": np.array(self._rounds), "best": self._best, "best_cost": self._best_cost}
        return {**own, "evolution_diverged": self._diverged, **inner}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from `state`: the strategy takes the same costs again, which brings it to the same point."""
        for costs in state["rounds"]:
            self._asked = [self._strategy.ask() for _ in range(self._strategy.population_size)]
            self._update(costs)
        self._best, self._best_cost = state["best"], float(state["best_cost"])
        self._diverged = int(state["evolution_diverged"])
        own = {name.removeprefix("polish."): value for name, value in state.items() if name.startswith("polish.")}
        self._polish.restore(own)
