"""Report of ``simwarp eval``: tables, pictures, JSON."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from simwarp.cli import UsageError
from simwarp.core.files import check_output, output_error
from simwarp.tasks import config_to_plain
from simwarp.train.evaluation.evaluation import Evaluation
from simwarp.train.evaluation.grid import (
    LEVEL,
    POLICY_NAMES,
    EvaluationStoppedError,
    GridPoint,
    GridSettings,
    PointResult,
    axes_of,
    has_curriculum,
    value_text,
    words,
)
from simwarp.train.networks.policies import PolicySource
from simwarp.train.runs.run_files import write_json

RESULTS = "results.json"
_FOLDER_BYTES = 4096


@dataclasses.dataclass
class Report:
    """Results of an evaluation, as they come.

    Attributes:
        task: its name.
        source: the policy.
        settings: settings of the evaluation, the same at every point.
        points: all that were asked for.
        folder: for pictures and results; None writes none.
        results: of the points that were evaluated.
        stopped: place at which it was stopped, if it was.
        written: files written so far.
    """

    task: str
    source: PolicySource
    settings: GridSettings
    points: list[GridPoint]
    folder: Path | None
    results: list[PointResult] = dataclasses.field(default_factory=list)
    stopped: EvaluationStoppedError | None = None
    written: list[Path] = dataclasses.field(default_factory=list)

    @property
    def problem(self) -> str:
        """Reason why the results of the policy say nothing about the task; empty if they do."""
        found = [(result.point.label, result.evaluation.problem) for result in self.results]
        return "; ".join(": ".join(filter(None, parts)) for parts in found if parts[1])

    @property
    def is_grid(self) -> bool:
        """True if there are keys."""
        return bool(self.points[0].values)

    @property
    def at_level(self) -> str:
        """`` at level 0.2``, where a task has a curriculum or a level was asked for, the same at all points."""
        point = self.points[0]
        if LEVEL in point.values or (point.level == 1.0 and not has_curriculum(point.config)):
            return ""
        return f" at level {value_text(point.level)}"

    def content(self) -> dict[str, Any]:
        """Return the content of ``--json``."""
        head: dict[str, Any] = {"task": self.task, "checkpoint": str(self.source.path), "seed": self.settings.seed}
        if self.written:
            head["files"] = [str(path) for path in self.written]
        if self.stopped is not None:
            head["unfinished"] = {
                "at": self.stopped.where,
                "episodes": self.stopped.ended,
                "end_reasons": self.stopped.end_reasons,
            }
        head["interrupted"] = self.stopped is not None or len(self.results) < len(self.points)
        if self.is_grid:
            return {**head, "keys": axes_of(self.points), "grid": [result.as_json() for result in self.results]}
        head["task_config"] = config_to_plain(self.points[0].config)
        return head | (self.results[0].as_json() if self.results else {})

    def finish(self, console: Console) -> bool:
        """Print the tables, write the files; return True if there is anything to report.

        Raises:
            OutputError: a file could not be written.
        """
        if not self.results and self.folder is not None:
            with contextlib.suppress(OSError):  # it holds something, or is gone
                self.folder.rmdir()
        if not self.results and self.stopped is None:
            return False
        self.show(console)
        self.draw()
        trained = self._trained_level()
        if trained is not None:
            text = f"training ended at a mean level of {trained:.2g}; --level {trained:.2g} evaluates there"
            console.print(text, highlight=False, markup=False, soft_wrap=True)
        console.print(f"policy: {self.source.origin}", highlight=False, markup=False, soft_wrap=True)
        if self.written:
            names = ", ".join(path.name for path in self.written)
            console.print(f"wrote {self.folder}: {names}", highlight=False, markup=False, soft_wrap=True)
        return True

    def _trained_level(self) -> float | None:
        """Return the mean level at which the policy's training ended, if it was below that of the evaluation."""
        worlds = self.source.content.get("worlds") if self.source.content else None
        level = worlds.get("level") if isinstance(worlds, Mapping) else None
        if level is None or not has_curriculum(self.points[0].config):
            return None
        mean = round(float(level.mean()), 2)
        return mean if mean < min(point.level for point in self.points) else None

    # ---- tables ------------------------------------------------------------------------------------------------

    def show(self, console: Console) -> None:
        """Print the tables, and what was left unfinished."""
        if self.results and not self.is_grid:
            _show_point(console, f"{self.task}, {self.settings.episodes} episodes{self.at_level}", self.results[0])
        elif self.results:
            keys = axes_of(self.points)
            for policy in dict.fromkeys(name for result in self.results for name in result.evaluations):
                title = (
                    f"{self.task}: {POLICY_NAMES[policy]}, {self.settings.episodes} episodes per point{self.at_level}"
                )
                found = {
                    tuple(result.point.values.values()): result.evaluations[policy]
                    for result in self.results
                    if policy in result.evaluations
                }
                shapes = ([_matrix] if len(keys) == 2 else []) + [_list, _short_list]
                _show_table(console, [shape(title, keys, found) for shape in shapes])
        if self.stopped is not None:
            ends = ", ".join(f"{reason} {count}" for reason, count in self.stopped.end_reasons.items()) or "none"
            where = f" at {self.stopped.where}" if self.stopped.where else ""
            console.print(
                f"interrupted{where}: of its episodes {self.stopped.ended} were over ({ends}); they are not counted,"
                " as short ones end first",
                highlight=False, markup=False, soft_wrap=True,
            )  # fmt: skip

    # ---- files -------------------------------------------------------------------------------------------------

    def save(self) -> None:
        """Write the results of all points so far."""
        if self.folder is not None and self.results:
            self._note_file(RESULTS)
            write_json(self.folder / RESULTS, self.content())

    def draw(self) -> None:
        """Write the pictures, then the results that name them."""
        if self.folder is None or not self.results:
            return
        from simwarp.train.evaluation.grid_plot import draw_success
        from simwarp.train.evaluation.path_maps import draw_paths, draw_worlds

        origin = self.source.origin.replace(str(self.source.path), "/".join(self.source.path.parts[-4:]))
        each = " per point" if self.is_grid else ""
        note = f"{self.settings.episodes} episodes{each}{self.at_level}, seed {self.settings.seed}, {origin}"
        if self.is_grid:
            target = self._note_file("success.png")
            draw_success(target, f"{self.task}: success rate, 95 % intervals", note, self.points, self.results)
        moving = [result for result in self.results if result.paths_driven is not None and not result.paths_driven.flat]
        if moving:
            draw_paths(self._note_file("paths.png"), f"{self.task}: paths from above", note, moving)
        for result in moving:
            if result.paths_driven is not None and result.paths_driven.surroundings:
                values = "".join(f"_{key}={value_text(value)}" for key, value in result.point.values.items())
                title = ": ".join(filter(None, [self.task, result.point.label])) + ", first worlds from above"
                draw_worlds(self._note_file(f"worlds{values.replace('/', '-')}.png"), title, note, result)
        self.save()

    def _note_file(self, name: str) -> Path:
        assert self.folder is not None
        path = self.folder / name
        if path not in self.written:
            self.written.append(path)
        return path


