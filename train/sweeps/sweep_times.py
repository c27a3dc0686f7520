"""Picture of a sweep that is ranked by time: how runs come to their bound, and the seconds that it took."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..evaluation.figure_style import GREY, INK, PALE, new_figure, save_figure, style_axes
from .ranking import RankedPoint, RunResult
from .sweep_curves import COLOURS, MOST_ROWS, draw_ranking
from .time_to_bound import WINDOW, Bound, score_text, seconds_of, window_means

_NOTE: Final = (
    f"Left: a line per run, means over {WINDOW} iterations, of the first column that has a bound (dashed).\n"
    "Right: small marks are seeds, large ones their median; bars reach over the seeds as far as the table tells."
)


def draw_times(path: Path, title: str, bounds: Sequence[Bound], points: Sequence[RankedPoint]) -> None:
    """Write a picture of what runs reached over seconds of training, and of the times to the bounds.

    Args:
        path: the PNG.
        title: the heading.
        bounds: that runs are ranked by.
        points: in the order of the ranking.

    Raises:
        OutputError: the disk did not take it.
    """
    shown = [point for point in points if point.interval is not None][:MOST_ROWS]
    legend = [
        Line2D([], [], color=COLOURS[rank], label=point.label or "all seeds")
        for rank, point in enumerate(shown[: len(COLOURS)])
    ]
    figure = new_figure(11.0, max(4.0, 1.8 + 0.3 * len(shown)), title, _NOTE, legend=legend)
    curves, times = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    for rank in reversed(range(len(points))):
        colour = COLOURS[rank] if rank < len(COLOURS) else GREY
        for result in points[rank].results:
            _curve(curves, result, colour)
    curves.axhline(bounds[0].value, color=INK, linewidth=0.8, linestyle="--")
    curves.set_xlabel("training [s]", color=INK)
    curves.set_ylabel(bounds[0].column.replace("_", " "), color=INK)
    draw_ranking(times, shown, seconds_of)
    for row, point in enumerate(shown):
        if point.interval is not None and math.isnan(seconds_of(point.interval.median)):
            text = score_text(point.interval.median)
            times.text(0.02, row, text, transform=times.get_yaxis_transform(), va="center", color=INK)
    times.set_xlim(left=0.0)
    times.set_xlabel(f"training until {' and '.join(bound.text for bound in bounds)} [s]", color=INK)
    for axes in (curves, times):
        style_axes(axes)
        axes.grid(color=PALE, linewidth=0.8)
        axes.set_axisbelow(True)
    save_figure(figure, path)


def _curve(axes: Axes, result: RunResult, colour: str) -> None:
    if len(result.curve) < WINDOW:
        return
    axes.plot(result.seconds[WINDOW - 1 :], window_means(np.array(result.curve)), color=colour, linewidth=1.0)
