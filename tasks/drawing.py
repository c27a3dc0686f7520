"""What a task shows of its worlds until there are cameras: lines in world coordinates."""

from __future__ import annotations

import dataclasses
import enum

import torch


class View(enum.Enum):
    """Plane a line drawing is projected on: (horizontal, vertical) axes of the world frame."""

    SIDE = (0, 2)
    FRONT = (1, 2)
    TOP = (0, 1)


@dataclasses.dataclass(frozen=True)
class Line:
    """One connected line of every world.

    Attributes:
        points: (W, P, 3) float32, vertices in the world frame [m].
        colour: any matplotlib colour.
        width: line width in points.
    """

    points: torch.Tensor
    colour: str = "black"
    width: float = 1.5


@dataclasses.dataclass(frozen=True)
class Drawing:
    """Lines of all worlds and how to look at them.

    Attributes:
        lines: the lines, drawn in order.
        view: projection plane.
        window: ((horizontal low, high), (vertical low, high)) [m]; None follows the lines.
        panel: width of the panel of one world [inch].
    """

    lines: tuple[Line, ...]
    view: View = View.SIDE
    window: tuple[tuple[float, float], tuple[float, float]] | None = None
    panel: float = 2.6
