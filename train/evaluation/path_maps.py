"""Paths of evaluated episodes on maps: all of them over each other, and some worlds with what stands in them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from simwarp.tasks.framework.task import TIME_LIMIT

from .driven_paths import DrivenPaths, Points
from .figure_style import GREY, INK, new_figure, save_figure, style_axes
from .grid import PointResult, axes_of

_SUCCESSES = ("#009e73", "#56b4e9")
_FAILURES = ("#000000", "#e69f00", "#d55e00", "#cc79a7", "#0072b2", "#8c564b")
_UNDECIDED = "#7b8794"
"""Of an episode that only the clock ended, without success."""
_WORLDS = 12
_COMMON = 20
"""Most variants of a line over the worlds with which it is shown on the map of all of them."""
_SHEET = (11.0, 9.0)
"""Width and height of all panels together [inch]."""
_LEAST = 1.5
"""Width of a panel [inch]."""

Window = tuple[tuple[float, float], tuple[float, float]]
End = tuple[str, bool]


def draw_paths(path: Path, title: str, note: str, results: list[PointResult]) -> None:
    """Write one map per point with all paths over each other."""
    shown = [(result, result.paths_driven) for result in results if result.paths_driven is not None]
    axes_values = list(axes_of([result.point for result, _ in shown]).values())
    columns = len(axes_values[1]) if len(axes_values) == 2 else 0
    window = _common_window([paths_driven for _, paths_driven in shown])
    colours = _colours([paths_driven for _, paths_driven in shown])
    if any(len(paths_driven.paths) < result.evaluation.episodes for result, paths_driven in shown):
        title = f"{title}, first episodes of {max(len(paths_driven.paths) for _, paths_driven in shown)} worlds"
    figure, panels = _sheet(len(shown), window, title, note, colours, columns=columns, largest=6.0)
    for axes, (result, paths_driven) in zip(panels, shown, strict=True):
        for points, colour in _common_lines(paths_driven):
            axes.add_collection(LineCollection(list(points), colors=colour, linewidths=0.8, alpha=0.35, zorder=1))
        _draw_paths(axes, paths_driven, colours, range(len(paths_driven.paths)))
        value = result.evaluation
        heading = f"{result.point.label}\n" if result.point.label else ""
        axes.set_title(f"{heading}success {100.0 * value.success_rate:.1f} %", loc="left", fontsize=9, color=INK)
    save_figure(figure, path)


def draw_worlds(path: Path, title: str, note: str, result: PointResult) -> None:
    """Write a map for each of the first worlds of a point, with what stands in it."""
    paths_driven = result.paths_driven
    if paths_driven is None:
        return
    colours = _colours([paths_driven])
    worlds = range(min(_WORLDS, len(paths_driven.paths)))
    figure, panels = _sheet(len(worlds), _common_window([paths_driven]), title, note, colours, largest=4.0)
    for axes, world in zip(panels, worlds, strict=True):
        for surrounding in paths_driven.surroundings:
            line = surrounding.points[world]
            axes.plot(line[:, 0], line[:, 1], color=surrounding.colour, linewidth=1.0, alpha=0.45, zorder=1)
        _draw_paths(axes, paths_driven, colours, range(world, world + 1))
        end = (paths_driven.reasons[world], paths_driven.successes[world])
        seconds = (len(paths_driven.paths[world]) - 1) * paths_driven.control_dt
        axes.set_title(f"world {world}: {_words(end)}, {seconds:.1f} s", loc="left", fontsize=8, color=colours[end])
    save_figure(figure, path)


def _words(end: End) -> str:
    reason, success = end
    return f"{reason.replace('_', ' ')}{' (success)' if success else ''}"


def _colours(all_paths: list[DrivenPaths]) -> dict[End, str]:
    """Return a colour for each way to end that occurs, the same for the same reason in all pictures of a task."""
    seen = {end for paths_driven in all_paths for end in zip(paths_driven.reasons, paths_driven.successes, strict=True)}
    known = list(dict.fromkeys(reason for paths_driven in all_paths for reason in paths_driven.known_reasons))
    good = [reason for reason in known if (reason, True) in seen]
    colours = {(reason, True): _SUCCESSES[index % len(_SUCCESSES)] for index, reason in enumerate(good)}
    for index, reason in enumerate(known):
        if (reason, False) in seen:
            colours[reason, False] = _UNDECIDED if reason == TIME_LIMIT else _FAILURES[index % len(_FAILURES)]
    return colours


def _legend(colours: dict[End, str]) -> list[Line2D]:
    handles = [
        Line2D([], [], color=colour, linewidth=2.0, marker="o" if end[1] else "x", markersize=5, label=_words(end))
        for end, colour in colours.items()
    ]
    return [*handles, Line2D([], [], color=GREY, linestyle="none", marker=".", label="start")]


def _draw_paths(axes: Any, paths_driven: DrivenPaths, colours: dict[End, str], worlds: range) -> None:
    """Draw the paths of some worlds, failures above successes, with a mark where each one starts and ends."""
    faint = min(0.9, max(0.25, 40.0 / len(worlds)))
    for layer, (end, colour) in enumerate(colours.items()):
        paths = [
            paths_driven.paths[world]
            for world in worlds
            if (paths_driven.reasons[world], paths_driven.successes[world]) == end and len(paths_driven.paths[world])
        ]
        if not paths:
            continue
        width = 1.6 if len(worlds) == 1 else 1.0
        # Failures are what one looks for
        alpha = faint if end[1] else max(faint, 0.6)
        axes.add_collection(LineCollection(paths, colors=colour, linewidths=width, alpha=alpha, zorder=2 + 0.1 * layer))
        last = np.array([path[-1] for path in paths])
        good = {"marker": "o", "s": 12 if len(worlds) < 100 else 7, "linewidths": 0.0}
        mark = good if end[1] else {"marker": "x", "s": 22, "linewidths": 1.2}
        axes.scatter(last[:, 0], last[:, 1], color=colour, zorder=4 + 0.1 * layer, clip_on=False, **mark)
    starts = np.array([paths_driven.paths[world][0] for world in worlds if len(paths_driven.paths[world])]).reshape(
        -1, 2
    )
    axes.scatter(starts[:, 0], starts[:, 1], color=GREY, s=8, linewidths=0.0, zorder=3)


def _common_lines(paths_driven: DrivenPaths) -> list[tuple[Points, str]]:
    """Return the lines that are the same in all worlds or have few variants: (variants, P, 2) points and a colour."""
    found = []
    for surrounding in paths_driven.surroundings:
        variants = np.unique(surrounding.points.round(3), axis=0)
        if len(variants) <= max(1, min(_COMMON, len(paths_driven.paths) // 2)):
            found.append((variants, surrounding.colour))
    return found


def _common_window(all_paths: list[DrivenPaths]) -> Window:
    """Return the task's window, or one around all paths."""
    windows = [paths_driven.window for paths_driven in all_paths]
    points = [path for paths_driven in all_paths for path in paths_driven.paths if len(path)]
    if windows and all(window is not None for window in windows):
        low = np.min([[window[0][0], window[1][0]] for window in windows if window is not None], axis=0)
        high = np.max([[window[0][1], window[1][1]] for window in windows if window is not None], axis=0)
    elif points:
        low, high = (pick([pick(path, axis=0) for path in points], axis=0) for pick in (np.min, np.max))
        margin = 0.05 * float(max(high - low)) + 0.05
        low, high = low - margin, high + margin
    else:
        low, high = np.zeros(2), np.ones(2)
    return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))


