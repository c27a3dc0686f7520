"""`simwarp bench SCENE`: the command line around the measurements."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

import simwarp
from simwarp.bench.compiling import cold_and_warm
from simwarp.bench.machine import describe
from simwarp.bench.measure import Row, enter_cost_per_vehicle
from simwarp.bench.subjects import Choices, Measure, find_subject
from simwarp.bench.workloads import SENSOR_SCENES, TASK_SUFFIX, display_names
from simwarp.cli import DONE, FELL_SHORT, UsageError, shortened
from simwarp.cli.options import (
    TASK_FILE,
    CommonOptions,
    option_value,
    parse_options,
    require_subject,
    split_subject,
)
from simwarp.cli.values import LARGEST_COUNT
from simwarp.core.threads import MOST_THREADS, default_threads, thread_count
from simwarp.model.model import resolve_device
from simwarp.soil.soil_parameters import soil_preset
from simwarp.vehicle.vehicle_convoy import MOST_VEHICLES

_SOURCES = {"this process": "this process", "cold process": "a new process with an empty kernel cache"}

MOST_ROWS: Final = 64
"""Numbers of worlds of one table."""
LONGEST: Final = 3600
"""Time to step for, per row [s]."""

SHORTEST_STEP: Final = 1e-9
LONGEST_STEP: Final = 10.0
"""[s]"""

EMULATED: Final = "emulated"
"""Device that is a program of the tests."""

Flag = tyro.conf.FlagCreatePairsOff[bool]


@dataclasses.dataclass(frozen=True)
class BenchOptions(CommonOptions):
    """Speed of a scene, a vehicle, a sensor or a task over numbers of worlds.

    No speed is told of a state that is not sound (exit code 1).

    Scenes: `simwarp bench --help`. A vehicle is timed in the moving part of the manoeuvre reference-steer.
    """

    worlds: Annotated[str, tyro.conf.arg(metavar="N,N,...")] = "1,256,1024"
    """Numbers of worlds, one row each."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto. `emulated`: counts of an emulated GPU and a time by model (of a checkout alone)."""
    dt: float | None = None
    """Time step [s]; by default the scene's own."""
    seconds: float = 1.0
    """Time to step for, per row [s], in five parts."""
    obs: str | None = None
    """Observations of a task that has a choice: state or camera."""
    spacing: Annotated[float | None, tyro.conf.arg(metavar="m")] = None
    """Of the soil's nodes, of what drives on soil; by default 0.05."""
    vehicles: int | None = None
    """In each world of a convoy (hmmwv-convoy); by default 4. A row with one vehicle stands before: `cost` is what each
    of several costs, where one alone costs 1."""
    soil: str | None = None
    """Preset that a convoy drives on, such as mid; by default firm ground."""
    compile: Flag = False
    """Also measure a cold start: a new process with an empty kernel cache, then one with a filled one (slow)."""
    threads: Annotated[str | None, tyro.conf.arg(metavar="N,N,...")] = None
    """Numbers of CPU threads, a row each for every number of worlds; by default one thread, and all processors."""
    peers: Flag = False
    """Other engines on the same scene, where they are installed."""


def run(arguments: list[str]) -> int:
    """Measure as the arguments say; 1 where a state was refused."""
    word, rest = _split_scene(arguments)
    name = _task_in_file(word) if TASK_FILE in word else word
    subject = find_subject(name, _task_names, _choices(rest))
    options = parse_options(BenchOptions, rest, f"simwarp bench {word}")
    options.check()
    worlds = whole_numbers("worlds", options.worlds, LARGEST_COUNT)
    _require_positive("dt", options.dt)
    _require_positive("seconds", options.seconds)
    if options.dt is not None and not SHORTEST_STEP <= options.dt <= LONGEST_STEP:
        raise UsageError(f"dt must be from {SHORTEST_STEP:g} to {LONGEST_STEP:g} s, got {options.dt:g}")
    if options.seconds > LONGEST:
        raise UsageError(f"seconds must be at most {LONGEST}, got {options.seconds:g}")
    if options.device == EMULATED:
        return _count_on_emulated_device(word, rest)
    device = resolve_device(None if options.device == "auto" else options.device)
    threads = _thread_counts(options.threads, device)
    machine = describe(device)
    console = options.console()

    numbers = str(device), options.dt, options.seconds
    rows = _rows(subject.measures, worlds, threads, numbers)
    enter_cost_per_vehicle(rows)
    if options.compile and subject.cold_name is not None:
        _enter_cold_start(rows, subject.cold_name, str(device))
    peers: list[Row] = []
    notes: tuple[str, ...] = ()
    if options.peers:
        notes = subject.notes
        peers = _rows(subject.peers, worlds, threads, numbers)
    _print(console, name, rows, peers, notes, machine)
    options.emit(
        {
            "scene": name,
            "kind": subject.kind,
            "machine": machine,
            "rows": [dataclasses.asdict(row) for row in rows],
            "peers": [dataclasses.asdict(row) for row in peers],
            "notes": list(notes),
        }
    )
    return DONE if all(row.valid for row in rows + peers) else FELL_SHORT