def open_folder(wanted: Path | None, task: str, is_grid: bool) -> Path | None:
    """Make the folder for pictures: the one the user names, or a new TASK-eval where a grid is evaluated.

    Raises:
        UsageError: it cannot be made.
        FileError: nothing can be written to it.
        OutputError: the disk did not take it.
    """
    path = wanted
    if path is None:
        if not is_grid:
            return None
        names = (f"{task}-eval{number}" for number in ("", *(f"-{count}" for count in range(2, 10_000))))
        path = next(Path(name) for name in names if not Path(name).exists())
    if not os.path.isdir(path.parent):
        raise UsageError(f"--plot: cannot write to '{path}': folder {path.parent} does not exist; make it first")
    try:
        path.mkdir(exist_ok=True)
    except FileExistsError:
        raise UsageError(f"--plot must name a folder, '{path}' is none") from None
    except OSError as error:
        raise output_error(path, error, needed=_FOLDER_BYTES) from error
    check_output(path / RESULTS, "--plot")
    return path


Cells = tuple[str, Sequence[str], Sequence[Sequence[str]]]
"""Title, heads of the columns, rows."""


def _show_table(console: Console, choices: Sequence[Cells]) -> None:
    """Print the first of some tables that the console is wide enough for, else the last one."""
    made = [(title, _table(head, rows, tight)) for title, head, rows in choices for tight in (False, True)]
    title, table = next(((title, table) for title, table in made if _fits(console, table)), made[-1])
    console.print(title, style="italic", highlight=False, markup=False, soft_wrap=True)
    console.print(table)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], tight: bool) -> Table:
    """Return a table of which no cell is cut; a ``tight`` one folds its heads."""
    table = Table(box=SIMPLE, padding=(0, 1, 0, 0))
    for index, name in enumerate(head):
        last = name == _ENDS
        pieces = [piece for row in rows for piece in (row[index].split(", ") if last else row[index].splitlines())]
        pieces += name.split() if tight else [name]
        width = max(map(len, pieces), default=0)
        if last:
            table.add_column(name, min_width=width + 1, overflow="fold")
        else:
            table.add_column(name, justify="right" if name else "left", width=width)
    for row in rows:
        table.add_row(*row)
    return table


