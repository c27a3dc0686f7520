"""Rendered images of a task's worlds, for the pictures and videos of ``simwarp play``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from matplotlib.colors import to_rgb

from simwarp import WORLD, ModelBuilder, Simulation
from simwarp.sensors import Scene, Visuals
from simwarp.tasks import InputError, Task
from simwarp.viewer import FollowCamera, Polyline, Shot, caption, grid, paint
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
        self._task = task
        self._moments = 0 if video else max(1, min(_MOMENTS, _PANELS // task.num_worlds))
        panels = task.num_worlds * max(1, self._moments)
        pixels = (_VIDEO_PIXELS if video else _PICTURE_PIXELS) / panels
        width = 2 * round(0.5 * min(640.0, max(96.0, math.sqrt(1.5 * pixels))))
        scene = task.scene()
        simulation, scene, shot = stage(task) if scene is None else (task.simulation, scene, task.shot())
        self._studio = FollowCamera(
            simulation, scene, shot, worlds=range(task.num_worlds),
            width=width, height=2 * round(width / 3.0), samples=2 if video else 3, lighting=task.lighting(),
        )  # fmt: skip

    def take(self, index: int, count: int, time: float) -> Images | None:
        """Images of the present state, frame ``index`` of ``count``; None where none is wanted."""
        if self._moments:
            wanted = {round(place) for place in np.linspace(0, count - 1, self._moments + 1)[1:]}
            if index not in wanted:
                return None
        lines = [
            [Polyline(points, to_rgb(line.colour), line.width) for points in line.points.double().cpu().numpy()]
            for line in self._task.drawing().lines
        ]
        return self._studio.take(time, list(zip(*lines, strict=True)))


def stage(task: Task[Any]) -> tuple[Simulation, Scene, Shot]:
    """Bare ground for a task of lines without bodies, and a look at it from above."""
    drawing = task.drawing()
    if not drawing.lines:
        raise InputError(f"task '{task.name}' has nothing to draw; build bodies, or return lines from drawing()")
    builder = ModelBuilder()
    builder.add_body("unseen", mass=1.0, inertia=(1.0, 1.0, 1.0))  # a model needs one
    visuals = Visuals(builder)
    visuals.add_plane(name="ground")
    paint(visuals)
    model = builder.finalize(world_count=task.num_worlds, device=str(task.device))
    points = torch.cat([line.points.reshape(-1, 3) for line in drawing.lines])
    low, high = points.amin(dim=0).tolist(), points.amax(dim=0).tolist()
    if drawing.window is not None:
        (low[0], high[0]), (low[1], high[1]) = drawing.window
    x, y, z = (0.5 * (a + b) for a, b in zip(low, high, strict=True))
    away = 2.0 * max(b - a for a, b in zip(low, high, strict=True))
    shot = Shot(body=WORLD, target=(x, y, z), eye=(0.0, -0.1 * away, max(away, 0.1)))
    return Simulation(model, dt=1.0), visuals.finalize(model), shot


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