def _count_on_emulated_device(word: str, rest: list[str]) -> int:
    """Start a process on the emulated CUDA device, which belongs to the checkout, and count there."""
    folder = Path(simwarp.__file__).resolve().parents[1] / "tests" / "emulated_cuda"
    if not (folder / "__main__.py").is_file():
        raise UsageError(
            f"--device {EMULATED} needs a checkout of the project, which '{folder.parents[1]}' is not; clone it"
        )
    command = [sys.executable, str(folder), "-m", "tests.emulated_cuda.counts.scene_counts", word, *rest]
    environment = {**os.environ, "EMULATED_CUDA_CHECK": "count", "EMULATED_CUDA_REPORT": "0"}
    return subprocess.run(command, env=environment, check=False).returncode


def _choices(words: list[str]) -> Choices:
    """What is chosen for some subjects alone: looked at before anything that takes long."""
    vehicles, soil = _number(option_value(words, "--vehicles")), option_value(words, "--soil")
    if vehicles is not None and not (1 <= vehicles <= MOST_VEHICLES and vehicles == int(vehicles)):
        raise UsageError(f"vehicles must be a whole number from 1 to {MOST_VEHICLES}, got {vehicles:g}")
    if soil is not None:
        soil_preset(soil)
    return Choices(
        obs=option_value(words, "--obs"), spacing=_number(option_value(words, "--spacing")),
        vehicles=None if vehicles is None else int(vehicles), soil=soil,
    )  # fmt: skip


def _number(word: str | None) -> float | None:
    """The number that a word is; None where it is none, which the parser of the options tells."""
    try:
        return None if word is None else float(word)
    except ValueError:
        return None


def _task_names() -> list[str]:
    """Names of the tasks: importing them takes seconds, for torch."""
    from simwarp.tasks import task_names

    return task_names()


def _task_in_file(word: str) -> str:
    """Return the name by which a task of a file is measured, once it is loaded."""
    from simwarp.tasks import task_class

    return display_names([task_class(word).name])[-1]


def _split_scene(arguments: list[str]) -> tuple[str, list[str]]:
    """Split the SCENE off the arguments: the first one, or the first that names something known."""
    if arguments and not arguments[0].startswith("-"):
        return arguments[0], arguments[1:]  # without the names, which take seconds to find
    known, usage = display_names(_task_names()), "usage: simwarp bench SCENE [options]"
    names = ", ".join(known)
    subjects = f"scenes, vehicles, sensors and tasks: {names}"
    overview = f"{usage}\n\n{subjects}\n\n`simwarp bench SCENE --help` lists the options."
    word, rest = split_subject(arguments, lambda word: word in known or word.endswith(TASK_SUFFIX) or TASK_FILE in word)
    return require_subject(word, arguments, overview, f"which scene? {usage}; there are: {names}"), rest


def whole_numbers(name: str, text: str, most: int) -> list[int]:
    """Read numbers with commas between.

    Args:
        name: of the option.
        text: its value.
        most: largest number that is allowed.

    Raises:
        UsageError: they are none, or not from 1 to `most`.
    """
    words = [word.strip() for word in text.split(",")]
    if not all(re.fullmatch("-?[0-9]{1,20}", word) for word in words):
        example = "1,256,1024" if name == "worlds" else "1,2"
        rule = f"{name} must be whole numbers with commas between, such as {example}"
        raise UsageError(f"{rule}, got '{shortened(text)}'")
    counts = [int(word) for word in words]
    if min(counts) < 1:
        raise UsageError(f"{name} must each be at least 1, got '{shortened(text)}'")
    if max(counts) > most:
        raise UsageError(f"{name} must each be at most {most}, got '{shortened(text)}'; use fewer {name}")
    if len(counts) > MOST_ROWS:
        raise UsageError(f"{name} must be at most {MOST_ROWS} numbers, got {len(counts)}")
    return counts


def _thread_counts(text: str | None, device: Any) -> list[int]:
    """One thread and all of them, unless told; on a GPU one."""
    if text is not None:
        return whole_numbers("threads", text, MOST_THREADS)
    return [1] if device.is_cuda else sorted({1, thread_count()})


