"""``simwarp drive``."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import tyro
import warp as wp
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED, UsageError
from simwarp.cli.drive.drive_batch import ALONE, Batch, batch_variants, parse_values, run_batch, verdict_table
from simwarp.cli.drive.drive_films import RecordOptions, films_of, sensors_of
from simwarp.cli.drive.drive_progress import ManeuverBar
from simwarp.cli.drive.drive_road import (
    METAVAR as PATCH,
    Patch,
    check_patches,
    check_road_option,
    road_below,
    with_patches,
)
from simwarp.cli.drive.drive_titles import UNITS, choices_of_run, named_options, title_of_run
from simwarp.cli.drive.study_options import StudyOptions
from simwarp.cli.options import FLAT, parse_options, require_subject, split_subject
from simwarp.core.memory import check_fits
from simwarp.core.warp_start import report_compiling, start_warp
from simwarp.exporters.run_report import check_report
from simwarp.exporters.run_tables import check_run_file, write_run
from simwarp.importers.chrono_json import vehicle_template
from simwarp.model.model import resolve_device
from simwarp.soil import Soil, soil_under
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.assessment.verdicts import passed, verdict_rows, verdicts
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.maneuvers import MANEUVERS, maneuver
from simwarp.vehicle.driving.track_maneuvers import TRACK_MANEUVERS
from simwarp.vehicle.results.chain_plot import draw_chains
from simwarp.vehicle.results.chain_record import ChainRecord
from simwarp.vehicle.results.channel_samples import Channel
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.drive_plot import draw_run
from simwarp.vehicle.results.named_channels import channels_of, wants_reactions
from simwarp.vehicle.results.results import results
from simwarp.vehicle.results.run_result import Result
from simwarp.vehicle.results.runs import REFERENCE_DT, REFERENCE_FRICTION, SAMPLE_TIME, Drive, Setup, row_steps, set_up
from simwarp.vehicle.roads.road_surface import RoadSurface, road_ground
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.tires.soil_tires import SoilTires
from simwarp.vehicle.tracks.tracked_files import all_vehicle_names, load_any_vehicle
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle

if TYPE_CHECKING:
    from simwarp.cli.drive.drive_films import AnyFilm
    from simwarp.cli.view.maneuver_view import ManeuverView

PICTURES = (".png", ".pdf", ".svg")
CHAINS_TIME: Final = 1.0
"""Over which the plot of --chains takes means [s]."""
MOST_STEPS: Final = 10**9
"""Of one run: days of driving."""
ROW_BYTES: Final = 1000
"""That a row of the record takes, with what is made of it in the end."""

LIST: Final = "list"
"""Of --channels, prints the names of all and drives nothing."""

MANEUVER_HELP: Final = (
    f"What to do: {', '.join(MANEUVERS)} (docs/vehicles.md tells what each does); on tracks: "
    f"{', '.join(TRACK_MANEUVERS)} (docs/tracks.md); or a .csv file with a column t_s (or"
    " time, t) [s] and any of steering (or steer), throttle, braking (or brake) and speed_target [m/s], such as a file"
    " of --csv."
)
OWN: Final = "(default: the vehicle's own)"
MANEUVER_HINT: Final = "(default: reference-accel, on tracks accelerate)"
SPEEDS_HINT: Final = (
    "(default: the manoeuvre's for this vehicle, 12 or 15; 6 of gator, 1.5 or 1.7 of artcar, 0.5 or 0.8 of skid-steer,"
    " 4, 2 or 1 on tracks)"
)
STEERING_HINT: Final = (
    "(default: 0.3 of step-steer, 0.1 of sine-sweep, 1 of steady-turn and pivot, 0.5 of slow-steer at its end,"
    " multiples of that at 0.3 g of step-input, sine-with-dwell and fishhook)"
)
RADIUS_HINT: Final = "(default: 30; 15 of gator, 3 of artcar, 2 of skid-steer; 0.2 of obstacle)"
SLOPE_HINT: Final = "(default: 0.2, on tracks 0.3)"
WIDTH_HINT: Final = "(default: 1.2)"
DURATION_HINT: Final = (
    "(default: 5 to 20 on tracks, 25 of step-steer, 50 of sine-sweep, 40 of constant-radius, 60 of slope-hold, to the"
    " end of the course of double-lane-change, to the last row of a .csv file)"
)
BRAKES_HINT = "(default: 0.5)"
BUMP_HINT: Final = "(default: by the tires)"
DWELL_HINT: Final = "(default: until the roll rate is below 1.5°/s)"
SPACING_HINT: Final = "(default: 0.05, or half the width of narrower wheels)"
SOIL_HINT: Final = "(default: mid with --tire soil-rigid)"
ROAD_HINT: Final = "(default: a plane)"
NORMAL_HINT: Final = "(default: ground)"
"""Defaults of the options that are not given, for the help."""


@dataclasses.dataclass(frozen=True)
class DriveOptions(RecordOptions):
    """Drives one manoeuvre with a vehicle, a shipped one or that of a JSON file: `simwarp drive` lists them.

    The CSV file has a row every 10 ms, from t = -1 s on (the vehicle settles on its brakes before t = 0).
    """

    maneuver: Annotated[
        str | None, tyro.conf.arg(metavar="M", help=MANEUVER_HELP, help_behavior_hint=MANEUVER_HINT)
    ] = None
    tire: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint=OWN)] = None
    """Other tires: a name that is shipped for the vehicle, or a JSON file."""
    powertrain: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint=OWN)] = None
    """Another engine with its transmission, likewise. For a Chrono vehicle its two files, with a comma between."""
    driveline: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint=OWN)] = None
    """Another driveline, likewise."""
    soil: Annotated[str | None, tyro.conf.arg(metavar="soft|mid|hard|clay|snow|sand", help_behavior_hint=SOIL_HINT)] = (
        None
    )
    """Deformable ground below `--tire soil-rigid` or `flexible`."""
    spacing: Annotated[float | None, tyro.conf.arg(metavar="m", help_behavior_hint=SPACING_HINT)] = None
    """Of the soil's nodes."""
    soil_normal: Annotated[str | None, tyro.conf.arg(metavar="ground|surface", help_behavior_hint=NORMAL_HINT)] = None
    """Along which soil presses on rigid wheels: the ground's, or their surface's, where compaction holds them back."""
    friction: float = REFERENCE_FRICTION
    """Of the ground. Tires grip by it over their own reference_friction, on which they were measured."""
    friction_patch: Annotated[tyro.conf.UseAppendAction[tuple[Patch, ...]], tyro.conf.arg(metavar=PATCH)] = ()
    """Another friction on a rectangle of the road [m], x ahead and y to the left of the start; may be repeated."""
    road: Annotated[str | None, tyro.conf.arg(metavar="iso8608:CLASS[:SEED]|FILE", help_behavior_hint=ROAD_HINT)] = None
    """A random road of ISO 8608, of a class from A (very good) to H; a .json file of bitmaps, or a .crg file."""
    dt: Annotated[float, tyro.conf.arg(metavar="s")] = REFERENCE_DT
    """Time step."""
    csv: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is written)")] = None
    """Writes the run to this file."""
    output: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is written)")] = (
        None
    )
    """Writes the run to this file, .csv or .parquet, which holds units and sources too."""
    channels: Annotated[
        str | None, tyro.conf.arg(metavar="NAMES", help_behavior_hint="(default: the usual columns)")
    ] = None
    """Further columns: names or patterns with commas between, such as "Fx_*,travel_*"; list prints all names."""
    plot: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is drawn)")] = None
    """Writes a page of plots: .png, .pdf or .svg."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is written)")] = (
        None
    )
    """Writes a page of HTML with verdicts, figures, plots and the vehicle's data, which opens without a network."""
    chains: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is drawn)")] = None
    """Writes a plot of the tension round the tracks and the load under their shoes, means of the last second."""
    video: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is made)")] = None
    """Films the first world, soil with its ruts: .mp4 or .gif; .png or .jpg: a picture of the end."""
    export_scene: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is written)")
    ] = None
    """Writes the first world with its motion for other programs: .glb (glTF 2.0), or .pov for POV-Ray."""
    worlds: int = 1
    """Worlds that do the same; the first one is recorded."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""
    view: bool = False
    """Show it live in a page of the browser, at real time."""
    port: int = 8080
    """Of the page; the next free one is taken."""
    open: bool = True
    """Open a browser."""
    speeds: Annotated[str | None, tyro.conf.arg(metavar="A:B:STEP", help_behavior_hint="(default: one run)")] = None
    """Drives the manoeuvre at many speeds at once, each in a world of its own, and prints a table with verdicts: from A
    to B by STEP, or numbers with commas [m/s]."""
    steerings: Annotated[str | None, tyro.conf.arg(metavar="A:B:STEP", help_behavior_hint="(default: one run)")] = None
    """The same with many steering amplitudes, of slow-steer, step-input, sine-with-dwell and fishhook."""
    speed: Annotated[float | None, tyro.conf.arg(metavar="m/s", help_behavior_hint=SPEEDS_HINT)] = None
    """To hold, of manoeuvres with steering and of stops; of brake, steady-turn, obstacle and trench on tracks."""
    steering: Annotated[float | None, tyro.conf.arg(metavar="-1..1", help_behavior_hint=STEERING_HINT)] = None
    """Of step-steer, sine-sweep, handling tests, steady-turn and pivot, positive to the left."""
    radius: Annotated[float | None, tyro.conf.arg(metavar="m", help_behavior_hint=RADIUS_HINT)] = None
    """Of circles, negative to the right; of the half round of obstacle."""
    slope: Annotated[float | None, tyro.conf.arg(metavar="rise/run", help_behavior_hint=SLOPE_HINT)] = None
    """Of slope-hold and hill-start, and of slope on tracks."""
    width: Annotated[float | None, tyro.conf.arg(metavar="m", help_behavior_hint=WIDTH_HINT)] = None
    """Of trench."""
    brakes: Annotated[float | None, tyro.conf.arg(metavar="0..1", help_behavior_hint=BRAKES_HINT)] = None
    """Of braking, split-braking and brake-in-turn."""
    left: Annotated[float | None, tyro.conf.arg(metavar="SHARE", help_behavior_hint="(default: 0.3)")] = None
    """Of the friction on the left side, in split-braking."""
    height: Annotated[float | None, tyro.conf.arg(metavar="m", help_behavior_hint=BUMP_HINT)] = None
    """Of bump."""
    length: Annotated[float | None, tyro.conf.arg(metavar="m", help_behavior_hint=BUMP_HINT)] = None
    """Of bump."""
    dwell: Annotated[float | None, tyro.conf.arg(metavar="s", help_behavior_hint=DWELL_HINT)] = None
    """Of fishhook, between its turns of the wheel."""
    duration: Annotated[float | None, tyro.conf.arg(metavar="s", help_behavior_hint=DURATION_HINT)] = None
    """Of the manoeuvre after t = 0; reference-* have their own."""
    flat_study: Annotated[StudyOptions, FLAT] = dataclasses.field(default_factory=StudyOptions)

    @property
    def patterns(self) -> tuple[str, ...]:
        """Of --channels; none where it is left out or only lists them."""
        if self.channels is None or self.channels == LIST:
            return ()
        return tuple(each.strip() for each in self.channels.split(",") if each.strip())

    @property
    def chosen(self) -> dict[str, float]:
        """The options of the manoeuvre that are given."""
        values = {key: getattr(self, key) for key in UNITS}
        return {key: value for key, value in values.items() if value is not None}


@dataclasses.dataclass
class Outcome:
    """Outcome of a run."""

    run: Run
    maneuver: Maneuver
    steps: int
    wall: float
    interrupted: bool = False
    broken: bool = False
    left_road: float | None = None
    films: tuple[AnyFilm, ...] = ()
    chains: ChainRecord | None = None
    channels: tuple[Channel, ...] = ()


def run(arguments: list[str]) -> int:
    """Drive as the arguments say; 1 where the vehicle broke down, 130 after an interruption."""
    name, rest = _split_vehicle(arguments)
    options = parse_options(DriveOptions, rest, f"simwarp drive {name or 'VEHICLE'}")
    _check(name, options)
    spec = _vehicle(name, options)
    if options.duration is not None:
        _check_effort(options, options.duration)  # a table of a manoeuvre is as long as it lasts
    if options.flat_study.vary or options.flat_study.search:
        from simwarp.cli.drive.drive_study import run_study

        return run_study(spec, options, options.flat_study)
    if options.speeds is not None or options.steerings is not None:
        return _run_batch(spec, options)
    usual = "accelerate" if isinstance(spec, TrackedVehicleSpec) else "reference-accel"
    with named_options():
        what = maneuver(usual if options.maneuver is None else options.maneuver, spec, **options.chosen)
    what = with_patches(what, options.friction_patch, options.friction, spec)
    _check_effort(options, what.start + what.duration)
    if options.video is not None:
        from simwarp.cli.view.drive_film import check_film

        check_film(options.video, what.start + what.duration)
    if options.export_scene is not None:
        from simwarp.cli.view.scene_film import check_scene

        check_scene(options.export_scene, what.start + what.duration)
    console = options.console()
    if options.channels == LIST:
        _print_channels(console, spec, what, options)
        return DONE
    outcome = _drive(spec, what, options, console)
    found = results(outcome.run, what)
    judged = [] if isinstance(spec, TrackedVehicleSpec) else verdicts(outcome.run, what)
    _print_results(console, spec, options, outcome, found, judged)
    _write(console, spec, options, outcome, found, judged)
    options.emit(_content(spec, options, outcome, found) | {"passed": passed(judged), "verdicts": verdict_rows(judged)})
    if outcome.interrupted:
        return INTERRUPTED
    return FELL_SHORT if outcome.broken or outcome.left_road is not None else DONE


def _run_batch(spec: AnyVehicleSpec, options: DriveOptions) -> int:
    """Drives a manoeuvre at many speeds or steerings."""
    key = "speed" if options.speeds is not None else "steering"
    if options.speeds is not None and options.steerings is not None:
        raise UsageError("--steerings: cannot be given beside --speeds; vary one of them")
    if isinstance(spec, TrackedVehicleSpec):
        raise UsageError(f"--{key}s: '{spec.name}' has tracks; many worlds at once are for vehicles on wheels")
    for name in ALONE:
        if getattr(options, name) is not None:
            raise UsageError(f"--{name.replace('_', '-')}: is of one run, not of many {key}s; leave out one of them")
    if any(axle.tire.template == "soil-rigid" for axle in spec.all_axles):
        raise UsageError(f"--{key}s: must be driven on a road, got tires on soil; leave out --tire soil-rigid")
    if options.view or options.worlds != 1:
        rule = "--view shows one run" if options.view else "--worlds: follows from the values"
        raise UsageError(f"{rule}; leave it out beside --{key}s")
    if key in options.chosen:
        raise UsageError(f"--{key}: cannot be given beside --{key}s; leave it out")
    if options.maneuver is None:
        raise UsageError(f"--{key}s: needs a --maneuver that has a {key}, such as iso-3888-1")
    values = parse_values(f"{key}s", options.speeds or options.steerings or "")
    batch = Batch(
        vehicle=spec, name=options.maneuver, key=key, values=values, chosen=options.chosen, dt=options.dt,
        friction=options.friction, device=str(resolve_device(None if options.device == "auto" else options.device)),
        plot=options.plot,
    )  # fmt: skip
    with named_options():
        variants = batch_variants(batch)
    variants = [with_patches(each, options.friction_patch, options.friction, spec) for each in variants]
    _check_effort(options, max(each.start + each.duration for each in variants), len(variants))
    code, content = run_batch(batch, variants, options.console())
    options.emit(content)
    return code


def _split_vehicle(arguments: list[str]) -> tuple[str, list[str]]:
    """Split the VEHICLE off the arguments: the first one, or the first that names a shipped one or ends in .json."""
    known, usage = all_vehicle_names(), "usage: simwarp drive VEHICLE --maneuver M [options]"
    vehicles, maneuvers = (
        f"vehicles: {', '.join(known)}",
        f"maneuvers: {', '.join(MANEUVERS)}; on tracks {', '.join(TRACK_MANEUVERS)}",
    )
    hint = "`simwarp drive VEHICLE --help` lists the options."
    overview = f"{usage}\n\n{vehicles}, or a JSON file\n{maneuvers}\n\n{hint}"
    word, rest = split_subject(arguments, known.__contains__)
    return require_subject(word, arguments, overview, f"which vehicle? {usage}; {vehicles}; {maneuvers}"), rest


def _check(name: str, options: DriveOptions) -> None:
    """Refuse what cannot work, before any work is done."""
    words = [name, options.maneuver, options.tire, options.driveline, *(options.powertrain or "").split(",")]
    files = [word for word in words if word is not None and word.endswith((".json", ".csv"))]
    options.check(
        *files, csv=options.csv, output=options.output, plot=options.plot, report=options.report,
        chains=options.chains, video=options.video, export_scene=options.export_scene, record=options.record,
    )  # fmt: skip
    if name.endswith(".csv"):
        rule = "a shipped one or a JSON file, got a .csv file; drive its inputs by --maneuver"
        raise UsageError(f"vehicle '{name}': must be {rule} {name}")
    check_patches(options.friction_patch)
    check_road_option(options.road)
    options.check_record()
    if options.output is not None:
        check_run_file(options.output, "--output")
    if options.report is not None:
        check_report(options.report, "--report")
    resolve_device(None if options.device == "auto" else options.device)
    for key in ("dt", "friction"):
        value = getattr(options, key)
        if not (math.isfinite(value) and value > 0.0):
            raise UsageError(f"--{key} must be a positive number, got {value}")
    if options.dt > 0.05:
        raise UsageError(f"--dt must be at most 0.05 s for a vehicle, got {options.dt:g}")
    if options.worlds < 1:
        raise UsageError(f"--worlds must be at least 1, got {options.worlds}")
    for picture in (options.plot, options.chains):
        if picture is not None and picture.suffix not in PICTURES:
            raise UsageError(f"cannot write '{picture}': the name must end in {', '.join(PICTURES)}")


def _check_effort(options: DriveOptions, time: float, recorded: int = 1) -> None:
    """Refuse runs that would take weeks, or whose record no memory holds."""
    steps = time / options.dt
    if steps > MOST_STEPS:
        raise UsageError(
            f"{time:.4g} s in steps of {options.dt:g} s are {steps:.3g} steps, at most {MOST_STEPS:.0e} are made; "
            "raise --dt or shorten --duration"
        )
    rows = steps if row_steps(options.dt) == 0 else time / SAMPLE_TIME
    check_fits("the rows of the record", round(ROW_BYTES * rows * recorded), wp.get_device("cpu"), "shorten --duration")


def _vehicle(name: str, options: DriveOptions) -> AnyVehicleSpec:
    """The vehicle with its options: a shipped one, one of our JSON files, or one of Chrono's."""
    chrono = vehicle_template(Path(name))
    if chrono == "TrackedVehicle":
        from simwarp.importers.chrono_tracks import load_chrono_tracked_vehicle

        return _on_tracks(load_chrono_tracked_vehicle(name), options)
    if chrono is not None:
        from simwarp.importers.chrono_vehicle import load_chrono_vehicle

        engine, _, transmission = (options.powertrain or "").partition(",")
        if options.powertrain is not None and not transmission:
            raise UsageError("--powertrain of a Chrono vehicle: its engine's file, a comma, its transmission's file")
        spec = load_chrono_vehicle(name, engine=engine or None, transmission=transmission or None, tire=options.tire)
        return with_options(spec, driveline=options.driveline)
    any_spec = load_any_vehicle(name)
    if isinstance(any_spec, TrackedVehicleSpec):
        return _on_tracks(any_spec, options)
    if options.chains is not None:
        raise UsageError(f"--chains: '{any_spec.name}' has wheels and no chains; take --plot")
    return with_options(any_spec, tire=options.tire, powertrain=options.powertrain, driveline=options.driveline)


