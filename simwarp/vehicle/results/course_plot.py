"""A course of lanes as a picture: cones, the outline's way at two speeds, and how far it came beyond the cones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from simwarp.core.files import replacing
from simwarp.vehicle.results.lane_verdicts import outline_corners
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, legend, title_of
from simwarp.vehicle.results.variants import Outcome

SPACING: Final = 6.0
"""Between drawn outlines, along the way [m]."""
LANE_COLOURS: Final = (BLUE, ORANGE, GREY)


def draw_course(found: Sequence[Outcome], target: Path, title: str) -> None:
    """Writes a picture in the format of the file's suffix: the fastest run that passed, the first that failed, and the
    outline beyond the cones of every lane over the speed.

    Args:
        found: variants of a manoeuvre with a course, in order of their speed.
        target: .png, .pdf or .svg.
        title: the heading.

    Raises:
        FileError: the target cannot be written to.
        OutputError: the disk did not take it.
    """
    shown = shown_outcomes(found)
    figure = _figure(2.6 * len(shown) + 3.6)
    figure.suptitle(title, x=0.012, ha="left", fontsize=15, fontweight="bold", color=INK)
    grid = figure.add_gridspec(len(shown) + 1, 1, height_ratios=[1.0] * len(shown) + [1.5])
    for row, outcome in enumerate(shown):
        axes = figure.add_subplot(grid[row, 0])
        dress(axes)
        _draw_way(axes, outcome)
    axes = figure.add_subplot(grid[len(shown), 0])
    dress(axes)
    _draw_verdicts(axes, found)
    with replacing(target) as draft:
        figure.savefig(draft, dpi=120)


def course_figure(outcome: Outcome) -> Figure:
    """The way of one run between its cones."""
    figure = _figure(1.8)
    axes = figure.add_subplot()
    dress(axes)
    _draw_way(axes, outcome)
    return figure


def _figure(height: float) -> Figure:
    figure = Figure(figsize=(12.0, height))
    figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
    FigureCanvasAgg(figure)
    return figure


def shown_outcomes(found: Sequence[Outcome]) -> list[Outcome]:
    """The last of the leading runs that passed and the first that did not."""
    first = next((k for k, each in enumerate(found) if not each.passed), len(found))
    return list(found[max(first - 1, 0) : first + 1])


def speed_of(outcome: Outcome) -> float:
    """That its driver was to hold [m/s]."""
    follow = outcome.maneuver.follow
    return math.nan if follow is None else follow.speed


def _draw_way(axes: Any, outcome: Outcome) -> None:
    course = outcome.maneuver.course
    assert course is not None
    word = "passed" if outcome.passed else "failed"
    title_of(axes, f"{course.standard} at {speed_of(outcome):g} m/s: {word}, from above [m]")
    cones = course.cones()
    axes.plot([cone.x for cone in cones], [cone.y for cone in cones], "^", color=ORANGE, markersize=5)
    corners = outline_corners(outcome.run, course)
    middle = corners.mean(axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))])
    picked = np.searchsorted(way, np.arange(0.0, way[-1], SPACING))
    for corner in corners[picked]:
        axes.add_patch(Polygon(corner, closed=True, facecolor=BLUE, edgecolor=BLUE, alpha=0.25))
    for k in range(4):
        axes.plot(*corners[:, k].T, color=BLUE if k in (0, 1) else INK, linewidth=0.7)
    axes.set_xlim(course.start - 10.0, course.end + 10.0)
    low, high = min(lane.right for lane in course.lanes), max(lane.left for lane in course.lanes)
    axes.set_ylim(low - 1.5, high + 1.5)
    axes.set_aspect("equal")


def _draw_verdicts(axes: Any, found: Sequence[Outcome]) -> None:
    title_of(axes, "outline beyond the cones [m], negative: inside")
    speeds = [speed_of(each) for each in found]
    for lane, colour in enumerate(LANE_COLOURS):
        over = [each.verdicts[lane].value if len(each.verdicts) > lane else math.nan for each in found]
        axes.plot(speeds, over, "o-", color=colour, markersize=4, linewidth=1.2, label=f"lane {lane + 1}")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set_xlabel("speed to hold [m/s]", fontsize=9, color=INK)
    legend(axes)
