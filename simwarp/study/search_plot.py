"""A search for a design as a picture: how the goal grew, and where in each range good designs are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Page

from simwarp.core.files import replacing
from simwarp.study.design_goal import Goal
from simwarp.study.design_search import Design
from simwarp.study.distributions import Kind
from simwarp.study.study_plot import unit_of_key
from simwarp.study.varied_vehicle import VariedKey
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, title_of

MOST_KEYS: Final = 12
ACROSS: Final = 3


def draw_search(designs: Sequence[Design], keys: Sequence[VariedKey], goal: Goal, target: Path, title: str) -> None:
    """Writes a page: the goal of every design with the best so far, and the goal over each key.

    Args:
        designs: in the order in which they were driven.
        keys: of the search.
        goal: of the search.
        target: .png, .pdf or .svg.
        title: the heading.

    Raises:
        FileError: the target cannot be written to.
        OutputError: the disk did not take it.
    """
    shown = list(keys)[:MOST_KEYS]
    rows = math.ceil(len(shown) / ACROSS)
    page = Page(figsize=(12.0, 3.6 + 2.6 * rows))
    page.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
    FigureCanvasAgg(page)
    page.suptitle(title, x=0.012, ha="left", fontsize=15, fontweight="bold", color=INK)
    grid = page.add_gridspec(rows + 1, ACROSS, height_ratios=[1.3] + [1.0] * rows)
    goals = np.array([each.goal for each in designs])
    good = np.array([each.kept for each in designs], bool) & np.isfinite(goals)
    axes = page.add_subplot(grid[0, :])
    dress(axes)
    title_of(axes, f"{goal.key} of each design; the line is the best so far, grey ones break a bound")
    numbers = np.arange(len(designs))
    axes.plot(numbers[~good], goals[~good], ".", color=GREY)
    axes.plot(numbers[good], goals[good], ".", color=BLUE)
    axes.plot(numbers, best_so_far(designs, goal), "-", color=ORANGE, linewidth=1.4, drawstyle="steps-post")
    axes.set_xlabel("design", fontsize=9, color=INK)
    for index, key in enumerate(shown):
        axes = page.add_subplot(grid[1 + index // ACROSS, index % ACROSS])
        dress(axes)
        title_of(axes, f"over {key.name if len(key.name) <= 40 else '...' + key.name[-37:]}")
        axes.set_xlabel(unit_of_key(key.factor), fontsize=9, color=INK)
        if key.distribution.kind is Kind.LOG_UNIFORM:
            axes.set_xscale("log")
        else:
            axes.locator_params(axis="x", nbins=5)
        values = np.array([each.values[index] for each in designs])
        axes.plot(values[~good], goals[~good], ".", color=GREY)
        axes.plot(values[good], goals[good], ".", color=BLUE)
    with replacing(target) as draft:
        page.savefig(draft, dpi=110)


def best_so_far(designs: Sequence[Design], goal: Goal) -> list[float]:
    """The best goal of the designs up to each that keep all bounds; NaN before there is one."""
    found, best = [], math.nan
    for each in designs:
        if each.kept and not math.isnan(each.goal) and (math.isnan(best) or goal.better(each.goal, best)):
            best = each.goal
        found.append(best)
    return found