def _on_tracks(spec: TrackedVehicleSpec, options: DriveOptions) -> TrackedVehicleSpec:
    """A tracked vehicle with its options.

    Raises:
        UsageError: one makes no sense on tracks.
    """
    for key in ("tire", "soil", "spacing", "soil_normal"):
        if getattr(options, key) is not None:
            option = key.replace("_", "-")
            raise UsageError(f"--{option}: '{spec.name}' has tracks, which drive on rigid ground; leave it out")
    return with_options(spec, powertrain=options.powertrain, driveline=options.driveline)


def _print_channels(console: Console, spec: AnyVehicleSpec, what: Maneuver, options: DriveOptions) -> None:
    """Names, units and meanings of all channels, for people and for scripts."""
    road = road_below(what, options.road, options.soil)
    setup = set_up(
        spec, what, device="cpu", elements=lambda v: _soil(v, options, road), on_soil=_on_soil(options, road), road=road
    )
    known = channels_of(setup.simulation, setup.vehicle)
    for channel in known:
        line = f"{channel.name}  [{channel.unit}]  {channel.meaning}"
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    options.emit({"channels": [{"name": c.name, "unit": c.unit, "meaning": c.meaning} for c in known]})


def _drive(spec: AnyVehicleSpec, what: Maneuver, options: DriveOptions, console: Console) -> Outcome:
    device = None if options.device == "auto" else options.device
    road = road_below(what, options.road, options.soil)
    outcome = Outcome(Run({}), what, 0, 0.0)
    start_warp()
    with report_compiling():
        setup = set_up(
            spec, what, worlds=options.worlds, device=str(resolve_device(device)), dt=options.dt,
            friction=options.friction, elements=lambda vehicle: _soil(vehicle, options, road),
            on_soil=_on_soil(options, road), joint_reactions=wants_reactions(options.patterns),
            sensors=sensors_of(what, options), road=road,
        )  # fmt: skip
        drive = Drive(setup, channels=options.patterns)
        outcome.films = films = films_of(drive, options)
    page = _page(setup, f"{spec.name} {what.name}", options, console)
    if options.chains is not None and isinstance(setup.vehicle, TrackedVehicle):
        outcome.chains = ChainRecord(setup.simulation, setup.vehicle)
    begin = time.perf_counter()
    with ManeuverBar(console, f"{spec.name} {what.name}", what) as bar, page or contextlib.nullcontext():
        try:
            shown: Callable[[float], None] = bar.advance
            for film in films:
                shown = film.beside(shown)
            if outcome.chains is not None:
                shown = _sampled(outcome.chains, what, shown)
            drive.run(shown if page is None else page.beside(shown))
            if page is not None:
                page.hold()
        except KeyboardInterrupt:
            if not drive.recorder.rows:
                raise
            outcome.interrupted = True
    outcome.wall = time.perf_counter() - begin - sum(film.seconds for film in films)
    outcome.run, outcome.channels = drive.result(), drive.recorder.channels
    outcome.steps = round(float(setup.simulation.time.numpy()[0]) / options.dt) * options.worlds
    outcome.broken, outcome.left_road = drive.broken(), drive.left_road
    return outcome


