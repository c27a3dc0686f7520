"""Kinds of observation groups: what the numbers of a group are, which decides how a network reads them."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Any, Final


class ObservationKind(enum.Enum):
    """What an observation group of one world is."""

    VECTOR = "vector"
    """(N,): numbers without an order."""
    IMAGE = "image"
    """(height, width, channels): colours, depths, or the range image of a lidar."""
    POINTS = "points"
    """(..., channels): a cloud of points whose order says nothing; all axes but the last one count them."""
    SEQUENCE = "sequence"
    """(length, channels): a row of beams, or what was measured step by step, the oldest first."""

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Return True if a group of this kind may have this shape, without the worlds."""
        return min(shape, default=0) > 0 and len(shape) in _AXES[self]


_AXES: Final = {
    ObservationKind.VECTOR: (1,),
    ObservationKind.IMAGE: (3,),
    ObservationKind.POINTS: (2, 3),
    ObservationKind.SEQUENCE: (2,),
}
_POINT_CHANNELS: Final = (3, 4)
"""Of places, with an intensity or without."""


def kind_of_shape(shape: tuple[int, ...]) -> ObservationKind | None:
    """Return the kind that a group is of, unless its task says another one; None of a shape that no kind has.

    Args:
        shape: of the group, without the worlds.
    """
    if len(shape) == 2:
        return ObservationKind.POINTS if shape[1] in _POINT_CHANNELS else ObservationKind.SEQUENCE
    return {1: ObservationKind.VECTOR, 3: ObservationKind.IMAGE}.get(len(shape))


def kinds_of_groups(
    shapes: Mapping[str, tuple[int, ...]], named: Mapping[str, Any]
) -> dict[str, ObservationKind | None]:
    """Return the kinds of observation groups: those that are named, else those of their shapes.

    Args:
        shapes: group -> shape, without the worlds.
        named: ``observation_kinds`` of the task.
    """
    return {
        name: ObservationKind(named[name]) if name in named else kind_of_shape(shape)
        for name, shape in shapes.items()
    }  # fmt: skip
