"""Pictures of a sweep: learning curves with intervals over seeds, the ranking, and scores over what was searched."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, MaxNLocator, NullFormatter

from ..evaluation.figure_style import GREY, INK, PALE, new_figure, save_figure, style_axes
from .ranking import RankedPoint, median_interval
from .run_state import RunState

COLOURS: Final = ("#0b6e99", "#b8470f", "#2f855a", "#805ad5", "#b7791f", "#97266d", "#2c7a7b", "#4a5568")
"""Of the best points; the others are grey."""
MOST_ROWS: Final = 24
"""Points that the picture of the ranking has room for, the best ones."""
_WORDS = {"mean_reward": "mean return", "mean_episode_length": "mean episode length [steps]"}


def draw_curves(path: Path, title: str, column: str, points: Sequence[RankedPoint]) -> None:
    """Write a picture of the learning curves and of the scores.

    Args:
        path: the PNG.
        title: the heading.
        column: of ``progress.csv``, that is drawn and ranked by.
        points: in the order of the ranking.

    Raises:
        OutputError: the disk did not take it.
    """
    shown = [point for point in points if point.interval is not None][:MOST_ROWS]
    figure = new_figure(11.0, max(3.6, 1.4 + 0.3 * len(shown)), title, seeds_note(points))
    word = _WORDS.get(column, column.replace("_", " "))
    curves, scores = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    for rank in reversed(range(len(points))):
        colour = COLOURS[rank] if rank < len(COLOURS) else GREY
        _curve(curves, points[rank], colour, faint=rank >= len(COLOURS))
    curves.set_xlabel("environment steps", color=INK)
    curves.set_ylabel(word, color=INK)
    curves.xaxis.set_major_formatter(EngFormatter())
    draw_ranking(scores, shown)
    scores.set_xlabel(f"{word}, last tenth of the iterations", color=INK)
    for axes in (curves, scores):
        style_axes(axes)
        axes.grid(color=PALE, linewidth=0.8)
        axes.set_axisbelow(True)
    save_figure(figure, path)


def seeds_note(points: Sequence[RankedPoint]) -> str:
    """Return what lines, bands and marks over seeds are."""
    seeds = sorted({len(point.scores) for point in points if point.scores}) or [0]
    if seeds[-1] < 2:
        return "One seed per point: nothing tells chance apart."
    held = [f"{median_interval([0.0] * count).coverage:.0%} of {count} seeds" for count in seeds if count > 1]
    return (
        "Lines and large marks: median over seeds; bands and bars: interval that holds the true median with a"
        f" probability of {', '.join(held)}, whatever the distribution; small marks: single seeds."
    )


def _table(point: RankedPoint) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return steps (iterations,) and values (seeds, iterations) of the finished runs, or of all if none is finished."""
    results = [result for result in point.results if result.steps]
    done = [result for result in results if result.record.state is RunState.DONE] or results
    count = min((len(result.steps) for result in done), default=0)
    if count == 0:
        return np.zeros(0), np.zeros((0, 0))
    return np.array(done[0].steps[:count]), np.array([result.curve[:count] for result in done])


def _curve(axes: Axes, point: RankedPoint, colour: str, *, faint: bool) -> None:
    """Draw the median over seeds with its interval, from where all seeds have a value."""
    steps, values = _table(point)
    known = np.isfinite(values).all(axis=0) if len(values) else np.zeros(0, dtype=bool)
    steps, values = steps[known], values[:, known] if len(values) else values
    if not len(steps):
        return
    found = [median_interval(column) for column in values.T.tolist()]
    axes.plot(
        steps, [item.median for item in found], color=colour, linewidth=0.8 if faint else 1.6,
        marker="o" if len(steps) == 1 else None,
    )  # fmt: skip
    if len(values) > 1 and not faint:
        low, high = [item.low for item in found], [item.high for item in found]
        axes.fill_between(steps, low, high, color=colour, alpha=0.18, linewidth=0)


def draw_ranking(
    axes: Axes, points: Sequence[RankedPoint], value: Callable[[float], float] = lambda score: score
) -> None:  # fmt: skip
    """Draw a row per point, the best one above: scores of the seeds, their median and its interval.

    Args:
        axes: takes the rows.
        points: with intervals.
        value: returns what is drawn of a score; NaN: nothing.
    """
    for row, point in enumerate(points):
        known = point.interval
        assert known is not None  # others are not handed over
        colour = COLOURS[row] if row < len(COLOURS) else GREY
        ends = [value(known.low), value(known.high)]
        finite = [score for score in map(value, point.scores) if math.isfinite(score)]
        if all(map(math.isfinite, ends)):
            axes.plot(ends, [row, row], color=colour, linewidth=5, alpha=0.25)
        axes.plot(finite, [row] * len(finite), ".", color=colour, markersize=5)
        if math.isfinite(value(known.median)):
            axes.plot(value(known.median), row, "o", color=colour, markersize=8)
    axes.set_yticks(range(len(points)), [_label(point) for point in points])
    axes.set_ylim(len(points) - 0.4, -0.6)


def _label(point: RankedPoint) -> str:
    label = point.label.replace(",", ", ") or "all seeds"
    return f"{label}  ({point.failed} failed)" if point.failed else label


def draw_search(
    path: Path, title: str, column: str, points: Sequence[RankedPoint],
    value: Callable[[float], float] = lambda score: score,
) -> None:  # fmt: skip
    """Write a picture of the scores over each field that was searched, the best point ringed.

    Args:
        path: the PNG.
        title: the heading.
        column: that is ranked by, or words in its place.
        points: in the order of the ranking.
        value: returns what is drawn of a score; NaN: nothing.

    Raises:
        OutputError: the disk did not take it.
    """
    found = [(point.values, value(point.interval.median)) for point in points if point.interval is not None]
    known = [(values, score) for values, score in found if math.isfinite(score)]
    keys = list(known[0][0]) if known else []
    if not keys:
        return
    figure = new_figure(max(4.0, 3.4 * len(keys)), 3.4, title, "One mark per trial: the median over its seeds.")
    for index, key in enumerate(keys):
        axes = figure.add_subplot(1, len(keys), index + 1)
        style_axes(axes)
        _scatter(axes, key, known)
        if index == 0:
            axes.set_ylabel(_WORDS.get(column, column.replace("_", " ")), color=INK)
    save_figure(figure, path)


def _scatter(axes: Axes, key: str, found: Sequence[tuple[Mapping[str, Any], float]]) -> None:
    values = [point[key] for point, _ in found]
    numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if numeric:
        places = [float(value) for value in values]
        if min(places) > 0.0 and max(places) > 30.0 * min(places):
            axes.set_xscale("log")
            axes.xaxis.set_minor_formatter(NullFormatter())
        elif all(isinstance(value, int) for value in values):
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    else:
        names = sorted({str(value) for value in values})
        places = [float(names.index(str(value))) for value in values]
        axes.set_xticks(range(len(names)), names)
        axes.set_xlim(-0.5, len(names) - 0.5)
    scores = [score for _, score in found]
    axes.plot(places, scores, "o", color=COLOURS[0], markersize=5, alpha=0.7)
    axes.plot(places[0], scores[0], "o", markersize=11, markerfacecolor="none", markeredgecolor=COLOURS[1])
    axes.set_xlabel(key, color=INK)
    axes.grid(color=PALE, linewidth=0.8)
    axes.set_axisbelow(True)
