"""``simwarp drive --vary``: a manoeuvre in many worlds whose vehicles differ by chance."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any, Final

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED
from simwarp.cli.drive.study_options import DriveChoices, StudyOptions, WorstFilm, check_study, study_folder
from simwarp.cli.drive.study_progress import StudyBar
from simwarp.core.object_repr import plural
from simwarp.core.stopping import StopRequest, stop_on_signals
from simwarp.model.model import resolve_device
from simwarp.study.monte_carlo import MonteCarlo, StudyResult, StudyRow, Worst, rows_of
from simwarp.study.study_plot import draw_study
from simwarp.study.study_summary import QUANTILES, FigureSummary
from simwarp.study.varied_vehicle import MANEUVER, friction_of, spec_of, varied_vehicle
from simwarp.vehicle.results.runs import Drive
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec
from simwarp.vehicle.spec.vehicle_files import save_vehicle

SHOWN_WORST: Final = 5
FILM_SIZE: Final = (640, 360)
"""Of films of the worst worlds, a third of the work of the usual size."""


class _StoppedError(Exception):
    """A request to stop came while worlds were driven."""


def run_study(any_spec: AnyVehicleSpec, drive: DriveChoices, study: StudyOptions) -> int:
    """Make the study that the options ask for.

    Raises:
        UsageError: an option makes no sense here.
        SpecError: a key cannot be varied so.
    """
    spec = check_study(any_spec, drive, study)
    if study.search:
        from simwarp.cli.drive.drive_search import run_search

        return run_search(spec, drive, study)
    name = drive.maneuver or ""
    vehicle = varied_vehicle(spec, name, study.vary, options=drive.chosen, friction=drive.friction)
    made = MonteCarlo(
        vehicle, worlds=drive.worlds, seed=study.seed, dt=drive.dt, batch=study.batch,
        device=str(resolve_device(None if drive.device == "auto" else drive.device)),
    )  # fmt: skip
    title = f"{spec.name}, {name}, {plural(drive.worlds, 'world')}"
    console = drive.table_console()
    begin, work = time.perf_counter(), time.process_time()
    made.drive_nominal()
    by = made.worst_by(study.worst_by) if study.worst or made.judged else None
    with stop_on_signals() as stop:
        result = _drive(made, drive, console, title, stop)
        interrupted = stop.requested
        wall, cpu = time.perf_counter() - begin, time.process_time() - work
        _print(console, title, made, result, by, interrupted)
        console.print(f"{plural(len(result.rows), 'world')}, {wall:.1f} s, {cpu:.1f} s of processors", highlight=False)
        _write(drive, result, title, console)
        worst = [] if by is None else result.worst(by, study.worst)
        files = _write_worst(made, worst, study, study_folder(spec, drive, study), console, stop)
        interrupted = stop.requested
    drive.emit(
        _content(spec.name, made, drive, result, files)
        | {"interrupted": interrupted, "wall_s": wall, "cpu_s": cpu, "worst_by": None if by is None else by.key}
    )
    if interrupted:
        return INTERRUPTED
    return DONE if result.sound else FELL_SHORT


def _drive(made: MonteCarlo, drive: DriveChoices, console: Console, title: str, stop: StopRequest) -> StudyResult:
    """All worlds, or those of the batches that were done when a request to stop came."""
    with StudyBar(console, title, drive.worlds, "worlds") as bar:

        def advance(done: float) -> None:
            bar.advance(done)
            if stop.requested:
                raise _StoppedError

        try:
            for result in made.steps(advance):
                if drive.csv is not None:
                    result.write_rows(drive.csv)
                if stop.requested:
                    break
        except _StoppedError:
            pass
    return made.result()


def _print(
    console: Console, title: str, made: MonteCarlo, result: StudyResult, by: Worst | None, interrupted: bool
) -> None:
    """The tables of a study."""
    console.print(title, style="bold", highlight=False, soft_wrap=True)
    for number, key in enumerate(made.vehicle.keys, 1):
        console.print(f"({number}) {key.name} = {key.distribution.text}", highlight=False, soft_wrap=True)
    found = result.summaries()
    console.print(figure_table(found))
    if found and len(result.sound) > 1:
        console.print(correlation_table(found, len(result.keys)))
        chance = found[0].chance
        text = f"rank correlations below {chance:.2f} may be chance (95 %)"
        few = "too few worlds: any rank correlation may be chance"
        console.print(text if chance < 1.0 else few, highlight=False, soft_wrap=True)
    passes = result.passes()
    if passes is not None:
        good, of, (low, high) = passes
        share = f"passed: {good} of {of}, {100 * good / max(of, 1):.1f} %"
        console.print(f"{share} (95 %: {100 * low:.1f} to {100 * high:.1f} %)", highlight=False, soft_wrap=True)
    troubled = [row for row in result.rows if not row.sound]
    if troubled:
        first = troubled[0]
        text = f"{plural(len(troubled), 'world')} without figures, the first {first.world}: {first.trouble}"
        console.print(text, style="red", highlight=False, soft_wrap=True)
    if by is not None and result.rows:
        worst = result.worst(by, SHOWN_WORST)
        texts = [f"{row.world} ({row.trouble or _text(row.figures.get(by.key))})" for row in worst]
        console.print(f"worst by {by.key}: {', '.join(texts)}", highlight=False, soft_wrap=True)
    if interrupted:
        done = f"{len(result.rows)} of {made.worlds} worlds are done and kept"
        console.print(f"interrupted: {done}", highlight=False, soft_wrap=True)


def figure_table(found: list[FigureSummary]) -> Table:
    """A row for each figure: as built, mean, standard deviation, quantiles."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for name in ("figure", "unit", "built", "mean", "std", *(f"{part} %" for part in QUANTILES), "missing"):
        table.add_column(name, justify="left" if name in ("figure", "unit") else "right", no_wrap=True)
    for each in found:
        numbers = (each.nominal, each.mean, each.deviation, *each.quantiles.values())
        table.add_row(each.figure.key, each.figure.unit, *map(_text, numbers), str(each.missing or ""))
    return table