def _sampled(chains: ChainRecord, what: Maneuver, progress: Callable[[float], None]) -> Callable[[float], None]:
    """Progress that records the chains in the last second."""

    def advance(t: float) -> None:
        progress(t)
        if t > what.duration - CHAINS_TIME - 1e-9:
            chains.sample()

    return advance


def _on_soil(options: DriveOptions, road: RoadSurface | None) -> bool:
    """Whether a soil is chosen, or the road has some."""
    return options.soil is not None or (road is not None and bool(road.soils))


def _soil(vehicle: AnyVehicle, options: DriveOptions, road: RoadSurface | None) -> list[Soil]:
    """The soil below a vehicle; none below tracks, and tires that need none."""
    if isinstance(vehicle, TrackedVehicle):
        return []
    if not _on_soil(options, road) and not isinstance(vehicle.tires, SoilTires):
        return []
    given: dict[str, Any] = {} if options.spacing is None else {"spacing": options.spacing}
    if road is not None:
        given |= {"ground": road_ground(vehicle.model, road)} | road.soil_options()
    if options.soil_normal is not None:
        given["pressure_normal"] = options.soil_normal
    return [soil_under(vehicle, **{"soil": options.soil or "mid"} | given)]


def _page(setup: Setup[AnyVehicle], title: str, options: DriveOptions, console: Console) -> ManeuverView | None:
    """The page that was asked for, with a browser that looks."""
    if not options.view:
        return None
    from simwarp.cli.view.maneuver_view import ManeuverView

    if row_steps(options.dt) == 0:
        raise UsageError(f"--view shows a row every {1e3 * SAMPLE_TIME:g} ms, got --dt {options.dt:g}; take 0.001")
    page = ManeuverView(setup, title, options.port)
    console.print(f"view  {page.view.url}", highlight=False, soft_wrap=True)
    if options.open:
        webbrowser.open(page.view.url)
        page.wait()
    return page


