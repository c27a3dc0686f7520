"""Stops of joints that a user writes: the lower one must not be above the upper one, in any world."""

from __future__ import annotations

import dataclasses
import weakref
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.arrays import Domain, WritableArray, on_host
from simwarp.core.types import ModelError

Indices: TypeAlias = npt.NDArray[np.integer[Any]]

LOWER: Final = "joint_limit_lower"
UPPER: Final = "joint_limit_upper"


@dataclasses.dataclass(frozen=True, kw_only=True)
class LimitOrder(Domain):
    """Allowed values of the stops on one side: those that do not pass the stops on the other side as they are now.

    Attributes:
        is_lower: the side.
        others: the array of the other side. Each is known to the other one's domain: strong references were a circle.
        rows: of the array: one for all worlds, or one for each.
        worlds, dofs: row and coordinate of every value of the array, or of the slice of it that the domain is for.
        titles: what errors call the coordinates.
    """

    is_lower: bool
    others: weakref.ref[WritableArray]
    rows: int
    worlds: Indices
    dofs: Indices
    titles: tuple[str, ...]

    def check(self, label: str, values: npt.NDArray[Any]) -> None:
        """Raises a ModelError for the first value outside, or beyond the stop on the other side."""
        super().check(label, values)
        array = self.others()
        if array is None:
            return
        others = array.numpy()  # the memory itself, on a host
        row = self._first_met(others)
        bounds = others[row, self.dofs]
        values, bounds = np.broadcast_arrays(values, bounds)
        beyond = values > bounds if self.is_lower else values < bounds
        if not beyond.any():
            return
        place = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        world = self.worlds[place] if self.rows > 1 else row[place]
        where = f"world {world}" if max(self.rows, len(others)) > 1 else "all worlds"
        rule, remedy = ("at most its upper stop", "less") if self.is_lower else ("at least its lower stop", "more")
        raise ModelError(
            f"{label}: {values[place]:g} of {self.titles[self.dofs[place]]} in {where} must be {rule} "
            f"{bounds[place]:g}; give {remedy}, or write {UPPER if self.is_lower else LOWER} first"
        )

    def at(self, shape: tuple[int, ...], key: Any) -> Domain:
        """That of a slice of an array of the given shape."""
        return dataclasses.replace(self, worlds=self.worlds[key], dofs=self.dofs[key])

    def _first_met(self, others: npt.NDArray[Any]) -> Indices:
        """Row of the other side that each value meets first: its own world's, or the nearest of all."""
        if len(others) == 1:
            return np.zeros_like(self.dofs)
        if self.rows > 1:
            return self.worlds
        nearest: Indices = others.argmin(axis=0) if self.is_lower else others.argmax(axis=0)
        return np.asarray(nearest[self.dofs])


def keep_in_order(lower: WritableArray, upper: WritableArray, titles: tuple[str, ...]) -> None:
    """From now on a stop that is written beyond the other one is refused, where that costs no wait for a device.

    Args:
        lower, upper: (1 or W, dofs) of a model.
        titles: of its coordinates.
    """
    if not on_host(lower):
        return
    for array, other in ((lower, upper), (upper, lower)):
        declared = array.domain if array.domain is not None else Domain()
        worlds, dofs = np.indices(array.shape, sparse=True)
        array.domain = LimitOrder(
            least=declared.least, most=declared.most, remedy=declared.remedy, is_lower=array is lower,
            others=weakref.ref(other), rows=array.shape[0], worlds=np.broadcast_to(worlds, array.shape),
            dofs=np.broadcast_to(dofs, array.shape), titles=titles,
        )  # fmt: skip


def crossed_limits(
    lower: WritableArray, upper: WritableArray, titles: tuple[str, ...], world_count: int
) -> dict[int, str]:
    """A line by world for stops that crossed in what nobody checks: views of torch, arrays of a GPU. Waits for it.

    Args:
        lower, upper: (1 or W, dofs) of a model.
        titles: of its coordinates.
        world_count: W.
    """
    shape = (world_count, len(titles))
    low, high = np.broadcast_to(lower.numpy(), shape), np.broadcast_to(upper.numpy(), shape)
    crossed = low > high
    found = {}
    for world in np.nonzero(crossed.any(axis=1))[0].tolist():
        dof = int(np.argmax(crossed[world]))
        found[world] = (
            f"stops of {titles[dof]} crossed: lower {low[world, dof]:g} is above upper {high[world, dof]:g}; "
            "write them in order"
        )
    return found


def coordinate_titles(joint_names: Sequence[str], joint_dof_start: Sequence[int]) -> tuple[str, ...]:
    """What errors call each coordinate of a model: its joint, and which one where that has several."""
    titles = []
    for joint, name in enumerate(joint_names):
        count = joint_dof_start[joint + 1] - joint_dof_start[joint]
        titles += [f"joint '{name}'" + (f" (coordinate {local})" if count > 1 else "") for local in range(count)]
    return tuple(titles)
