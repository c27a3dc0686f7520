"""Logs of recorded runs: columns of numbers over time, from CSV and npz files."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core import files
from simwarp.core.types import formatted
from simwarp.core.wording import nearest, shortened
from simwarp.identify.fit_config import Column, FitConfig, LoggedRun
from simwarp.identify.fit_error import FitError
from simwarp.identify.log_units import factor_of

Array = npt.NDArray[np.float64]

LEAST_ROWS: Final = 2
"""Of a column that is used."""


@dataclasses.dataclass(frozen=True)
class Signal:
    """Samples of one quantity in SI, (n,) each; times rise."""

    time: Array
    value: Array

    def at(self, times: Array, *, hold: bool = False) -> Array:
        """Values at times, linear between the samples or held; the first and last ones beyond them."""
        if hold:
            before = np.clip(np.searchsorted(self.time, times + 1e-9, side="right") - 1, 0, None)
            return np.asarray(self.value[before])
        return np.asarray(np.interp(times, self.time, self.value))

    def within(self, begin: float, end: float) -> Signal:
        """The samples from one time up to, but not at, another."""
        inside = (self.time >= begin - 1e-9) & (self.time < end - 1e-9)
        return Signal(self.time[inside], self.value[inside])


@dataclasses.dataclass(frozen=True)
class RunLog:
    """A run as the fit uses it.

    Attributes:
        config: what was asked for.
        readings, inputs: by name, in SI.
        begin, end: times between which it is used [s].
    """

    config: LoggedRun
    readings: Mapping[str, Signal]
    inputs: Mapping[str, Signal]
    begin: float
    end: float


def read_run(config: FitConfig, run: LoggedRun) -> RunLog:
    """The columns of a run that a fit uses.

    Raises:
        FitError: a file cannot be read, a column is missing, a number is not finite, or clocks do not overlap.
    """
    tables = [_table(config.path_of(name)) for name in run.file]
    clock = run.clock or (0.0,) * len(tables)
    times = [
        _times(name, table, config.time, shift) for name, table, shift in zip(run.file, tables, clock, strict=True)
    ]
    found: dict[str, dict[str, Signal]] = {"readings": {}, "inputs": {}}
    for kind, wanted in (("readings", config.readings), ("inputs", config.inputs)):
        for name, column in wanted.items():
            index = _file_with(run, tables, column, f"{kind}.{name}")
            values = tables[index][column.column or name]
            found[kind][name] = _signal(run.file[index], column, f"{kind}.{name}", times[index], values)
    begin, end = _common_span(run, [*found["readings"].values(), *found["inputs"].values()])
    begin = begin if run.begin is None else run.begin
    end = end if run.end is None else run.end
    log = RunLog(run, found["readings"], found["inputs"], begin, end)
    for name, signal in log.readings.items():
        count = len(signal.within(begin, end + 1e-6).time)
        if count < LEAST_ROWS:
            rule = f"must have {LEAST_ROWS} values from {begin:g} to {end:g} s"
            raise FitError(f"{shortened(run.file[0])}: readings.{name}: {rule}, got {count}; widen begin and end")
    return log


def _table(path: Path) -> dict[str, Array]:
    """Columns of a file by name; nan stands for an empty cell."""
    if path.suffix == ".npz":
        return _npz(path)
    try:
        text = files.read_text(path, "log")
    except files.FileError as error:
        raise FitError(f"{shortened(path)}: cannot be read: {error.reason or error}") from None
    try:
        lines = [(number, row) for number, row in enumerate(csv.reader(io.StringIO(text, newline="")), 1) if row]
    except csv.Error as error:
        raise FitError(f"{shortened(path.name)}: must be a table of numbers with a header: {error}") from None
    if len(lines) <= LEAST_ROWS:
        raise FitError(f"{shortened(path.name)}: must have a header and {LEAST_ROWS} rows, got {len(lines)} lines")
    header = [name.strip() for name in lines[0][1]]
    twice = next((name for name, count in Counter(header).items() if count > 1), None)
    if twice is not None:
        raise FitError(f"{shortened(path.name)}: column {formatted(twice)}: given twice; give it once")
    cells = np.full((len(lines) - 1, len(header)), np.nan)
    for index, (number, row) in enumerate(lines[1:]):
        if len(row) != len(header):
            rule = f"must have {len(header)} cells as the header has names, got {len(row)}"
            raise FitError(f"{shortened(path.name)}: line {number}: {rule}")
        for column, cell in enumerate(row):
            cells[index, column] = _cell(path, number, header[column], cell)
    return {name: cells[:, index] for index, name in enumerate(header)}


def _cell(path: Path, line: int, name: str, cell: str) -> float:
    """A number; nan of an empty cell: at that time there is no value of this column."""
    if not cell.strip():
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        rule = "must be a finite number, or empty where there is no sample"
        raise FitError(f"{shortened(path.name)}: line {line}: column {formatted(name)} {rule}, got {formatted(cell)}")
    return value


def _npz(path: Path) -> dict[str, Array]:
    try:
        with np.load(files.check_input(path, "log"), allow_pickle=False) as archive:
            arrays = {name: np.asarray(archive[name]) for name in archive.files}
    except files.FileError as error:
        raise FitError(f"{shortened(path)}: cannot be read: {error.reason or error}") from None
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise FitError(f"{shortened(path.name)}: must be an npz file of arrays of numbers: {error}") from None
    table = {}
    for name, array in arrays.items():
        if array.ndim != 1 or array.dtype.kind not in "fiub":
            continue  # what is no column may stand beside them
        values = array.astype(float)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise FitError(
                f"{shortened(path.name)}: array {formatted(name)} must have finite numbers, got {values[bad[0]]} at "
                f"index {bad[0]}; leave such samples out"
            )
        table[name] = values
    return table


def _times(name: str, table: Mapping[str, Array], column: Column, shift: float) -> Array:
    """Times of the rows [s], which must rise."""
    key = column.column or "t_s"
    if key not in table:
        raise FitError(
            f"{shortened(name)}: time: there must be a column {formatted(key)}{nearest(key, table)}; "
            f"columns: {_listed(table)}"
        )
    times = table[key] * factor_of(column.unit or "s", "time")
    if not np.isfinite(times).all():
        raise FitError(f"{shortened(name)}: time: column {formatted(key)} must have no empty cells; fill them")
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if back.size:
        row = int(back[0]) + 1
        raise FitError(
            f"{shortened(name)}: time: must rise from row to row, got {times[row]:g} s after {times[row - 1]:g} s in "
            f"row {row + 1}; sort the rows, or give each clock a file of its own"
        )
    return np.asarray(times + shift)


def _listed(table: Mapping[str, Array]) -> str:
    names = list(table)
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _file_with(run: LoggedRun, tables: Sequence[Mapping[str, Array]], column: Column, place: str) -> int:
    """The first file that has a column."""
    key = column.column
    for index, table in enumerate(tables):
        if key in table:
            return index
    known = [name for table in tables for name in table]
    raise FitError(
        f"{shortened(', '.join(run.file))}: {place}: there must be a column {formatted(key)}{nearest(key, known)}; "
        f"columns: {_listed(dict.fromkeys(known, np.zeros(0)))}"
    )


def _signal(name: str, column: Column, place: str, times: Array, values: Array) -> Signal:
    """The samples that a column has, in SI."""
    if len(values) != len(times):
        raise FitError(f"{shortened(name)}: {place}: must have {len(times)} values as its times, got {len(values)}")
    there = np.isfinite(values)
    if there.sum() < LEAST_ROWS:
        raise FitError(f"{shortened(name)}: {place}: must have {LEAST_ROWS} values, got {there.sum()}")
    factor = factor_of(column.unit, place) if column.unit else 1.0
    return Signal(times[there], values[there] * factor)


def _common_span(run: LoggedRun, signals: Sequence[Signal]) -> tuple[float, float]:
    """From the last first to the first last sample of all columns [s]."""
    begin = max(float(signal.time[0]) for signal in signals)
    end = min(float(signal.time[-1]) for signal in signals)
    if not begin < end:
        spans = sorted({(float(signal.time[0]), float(signal.time[-1])) for signal in signals})
        told = ", ".join(f"{first:g} to {last:g} s" for first, last in spans)
        raise FitError(
            f"{shortened(', '.join(run.file))}: clocks must overlap, got columns from {told}; give clock, what is "
            "added to the times of each file"
        )
    return begin, end
