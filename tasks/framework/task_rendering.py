"""Rendered images of a task's worlds: for films, and for whoever asks an environment to render."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
        worlds: indices of those that are seen; None: all.
        view: makes another shot of the task's own.
        marks: on the ground, every metre.

    Raises:
        InputError: the task has neither bodies nor a drawing.
    """

    def __init__(
        self, task: Task[Any], *, width: int, height: int, samples: int, worlds: Sequence[int] | None = None,
        view: Callable[[Shot], Shot] | None = None, marks: bool = True,
    ) -> None:  # fmt: skip
        self._task = task
        self._rows = list(range(task.num_worlds) if worlds is None else worlds)
        scene = task.scene()
        simulation, scene, shot = stage(task) if scene is None else (task.simulation, scene, task.shot())
        self._camera = FollowCamera(
            simulation, scene, shot if view is None else view(shot), worlds=self._rows, width=width, height=height,
            samples=samples, lighting=task.lighting(), marks=marks, quiet=True,
        )  # fmt: skip

    def render(self, time: float, below: Sequence[Sequence[Polyline]] = ()) -> npt.NDArray[np.uint8]:
        """Images of the present state.

        Args:
            time: since the start, over which the camera goes along [s].
            below: lines under those of the drawing: of each, one per world that is seen.

        Returns:
            (S, height, width, 3) sRGB of the worlds that are seen.
        """
        lines = list(below)
        for line in self._task.contract.drawing().lines:
            if not line.only_maps:
                points = line.points.double().cpu().numpy()[self._rows]
                lines.append([Polyline(each, to_rgb(line.colour), line.width) for each in points])
        return self._camera.render(time, list(zip(*lines, strict=True)))

    @property
    def follows(self) -> bool:
        """Whether there is a body that the shot is about."""
        return self._camera.follows

    def floors(self, places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(S,) height of the ground below places (S, 3) in the worlds that are seen [m]."""
        return self._camera.floors(places)

    def cut(self) -> None:
        """Be where the worlds are at once in the next image: new episodes have begun."""
        self._camera.cut()


def stage(task: Task[Any]) -> tuple[Simulation, Scene, Shot]:
    """Bare ground for a task of lines without bodies, and a look at it from above.

    A step of the simulation is a control step of the task: nothing moves in it, but it has the time.
    """
    drawing = task.contract.drawing()
    if not drawing.lines:
        raise InputError(f"task '{task.name}' has nothing to draw; build bodies, or return lines from drawing()")
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
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
    return Simulation(model, dt=float(task.config.control_dt)), visuals.finalize(model), shot