def _print_results(
    console: Console,
    spec: AnyVehicleSpec,
    options: DriveOptions,
    outcome: Outcome,
    found: list[Result],
    judged: list[Verdict],
) -> None:
    console.print(title_of_run(spec, options, outcome.maneuver), style="bold", highlight=False, soft_wrap=True)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for item in found:
        table.add_row(item.label, item.value_text, item.unit_text)
    console.print(table)
    if judged:
        console.print(verdict_table(judged))
    end = float(outcome.run["t_s"][-1])
    if outcome.broken:
        console.print(
            f"the vehicle broke down at t = {end:.2f} s: a value is not finite; try a smaller --dt",
            style="red", highlight=False, soft_wrap=True,
        )  # fmt: skip
    if outcome.left_road is not None:
        text = f"the vehicle left the road at t = {end:.2f} s, where the run ends; take a longer one or --duration"
        console.print(text, style="red", highlight=False, soft_wrap=True)
    if outcome.interrupted:
        console.print(f"interrupted at t = {end:.2f} s; what was recorded is kept", highlight=False, soft_wrap=True)
    rate = outcome.steps / max(outcome.wall, 1e-9)
    worlds = f"{options.worlds:,} worlds that did the same" if options.worlds > 1 else "1 world"
    differ = "; --vary KEY=LOW..HIGH lets them differ" if options.worlds > 1 else ""
    console.print(f"{worlds}, {outcome.wall:.1f} s, {rate:,.0f} steps/s{differ}", highlight=False, soft_wrap=True)


