"""``simwarp drive --search``: the best design of a vehicle for one goal of a manoeuvre."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED, UsageError
from simwarp.cli.drive.drive_batch import parse_values
from simwarp.cli.drive.study_options import DriveChoices, StudyOptions, study_folder
from simwarp.cli.drive.study_progress import StudyBar
from simwarp.core.files import layout, replacing, write_file
from simwarp.core.stopping import StopRequest, stop_on_signals
from simwarp.identify.document_numbers import patch_of
from simwarp.model.model import resolve_device
from simwarp.study.design_goal import PASS_SPEED, Bound, Goal, parse_bound
from simwarp.study.design_search import Design, DesignSearch, SearchPlan
from simwarp.study.monte_carlo import DEVICE_BATCH, USUAL_BATCH, MonteCarlo
from simwarp.study.search_plot import draw_search
from simwarp.study.varied_vehicle import GROUND, MANEUVER, VariedVehicle, spec_of, varied_vehicle
from simwarp.vehicle.spec.vehicle_files import save_vehicle
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec


class _StoppedError(Exception):
    """A request to stop came while designs were driven."""


def run_search(spec: VehicleSpec, drive: DriveChoices, study: StudyOptions) -> int:
    """Search as the options ask for.

    Raises:
        UsageError: an option makes no sense here.
        SpecError: a key cannot be searched so, or a figure is not known.
        ModelError: optuna is not installed.
    """
    goal, bounds = _goal(study), tuple(map(parse_bound, study.subject_to))
    speeds = _speeds(drive, goal)
    name, device = drive.maneuver or "", str(resolve_device(None if drive.device == "auto" else drive.device))
    options = drive.chosen if speeds is None else {**drive.chosen, "speed": speeds[0]}
    vehicle = varied_vehicle(
        spec, name, study.search, options=options, friction=drive.friction, option="--search"
    )  # fmt: skip
    batch = study.batch or (USUAL_BATCH if device.startswith("cpu") else DEVICE_BATCH)
    plan = SearchPlan(
        vehicle=vehicle, goal=goal, bounds=bounds, speeds=speeds, trials=study.trials, at_once=study.at_once,
        seed=study.seed, batch=batch,
    )  # fmt: skip
    before = MonteCarlo(vehicle, worlds=1, seed=study.seed, dt=drive.dt, device=device, batch=batch)
    folder = study_folder(spec, drive, study)
    search = DesignSearch(plan, before.runs, folder)
    _check_figures(before, plan)
    console, title = (
        drive.table_console(),
        f"{spec.name}, {name}: {'highest' if goal.maximise else 'lowest'} {goal.key}",
    )
    begin, work = time.perf_counter(), time.process_time()
    with stop_on_signals() as stop:
        _drive(search, console, title, stop)
        interrupted = stop.requested
    wall, cpu = time.perf_counter() - begin, time.process_time() - work
    _print(console, title, search)
    files = _write(search, spec, folder, drive.plot, title)
    for path in files.values():
        console.print(f"wrote {path}", highlight=False, markup=False, soft_wrap=True)
    console.print(f"{len(search.designs)} designs, {wall:.1f} s, {cpu:.1f} s of processors", highlight=False)
    if interrupted:
        console.print("interrupted; the same command goes on", highlight=False, soft_wrap=True)
    drive.emit(
        _content(spec.name, search, drive, files) | {"interrupted": interrupted, "wall_s": wall, "cpu_s": cpu}
    )  # fmt: skip
    if interrupted:
        return INTERRUPTED
    return FELL_SHORT if search.best is None else DONE


def _goal(study: StudyOptions) -> Goal:
    """The one goal.

    Raises:
        UsageError: there is none, or two.
    """
    if (study.maximise is None) == (study.minimise is None):
        raise UsageError("--search: needs one goal, --maximise FIGURE or --minimise FIGURE")
    if study.minimise is not None:
        if study.minimise == PASS_SPEED:
            raise UsageError(f"--minimise: {PASS_SPEED} can be maximised alone")
        return Goal(study.minimise, maximise=False)
    return Goal(study.maximise or "", maximise=True)


def _speeds(drive: DriveChoices, goal: Goal) -> tuple[float, ...] | None:
    """Speeds at which every design is driven; None: as the manoeuvre's options say.

    Raises:
        UsageError: they are missing, or of no use.
    """
    if goal.key != PASS_SPEED:
        if drive.speeds is not None:
            raise UsageError(f"--speeds: is of --maximise {PASS_SPEED}; another goal has one --speed")
        return None
    if drive.speeds is None:
        raise UsageError(f"--maximise {PASS_SPEED}: needs --speeds A:B:STEP, at which every design is driven")
    if "speed" in drive.chosen:
        raise UsageError("--speed: cannot be given beside --speeds; leave it out")
    speeds = parse_values("speeds", drive.speeds)
    if sorted(set(speeds)) != speeds:
        raise UsageError(f"--speeds: must rise, got '{drive.speeds}'")
    return tuple(speeds)


def _check_figures(before: MonteCarlo, plan: SearchPlan) -> None:
    """Refuse figures that the manoeuvre does not have, by driving the vehicle as built.

    Raises:
        StudyError: so it is.
    """
    before.drive_nominal()
    if plan.goal.key == PASS_SPEED:
        if not before.judged:
            raise UsageError(f"--maximise {PASS_SPEED}: {plan.vehicle.maneuver} has no rules that could be passed")
    else:
        before.require_figure(plan.goal.key, "--maximise" if plan.goal.maximise else "--minimise")
    for bound in plan.bounds:
        before.require_figure(bound.key, "--subject-to")


def _drive(search: DesignSearch, console: Console, title: str, stop: StopRequest) -> None:
    """All designs, or those that were done when a request to stop came."""
    with StudyBar(console, title, search.plan.trials, "designs") as bar:

        def advance(done: float) -> None:
            best = search.best
            bar.advance(done, "" if best is None else f", best {best.goal:.4g}")
            if stop.requested:
                raise _StoppedError

        try:
            for _ in search.steps(advance):
                advance(len(search.designs))
        except _StoppedError:
            pass


def _print(console: Console, title: str, search: DesignSearch) -> None:
    """The best design beside the vehicle as built."""
    console.print(title, style="bold", highlight=False, soft_wrap=True)
    for bound in search.plan.bounds:
        console.print(f"with {bound.text}", highlight=False, soft_wrap=True)
    best, built = search.best, _built(search)
    if best is None:
        console.print("no design keeps all rules and bounds", style="red", highlight=False, soft_wrap=True)
        return
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for column in ("", "built", f"best ({best.number})"):
        table.add_column(column, justify="right" if column else "left", no_wrap=bool(column))
    nominal = search.plan.vehicle.nominal()
    for key, before, after in zip(search.plan.vehicle.keys, nominal, best.values, strict=True):
        table.add_row(f"{key.name}{' x' if key.factor else ''}", f"{before:.5g}", f"{after:.5g}")
    table.add_section()
    goals = [(search.plan.goal.key, "goal"), ("highest speed passed", "highest")]
    for label, name in goals if search.plan.speeds is not None else goals[:1]:
        table.add_row(label, *(_text(None if each is None else getattr(each, name)) for each in (built, best)))
    for figure in best.figures:
        table.add_row(figure, *(_text(None if each is None else each.figures.get(figure)) for each in (built, best)))
    console.print(table)


def _built(search: DesignSearch) -> Design | None:
    """The vehicle as built among the designs."""
    nominal = search.plan.vehicle.nominal()
    return next((each for each in search.designs if _near(each.values, nominal)), None)


def _near(one: Sequence[float], other: Sequence[float]) -> bool:
    return all(math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-12) for a, b in zip(one, other, strict=True))


def _text(value: float | None) -> str:
    """A number for people."""
    return "" if value is None or math.isnan(value) else f"{value:.4g}"


def _write(search: DesignSearch, spec: VehicleSpec, folder: Path, plot: Path | None, title: str) -> dict[str, Path]:
    """The best vehicle, what of it differs, a table of all designs and a picture."""
    files = {"trials": folder / "trials.csv", "plot": plot or folder / "search.png"}
    if not search.designs:
        return {}
    vehicle, names = search.plan.vehicle, [key.name for key in search.plan.vehicle.keys]
    with replacing(files["trials"]) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        figures = list(dict.fromkeys(key for each in search.designs for key in each.figures))
        writer.writerow(["design", *names, search.plan.goal.key, "highest", "kept", *figures, "trouble"])
        for each in search.designs:
            numbers = [f"{value:.9g}" for value in (*each.values, each.goal, each.highest)]
            rest = [f"{each.figures.get(key, math.nan):.9g}" for key in figures]
            writer.writerow([each.number, *numbers, int(each.kept), *rest, each.trouble])
    draw_search(search.designs, vehicle.keys, search.plan.goal, files["plot"], title)
    best = search.best
    if best is not None:
        files |= {"vehicle": folder / "best.json", "patch": folder / "patch.json"}
        document = vehicle.changed(best.values)
        save_vehicle(spec_of(document), files["vehicle"])
        write_file(files["patch"], layout(_patch(vehicle, document)) + "\n")
    return files


def _patch(vehicle: VariedVehicle, document: Any) -> Any:
    """What of the vehicle's file differs."""
    mine, theirs = (
        {key: value for key, value in each.items() if key not in (GROUND, MANEUVER)}
        for each in (vehicle.document, document)
    )
    return patch_of(mine, theirs)


