"""What driving policies reached over conditions: numbers, tables and pictures, from the rows that are there."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import warp as wp
from matplotlib.lines import Line2D
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import robustness_points as points
from benchmarks.robustness_points import (
    AXES,
    MAPS,
    ROOT,
    Axis,
    Changes,
    Row,
    axes_of_task,
    key_of,
    nominal_value,
    path_of,
    read_rows,
)
from simwarp.bench.machine import describe
from simwarp.core.files import read_json
from simwarp.statistics.proportions import wilson_interval
from simwarp.tasks import task_class
from simwarp.train.evaluation.figure_style import INK, PALE, new_figure, save_figure, style_axes
from simwarp.train.evaluation.grid_plot import Percent, draw_heat_map
from simwarp.train.runs.run_files import write_json, write_run_file
from simwarp.train.runs.run_folder import git_revision

PICTURES: Final = ROOT / "docs" / "images"
SEED: Final = 1_000_003
COLOURS: Final = ("#0b6e99", "#b8470f", "#4d7c0f", "#7c3aed", "#be185d")
WIDE: Final = 4
"""Panels beside each other."""


def labels_of(task: str, obs: str, first: Sequence[str]) -> list[str]:
    """Return the labels of the policies that have rows: those asked for first, then others by name."""
    known = sorted(path.name.removeprefix(f"{task}.{obs}.")[:-4] for path in points.RESULTS.glob(f"{task}.{obs}.*.csv"))
    return [label for label in first if label in known] + [label for label in known if label not in first]


def numbers_of(task: str, obs: str, labels: Sequence[str]) -> dict[str, Any]:
    """Return the rows of all policies by axis and map: label -> parts; points that are not there are left away."""
    config: Any = dataclasses.replace(task_class(task).config_type())
    found: dict[str, Any] = {}
    for label in labels:
        rows = read_rows(path_of(task, obs, label))

        def share_of(changes: Changes, rows: Mapping[str, Row] = rows) -> dict[str, Any] | None:
            row = rows.get(key_of(config, changes))
            if row is None:
                return None
            episodes, successes = int(row["episodes"]), int(row["successes"])
            low, high = wilson_interval(successes, episodes)
            return {
                "episodes": episodes, "successes": successes, "success": successes / episodes, "low": low,
                "high": high, "reasons": json.loads(row["reasons"]),
            }  # fmt: skip

        axes = {
            name: [{"value": value, **cell} for value in axis.values if (cell := share_of({name: value}))]
            for name, axis in axes_of_task(task, obs, tuple(AXES)).items()
        }
        maps = {}
        for name, each in MAPS.items():
            cells = [[share_of(changes) for changes in line] for line in each.changes()]
            there = sum(cell is not None for line in cells for cell in line)
            if there >= len(each.rows) + len(each.columns):  # more than the two axes have
                maps[name] = cells
        found[label] = {
            "digest": next((row["digest"] for row in rows.values()), None),
            "nominal": share_of({}), "drawn": share_of({"conditions": "random"}),
            "axes": {name: cells for name, cells in axes.items() if len(cells) > 1}, "maps": maps,
        }  # fmt: skip
    return found


def percent(cell: Mapping[str, float] | None) -> str:
    """Return a rate with its interval [%]."""
    if cell is None:
        return "–"
    return f"{100 * cell['success']:.1f} ({100 * cell['low']:.0f} to {100 * cell['high']:.0f})"


def tables(task: str, numbers: Mapping[str, Any]) -> str:
    """Return success rates [%] with 95 % intervals as tables in Markdown: axes, then maps."""
    labels = list(numbers)
    lines = [f"| {task}: success [%] | | {' | '.join(labels)} |", "|---|---|" + "---|" * len(labels)]
    for name, about in (("nominal", "all conditions as in training by default"), ("drawn", "all conditions drawn")):
        lines.append(f"| {about} | | {' | '.join(percent(numbers[label][name]) for label in labels)} |")
    for name, axis in AXES.items():
        cells = {
            label: {json.dumps(cell["value"]): cell for cell in numbers[label]["axes"].get(name, ())}
            for label in labels
        }
        values = list(dict.fromkeys(value for each in cells.values() for value in each))
        for place, value in enumerate(values):
            head = axis.label if place == 0 else ""
            told = " | ".join(percent(cells[label].get(value)) for label in labels)
            lines.append(f"| {head} | {axis.value_text(json.loads(value))} | {told} |")
    for name, each in MAPS.items():
        down, across = AXES[each.down], AXES[each.across]
        for label in labels:
            if name in numbers[label]["maps"]:
                shown = " | ".join(across.value_text(value) for value in each.columns)
                lines += ["", f"| {label}: {down.label} \\ {across.label} | {shown} |"]
                lines.append("|---|" + "---|" * len(each.columns))
                for value, cells_of in zip(each.rows, numbers[label]["maps"][name], strict=True):
                    lines.append(f"| {down.value_text(value)} | {' | '.join(map(percent, cells_of))} |")
    return "\n".join(lines) + "\n"


def lowest(axis: Axis, cells: Sequence[Mapping[str, Any]]) -> str:
    """Return the least success along an axis [%], and where; a dash where it was not varied."""
    if not cells:
        return "–"
    least = min(cells, key=lambda cell: cell["success"])
    return f"{100 * least['success']:.0f} at {axis.value_text(least['value'])}"


def summary(tasks: Sequence[str], obs: str, first: Sequence[str]) -> str:
    """Return a table in Markdown of the least success along each condition [%], a column for each task and policy."""
    columns = {
        (task, label): numbers
        for task in tasks
        for label, numbers in numbers_of(task, obs, labels_of(task, obs, first)).items()
    }
    lines = [f"| success [%] | {' | '.join(f'{task}, {label}' for task, label in columns)} |"]
    lines.append("|---|" + "---|" * len(columns))
    for name, about in (("nominal", "nominal"), ("drawn", "all drawn")):
        cells = [numbers[name] for numbers in columns.values()]
        told = (f"{100 * cell['success']:.0f} % of {cell['episodes']}" if cell else "–" for cell in cells)
        lines.append(f"| {about} | {' | '.join(told)} |")
    for name, axis in AXES.items():
        least = [lowest(axis, numbers["axes"].get(name, ())) for numbers in columns.values()]
        lines.append(f"| {axis.label} | {' | '.join(least)} |")
    return "\n".join(lines)


def _draw_axis(panel: Any, axis: Axis, usual: Any, numbers: Mapping[str, Any]) -> None:
    """Draw the curve of each policy along an axis."""
    style_axes(panel)
    values = list(
        dict.fromkeys(cell["value"] for each in numbers.values() for cell in each["axes"].get(axis.field, ()))
    )
    numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    places = {value: float(value) * axis.scale if numeric else float(at) for at, value in enumerate(values)}
    for index, each in enumerate(numbers.values()):
        cells = each["axes"].get(axis.field, ())
        aside = 0.0 if numeric else 0.12 * (index - 0.5 * (len(numbers) - 1))
        x = [places[cell["value"]] + aside for cell in cells]
        y = np.array([100.0 * cell["success"] for cell in cells])
        off = [y - [100.0 * cell["low"] for cell in cells], [100.0 * cell["high"] for cell in cells] - y]
        panel.errorbar(
            x, y, yerr=np.maximum(off, 0.0), color=COLOURS[index % len(COLOURS)], capsize=2.5, linewidth=1.3,
            markersize=3.5, marker="o", linestyle="-" if numeric else "none", clip_on=False,
        )  # fmt: skip
    if not numeric:
        panel.set_xticks(list(places.values()), [axis.value_text(value) for value in values], fontsize=7)
        panel.tick_params(axis="x", rotation=20 if len(values) > 2 else 0)
        panel.set_xlim(-0.5, len(values) - 0.5)
    else:
        panel.axvline(usual * axis.scale, color=PALE, linewidth=4.0, zorder=0)
    panel.set_ylim(0.0, 100.0)
    panel.grid(axis="y", color=PALE, linewidth=0.8)
    panel.set_xlabel(axis.label, color=INK, fontsize=8)


def draw(task: str, obs: str, numbers: Mapping[str, Any], picture: Path) -> None:
    """Draw curves along the axes, a line per policy, and the maps of each policy below."""
    axes = [AXES[name] for name in AXES if any(name in each["axes"] for each in numbers.values())]
    maps = [(name, label) for name in MAPS for label, each in numbers.items() if name in each["maps"]]
    rows = math.ceil(len(axes) / WIDE), math.ceil(len(maps) / 2)
    heights = [2.0] * rows[0] + [2.5] * rows[1]
    legend = [
        Line2D([], [], color=COLOURS[at % len(COLOURS)], marker="o", label=label) for at, label in enumerate(numbers)
    ]
    episodes = sorted({each["nominal"]["episodes"] for each in numbers.values() if each["nominal"]})
    note = (
        f"{task}, --obs {obs}: {' or '.join(map(str, episodes))} episodes per point, the same worlds at all; bars and "
        "small numbers: Wilson intervals at 95 %. A grey line is the nominal value, which all other conditions have."
    )
    figure = new_figure(11.0, sum(heights) + 0.9, f"{task}: success [%] over conditions", note, legend=legend)
    grid = figure.add_gridspec(len(heights), 2 * WIDE, height_ratios=heights)
    for place, axis in enumerate(axes):
        row, column = divmod(place, WIDE)
        usual = nominal_value(task_class(task).config_type(), axis)
        _draw_axis(figure.add_subplot(grid[row, 2 * column : 2 * column + 2]), axis, usual, numbers)
    for place, (name, label) in enumerate(maps):
        row, column = divmod(place, 2)
        panel = figure.add_subplot(grid[rows[0] + row, WIDE * column : WIDE * column + WIDE])
        down, across = AXES[MAPS[name].down], AXES[MAPS[name].across]
        ones, others = MAPS[name].rows, MAPS[name].columns
        cells: dict[tuple[int, int], Percent | None] = {
            (at, to): None if cell is None else (100 * cell["success"], 100 * cell["low"], 100 * cell["high"])
            for at, line in enumerate(numbers[label]["maps"][name])
            for to, cell in enumerate(line)
        }
        draw_heat_map(panel, cells, len(ones), len(others))
        panel.set_xticks(range(len(others)), [across.value_text(value) for value in others])
        panel.set_yticks(range(len(ones)), [down.value_text(value) for value in ones])
        panel.set_xlabel(across.label, color=INK, fontsize=8)
        panel.set_ylabel(down.label, color=INK, fontsize=8)
        panel.set_title(label, loc="left", fontsize=9, color=INK)
    save_figure(figure, picture, dpi=100)


def report(task: str, obs: str, first: Sequence[str], device: str, console: Console, *, again: bool = False) -> None:
    """Write numbers, tables and picture of a task, of all policies that have rows.

    Args:
        task: its name.
        obs: observations of the policies.
        first: labels that come first.
        device: that was evaluated on.
        console: for the output.
        again: nothing was evaluated: machine and revision are those of the last evaluation.
    """
    numbers = numbers_of(task, obs, labels_of(task, obs, first))
    if not numbers:
        console.print(f"{task}: no rows yet")
        return
    path = points.RESULTS / f"{task}.{obs}.json"
    made = {"machine": describe(wp.get_device(device)), **git_revision()}
    if again and path.is_file():
        before = read_json(path, "results")
        made = {key: before[key] for key in made if key in before}
    write_json(path, {"task": task, "obs": obs, "seed": SEED, **made, "policies": numbers})
    text = tables(task, numbers)
    write_run_file(points.RESULTS / f"{task}.{obs}.md", text.encode())
    print(text)
    if any(each["axes"] or each["maps"] for each in numbers.values()):
        draw(task, obs, numbers, PICTURES / f"robustness_{task}_{obs}.png")
