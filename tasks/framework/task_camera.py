"""Rendered images of a task's worlds: for films, and for whoever asks an environment to render."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from matplotlib.colors import to_rgb

from simwarp import WORLD, ModelBuilder, Simulation
from simwarp.sensors import Scene, Visuals
from simwarp.viewer import FollowCamera, Polyline, Shot, paint

from .errors import InputError
from .task import Task


class TaskCamera:
    """Takes images of all worlds of a task, with the lines of its drawing in them.

    Args:
        task: with something to see: bodies, or lines.
        width, height: of the image of one world [pixels].
        samples: s x s rays per pixel.

    Raises:
        InputError: the task has neither bodies nor a drawing.
    """

    def __init__(self, task: Task[Any], *, width: int, height: int, samples: int) -> None:
        self._task = task
        scene = task.scene()
        simulation, scene, shot = stage(task) if scene is None else (task.simulation, scene, task.shot())
        self._camera = FollowCamera(
            simulation, scene, shot, worlds=range(task.num_worlds), width=width, height=height, samples=samples,
            lighting=task.lighting(),
        )  # fmt: skip

    def take(self, time: float) -> npt.NDArray[np.uint8]:
        """(W, height, width, 3) sRGB of the present state; the camera goes along over ``time``, since the start [s]."""
        lines = [
            [Polyline(points, to_rgb(line.colour), line.width) for points in line.points.double().cpu().numpy()]
            for line in self._task.drawing().lines
        ]
        of_worlds: Sequence[Sequence[Polyline]] = list(zip(*lines, strict=True))
        return self._camera.take(time, of_worlds)

    def cut(self) -> None:
        """Be where the worlds are at once in the next image: new episodes have begun."""
        self._camera.cut()


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
