"""Least squares after Levenberg and Marquardt, where one iteration is one batch of points.

A batch holds the next point with its neighbours on both sides in every direction, from which the Jacobian is made of
central differences, and some other points that steps of other damping lead to. If the next point is better, the next
step begins there and its Jacobian is there already. If only another one is better, that becomes the next point.

Differences are taken over about the way that the search still goes: a change of gear that comes a little later moves a
jump of the readings, of which a wide difference tells nothing right close to the end. A last batch at the end takes
them over what the unknowns may be off by, for the covariance.

    search = LevenbergMarquardt(space)
    while not search.done:
        search.tell(residuals_of(search.ask()))

References: Marquardt 1963, "An algorithm for least-squares estimation of nonlinear parameters"; Nocedal and Wright
2006, "Numerical optimization", chapter 10; Huber 1964 for the loss.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

FIRST_DAMPING: Final = 1e-2
LEAST_DAMPING: Final = 1e-9
MOST_DAMPING: Final = 1e9
OTHER_DAMPINGS: Final = (0.1, 10.0, 100.0)
"""Of the steps that are tried beside, over the damping of the next point."""
NARROWER: Final = 0.2
WIDER: Final = 1000.0
"""Factors of the damping after a good step, and after one where none of those tried was better."""
LEAST_DIFFERENCE: Final = 2e-3
"""Change for a difference, over the scale: single precision leaves noise in smaller ones."""
AHEAD: Final = 2.0
"""Change for the next difference over the last step."""
STILL: Final = 1e-5
"""Step of all unknowns, in their scales, below which a search is over."""
QUIET: Final = 3
"""Iterations without a fall of the cost beyond the tolerance after which it is over: differences have noise."""
NEARER: Final = 0.1
"""Least share of an unknown that a step leaves where a bound of zero only keeps its sign: most models have no such
world at zero itself (a mass, a modulus), so that a step to the bound would find nothing."""
LEAST_CURVATURE: Final = 1e-12
"""Over the largest: keeps the damping of unknowns without influence above zero."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchSpace:
    """Where a least cost is looked for.

    Attributes:
        start: (P,) first point.
        low, high: (P,) bounds.
        scale: (P,) changes that are large.
        difference: change for a difference, over the scale.
        tolerance: relative fall of the cost below which a search is over.
        iterations: most of them.
        huber: residual from which on errors count by their size; infinite: all by their square.
        signed: (P,) whether a bound of zero only keeps the sign of an unknown; None: of none.
    """

    start: Array
    low: Array
    high: Array
    scale: Array
    difference: float
    tolerance: float
    iterations: int
    huber: float = math.inf
    signed: npt.NDArray[np.bool_] | None = None

    def inside(self, points: Array) -> Array:
        """Points moved to the bounds where they are beyond."""
        return np.clip(points, self.low, self.high)

    def moved(self, point: Array, step: Array) -> Array:
        """(P,) where a step leads: to the bounds at most, and only nearer to those that keep a sign."""
        found = self.inside(point + step)
        if self.signed is None:
            return found
        return np.where(self.signed & (np.abs(found) < NEARER * np.abs(point)), NEARER * point, found)


def huber_weights(residuals: Array, huber: float) -> Array:
    """Weights of squares that give Huber's loss, 1 below the threshold; residuals that are not there have none."""
    return np.asarray(np.minimum(1.0, huber / np.maximum(np.abs(residuals), 1e-300)))


def cost_of(residuals: Array, huber: float = math.inf) -> Array:
    """Half the sum of squares, or of Huber's loss, along the last axis; infinite where a residual is not finite."""
    size = np.abs(residuals)
    # up to the threshold s²/2, beyond it huber (s - huber / 2): both by the shorter of the two; nan stays nan
    short = np.minimum(size, huber)
    total = (short * (size - 0.5 * short)).sum(axis=-1)
    return np.where(np.isfinite(total), total, math.inf)


