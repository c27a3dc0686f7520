"""Actions over the horizon as few numbers: values at knots, and a spline between them."""

from __future__ import annotations

import enum
from typing import Any

import numpy as np
import torch
from scipy.interpolate import make_interp_spline

from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError


class Spline(enum.Enum):
    """How actions go from knot to knot."""

    HOLD = "hold"
    LINEAR = "linear"
    CUBIC = "cubic"


class ActionSpline(Readable):
    """A spline of actions through knots that are spread evenly over the horizon.

    Args:
        horizon: control steps.
        knots: values of each action, from the first control step to the last; None: one per control step.
        kind: between the knots.
        device: of torch.

    Attributes:
        horizon, knots: both numbers.

    Raises:
        ModelError: there are more knots than steps, or too few for a cubic spline.
    """

    def __init__(self, horizon: int, knots: int | None, kind: Spline, device: Any) -> None:
        self.horizon, self.knots = horizon, horizon if knots is None else knots
        least = 4 if kind is Spline.CUBIC and knots is not None else 1
        if not least <= self.knots <= horizon:
            raise ModelError(
                f"knots must be from {least} to the horizon's {horizon} steps, got {knots}; leave them out for one each"
            )
        times = np.linspace(0.0, horizon - 1.0, self.knots)
        self._values = torch.as_tensor(_weights(times, np.arange(horizon), kind), device=device)
        later = np.minimum(times + 1.0, horizon - 1.0)
        self._later = torch.as_tensor(_weights(times, later, kind), device=device)

    def _readable_title(self) -> str:
        return f" of {self.knots} knots over {self.horizon} control steps"

    def actions(self, knots: torch.Tensor) -> torch.Tensor:
        """(..., horizon, A) actions of (..., knots, A) values."""
        return knots if self.knots == self.horizon else _mixed(self._values, knots)

    def shifted(self, knots: torch.Tensor) -> torch.Tensor:
        """(..., knots, A) of the plan one control step later: the last value is held."""
        return _mixed(self._later, knots)


def _weights(knots: Any, times: Any, kind: Spline) -> Any:
    """(times, knots) what each knot adds at each time."""
    count = len(knots)
    if count == 1:
        return np.ones((len(times), 1))
    if kind is Spline.HOLD:
        return np.eye(count)[np.searchsorted(knots, times + 1e-9, side="right") - 1]
    degree = 3 if kind is Spline.CUBIC and count > 3 else 1
    return make_interp_spline(knots, np.eye(count), k=degree)(times)


def _mixed(weights: torch.Tensor, knots: torch.Tensor) -> torch.Tensor:
    """Sums of knots one after the other: the same bits for any number of threads."""
    mixed = torch.zeros(*knots.shape[:-2], len(weights), knots.shape[-1], dtype=knots.dtype, device=knots.device)
    for knot in range(weights.shape[1]):
        mixed += weights[:, knot, None].to(knots.dtype) * knots[..., knot : knot + 1, :]
    return mixed
