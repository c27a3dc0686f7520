"""Rendered images of a task's worlds, for the pictures and videos of ``simwarp play``."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from enum import StrEnum
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.tasks import InputError, Task
from simwarp.tasks.framework.task_rendering import TaskCamera
from simwarp.viewer import Polyline, Shot, caption, grid
from simwarp.viewer.sheets import label

Images = npt.NDArray[np.uint8]

TRAIL: Final = (1.0, 0.62, 0.05)
"""sRGB of the line along which a body went."""
_TRAIL_WIDTH = 2.5
_VIDEO_PIXELS = 345_600
"""Of all worlds of a video together, unless a size is given."""
_PICTURE_PIXELS = 900_000
_MOMENTS = 6
_PANELS = 24
_WIDEST, _NARROWEST = 880.0, 96.0


class View(StrEnum):
    """Where the camera of a film is."""

    TASK = "task"
    """As the task has it."""
    BEHIND = "behind"
    """Behind the body, and turned with it."""
    SIDE = "side"
    FRONT = "front"
    ABOVE = "above"


_DIRECTIONS: Final = {
    View.BEHIND: (-1.0, 0.0, 0.45), View.SIDE: (0.0, -1.0, 0.35), View.FRONT: (1.0, -0.35, 0.4),
    View.ABOVE: (0.0, -0.02, 1.0),
}  # fmt: skip


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmOptions:
    """What a film shows of a task.

    Attributes:
        worlds: indices of the worlds shown; empty: all of them.
        size: width and height of one world's image [pixels], even; None: as large as their number leaves room for.
        view: where the camera is.
        zoom: how many times larger than from the usual distance.
        follow: the camera goes along with the body.
        trail: a line along which the body went.
        marks: on the ground, every metre.
    """

    worlds: tuple[int, ...] = ()
    size: tuple[int, int] | None = None
    view: View = View.TASK
    zoom: float = 1.0
    follow: bool = True
    trail: bool = True
    marks: bool = True


class Film:
    """Takes rendered images of worlds of a task, with the lines of its drawing in them.

    Args:
        task: with something to see: bodies, or lines.
        video: of every frame; else of some moments only.
        options: of what is shown.

    Attributes:
        worlds: indices of those that are shown.

    Raises:
        InputError: the task has neither bodies nor a drawing, or no such world.
    """

    def __init__(self, task: Task[Any], video: bool, options: FilmOptions | None = None) -> None:
        self._options = options = FilmOptions() if options is None else options
        self.worlds = options.worlds or tuple(range(task.num_worlds))
        if not all(0 <= world < task.num_worlds for world in self.worlds):
            raise InputError(
                f"worlds must be from 0 to {task.num_worlds - 1}, got {max(self.worlds)}; make more worlds"
            )
        shown = len(self.worlds)
        self._moments = 0 if video else max(1, min(_MOMENTS, _PANELS // shown))
        if options.size is None and not video and shown > 1:
            self._moments = min(self._moments, 3)
        width, height = options.size or _tile(shown * max(1, self._moments), video)
        self._task = task
        self._camera = TaskCamera(
            task, worlds=self.worlds, width=width, height=height, samples=2 if video else 3,
            view=partial(viewed, options=options), marks=options.marks, sparing=video,
        )  # fmt: skip
        self._trails = Trails(shown) if options.trail else None

    def render(self, index: int, count: int, time: float) -> Images | None:
        """Images of the present state, frame ``index`` of ``count``; None where none is wanted."""
        if self._trails is not None:
            self._trails.add(self._places())
        if self._moments:
            wanted = {round(place) for place in np.linspace(0, count - 1, self._moments + 1)[1:]}
            if index not in wanted:
                return None
        trails = [] if self._trails is None else [Polyline(line, TRAIL, _TRAIL_WIDTH) for line in self._trails.lines()]
        return self._camera.render(time, [trails] if trails else [])

    def _places(self) -> npt.NDArray[np.float64]:
        """(worlds, 3) where the bodies are: on the ground below what goes about, else where they are [m]."""
        place = self._task.contract.map_position()
        if place is None:
            return np.full((len(self.worlds), 3), np.nan)
        places: npt.NDArray[np.float64] = place.double().cpu().numpy()[list(self.worlds)].copy()
        if self._camera.follows:
            places[:, 2] = self._camera.floors(places)
        return places


class Trails:
    """Lines along which things went, each until it is elsewhere at once.

    Args:
        count: of them.
    """

    def __init__(self, count: int) -> None:
        self._points: list[list[npt.NDArray[np.float64]]] = [[] for _ in range(count)]

    def add(self, places: npt.NDArray[np.float64]) -> None:
        """Where they are now, (count, 3) [m]."""
        for points, place in zip(self._points, places, strict=True):
            steps = [float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(points[-6:])]
            # many times the steps before it: the world was reset
            if steps and np.linalg.norm(place - points[-1]) > 10.0 * max(steps) + 0.2:
                points.clear()
            points.append(place)

    def lines(self) -> list[npt.NDArray[np.float64]]:
        """(P, 3) of each so far."""
        return [np.array(points) for points in self._points]


def viewed(shot: Shot, options: FilmOptions) -> Shot:
    """The shot as the options ask for it."""
    if options.view is not View.TASK:
        direction = np.array(_DIRECTIONS[options.view])
        direction /= np.linalg.norm(direction)
        eye = None if shot.eye is None else tuple(float(np.linalg.norm(shot.eye)) * direction)
        shot = dataclasses.replace(
            shot, side=tuple(direction.tolist()), eye=eye, turns=options.view is View.BEHIND,
            target=None if shot.target is None else (0.0, 0.0, shot.target[2]) if shot.turns else shot.target,
        )  # fmt: skip
    fov = 2.0 * math.atan(math.tan(0.5 * shot.fov) / options.zoom)
    return dataclasses.replace(shot, fov=fov, follows=shot.follows and options.follow)


def _tile(panels: int, video: bool) -> tuple[int, int]:
    """Width and height of one of so many images [pixels], even."""
    pixels = (_VIDEO_PIXELS if video else _PICTURE_PIXELS) / panels
    width = 2 * round(0.5 * min(_WIDEST, max(_NARROWEST, math.sqrt(1.5 * pixels))))
    return width, 2 * round(width / 3.0)


def film_still(images: Images, time: float, title: str, worlds: Sequence[int] = ()) -> Images:
    """Worlds (by default the first ones) at one moment."""
    shown = len(images)
    names = worlds or range(shown)
    panels = [label(image, f"world {name}") if shown > 1 else image for name, image in zip(names, images, strict=True)]
    return caption(grid(panels, math.ceil(math.sqrt(shown))), f"{title}   t = {time:5.2f} s")


def film_strip(taken: Sequence[tuple[float, Images]], title: str, worlds: Sequence[int] = ()) -> Images:
    """Moments (time, images of worlds, by default the first ones): a row of them for each world."""
    shown = len(taken[0][1])
    names = worlds or range(shown)
    panels = [
        label(images[row], f"world {name}   t = {time:.2f} s" if shown > 1 else f"t = {time:.2f} s")
        for row, name in enumerate(names)
        for time, images in taken
    ]
    columns = len(taken) if shown > 1 else math.ceil(len(taken) / 2)
    if len(taken) == 1:
        columns = math.ceil(math.sqrt(shown))
    return caption(grid(panels, columns), title)