class LevenbergMarquardt:
    """One search.

    Args:
        space: where.

    Attributes:
        point: (P,) best one so far.
        cost: at it; infinite before the first batch.
        residuals: (M,) at it.
        jacobian: (M, P) at the best point, or near it: of the last next point that was the best one.
        iteration: number of batches so far.
        done: whether it is over.
        reason: why.
        diverged: points at which a residual was not finite.
    """

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.point = space.inside(np.array(space.start, float))
        self.cost = math.inf
        self.residuals = np.zeros(0)
        self.jacobian = np.zeros((0, len(self.point)))
        self.damping = FIRST_DAMPING
        self.difference = np.full(len(self.point), space.difference)
        self.closing = False
        self.iteration = 0
        self.quiet = 0
        self.diverged = 0
        self.done = False
        self.reason = ""
        self._fresh = False
        """Whether the Jacobian is that of the best point."""
        self._was_fresh = False
        """Whether it was so before the last batch: that one's next point is the end of a step then."""
        self._batch = np.zeros((0, 0))

    @property
    def batch_size(self) -> int:
        """Points of a batch."""
        return 2 * len(self.point) + 1 + len(OTHER_DAMPINGS)

    def ask(self) -> Array:
        """(batch_size, P) points: the next one, its neighbours, and those of other dampings."""
        space = self.space
        if self.closing:
            change = np.diag(self.difference * space.scale)
            self._batch = space.inside(np.concatenate([[self.point], self.point + change, self.point - change]))
            return self._batch.copy()
        steps = [self.damping, *(self.damping * factor for factor in OTHER_DAMPINGS)]
        if self._fresh:
            tried = [space.moved(self.point, self._step(damping)) for damping in steps]
        else:
            tried = [self.point] * len(steps)
        center, others = tried[0], tried[1:]
        change = np.diag(self.difference * space.scale)
        self._batch = space.inside(np.concatenate([[center], center + change, center - change, others]))
        return self._batch.copy()

    def tell(self, residuals: Array) -> None:
        """Take the residuals (batch_size, M) of what was asked; not finite ones count as infinitely bad."""
        if self.closing:
            count = len(self.point)
            self.jacobian = self._differences(residuals[1 : count + 1], residuals[count + 1 :], residuals[0])
            self.iteration += 1
            self.done = True
            return
        costs = cost_of(residuals, self.space.huber)
        self.diverged += int(np.isinf(costs).sum())
        count = len(self.point)
        others = slice(2 * count + 1, None)
        best_other = int(np.argmin(costs[others])) if self._fresh else 0
        other_cost = float(costs[others][best_other]) if self._fresh else math.inf
        before = self.cost
        if costs[0] < before or (not self._fresh and np.isfinite(costs[0]) and costs[0] <= before):
            steps = np.abs((self._batch[0] - self.point) / self.space.scale)
            moved = float(steps.max(initial=0.0))
            self._accept(residuals)
            if self._was_fresh:
                self.difference = np.clip(AHEAD * steps, LEAST_DIFFERENCE, self.space.difference)
            if self._was_fresh and other_cost < self.cost:
                # a step of another damping went further still: that damping is the better one from here
                self.damping *= OTHER_DAMPINGS[best_other]
            elif self._was_fresh:
                self.damping *= NARROWER
            self._judge(before, moved if self._was_fresh else math.inf)
        elif other_cost < before:
            self.point, self.cost = self._batch[others][best_other], other_cost
            self.residuals = residuals[others][best_other]
            self.damping *= OTHER_DAMPINGS[best_other]
            self._fresh = False
            self._judge(before, math.inf)
        else:
            self._refuse(bool(np.isfinite(before)), bool(np.isfinite(costs[0])))
        self.damping = float(np.clip(self.damping, LEAST_DAMPING, MOST_DAMPING))
        self.iteration += 1
        if not self.done and not self.closing and self.iteration >= self.space.iterations:
            self._close("the most iterations were made")

    def _accept(self, residuals: Array) -> None:
        """Go to the next point, whose neighbours give the Jacobian."""
        count = len(self.point)
        plus, minus = residuals[1 : count + 1], residuals[count + 1 : 2 * count + 1]
        self.point, self.residuals = self._batch[0], residuals[0]
        self.cost = float(cost_of(residuals[0], self.space.huber))
        self.jacobian = self._differences(plus, minus, residuals[0])
        self._was_fresh, self._fresh = self._fresh, True

    def _differences(self, plus: Array, minus: Array, middle: Array) -> Array:
        """(M, P) of central differences, one-sided where a neighbour diverged or a bound is near."""
        count = len(self.point)
        found = np.zeros((len(middle), count))
        for index in range(count):
            ahead, behind = self._batch[1 + index], self._batch[1 + count + index]
            rows = [(ahead[index], plus[index]), (behind[index], minus[index])]
            good = [(at, row) for at, row in rows if np.isfinite(row).all() and at != self._batch[0][index]]
            if len(good) == 2:
                found[:, index] = (good[0][1] - good[1][1]) / (good[0][0] - good[1][0])
            elif good:
                found[:, index] = (good[0][1] - middle) / (good[0][0] - self._batch[0][index])
        return found

    def _step(self, damping: float) -> Array:
        """The damped Gauss-Newton step, without unknowns that would leave their bounds."""
        weights = huber_weights(self.residuals, self.space.huber)
        jacobian = self.jacobian * self.space.scale
        normal = jacobian.T @ (weights[:, None] * jacobian)
        gradient = jacobian.T @ (weights * self.residuals)
        free = np.ones(len(gradient), bool)
        for _ in range(len(gradient) + 1):
            step = np.zeros(len(gradient))
            inner = normal[np.ix_(free, free)]
            diagonal = np.diag(inner)
            floor = LEAST_CURVATURE * float(diagonal.max(initial=0.0)) + 1e-300
            damped = inner + damping * np.diag(np.maximum(diagonal, floor))
            step[free] = -np.linalg.lstsq(damped, gradient[free], rcond=None)[0]
            wanted = self.point + self.space.scale * step
            leaving = free & (
                ((self.point <= self.space.low) & (wanted < self.space.low))
                | ((self.point >= self.space.high) & (wanted > self.space.high))
            )
            if not leaving.any():
                break
            free &= ~leaving
        return np.asarray(self.space.scale * step)

    def _judge(self, before: float, moved: float) -> None:
        """Whether a better point ends the search."""
        fall = (before - self.cost) / before if math.isfinite(before) and before > 0.0 else 1.0
        self.quiet = self.quiet + 1 if fall < self.space.tolerance else 0
        if self.cost == 0.0 or moved < STILL:
            self._close("the steps became small")
        elif self.quiet >= QUIET:
            self._close("the cost does not fall any more")

    def _refuse(self, started: bool, finite: bool) -> None:
        """No point of the batch was better; `finite`: the next one did not diverge."""
        if not started:
            self.done, self.reason = True, "the model diverges at the start"
            return
        self.quiet += 1
        self.damping *= WIDER
        if finite:
            # what looked better from afar was not: look closer
            self.difference = np.clip(NARROWER * self.difference, LEAST_DIFFERENCE, None)
            self._fresh = False
        if self.damping > MOST_DAMPING or self.quiet >= QUIET:
            self._close("the cost does not fall any more")

    def _close(self, reason: str) -> None:
        """Let one more batch take the Jacobian over what the unknowns may be off by."""
        self.reason, self.closing = reason, True
        jacobian = self.jacobian * self.space.scale
        freedom = max(1, len(self.residuals) - len(self.point))
        inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-10, hermitian=True)
        deviation = np.sqrt(np.maximum(np.diag(inverse), 0.0) * max(2.0 * self.cost / freedom, 0.0))
        self.difference = np.clip(deviation, LEAST_DIFFERENCE, self.space.difference)

    # ---- to go on later ----------------------------------------------------------------------------------------------

    ARRAYS: Final = ("point", "residuals", "jacobian", "difference")
    NUMBERS: Final = (
        "cost", "damping", "iteration", "quiet", "diverged", "done", "reason", "closing", "_fresh", "_was_fresh"
    )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """All that a search needs to go on, as arrays and plain values."""
        return {name: getattr(self, name) for name in (*self.ARRAYS, *self.NUMBERS)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from `state`."""
        for name in (*self.ARRAYS, *self.NUMBERS):
            setattr(self, name, state[name])