def _content(name: str, search: DesignSearch, drive: DriveChoices, files: dict[str, Path]) -> dict[str, Any]:
    """For scripts."""
    plan = search.plan
    return {
        "vehicle": name, "maneuver": plan.vehicle.maneuver, "options": drive.chosen, "friction": drive.friction,
        "dt": drive.dt, "seed": plan.seed, "goal": plan.goal.key, "maximise": plan.goal.maximise,
        "subject_to": [_bound(each) for each in plan.bounds], "speeds": plan.speeds,
        "keys": [{"name": key.name, "distribution": key.distribution.text, "factor": key.factor}
                 for key in plan.vehicle.keys],
        "designs": [_plain(each, plan) for each in search.designs], "trials": len(search.designs),
        "best": None if search.best is None else _plain(search.best, plan),
        "built": None if (built := _built(search)) is None else _plain(built, plan),
        "files": {key: str(path) for key, path in files.items()},
    }  # fmt: skip


def _bound(each: Bound) -> str:
    return each.text


def _plain(each: Design, plan: SearchPlan) -> dict[str, Any]:
    return {
        "design": each.number, "values": dict(zip((key.name for key in plan.vehicle.keys), each.values, strict=True)),
        "goal": each.goal, "highest_passed": each.highest, "kept": each.kept, "figures": dict(each.figures),
        "trouble": each.trouble,
    }  # fmt: skip