def _write(
    console: Console, spec: AnyVehicleSpec, options: DriveOptions, outcome: Outcome, found: list[Result],
    judged: list[Verdict],
) -> None:  # fmt: skip
    """The files that were asked for."""
    what, title = outcome.maneuver, title_of_run(spec, options, outcome.maneuver)
    if options.output is not None:
        sources = {"vehicle": spec.name, "maneuver": what.name, **choices_of_run(spec, options)}
        write_run(outcome.run, options.output, sources, {each.name: each.meaning for each in outcome.channels})
        console.print(f"wrote {options.output}", highlight=False, markup=False, soft_wrap=True)
    if options.report is not None:
        from simwarp.cli.drive.drive_report import Driven, write_drive_report

        driven = Driven(
            title=title, vehicle=spec, maneuver=what, run=outcome.run, results=found, verdicts=judged,
            options=choices_of_run(spec, options), broken=outcome.broken, interrupted=outcome.interrupted,
        )  # fmt: skip
        write_drive_report(driven, options.report)
        console.print(f"wrote {options.report}", highlight=False, markup=False, soft_wrap=True)
    if options.csv is not None:
        outcome.run.write(options.csv)
        console.print(f"wrote {options.csv}", highlight=False, markup=False, soft_wrap=True)
    if options.plot is not None:
        path = None if what.follow is None else what.follow.paths[0]
        draw_run(outcome.run, options.plot, title, found, path, what, judged)
        console.print(f"wrote {options.plot}", highlight=False, markup=False, soft_wrap=True)
    if options.chains is not None and outcome.chains is not None and outcome.chains.samples:
        draw_chains(outcome.chains, options.chains, title)
        console.print(f"wrote {options.chains}", highlight=False, markup=False, soft_wrap=True)
    for film in outcome.films:
        with report_compiling():
            film.write()
        console.print(f"wrote {film.path}", highlight=False, markup=False, soft_wrap=True)