def correlation_table(found: list[FigureSummary], count: int) -> Table:
    """A row for each figure, with its rank correlation to every key; keys are called by their numbers."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("rank correlation", no_wrap=True)
    for number in range(1, count + 1):
        table.add_column(f"({number})", justify="right", no_wrap=True)
    for each in found:
        table.add_row(each.figure.key, *(f"{value:+.2f}" if value == value else "" for value in each.correlations))
    return table


def _text(value: float | None) -> str:
    """A number for people."""
    if value is None or value != value:
        return ""
    return "0" if abs(value) < 5e-7 else f"{value:.3g}" if abs(value) < 1.0 else f"{value:.4g}"


def _write(drive: DriveChoices, result: StudyResult, title: str, console: Console) -> None:
    """The files of all worlds that were asked for."""
    if drive.csv is not None:
        result.write_rows(drive.csv)
        console.print(f"wrote {drive.csv}", highlight=False, markup=False, soft_wrap=True)
    if drive.plot is not None and result.sound:
        draw_study(result, drive.plot, title)
        console.print(f"wrote {drive.plot}", highlight=False, markup=False, soft_wrap=True)


def _write_worst(
    made: MonteCarlo, rows: list[StudyRow], study: StudyOptions, folder: Path, console: Console, stop: StopRequest
) -> list[dict[str, Any]]:
    """Drive the worst worlds once more, each alone: a table, a film, the vehicle's file."""
    written = []
    for number, row in enumerate(rows, 1):
        if stop.requested:
            break
        folder.mkdir(parents=True, exist_ok=True)
        files = _write_world(made, row, study.worst_film, folder / f"worst_{number}", console, stop)
        for path in files.values():
            console.print(f"wrote {path}", highlight=False, markup=False, soft_wrap=True)
        if files:
            console.print(f"the same again: {_again(made, row, files)}", highlight=False, markup=False, soft_wrap=True)
        written.append({
            "world": row.world, "values": dict(zip(made.result().keys, row.values, strict=True)),
            "figures": dict(row.figures), "passed": row.passed, "trouble": row.trouble,
            "files": {kind: str(path) for kind, path in files.items()},
        })  # fmt: skip
    return written


def _again(made: MonteCarlo, row: StudyRow, files: dict[str, Path]) -> str:
    """The command that drives a world by itself: its file has neither road nor manoeuvre."""
    document = made.vehicle.changed(row.values)
    given = {key: value for key, value in document[MANEUVER].items() if not math.isnan(value)}
    given |= {"friction": friction_of(document), "dt": made.runs.dt}
    options = [f"--{key.replace('_', '-')} {value!r}" for key, value in given.items()]
    return " ".join(["simwarp drive", str(files["vehicle"]), "--maneuver", made.vehicle.maneuver, *options])


def _write_world(
    made: MonteCarlo, row: StudyRow, film: WorstFilm, stem: Path, console: Console, stop: StopRequest
) -> dict[str, Path]:
    """Files of one world; none of one that cannot be built. A request to stop leaves the vehicle's."""
    document = made.vehicle.changed(row.values)
    try:
        setup = made.runs.alone(document)
    except ValueError:
        return {}
    drive, seconds = Drive(setup), max(setup.maneuver.duration, 1e-9)
    files = {"vehicle": stem.with_suffix(".json")}
    save_vehicle(spec_of(document), files["vehicle"])
    with StudyBar(console, stem.name, 100, "%") as bar:

        def advance(t: float) -> None:
            bar.advance(100.0 * min(1.0, (t + setup.maneuver.start) / seconds))
            if stop.requested:
                raise _StoppedError

        try:
            if film is WorstFilm.NONE:
                run = drive.run(advance)
            else:
                from simwarp.cli.view.drive_film import DriveFilm

                video = stem.with_suffix(f".{film.value}")
                camera = DriveFilm(setup, video, FILM_SIZE)
                run = drive.run(camera.beside(advance))
        except _StoppedError:
            return files
    files["csv"] = stem.with_suffix(".csv")
    run.write(files["csv"])
    if film is not WorstFilm.NONE:
        files["video"] = video
        camera.write()
    return files


def _content(
    name: str, made: MonteCarlo, drive: DriveChoices, result: StudyResult, worst: list[dict[str, Any]]
) -> dict[str, Any]:
    """For scripts."""
    found = result.summaries()
    passes = result.passes()
    share = None
    if passes is not None:
        good, of, (low, high) = passes
        share = {"passed": good, "worlds": of, "share": good / max(of, 1), "low": low, "high": high}
    return {
        "vehicle": name, "maneuver": made.vehicle.maneuver, "options": drive.chosen, "friction": drive.friction,
        "dt": drive.dt, "worlds": made.worlds, "done": len(result.rows), "seed": made.seed,
        "keys": [
            {"name": key.name, "distribution": key.distribution.text, "kind": key.distribution.kind.value,
             "factor": key.factor}
            for key in made.vehicle.keys
        ],
        "figures": [each.plain(result.keys) for each in found],
        "quantiles": {each.figure.key: {str(k): v for k, v in each.quantiles.items()} for each in found},
        "passes": share, "broken": sum(not row.sound for row in result.rows), "rows": rows_of(result),
        "worst": worst, "csv": None if drive.csv is None else str(drive.csv),
        "plot": None if drive.plot is None else str(drive.plot),
    }  # fmt: skip
