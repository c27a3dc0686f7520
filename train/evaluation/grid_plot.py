"""Success over a grid as a picture: a line for one key, a heat map for two, several of them for more."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .evaluation import Evaluation
from .figure_style import GREY, INK, PALE, new_figure, save_figure, style_axes
from .grid import POLICY_NAMES, GridPoint, PointResult, axes_of, value_text, words

COLOURS = {"policy": "#0b6e99", "zero": GREY, "random": "#b8470f"}
Percent: TypeAlias = tuple[float, float, float]
"""A rate and the bounds of its interval [%]."""
_CELL = (1.25, 0.75)
"""Width and height of a cell of a heat map [inch]."""


def draw_success(path: Path, title: str, note: str, points: list[GridPoint], results: list[PointResult]) -> None:
    """Write a picture of the success rates.

    Args:
        path: the PNG.
        title: the heading.
        note: one small line below.
        points: all that were asked for, with at least one key.
        results: of those that were evaluated.
    """
    axes = axes_of(points)
    figure = (_lines if len(axes) == 1 else _heat_maps)(title, note, axes, results)
    save_figure(figure, path)


def _percent_of(value: Evaluation | None) -> Percent | None:
    return None if value is None else _percent(value)


def _percent(value: Evaluation) -> Percent:
    """Success rate and the bounds of its interval [%]."""
    low, high = value.success_ci95
    return 100.0 * value.success_rate, 100.0 * low, 100.0 * high


# ---- one key -------------------------------------------------------------------------------------------------------


def _lines(title: str, note: str, keys: dict[str, list[Any]], results: list[PointResult]) -> Figure:
    (key, values), = keys.items()  # fmt: skip
    numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    places = {value: float(value) if numeric else float(index) for index, value in enumerate(values)}
    names = list(dict.fromkeys(name for result in results for name in result.evaluations))
    legend = [Line2D([], [], color=COLOURS[name], marker="o", label=POLICY_NAMES[name]) for name in names]
    width = max(5.0, 1.2 + 0.7 * len(values))
    figure = new_figure(width, 3.8, title, note, legend=legend if len(names) > 1 else ())
    axes = figure.add_subplot()
    style_axes(axes)
    for index, name in enumerate(names):
        # Where no lines tell the policies apart, they stand side by side
        aside = 0.0 if numeric else 0.08 * (index - 0.5 * (len(names) - 1))
        found = sorted(
            (aside + places[result.point.values[key]], _percent(result.evaluations[name]))
            for result in results
            if name in result.evaluations
        )
        x = [place for place, _ in found]
        y = [share for _, (share, _, _) in found]
        errors = [[share - low for _, (share, low, _) in found], [high - share for _, (share, _, high) in found]]
        axes.errorbar(
            x, y, yerr=np.maximum(errors, 0.0), color=COLOURS[name], capsize=4, linewidth=1.4, markersize=5,
            marker="o", linestyle="-" if numeric else "none", clip_on=False,
        )  # fmt: skip
    axes.set_xticks(list(places.values()), [value_text(value) for value in values])
    if numeric:
        axes.margins(x=0.06)
    else:
        axes.set_xlim(-0.5, len(values) - 0.5)
    axes.set_ylim(0.0, 100.0)
    axes.grid(axis="y", color=PALE, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_xlabel(words(key), color=INK)
    axes.set_ylabel("success rate [%]", color=INK)
    return figure


# ---- two keys and more ---------------------------------------------------------------------------------------------


def _heat_maps(title: str, note: str, keys: dict[str, list[Any]], results: list[PointResult]) -> Figure:
    """One heat map of the first two keys for each combination of the others."""
    (down, rows), (across, columns), *others = keys.items()
    facets = list(itertools.product(*(values for _, values in others)))
    wide = max(1, min(len(facets), math.floor(12.0 / (_CELL[0] * len(columns) + 0.6))))
    tall = math.ceil(len(facets) / wide)
    width = wide * (_CELL[0] * len(columns) + 0.7) + 1.1
    height = tall * (_CELL[1] * len(rows) + (0.9 if others else 0.6)) + 0.8
    figure = new_figure(max(width, 5.0), height, title, note)
    by_values = {tuple(result.point.values.values()): result.evaluation for result in results}
    image, panels = None, []
    for index, facet in enumerate(facets):
        axes = figure.add_subplot(tall, wide, index + 1)
        panels.append(axes)
        cells = {
            (row, column): _percent_of(by_values.get((value, other, *facet)))
            for row, value in enumerate(rows)
            for column, other in enumerate(columns)
        }
        image = draw_heat_map(axes, cells, len(rows), len(columns))
        axes.set_xticks(range(len(columns)), [value_text(value) for value in columns])
        axes.set_yticks(range(len(rows)), [value_text(value) for value in rows])
        axes.set_xlabel(words(across), color=INK)
        axes.set_ylabel(words(down), color=INK)
        if others:
            text = ", ".join(
                f"{words(key)} = {value_text(value)}" for (key, _), value in zip(others, facet, strict=True)
            )
            axes.set_title(text, loc="left", fontsize=9, color=INK)
    if image is not None:
        bar = figure.colorbar(image, ax=panels, fraction=0.08, pad=0.02, aspect=18)
        bar.set_label("success rate [%]", color=INK)
        bar.outline.set_visible(False)
        bar.ax.tick_params(labelsize=8, colors=INK)
    return figure


def draw_heat_map(axes: Any, cells: Mapping[tuple[int, int], Percent | None], rows: int, columns: int) -> Any:
    """Draw rates as colours, with rate and interval in every cell; cells without a result are hatched.

    Args:
        axes: of Matplotlib.
        cells: (row, column) -> rate and bounds of its interval [%].
        rows, columns: numbers of them.

    Returns:
        The image, for a colour bar.
    """
    shares = np.full((rows, columns), np.nan)
    for (row, column), value in cells.items():
        if value is None:
            axes.fill_between(
                [column - 0.5, column + 0.5], row - 0.5, row + 0.5, facecolor="white", edgecolor=GREY, hatch="///",
                linewidth=0.0,
            )  # fmt: skip
            continue
        share, low, high = value
        shares[row, column] = share
        ink = "white" if share < 60.0 else INK
        axes.text(
            column, row - 0.1, f"{share:.1f} %", ha="center", va="center", color=ink, fontsize=11, fontweight="bold"
        )
        axes.text(column, row + 0.22, f"{low:.0f} – {high:.0f}", ha="center", va="center", color=ink, fontsize=8)
    image = axes.imshow(shares, vmin=0.0, vmax=100.0, cmap="viridis", aspect="auto")
    axes.set_xlim(-0.5, columns - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.set_xticks(np.arange(columns + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(rows + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="white", linewidth=2.0)
    axes.tick_params(which="both", length=0, labelsize=9, colors=INK)
    axes.spines[:].set_visible(False)
    return image