def _content(spec: AnyVehicleSpec, options: DriveOptions, outcome: Outcome, found: list[Result]) -> dict[str, Any]:
    """For scripts: what ran, its results, and the last value of every column."""
    files = {name: getattr(options, name) for name in ("csv", "output", "plot", "report", "chains", "video")}
    files["file"] = options.export_scene or options.record
    return {
        "vehicle": spec.name,
        "maneuver": outcome.maneuver.name,
        "options": options.chosen,
        "tire": None if isinstance(spec, TrackedVehicleSpec) else options.tire or spec.axles[0].tire.template,
        "powertrain": options.powertrain,
        "driveline": options.driveline,
        "soil": options.soil,
        "soil_normal": options.soil_normal,
        "friction": options.friction,
        "road": options.road,
        "friction_patches": [list(patch) for patch in options.friction_patch],
        "dt": options.dt,
        "worlds": options.worlds,
        "results": {item.key: item.value for item in found},
        "final": outcome.run.final(),
        **{name: None if path is None else str(path) for name, path in files.items()},
        "interrupted": outcome.interrupted,
        "broken": outcome.broken,
        "left_road_s": outcome.left_road,
        "wall_s": outcome.wall,
        "steps_per_s": outcome.steps / max(outcome.wall, 1e-9),
    }
