"""Options of studies, `simwarp drive VEHICLE --maneuver M --vary KEY=LOW..HIGH` or `--search`, and what they refuse."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Protocol, TypeAlias

import tyro
from rich.console import Console

from simwarp.cli import UsageError
from simwarp.cli.drive.drive_batch import ALONE
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

NO_HINT: Final = "(default: none)"
OUT_HINT: Final = "(default: studies/VEHICLE-MANEUVER)"
MOST_WORLDS: Final = 1_000_000
MOST_FILMED: Final = 20

Repeated: TypeAlias = tyro.conf.UseAppendAction[tuple[str, ...]]


class WorstFilm(enum.Enum):
    """What is made of the worst worlds beside their tables."""

    MP4 = "mp4"
    GIF = "gif"
    PNG = "png"
    NONE = "none"


@dataclasses.dataclass(frozen=True)
class StudyOptions:
    """Many worlds whose vehicles differ by chance, or a search for the best design (docs/study.md)."""

    vary: Annotated[Repeated, tyro.conf.arg(metavar="KEY=LOW..HIGH", help_behavior_hint=NO_HINT)] = ()
    """Draws a number anew in each of --worlds; keys are those of `simwarp fit --list VEHICLE`, `ground.friction` and
    options of the manoeuvre such as `maneuver.speed`; LOW..HIGH:log, MEAN+-DEVIATION or A,B,C, too, and all in %."""
    search: Annotated[Repeated, tyro.conf.arg(metavar="KEY=LOW..HIGH", help_behavior_hint=NO_HINT)] = ()
    """Looks for the best value of a number, by Optuna; with --maximise or --minimise."""
    maximise: Annotated[str | None, tyro.conf.arg(metavar="FIGURE", help_behavior_hint=NO_HINT)] = None
    """Goal of a search: a figure of the manoeuvre, or pass_speed, the highest of --speeds that is passed."""
    minimise: Annotated[str | None, tyro.conf.arg(metavar="FIGURE", help_behavior_hint=NO_HINT)] = None
    """Goal of a search, likewise."""
    subject_to: Annotated[Repeated, tyro.conf.arg(metavar='"FIGURE<=X"', help_behavior_hint=NO_HINT)] = ()
    """A bound of a search, such as "peak_roll<=2.5"; may be repeated. Of pass_speed, at all speeds that count."""
    trials: int = 64
    """Designs that a search tries, in all."""
    at_once: int = 8
    """Designs that are proposed and driven together; the result depends on it."""
    seed: int = 0
    """Of all draws."""
    batch: Annotated[int | None, tyro.conf.arg(help_behavior_hint="(default: 64, on a GPU 1024)")] = None
    """Most worlds of one simulation; no result depends on it."""
    worst: int = 0
    """Worst worlds that are driven once more: a table, a film and the vehicle's file of each."""
    worst_by: Annotated[
        str | None, tyro.conf.arg(metavar="FIGURE[:least]", help_behavior_hint="(default: the margin to the rules)")
    ] = None
    """Figure by which worlds are the worst: the greatest, or the least."""
    worst_film: WorstFilm = WorstFilm.MP4
    """Film of each of the worst worlds, or a picture of its end."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint=OUT_HINT)] = None
    """Folder of the worst worlds, or of a search, which goes on where it was."""


class DriveChoices(Protocol):
    """Options of `simwarp drive` that a study takes, too."""

    @property
    def maneuver(self) -> str | None:
        """Its name."""

    @property
    def chosen(self) -> dict[str, float]:
        """Options of the manoeuvre that are given."""

    @property
    def speeds(self) -> str | None:
        """Many speeds."""

    @property
    def steerings(self) -> str | None:
        """Many amplitudes."""

    @property
    def worlds(self) -> int:
        """How many."""

    @property
    def view(self) -> bool:
        """Whether it is shown live."""

    @property
    def device(self) -> str:
        """Of the run."""

    @property
    def dt(self) -> float:
        """Time step [s]."""

    @property
    def friction(self) -> float:
        """Of the ground."""

    @property
    def csv(self) -> Path | None:
        """File of rows."""

    @property
    def plot(self) -> Path | None:
        """File of a picture."""

    def table_console(self) -> Console:
        """For people, with whole tables."""

    def emit(self, content: Mapping[str, Any]) -> None:
        """For scripts."""


def check_study(spec: AnyVehicleSpec, drive: DriveChoices, study: StudyOptions) -> VehicleSpec:
    """Refuse what a study cannot have, before any work is done; returns the vehicle.

    Raises:
        UsageError: an option makes no sense here.
    """
    option = "--search" if study.search else "--vary"
    if study.search and study.vary:
        raise UsageError("--search: cannot be given beside --vary; make two studies")
    if isinstance(spec, TrackedVehicleSpec):
        raise UsageError(f"{option}: '{spec.name}' has tracks; studies are for vehicles on wheels")
    for name in ALONE:
        if getattr(drive, name) is not None and name != "csv":
            raise UsageError(f"--{name.replace('_', '-')}: is of one run, not of a study; leave out one of them")
    if any(axle.tire.template == "soil-rigid" for axle in spec.all_axles):
        raise UsageError(f"{option}: must be driven on a road, got tires on soil; leave out --tire soil-rigid")
    if drive.view:
        raise UsageError(f"--view shows one run; leave it out beside {option}")
    if drive.maneuver is None:
        raise UsageError(f"{option}: needs a --maneuver, such as iso-3888-2")
    if drive.steerings is not None or (study.vary and drive.speeds is not None):
        word = "steering" if drive.steerings is not None else "speed"
        raise UsageError(f"--{word}s: cannot be given beside {option}; take maneuver.{word}=A,B,C as a key")
    for name, least, most in (
        ("trials", 1, MOST_WORLDS), ("at_once", 1, 10_000), ("batch", 1, MOST_WORLDS), ("worst", 0, MOST_FILMED)
    ):  # fmt: skip
        value = getattr(study, name)
        if value is not None and not least <= value <= most:
            raise UsageError(f"--{name.replace('_', '-')} must be from {least} to {most}, got {value}")
    if study.out is not None and study.out.exists() and not study.out.is_dir():
        raise UsageError(f"--out: must be a folder, got the file '{study.out}'")
    _check_kind(drive, study)
    return spec


def _check_kind(drive: DriveChoices, study: StudyOptions) -> None:
    """Options of the other kind of study, and the number of worlds."""
    if study.search:
        if drive.worlds != 1 or study.worst or study.worst_by is not None:
            name = "worlds" if drive.worlds != 1 else "worst"
            raise UsageError(f"--{name}: is of --vary; a search drives --trials designs")
        if drive.csv is not None:
            raise UsageError("--csv: is of --vary; a search writes trials.csv in its folder")
        return
    for name in ("maximise", "minimise", "subject_to"):
        if getattr(study, name):
            raise UsageError(f"--{name.replace('_', '-')}: is of --search KEY=LOW..HIGH")
    if not 2 <= drive.worlds <= MOST_WORLDS:
        raise UsageError(
            f"--worlds: must be from 2 to {MOST_WORLDS} beside --vary, got {drive.worlds}; 512 is a good beginning"
        )
    if study.worst > drive.worlds:
        raise UsageError(f"--worst must be at most --worlds, got {study.worst} of {drive.worlds}")
    if study.worst_by is not None and not study.worst:
        raise UsageError("--worst-by: needs --worst, how many worlds to write")


def study_folder(spec: VehicleSpec, drive: DriveChoices, study: StudyOptions) -> Path:
    """Where files of a study go."""
    maneuver = Path(drive.maneuver or "").stem
    return study.out or Path("studies") / f"{spec.name}-{maneuver}"
