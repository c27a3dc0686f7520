"""Scenes with their motion for other programs: `--export-scene` of `simwarp play` and `simwarp drive`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

from simwarp.cli import UsageError
from simwarp.cli.view.drive_film import LIGHTING, RATE, SIZE, drive_shot
from simwarp.cli.view.maneuver_scene import maneuver_scene
from simwarp.exporters.scene_files import check_scene_path, save_scene
from simwarp.exporters.scene_recording import SceneRecording
from simwarp.tasks import Task
from simwarp.train.evaluation.filming import FilmOptions, viewed
from simwarp.vehicle.results.runs import Progress, Setup
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle

LONGEST: Final = 3600.0
"""Time that is recorded at most [s]: all frames are kept until they are written."""


def check_scene(path: Path, seconds: float) -> None:
    """Refuses names and lengths that cannot be written.

    Raises:
        UsageError: it is too long.
        ModelError: the file is of another kind.
    """
    check_scene_path(path)
    if seconds > LONGEST:
        raise UsageError(f"--export-scene records at most {LONGEST:g} s, got {seconds:.4g}; shorten --duration")


class TaskSceneFilm:
    """Records a world where pictures of `simwarp play` would be taken.

    Args:
        task: with bodies.
        path: of the file.
        options: of the camera, and the world.

    Raises:
        UsageError: the task has no bodies.
    """

    def __init__(self, task: Task[Any], path: Path, options: FilmOptions) -> None:
        self.path = path
        scene = task.scene()
        if scene is None:
            raise UsageError(f"--export-scene: task '{task.name}' has no bodies to export; make a --video of it")
        world, size = (options.worlds or (0,))[0], {} if options.size is None else {"size": options.size}
        shot = viewed(task.shot(), options)
        self._recording = SceneRecording(
            task.simulation, scene, world=world, shot=shot, lighting=task.lighting(), **size
        )

    def render(self, index: int, count: int, time: float) -> None:
        """Takes the present state as a frame."""
        self._recording.add(time)

    def write(self) -> None:
        """Writes the file."""
        save_scene(self._recording, self.path)

    def close(self) -> None:
        """Nothing is left open."""


class DriveSceneFilm:
    """Records the first world while a manoeuvre is driven.

    Args:
        setup: of the manoeuvre.
        path: of the file.
    """

    def __init__(self, setup: Setup[AnyVehicle], path: Path) -> None:
        self.path, self._start = path, setup.maneuver.start
        self._recording = SceneRecording(
            setup.simulation, maneuver_scene(setup), shot=drive_shot(setup), size=SIZE, lighting=LIGHTING
        )
        self._recording.add(0.0)
        self.seconds = 0.0
        """That recording took by the clock."""

    def beside(self, progress: Progress) -> Progress:
        """Both, after every row of the record."""

        def advance(t: float) -> None:
            progress(t)
            if t + self._start >= len(self._recording.times) / RATE - 1e-9:
                begin = time.perf_counter()
                self._recording.add(t + self._start)
                self.seconds += time.perf_counter() - begin

        return advance

    def write(self) -> None:
        """Writes the file."""
        save_scene(self._recording, self.path)
