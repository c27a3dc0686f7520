"""What all rigs share on the command line: options, the vehicle that is meant, progress, files and tables."""

from __future__ import annotations

import contextlib
import dataclasses
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress as Bar, TextColumn, TimeRemainingColumn
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED, UsageError
from simwarp.cli.options import CommonOptions
from simwarp.core.threads import default_threads
from simwarp.core.warp_start import LINES_APART, report_compiling, start_warp
from simwarp.model.model import resolve_device
from simwarp.vehicle.rigs.rig_rows import Progress, RigRows, RowStatus
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.tracks.tracked_files import load_any_vehicle

PICTURES: Final = (".png", ".pdf", ".svg")
REPORTED_EVERY: Final = 10.0
"""Between lines of progress where there is no terminal [s]."""
MOST_REASONS: Final = 4
"""Kinds of reasons that are printed; files have them all."""
VARYING: Final = re.compile(r"'[^']*'|-?\d[\d.]*(e[-+]?\d+)?")
"""What makes no other kind of a reason: names in quotes, and numbers."""
NOTHING: Final = 1e-9
"""Smallest number of a table that is not rounding."""


@dataclasses.dataclass(frozen=True)
class RigOptions(CommonOptions):
    """Options of all rigs."""

    csv: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is written)")] = None
    """Writes the rows to this file."""
    plot: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none is drawn)")] = None
    """Writes a page of plots: .png, .pdf or .svg."""
    threads: Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: all processors)")] = None
    """CPU threads that share the worlds of a sweep."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""

    @property
    def device_name(self) -> str:
        """The device that is meant."""
        return str(resolve_device(None if self.device == "auto" else self.device))

    def refuse(self, target: str, *inputs: str) -> None:
        """Refuse what cannot be written, before any work is done.

        Raises:
            UsageError: two files are the same, or a picture has no known format.
            FileError: one cannot be written.
        """
        self.check(*(word for word in (target, *inputs) if word.endswith(".json")), csv=self.csv, plot=self.plot)
        if self.plot is not None and self.plot.suffix not in PICTURES:
            raise UsageError(f"cannot write '{self.plot}': the name must end in {', '.join(PICTURES)}")

    @contextlib.contextmanager
    def shared(self) -> Iterator[None]:
        """A block whose simulations take the threads that were asked for."""
        with contextlib.nullcontext() if self.threads is None else default_threads(self.threads):
            yield


def wheeled_vehicle(target: str, rig: str) -> VehicleSpec:
    """A vehicle by its name or file.

    Raises:
        SpecError: there is none, or its file has a mistake.
        UsageError: it has tracks.
    """
    spec = load_any_vehicle(target)
    if isinstance(spec, TrackedVehicleSpec):
        raise UsageError(f"rig {rig}: '{spec.name}' has tracks; a rig holds vehicles on wheels, so take one of these")
    if rig != "tire":
        spec.require_linkages(f"rig {rig}")
    return spec


@contextlib.contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Progress on standard error: a bar on a terminal, elsewhere a line now and then; and of kernels as they are
    compiled.
    """
    console = Console(stderr=True, markup=False, emoji=False)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn())
    reported = time.perf_counter()
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=1.0)

        def advance(share: float) -> None:
            nonlocal reported
            bar.update(task, completed=share, description=title)
            if not console.is_terminal and time.perf_counter() - reported > REPORTED_EVERY:
                reported = time.perf_counter()
                console.print(f"{title}: {100.0 * share:.0f} %", highlight=False)

        def compiling(text: str) -> None:
            if console.is_terminal:
                bar.update(task, description=f"{title}: {text}")
            else:
                console.print(f"{title}: {text}", highlight=False, soft_wrap=True)

        start_warp()
        with report_compiling(compiling, every=1.0 if console.is_terminal else LINES_APART):
            yield advance


def print_table(console: Console, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table: names to the left, numbers to the right."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number == 0 else "right")
    for row in rows:
        table.add_row(*row)
    console.print(table)


def print_values(console: Console, values: Mapping[str, float], meanings: Mapping[str, str] | None = None) -> None:
    """A table of names and numbers, with what some of them mean."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
    table.add_column("quantity")
    table.add_column("value", justify="right")
    if meanings:
        table.add_column("meaning", style="dim")
    for name, value in values.items():
        told = [meanings.get(name, "")] if meanings else []
        table.add_row(name, f"{0.0 if abs(value) < NOTHING else value:.4g}", *told)
    console.print(table)


def finish(
    console: Console, options: RigOptions, rows: RigRows, content: Mapping[str, Any], *, interrupted: bool, wall: float,
    beside: Sequence[RigRows] = (),
) -> int:  # fmt: skip
    """Write the files of a rig, report rows that are missing with the reasons, and return the exit code: 1 where a row
    diverged.

    Args:
        console: for people.
        options: with the files.
        rows: of the sweep.
        content: what stands in the JSON file beside the rows.
        interrupted: the run was.
        wall: time that it took [s].
        beside: rows of further sweeps, which stand in the content.
    """
    every = [rows, *beside]
    total = sum(len(each.status) for each in every)
    diverged, unfinished, tipped = (
        sum(each.count(kind) for each in every) for kind in (RowStatus.DIVERGED, RowStatus.UNFINISHED, RowStatus.TIPPED)
    )
    if options.csv is not None:
        rows.write(options.csv)
        console.print(f"wrote {options.csv}", highlight=False, soft_wrap=True)
    if diverged:
        console.print(
            f"{diverged} of {total} rows diverged: see the columns status and reason", style="red", soft_wrap=True
        )
        _print_reasons(console, [line for each in every for line in each.divergences()])
    if tipped:
        console.print(f"{tipped} of {total} rows tipped over, as the columns status and reason tell", soft_wrap=True)
    if unfinished:
        console.print(f"{unfinished} of {total} rows are unfinished: see the column status", soft_wrap=True)
    if interrupted:
        console.print("interrupted; the rows that are done are kept", soft_wrap=True)
    console.print(f"{total} rows, {wall:.1f} s", highlight=False, soft_wrap=True)
    counts = {
        "rows": total,
        "diverged": diverged,
        "unfinished": unfinished,
        "tipped": tipped,
        "interrupted": interrupted,
    }
    files = {name: None if path is None else str(path) for name, path in (("csv", options.csv), ("plot", options.plot))}
    options.emit({**content, "curves": rows.as_json(), **counts, **files, "wall_s": wall})
    if interrupted:
        return INTERRUPTED
    return FELL_SHORT if diverged else DONE


def _print_reasons(console: Console, lines: Sequence[str]) -> None:
    """One line for each kind of reason, with the first row that has it; kinds differ in more than numbers and names."""
    first: dict[str, str] = {}
    for line in lines:
        first.setdefault(VARYING.sub("", line), line)
    for line in list(first.values())[:MOST_REASONS]:
        console.print(f"  {line}", highlight=False, markup=False, soft_wrap=True)
    if len(lines) > min(len(first), MOST_REASONS):
        others = len(lines) - min(len(first), MOST_REASONS)
        console.print(f"  and {others} more, likewise", highlight=False, soft_wrap=True)