def _sheet(
    count: int, window: Window, title: str, note: str, colours: dict[End, str], *, columns: int = 0, largest: float
) -> tuple[Any, list[Any]]:
    """Return a figure with panels of one scale; with ``columns`` 0 they fill the sheet well."""
    (left, right), (bottom, top) = window
    ratio = min(4.0, max(0.15, (top - bottom) / (right - left)))
    if columns == 0:
        columns = min(count, max(1, round(math.sqrt(1.3 * count * ratio))))
    rows = math.ceil(count / columns)
    width = max(_LEAST, min(largest, _SHEET[0] / columns, _SHEET[1] / rows / ratio))
    size = (max(6.5, columns * (width + 0.2) + 0.5), rows * (width * ratio + 0.5) + 1.3)
    figure = new_figure(*size, title, note, legend=_legend(colours))
    panels: list[Any] = []
    for index in range(count):
        shared = panels[0] if panels else None
        axes = figure.add_subplot(rows, columns, index + 1, sharex=shared, sharey=shared)
        style_axes(axes)
        axes.set_aspect("equal")
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        axes.set_facecolor("#fbfbfc")
        below = index + columns >= count
        axes.tick_params(labelsize=7, labelbottom=below, labelleft=index % columns == 0)
        if below:
            axes.set_xlabel("x [m]", fontsize=8, color=INK)
        if index % columns == 0:
            axes.set_ylabel("y [m]", fontsize=8, color=INK)
        panels.append(axes)
    return figure, panels