def _fits(console: Console, table: Table) -> bool:
    """True if nothing of a table has to be cut."""
    wide = console.options.update(max_width=10_000)
    return Measurement.get(console, wide, table).minimum <= console.width


def _interval(value: Evaluation, unit: str = "%") -> str:
    low, high = (f"{100.0 * bound:.1f}{unit}" for bound in value.success_ci95)
    return f"{low} - {high}"


_ENDS = "ended by"
_COLUMNS: dict[str, Callable[[Evaluation], str]] = {
    "return": lambda value: f"{value.mean_return:.1f} ± {value.std_return:.1f}",
    "length": lambda value: f"{value.mean_episode_length:.1f}",
    "success": lambda value: f"{value.success_rate:.1%}",
    "95 % interval": _interval,
    _ENDS: lambda value: ", ".join(f"{reason} {count}" for reason, count in value.end_reasons.items()),
}


def _cells(value: Evaluation) -> list[str]:
    return [show(value) for show in _COLUMNS.values()]


def _show_point(console: Console, title: str, result: PointResult) -> None:
    """Print policies in rows, and below each its models where there are several."""
    rows, named = [], []
    for name, whole in result.evaluations.items():
        each = [("", whole), *whole.by_model.items()]
        rows += [[f"  {model}" if model else POLICY_NAMES[name], *_cells(value)] for model, value in each]
        named += [(f"{POLICY_NAMES[name]} {model}".rstrip(), value) for model, value in each]
    _show_table(console, [(title, ["", *_COLUMNS], rows)])
    for metric in result.evaluation.metrics:
        values = ", ".join(f"{label} {value.metrics[metric]:.4g}" for label, value in named)
        console.print(f"{metric}: {values}", highlight=False)


def _list(title: str, keys: dict[str, list[Any]], found: Mapping[tuple[Any, ...], Evaluation]) -> Cells:
    """Return the points in rows."""
    rows = [[*map(value_text, values), *_cells(value)] for values, value in found.items()]
    return title, [*map(words, keys), *_COLUMNS], rows


def _short_list(title: str, keys: dict[str, list[Any]], found: Mapping[tuple[Any, ...], Evaluation]) -> Cells:
    """Return the points in rows, with their success alone."""
    rows = [
        [*map(value_text, values), f"{value.success_rate:.1%}", _interval(value)] for values, value in found.items()
    ]
    return title, [*map(words, keys), "success", "95 % interval"], rows


def _matrix(title: str, keys: dict[str, list[Any]], found: Mapping[tuple[Any, ...], Evaluation]) -> Cells:
    """Return the first key in rows and the second in columns: success, and its interval below."""
    (down, rows), (across, columns) = keys.items()

    def cell(value: Evaluation | None) -> str:
        return "-" if value is None else f"{value.success_rate:.1%}\n{_interval(value, '')}"

    lines = [[value_text(value), *(cell(found.get((value, other))) for other in columns)] for value in rows]
    head = [f"{words(down)} \\ {words(across)}", *map(value_text, columns)]
    return f"{title}; success and its 95 % interval", head, lines
