"""Ranges of the stops of joints: what they draw must not cross, which is told once, before anything is drawn."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..framework.errors import InputError
from .randomisation_config import Mode, Range

LIMITS: Final = ("joint_limit_lower", "joint_limit_upper")


@dataclasses.dataclass(frozen=True, kw_only=True)
class DrawnLimits:
    """The stops of one side.

    Attributes:
        spec: how they are drawn; None: they stay as they were built.
        built: (dofs,) [m or rad].
        chosen: (dofs,) bool, those that are drawn.
    """

    spec: Range | None
    built: npt.NDArray[np.float64]
    chosen: npt.NDArray[np.bool_]

    def at(self, share: float, level: float) -> npt.NDArray[np.float64]:
        """Return the stops (dofs,) for a number at this share of the range, at a level of the curriculum."""
        if self.spec is None:
            return self.built
        number = self.spec.low + share * (self.spec.high - self.spec.low)
        value = {
            Mode.SCALE: self.built * number, Mode.ADD: self.built + number, Mode.SET: np.full_like(self.built, number),
        }[Mode(self.spec.mode)]  # fmt: skip
        if self.spec.grows:
            value = self.built + level * (value - self.built)
        return np.where(self.chosen, value, self.built)


def check_limit_ranges(ranges: Mapping[str, Range], limits: Mapping[str, DrawnLimits], model: Any, owner: str) -> None:
    """Refuse ranges whose stops could cross.

    A stop is linear in its number and in the level, so that the nearest stops are at ends of the ranges.

    Args:
        ranges: of both sides, or of one.
        limits: both sides, named as in `LIMITS`.
        model: with the coordinates' names.
        owner: whose joints they are.

    Raises:
        InputError: a lower stop could be above its upper one.
    """
    from simwarp.model.limit_order import coordinate_titles

    lower, upper = (limits[name] for name in LIMITS)
    shares = [(0.0, 0.0), (1.0, 1.0)] if _tied(lower.spec, upper.spec) else [*itertools.product((0.0, 1.0), repeat=2)]
    for level, (below, above) in itertools.product((1.0, 0.0), shares):
        low, high = lower.at(below, level), upper.at(above, level)
        crossed = low > high
        if crossed.any():
            dof = int(np.argmax(crossed))
            name = next(name for name in LIMITS if name in ranges)
            titles = coordinate_titles(model.joint_names, model.joint_dof_start)
            remedy = "narrow the ranges, or give both the same draw" if len(ranges) > 1 else "narrow the range"
            raise InputError(
                f"randomise '{name}': the stops of {titles[dof]} of {owner} could cross, lower "
                f"{low[dof]:g} above upper {high[dof]:g}; {remedy}"
            )


def _tied(one: Range | None, other: Range | None) -> bool:
    """Return True if two ranges use the same random numbers."""
    if one is None or other is None or not one.draw:
        return False
    return (one.draw, one.shared, one.when) == (other.draw, other.shared, other.when)
