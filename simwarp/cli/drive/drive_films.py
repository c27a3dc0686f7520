"""What is filmed and recorded of a manoeuvre beside its rows: videos, scenes, and messages for tools of ROS 2."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import tyro

from simwarp.cli import UsageError
from simwarp.cli.drive.mounted_sensors import SENSORS_HINT, mounted_sensors, placed, words_of
from simwarp.cli.options import CommonOptions
from simwarp.mcap.mcap_extra import check_mcap_path
from simwarp.simulation.attachments import ForceElement, Sensor
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.runs import Drive, Progress

if TYPE_CHECKING:
    from simwarp.cli.view.drive_film import DriveFilm
    from simwarp.cli.view.scene_film import DriveSceneFilm

    AnyFilm: TypeAlias = "DriveFilm | DriveSceneFilm | DriveRecord"


@dataclasses.dataclass(frozen=True)
class RecordOptions(CommonOptions):
    """Options of what is recorded for tools of ROS 2."""

    record: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is written)")] = (
        None
    )
    """Records the first world for tools of ROS 2, .mcap: transforms, odometry, joints, wheels, inputs and sensors."""
    sensors: Annotated[str | None, tyro.conf.arg(metavar="NAMES", help_behavior_hint=SENSORS_HINT)] = None
    """On the chassis, for --record: names of `simwarp list` or JSON files with commas between, each with its place from
    the centre of mass where it matters, "vlp-16@0:0:1.2,mems-imu"."""

    def check_record(self) -> None:
        """Refuses what cannot be recorded.

        Raises:
            UsageError: there are sensors and no file to record them to, or a place is none.
            ModelError: the file is of another kind, or the extra is not installed.
        """
        if self.record is not None:
            check_mcap_path(self.record)
        elif self.sensors is not None:
            raise UsageError("--sensors: are recorded, and no --record names a file for them; add --record run.mcap")
        for word in words_of(self.sensors):
            placed(word)


def sensors_of(maneuver: Maneuver, options: RecordOptions) -> Callable[[Any, Sequence[ForceElement]], list[Sensor]]:
    """What makes the sensors that were asked for, once the vehicle is there."""

    def made(vehicle: Any, elements: Sequence[ForceElement]) -> list[Sensor]:
        if not words_of(options.sensors):
            return []
        from simwarp.cli.view.maneuver_scene import driven_scene

        return mounted_sensors(options.sensors, vehicle, driven_scene(vehicle, elements, maneuver))

    return made


class DriveRecord:
    """Records the first world after every step.

    Args:
        drive: whose steps they are.
        path: of the file.
    """

    seconds: Final = 0.0
    """Recording is part of the run."""

    def __init__(self, drive: Drive, path: Path) -> None:
        from simwarp.mcap import Writer

        self.path = path
        self._writer = Writer(path, drive.setup.simulation)
        drive.after_step, drive.steps_to_call = self._writer.add, self._writer.steps_to_next

    def beside(self, progress: Progress) -> Progress:
        """Nothing more after a row of the record."""
        return progress

    def write(self) -> None:
        """Ends the file."""
        self._writer.close()


def films_of(drive: Drive, options: Any) -> tuple[AnyFilm, ...]:
    """The film or picture, the scene, and the recording that were asked for."""
    films: list[AnyFilm] = []
    if options.video is not None:
        from simwarp.cli.view.drive_film import DriveFilm

        films.append(DriveFilm(drive.setup, options.video))
    if options.export_scene is not None:
        from simwarp.cli.view.scene_film import DriveSceneFilm

        films.append(DriveSceneFilm(drive.setup, options.export_scene))
    if options.record is not None:
        films.append(DriveRecord(drive, options.record))
    return tuple(films)
