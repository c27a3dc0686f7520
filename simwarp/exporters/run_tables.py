"""Recorded runs as files by their suffix: CSV, or Parquet with units and sources beside the numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from simwarp.core.files import FileError, replacing
from simwarp.importers.source_files import check_installed, needed
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.usual_columns import meaning_of, unit_of

CSV: Final = ".csv"
PARQUET: Final = ".parquet"
EXTRA: Final = "parquet"
UNIT: Final = b"unit"
MEANING: Final = b"meaning"
"""Keys of a column's metadata in a Parquet file, texts in UTF-8."""
UNITS: Final = b"units"
SOURCES: Final = b"sources"
RUN: Final = b"simwarp"
"""Keys of the file's metadata, each a JSON object: units and meanings by column, and what was run."""


def check_run_file(path: Path, option: str) -> None:
    """Refuses files that no run can be written to, before it is driven.

    Args:
        path: of the file.
        option: that asked for it, such as ``--output``: the errors begin with it.

    Raises:
        FileError: the suffix is none of .csv and .parquet.
        ModelError: Parquet is asked for and pyarrow is not installed.
    """
    if path.suffix not in (CSV, PARQUET):
        raise FileError(f"{option}: the name must end in {CSV} or {PARQUET}, got '{path.name}'")
    if path.suffix == PARQUET:
        check_installed("pyarrow", f"{option}: a Parquet file", EXTRA)


def write_run(
    run: Run, path: Path, sources: Mapping[str, Any] | None = None, meanings: Mapping[str, str] | None = None
) -> None:
    """Writes a run as CSV or, where the name ends in .parquet, as Parquet.

    A column of a Parquet file has its `unit` ("1": none) and `meaning`, with axes and sign, in its metadata. The file's
    own holds JSON objects: `units` and `sources`, by column, and `simwarp` with the version and `sources`.

    Args:
        run: recorded.
        path: of the file.
        sources: what was run: the vehicle, the manoeuvre, options; values that JSON knows. CSV has no place for it.
        meanings: of further columns, by name; the usual ones have theirs (`usual_columns`).

    Raises:
        FileError: the path cannot be written to.
        ModelError: pyarrow is not installed, which Parquet needs.
        OutputError: the disk did not take it.
    """
    if path.suffix != PARQUET:
        run.write(path)
        return
    arrow, parquet = (needed(name, f"'{path.name}'", EXTRA) for name in ("pyarrow", "pyarrow.parquet"))
    known = {name: (meanings or {}).get(name) or meaning_of(name) for name in run.columns}
    fields = [
        arrow.field(name, arrow.float64(), metadata={UNIT: unit_of(name).encode(), MEANING: known[name].encode()})
        for name in run.columns
    ]
    about = {
        UNITS: {name: unit_of(name) for name in run.columns},
        SOURCES: known,
        RUN: {"version": version("simwarp"), **(sources or {})},
    }
    metadata = {key: json.dumps(value, ensure_ascii=False).encode() for key, value in about.items()}
    table = arrow.table(
        [arrow.array(np.asarray(values, float)) for values in run.columns.values()],
        schema=arrow.schema(fields, metadata=metadata),
    )
    with replacing(path) as draft:
        parquet.write_table(table, draft)


def read_run(path: Path) -> Run:
    """A run from a CSV or Parquet file of `write_run`.

    Raises:
        FileError: the file is no Parquet file of numbers.
        ModelError: pyarrow is not installed, which Parquet needs.
        SpecError: the CSV file cannot be read.
    """
    if path.suffix != PARQUET:
        return Run.read(path)
    arrow, parquet = (needed(name, f"'{path.name}'", EXTRA) for name in ("pyarrow", "pyarrow.parquet"))
    try:
        table = parquet.read_table(path)
        return Run({name: table.column(name).to_numpy().astype(float) for name in table.column_names})
    except (OSError, ValueError, arrow.ArrowException) as error:
        reason = str(error).partition("\n")[0]
        raise FileError(f"{path}: must be a Parquet file of numbers: {reason}") from None
