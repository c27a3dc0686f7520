"""``progress.csv``: one line per iteration. It is a log: what cannot be read of it stops nothing."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from simwarp.core.files import output_error
from simwarp.tasks import InputError

from .run_files import append_whole, write_run_file

LOGGED: Final = "task/"
"""Beginning of the names of what a task tells at each iteration (``Task.on_iteration``)."""
SUCCESS: Final = "success"
"""Share of the episodes of an iteration that ended as a success."""
BY_MODEL: Final = "model/"
"""Beginning of the names of what is recorded of each model of a mixed batch: model/NAME/success and so on."""
PHASE: Final = "time/"
"""Beginning of the names of the time of an iteration by phase: time/simulate, time/sense, time/task, time/policy,
time/learn [s]; all but the last from a control step that is timed in parts."""
WALL: Final = "wall_s"
"""Time of training by the clock, that before a resume included [s]."""
FIRST_COLUMNS: Final = ("iteration", "env_steps", WALL, "mean_reward", "mean_episode_length", "env_steps_per_s")
COLUMNS: Final = (*FIRST_COLUMNS, "episodes", SUCCESS, "learning_rate", "action_std")
"""Columns of all tasks."""
FAMILIES: Final = ("reward/", "end/", "loss/", LOGGED, BY_MODEL, PHASE)
"""Beginnings of the names of columns that a task or an algorithm has for itself."""
_ITERATION = "iteration"


class ProgressTable:
    """``progress.csv``, appended to and flushed at once; made anew, all at once, where a column comes later.

    Args:
        path: the file.
        columns: names of the columns that are known; behind them come those of the lines that are kept.
        keep_below: of an existing file, keep the lines up to this iteration.

    Attributes:
        columns: names of all columns.
        lost: lines of the existing file that could not be read, and are no longer there.
        wall: time of training up to the last line that was kept [s].

    Raises:
        OutputError: the disk did not take it.
    """

    def __init__(self, path: Path, columns: list[str], keep_below: int = 0) -> None:
        self.path = path
        rows, self.lost = _read(path)
        kept = [row for row in rows if int(row[_ITERATION]) <= keep_below]
        self.wall = seconds_trained(kept)
        self.columns = list(dict.fromkeys([*columns, *(kept[0] if kept else ())]))
        write_run_file(path, _table(self.columns, kept))

    def append(self, row: Mapping[str, float | int]) -> None:
        """Add one line; lines before are empty in columns that come with it.

        Raises:
            OutputError: the disk did not take it; the lines before are unharmed.
        """
        new = sorted(row.keys() - set(self.columns))
        if not new:
            append_whole(self.path, _lines(self.columns, [row]))
            return
        columns = [*self.columns, *new]
        write_run_file(self.path, _table(columns, [*self._present(), row]))
        self.columns = columns

    def _present(self) -> list[dict[str, str]]:
        """Return the lines so far. Where they cannot be read now, they must not be written over."""
        try:
            return _parsed(self.path.read_bytes())[0] if self.path.exists() else []
        except OSError as error:
            raise output_error(self.path, error) from error


def _lines(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> bytes:
    buffer = io.StringIO()
    csv.DictWriter(buffer, columns, restval="").writerows(rows)
    return buffer.getvalue().encode()


def _table(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> bytes:
    return _lines(columns, [{name: name for name in columns}, *rows])


def read_progress(path: Path) -> list[dict[str, str]]:
    """Return the lines of ``progress.csv`` that are whole; none where there is no file."""
    return _read(path)[0]


def success_share(row: Mapping[str, str], good: Iterable[str]) -> float:
    """Return the share of the episodes of an iteration that ended as a success; NaN where none ended or none can tell.

    Args:
        row: of the table. Older lines have nothing in this column; their ends tell.
        good: reasons of an end that are successes; none of a task that has another measure.
    """
    if row.get(SUCCESS):
        return float(row[SUCCESS])
    reasons = tuple(good)
    ended = float(row.get("episodes") or 0.0)
    if not ended or not reasons:
        return math.nan
    return sum(float(row.get(f"end/{reason}") or 0.0) for reason in reasons) / ended


def check_column(name: str, option: str = "--rank-by") -> None:
    """Refuse a name that no column of ``progress.csv`` has, whatever the task; parts of a task show when it is trained.

    Args:
        name: of the column.
        option: that names it, for the message.

    Raises:
        InputError: it is none.
    """
    if name not in COLUMNS and not name.startswith(FAMILIES):
        families = ", ".join(f"{family}NAME" for family in FAMILIES)
        raise InputError(f"{option} must be one of {', '.join(COLUMNS)} or {families}, got '{name}'")


def series(
    rows: Iterable[Mapping[str, str]], column: str, good: Iterable[str], option: str = "--rank-by"
) -> list[float]:
    """Return a column of ``progress.csv``; NaN where it is empty or nothing is known yet.

    Args:
        rows: of the table.
        column: a name in its header, or `SUCCESS`, which rows of older runs do not have.
        good: reasons of an end that are successes.
        option: that names the column, for the message.

    Raises:
        InputError: there is no such column.
    """
    found, good = [], tuple(good)
    for row in rows:
        if column == SUCCESS:
            found.append(success_share(row, good))
        elif column in row:
            found.append(float(row[column] or "nan"))
        else:
            raise InputError(f"{option}: progress.csv has no column '{column}', but {', '.join(row)}")
    return found


def seconds_trained(rows: Iterable[Mapping[str, str]]) -> float:
    """Return how long the iterations of a table took by the clock [s]; in older ones each resume counts from 0."""
    total = last = 0.0
    for row in rows:
        wall = float(row.get(WALL) or last)
        total += wall if wall < last else wall - last
        last = wall
    return total


def _read(path: Path) -> tuple[list[dict[str, str]], int]:
    """Return the lines that are whole, and how many are not: a killed process leaves half of one, a disk does worse."""
    try:
        return _parsed(path.read_bytes() if path.is_file() else b"")
    except OSError:
        return [], 1


def _parsed(data: bytes) -> tuple[list[dict[str, str]], int]:
    """Return the lines of a table that are whole, and how many are not."""
    text = data.decode("utf-8", errors="replace")
    header, *lines = text.splitlines() or [""]
    # Without its end, a line may have lost digits of its last number
    ended = lines if text.endswith("\n") else lines[:-1]
    names = _words(header)
    rows = [dict(zip(names, words, strict=True)) for line in ended if len(words := _words(line)) == len(names)]
    whole = [row for row in rows if _is_whole(row)]
    return whole, len(lines) - len(whole)


def _words(line: str) -> list[str]:
    try:
        return next(csv.reader([line]), [])
    except csv.Error:
        return []


def _is_whole(row: Mapping[str, str]) -> bool:
    """True if a line counts an iteration and has only numbers; a column that came later is empty in lines before."""
    iteration = row.get(_ITERATION, "")
    try:
        for word in row.values():
            float(word or "0")
        return len(iteration) < 19 and int(iteration) > 0
    except ValueError:
        return False
