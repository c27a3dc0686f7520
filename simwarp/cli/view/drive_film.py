"""A picture or film of a manoeuvre: `simwarp drive --video`. Soil is seen with its ruts."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

from simwarp.cli import UsageError
from simwarp.cli.view.maneuver_scene import maneuver_scene
from simwarp.sensors.cameras.lights import Lighting, Sun
from simwarp.train.evaluation.play import Frame, write_video
from simwarp.vehicle.results.runs import Progress, Setup
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle
from simwarp.viewer.sheets import write_image
from simwarp.viewer.studio import FollowCamera, Shot

STILLS: Final = (".png", ".jpg", ".jpeg")
FILMS: Final = (".mp4", ".gif")
RATE: Final = 25.0
"""Images of a film per second."""
SIZE: Final = (960, 540)
EYE: Final = (-11.0, -4.2, 5.2)
"""Behind and above, a little to the right, in the vehicle's axes: what it leaves behind is in sight [m]."""
TARGET: Final = (-3.4, 0.2, -0.6)
TRACKS_EYE: Final = (4.7, -6.4, 1.2)
TRACKS_TARGET: Final = (0.0, 0.0, -0.35)
"""Of a vehicle on tracks, from the right and the front: wheels and shoes are in sight [m]."""
LIGHTING: Final = Lighting(suns=(Sun(direction=(0.55, -1.0, 0.8)),), shadow_reach=30.0, fog_density=0.004)
"""A sun that is low, from the right: edges of ruts throw shadows."""
MOST_FRAMES: Final = 3000
"""Images that are kept until they are written: two minutes, 5 GB."""


def check_film(path: Path, seconds: float) -> None:
    """Refuses names and lengths that cannot be written.

    Raises:
        UsageError: so it is.
    """
    suffix = path.suffix.lower()
    if suffix not in STILLS + FILMS:
        raise UsageError(f"cannot write '{path}': the name must end in {', '.join(FILMS + STILLS)}")
    if suffix in FILMS and seconds * RATE > MOST_FRAMES:
        raise UsageError(
            f"--video {path}: a film has at most {MOST_FRAMES / RATE:g} s, got {seconds:.4g}; shorten --duration"
        )


def drive_shot(setup: Setup[AnyVehicle]) -> Shot:
    """Behind the vehicle, beside one on tracks; turned with it."""
    if isinstance(setup.vehicle, TrackedVehicle):
        return Shot(body=setup.vehicle.parts.chassis, target=TRACKS_TARGET, eye=TRACKS_EYE, fov=0.9, turns=True)
    return Shot(body=setup.vehicle.parts.chassis, target=TARGET, eye=EYE, fov=0.9, turns=True)


class DriveFilm:
    """Takes images of the first world while a manoeuvre is driven.

    Args:
        setup: of the manoeuvre.
        path: .mp4 or .gif: a film; .png or .jpg: its end.
        size: of the images, width and height.
    """

    def __init__(self, setup: Setup[AnyVehicle], path: Path, size: tuple[int, int] = SIZE) -> None:
        self.path = path
        self._camera = FollowCamera(
            setup.simulation, maneuver_scene(setup), drive_shot(setup), width=size[0], height=size[1],
            lighting=LIGHTING,
        )  # fmt: skip
        self._start = setup.maneuver.start
        self._films = path.suffix.lower() in FILMS
        self._title = f"{setup.vehicle.parts.spec.name} {setup.maneuver.name}"
        self._frames: list[Frame] = []
        self.seconds = 0.0
        """That taking images took by the clock."""

    def beside(self, progress: Progress) -> Progress:
        """Both, after every row of the record."""

        def advance(t: float) -> None:
            progress(t)
            if self._films and t + self._start >= len(self._frames) / RATE - 1e-9:
                self._render(t)

        return advance

    def _render(self, t: float) -> None:

        begin = time.perf_counter()
        self._frames.append(Frame(t + self._start, self._camera.render(t + self._start)))
        self.seconds += time.perf_counter() - begin

    def write(self) -> None:
        """Writes the file.

        Raises:
            OutputError: the disk did not take it.
        """
        if self._films and self._frames:
            write_video(self.path, self._frames, self._title)
            return
        write_image(self.path, self._camera.render(0.0)[0])
