"""Soil that is pushed aside, once more: a flow around each shape on dense arrays, float64, from the law as stated.

After Project Chrono's SCM (commit 7689fbc, `SCMTerrain.cpp`): what a shape pressed down raises the nodes beside its
patch equally; then Jacobi steps in which neighbours that differ by more than they may exchange an eighth of the excess.
Nothing rises into a shape: a node takes from each neighbour a quarter of the room above it at most, and what could
not rise waits for the next flow. Nothing is exchanged with pressed nodes or beyond the rectangle around the patch.

Arrays are (rows, columns) of nodes; heights are in the world [m].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


class Flow(NamedTuple):
    """Constants: what stays of a difference between neighbours [m], Jacobi steps, nodes beyond those beside a patch."""

    steepest: float
    iterations: int
    propagation: int


def shifted(values: npt.NDArray, row: int, column: int, outside: float) -> npt.NDArray:
    """What each node's neighbour, `row` and `column` on, has."""
    padded = np.pad(values, 1, constant_values=outside)
    rows, columns = values.shape
    return padded[1 + row : 1 + row + rows, 1 + column : 1 + column + columns]


NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0))


def around(patch: Mask, reach: int) -> Mask:
    """The rectangle around a patch, `reach` nodes larger on each side."""
    rows, columns = np.nonzero(patch.any(axis=1))[0], np.nonzero(patch.any(axis=0))[0]
    inside = np.zeros_like(patch)
    inside[
        max(rows[0] - reach, 0) : rows[-1] + reach + 1, max(columns[0] - reach, 0) : columns[-1] + reach + 1
    ] = True  # fmt: skip
    return inside


def erosion_step(level: Array, top: Array, free: Mask, steepest: float) -> Array:
    """What comes to each node in a Jacobi step [m]."""
    change = np.zeros_like(level)
    room = np.maximum(top - level, 0.0)
    for neighbour in NEIGHBOURS:
        theirs, their_room = (shifted(values, *neighbour, 0.0) for values in (level, room))
        open_between = free & shifted(free, *neighbour, False)
        excess = np.maximum(np.abs(theirs - level) - steepest, 0.0) / 8.0
        given = np.where(theirs > level, np.minimum(excess, room / 4.0), -np.minimum(excess, their_room / 4.0))
        change += np.where(open_between, given, 0.0)
    return change


def flow_around(level: Array, low: list[Array], shape: int, amount: float, flow: Flow) -> tuple[Array, float]:
    """Raises after a flow around one shape, and what is left of the amount.

    Args:
        level: of the nodes; infinite where there is no ground.
        low: for each shape its lowest points over the nodes, infinity where it is not.
        shape: whose flow it is.
        amount: sum of the raises that are due [m].
        flow: constants.
    """
    top = np.min(low, axis=0)
    patch = low[shape] < level
    raised = np.zeros_like(level)
    if not patch.any():
        return raised, amount
    inside = around(patch, 1 + flow.propagation)
    free = np.isfinite(level) & (top >= level) & inside
    beside = free & np.any([shifted(patch, *neighbour, False) for neighbour in NEIGHBOURS], axis=0)
    if beside.any() and amount > 0.0:
        raised[beside] = np.minimum(amount / beside.sum(), (top - level)[beside])
    left = amount - float(raised.sum())
    for _ in range(flow.iterations):
        raised += erosion_step(np.where(free, level + raised, 0.0), top, free, flow.steepest)
    return raised, left


def flow_once(level: Array, low: list[Array], amounts: list[float], flow: Flow) -> tuple[Array, list[float]]:
    """Raises after a flow around all shapes, in order, and what is left of each amount."""
    raised, left = np.zeros_like(level), []
    for shape, amount in enumerate(amounts):
        more, rest = flow_around(level + raised, low, shape, amount, flow)
        raised += more
        left.append(rest)
    return raised, left
