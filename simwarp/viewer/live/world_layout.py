"""Where the shown worlds lie in the page."""

from __future__ import annotations

import enum
import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ROOM = 1.25
"""Distance of neighbours over what they need."""
SMALL = 12.0
"""Fixed things within this extent are taken to belong to one world each [m]."""


class Layout(enum.Enum):
    """How several worlds are shown at once."""

    GRID = "grid"
    """Side by side."""
    OVERLAY = "overlay"
    """All in the scenery of one."""
    ONE = "one"
    """One alone."""


def natural_layout(moving: Array, whole: Array) -> Layout:
    """Side by side what is small; in one place what drives through the same country."""
    size = np.ptp(whole[0], axis=0)[:2].max()
    return Layout.GRID if size <= max(SMALL, 4.0 * np.ptp(moving[0], axis=0)[:2].max()) else Layout.ONE


def offsets(layout: Layout, moving: Array, whole: Array) -> Array:
    """(S, 3) by which worlds are moved from their own coordinates [m].

    Args:
        layout: of the worlds.
        moving: (S, 2, 3) corners of what moves.
        whole: (S, 2, 3) corners of all but endless grounds.
    """
    count = len(moving)
    found = np.zeros((count, 3))
    if layout is not Layout.GRID or count == 1:
        return found
    box = np.stack([np.minimum(moving[:, 0], whole[:, 0]), np.maximum(moving[:, 1], whole[:, 1])], axis=1)
    pitch = ROOM * max(float(np.ptp(box, axis=1)[:, :2].max()), 0.1)
    columns = math.ceil(math.sqrt(count))
    index = np.arange(count)
    found[:, 0] = (index % columns - 0.5 * (columns - 1)) * pitch
    found[:, 1] = -(index // columns - 0.5 * (math.ceil(count / columns) - 1)) * pitch
    return found