def _rows(measures: Sequence[Measure], worlds: list[int], threads: list[int], numbers: tuple[Any, ...]) -> list[Row]:
    """A row for every measure, number of worlds and number of threads."""
    rows = []
    for measure in measures:
        for count in worlds:
            for shared in threads:
                with default_threads(shared):
                    rows.append(dataclasses.replace(measure(count, *numbers), threads=shared))
    return rows


def _require_positive(name: str, value: float | None) -> None:
    if value is not None and not (math.isfinite(value) and value > 0.0):
        raise UsageError(f"{name} must be a positive number of seconds, got {value}")


def _enter_cold_start(rows: list[Row], name: str, device: str) -> None:
    cold, warm = cold_and_warm(name, device)
    for row in rows:
        row.compile_s, row.compile_cpu_s = cold
        row.compile_warm_s, row.compile_source = warm.wall_s, "cold process"


def _print(
    console: Console, name: str, rows: list[Row], peers: list[Row], notes: tuple[str, ...], machine: dict[str, Any]
) -> None:
    console.print(
        ", ".join([name, *([f"dt {rows[0].dt:g} s"] if rows[0].dt else []), machine["gpu"] or machine["cpu"]]),
        style="bold",
        highlight=False,
        soft_wrap=True,
    )
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("engine", no_wrap=True)
    headings = ["worlds", "threads", "steps/s", "steps/CPU-s", "residual", "joints apart"]
    if name in SENSOR_SCENES:
        unit = "rays" if name == "rays" else "frames"
        headings[2:] = [f"{unit}/s", f"{unit}/CPU-s"]
    touching = any(row.contacts is not None for row in rows + peers)
    if touching:
        headings[5:] = ["contacts", "iter."]
    convoy = any(row.vehicles is not None for row in rows)
    if convoy:
        headings[5:] = ["vehicles", "cost"]
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows + peers:
        cells = [
            f"{row.worlds:,}",
            str(row.threads),
            _rate(row.steps_per_s),
            _rate(row.steps_per_cpu_s),
            _small(row.residual),
        ]
        cells += [_mean(row.contacts), _mean(row.iterations)] if touching else [_small(row.position_error)]
        if convoy:
            cells[5:] = [str(row.vehicles or ""), "" if row.cost_per_vehicle is None else f"{row.cost_per_vehicle:.2f}"]
        table.add_row(row.engine if row.scene == name else f"{row.engine} {row.scene}", *cells[: len(headings)])
    console.print(table)
    for row in rows + peers:
        if not row.valid:
            console.print(
                f"refused: {row.engine}, {row.worlds:,} worlds: {'; '.join(row.problems)}",
                highlight=False, markup=False, soft_wrap=True,
            )  # fmt: skip
        if row.split is not None:
            parts = ", ".join(f"{part} {100.0 * share:.0f} %" for part, share in row.split.items())
            console.print(f"{row.worlds:,} worlds: {parts}", highlight=False, soft_wrap=True)
    errors = {row.engine: row.error for row in rows + peers if row.error is not None}
    if errors:
        told = ", ".join(f"{engine} {100.0 * error:.2g} %" for engine, error in errors.items())
        console.print(f"error at rest: {told}", highlight=False, soft_wrap=True)
    console.print(_costs(rows[0]), highlight=False, soft_wrap=True)
    for note in notes:
        console.print(note, highlight=False, markup=False, soft_wrap=True)


def _rate(value: float | None) -> str:
    return "refused" if value is None else f"{value:,.0f}"


def _small(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _mean(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _costs(row: Row) -> str:
    """Costs that do not depend on the number of worlds."""
    parts = [] if row.tolerance is None else [f"solved to {row.tolerance:g}"]
    parts.append(f"{row.launches_per_step} launch{'es' if row.launches_per_step != 1 else ''} per step")
    if row.launches_beside_graph is not None:
        parts[-1] += f", in one graph with {row.launches_beside_graph} beside it"
    if row.bytes_per_world is not None:
        parts.append(f"{row.bytes_per_world:,} B per world and {row.bytes_shared:,} B shared")
    parts.append(f"model to first step {row.compile_s:.2f} s in {_SOURCES[row.compile_source]}")
    if row.compile_warm_s is not None:
        parts[-1] += f" ({row.compile_cpu_s:.2f} s of CPU time)"
        parts.append(f"{row.compile_warm_s:.2f} s with a filled one")
    return "; ".join(parts)
