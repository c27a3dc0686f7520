"""Lines in world coordinates that pictures and maps of a task show beside its bodies."""

from __future__ import annotations

import dataclasses

import torch


@dataclasses.dataclass(frozen=True)
class Line:
    """One connected line of every world.

    Attributes:
        points: (W, P, 3) float32, vertices in the world frame [m].
        colour: any matplotlib colour.
        width: in pixels of a picture.
        only_maps: it stands for a thing that rendered pictures show anyway, such as the outline of a vehicle.
    """

    points: torch.Tensor
    colour: str = "black"
    width: float = 1.5
    only_maps: bool = False


@dataclasses.dataclass(frozen=True)
class Drawing:
    """Lines of all worlds, such as paths, goals and limits.

    Attributes:
        lines: drawn in order into rendered pictures, and seen from above on maps.
        window: of maps, ((x low, high), (y low, high)) [m]; None: it fits paths and lines.
    """

    lines: tuple[Line, ...] = ()
    window: tuple[tuple[float, float], tuple[float, float]] | None = None
