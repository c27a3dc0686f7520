"""A study as a picture: a histogram of each figure with the key that bears most on it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Page
from matplotlib.ticker import FixedLocator

from simwarp.core.files import replacing
from simwarp.study.monte_carlo import StudyResult
from simwarp.study.study_summary import FigureSummary
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, title_of

MOST_SHOWN: Final = 6
"""Figures on a page."""
ROW_HEIGHT: Final = 2.1
MOST_BINS: Final = 40
MARKS: Final = (
    "red line: as built; dotted: 5, 50 and 95 % of the worlds; grey: correlations that may be chance; "
    "orange points: worlds that failed"
)


def draw_study(result: StudyResult, target: Path, title: str) -> None:
    """Writes a page in the format of the file's suffix: for each figure its histogram with quantiles and the value as
    built, beside it the rank correlations with all keys, and the figure over the key that bears most on it. A line at
    the foot says what the marks are.

    Args:
        result: with sound rows.
        target: .png, .pdf or .svg.
        title: the heading.

    Raises:
        FileError: the target cannot be written to.
        OutputError: the disk did not take it.
    """
    shown = [each for each in result.summaries() if each.deviation > 0.0][:MOST_SHOWN]
    page = Page(figsize=(13.0, 0.9 + ROW_HEIGHT * max(len(shown), 1)))
    page.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
    FigureCanvasAgg(page)
    page.suptitle(title, x=0.012, ha="left", fontsize=15, fontweight="bold", color=INK)
    page.supxlabel(MARKS, x=0.012, ha="left", fontsize=9, color=INK)
    if shown:
        grid = page.add_gridspec(len(shown), 3, width_ratios=[1.5, 1.2, 1.3])
        for row, each in enumerate(shown):
            panels = [page.add_subplot(grid[row, column]) for column in range(3)]
            for axes in panels:
                dress(axes)
                axes.ticklabel_format(useOffset=False)
                axes.locator_params(axis="x", nbins=5)
            _draw_histogram(panels[0], each, result)
            _draw_correlations(panels[1], each, result)
            _draw_strongest(panels[2], each, result)
    with replacing(target) as draft:
        page.savefig(draft, dpi=110)


def _draw_histogram(axes: Any, each: FigureSummary, result: StudyResult) -> None:
    values = result.column(each.figure.key)
    values = values[np.isfinite(values)]
    unit = f" [{each.figure.unit}]" if each.figure.unit else ""
    title_of(axes, f"{each.figure.label}{unit}")
    axes.hist(values, bins=min(MOST_BINS, max(5, math.isqrt(len(values)) * 2)), color=BLUE, alpha=0.75)
    for value in each.quantiles.values():
        axes.axvline(value, color=INK, linewidth=0.9, linestyle=":")
    if math.isfinite(each.nominal):
        axes.axvline(each.nominal, color=ORANGE, linewidth=1.4)
    axes.set_xlabel(f"[{each.figure.unit or '1'}]", fontsize=9, color=INK)
    axes.set_ylabel("worlds", fontsize=9, color=INK)


def _draw_correlations(axes: Any, each: FigureSummary, result: StudyResult) -> None:
    title_of(axes, "rank correlation")
    places = np.arange(len(result.keys))
    sizes = [0.0 if math.isnan(value) else value for value in each.correlations]
    axes.barh(places, sizes, color=[BLUE if value >= 0.0 else ORANGE for value in sizes], height=0.6)
    if math.isfinite(each.chance):
        axes.axvspan(-each.chance, each.chance, color=GREY, alpha=0.25, linewidth=0)
    axes.xaxis.set_major_locator(FixedLocator([-1.0, -0.5, 0.0, 0.5, 1.0]))
    axes.set_yticks(places, [_short(key) for key in result.keys], fontsize=7)
    axes.invert_yaxis()
    axes.set_xlim(-1.05, 1.05)


def _draw_strongest(axes: Any, each: FigureSummary, result: StudyResult) -> None:
    sizes = [-1.0 if math.isnan(value) else abs(value) for value in each.correlations]
    index = int(np.argmax(sizes))
    rows = result.sound
    key = [row.values[index] for row in rows]
    passed = np.array([row.passed is not False for row in rows])
    values = result.column(each.figure.key)
    title_of(axes, f"over {_short(result.keys[index])}")
    axes.set_xlabel(unit_of_key(result.keys[index] in result.factors), fontsize=9, color=INK)
    for mask, colour in ((passed, BLUE), (~passed, ORANGE)):
        axes.plot(np.asarray(key)[mask], values[mask], ".", color=colour, markersize=4)


def unit_of_key(factor: bool) -> str:
    """What stands below an axis of a key's values."""
    return "times as built" if factor else "as in the file [SI]"


def _short(key: str, most: int = 34) -> str:
    """The end of a long key."""
    return key if len(key) <= most else f"...{key[3 - most :].lstrip('.')}"
