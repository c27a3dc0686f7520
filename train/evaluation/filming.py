"""Rendered images of a task's worlds, for the pictures and videos of ``simwarp play``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.tasks import Task
from simwarp.tasks.framework.task_camera import TaskCamera
from simwarp.viewer import caption, grid
from simwarp.viewer.sheets import label

Images = npt.NDArray[np.uint8]

_VIDEO_PIXELS = 240_000
_PICTURE_PIXELS = 900_000
_MOMENTS = 6
_PANELS = 24


class Film:
    """Takes rendered images of all worlds of a task, with the lines of its drawing in them.

    Args:
        task: with something to see: bodies, or lines.
        video: of every frame; else of some moments only.

    Raises:
        InputError: the task has neither bodies nor a drawing.
    """

    def __init__(self, task: Task[Any], video: bool) -> None:
        self._moments = 0 if video else max(1, min(_MOMENTS, _PANELS // task.num_worlds))
        panels = task.num_worlds * max(1, self._moments)
        pixels = (_VIDEO_PIXELS if video else _PICTURE_PIXELS) / panels
        width = 2 * round(0.5 * min(640.0, max(96.0, math.sqrt(1.5 * pixels))))
        self._camera = TaskCamera(task, width=width, height=2 * round(width / 3.0), samples=2 if video else 3)

    def take(self, index: int, count: int, time: float) -> Images | None:
        """Images of the present state, frame ``index`` of ``count``; None where none is wanted."""
        if self._moments:
            wanted = {round(place) for place in np.linspace(0, count - 1, self._moments + 1)[1:]}
            if index not in wanted:
                return None
        return self._camera.take(time)


def film_still(images: Images, time: float, title: str) -> Images:
    """All worlds at one moment."""
    worlds = len(images)
    panels = [label(image, f"world {world}") if worlds > 1 else image for world, image in enumerate(images)]
    return caption(grid(panels, math.ceil(math.sqrt(worlds))), f"{title}   t = {time:5.2f} s")


def film_strip(taken: Sequence[tuple[float, Images]], title: str) -> Images:
    """Moments (time, images of all worlds): a row of them for each world."""
    worlds = len(taken[0][1])
    panels = [
        label(images[world], f"world {world}   t = {time:.2f} s" if worlds > 1 else f"t = {time:.2f} s")
        for world in range(worlds)
        for time, images in taken
    ]
    columns = len(taken) if worlds > 1 else math.ceil(len(taken) / 2)
    if len(taken) == 1:
        columns = math.ceil(math.sqrt(worlds))
    return caption(grid(panels, columns), title)
