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
    """Takes images of worlds of a task, with the lines of its drawing in them.

    Args:
        task: with something to see: bodies, or lines.
        width, height: of the image of one world [pixels].
        samples: s x s rays per pixel.
        worlds: indices of those that are seen; None: all.
        view: makes another shot of the task's own.
        marks: on the ground, every metre.
        sparing: plain parts of the images get fewer rays; for films.

    Raises:
        InputError: the task has neither bodies nor a drawing.
    """

    def __init__(
        self, task: Task[Any], *, width: int, height: int, samples: int, worlds: Sequence[int] | None = None,
        view: Callable[[Shot], Shot] | None = None, marks: bool = True, sparing: bool = False,
    ) -> None:  # fmt: skip
        seen = list(range(task.num_worlds) if worlds is None else worlds)
        self._cameras: list[tuple[list[int], _ModelCamera]] = []
        for group in task.model_groups:
            places = [place for place, world in enumerate(seen) if group.rows.start <= world < group.rows.stop]
            if places:
                rows = [seen[place] - group.rows.start for place in places]
                camera = _ModelCamera(group.task, rows, (width, height), samples, view, marks, sparing)
                self._cameras.append((places, camera))

    def render(self, time: float, below: Sequence[Sequence[Polyline]] = ()) -> npt.NDArray[np.uint8]:
        """Images of the present state.

        Args:
            time: since the start, over which the camera goes along [s].
            below: lines under those of the drawing: of each, one per world that is seen.

        Returns:
            (S, height, width, 3) sRGB of the worlds that are seen.
        """
        return self._in_order(
            lambda camera, places: camera.render(time, [[line[place] for place in places] for line in below])
        )

    @property
    def follows(self) -> bool:
        """Whether there is a body that the shot is about."""
        return any(camera.camera.follows for _, camera in self._cameras)

    def floors(self, places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(S,) height of the ground below places (S, 3) in the worlds that are seen [m]."""
        return self._in_order(lambda camera, rows: camera.camera.floors(places[rows]))

    def cut(self) -> None:
        """Be where the worlds are at once in the next image: new episodes have begun."""
        for _, camera in self._cameras:
            camera.camera.cut()

    def _in_order(self, look: Callable[[_ModelCamera, list[int]], npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """Return what the cameras of the models return for their worlds, in the order in which these are seen."""
        found = np.concatenate([look(camera, places) for places, camera in self._cameras])
        return found[np.argsort([place for places, _ in self._cameras for place in places])]


class _ModelCamera:
    """Takes images of worlds that share a model.

    Args:
        task: of one model.
        rows: indices of the worlds that are seen.
        size: width and height of an image [pixels].
        samples, view, marks, sparing: see `TaskCamera`.
    """

    def __init__(
        self, task: Task[Any], rows: list[int], size: tuple[int, int], samples: int,
        view: Callable[[Shot], Shot] | None, marks: bool, sparing: bool,
    ) -> None:  # fmt: skip
        self._task, self._rows = task, rows
        scene = task.scene()
        simulation, scene, shot = stage(task) if scene is None else (task.simulation, scene, task.shot())
        self.camera = FollowCamera(
            simulation, scene, shot if view is None else view(shot), worlds=rows, width=size[0], height=size[1],
            samples=samples, lighting=task.lighting(), marks=marks, quiet=True,
            sparing=sparing,
        )  # fmt: skip

    def render(self, time: float, below: Sequence[Sequence[Polyline]]) -> npt.NDArray[np.uint8]:
        """(S, height, width, 3) sRGB of the present state, with lines of each of the worlds."""
        lines = list(below)
        for line in self._task.contract.drawing().lines:
            if not line.only_maps:
                points = line.points.double().cpu().numpy()[self._rows]
                lines.append([Polyline(each, to_rgb(line.colour), line.width) for each in points])
        return self.camera.render(time, list(zip(*lines, strict=True)))


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
