"""A course of lanes as a picture: cones, the outline's way at two speeds, and how far it came beyond the cones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simwarp.core.files import replacing
from simwarp.vehicle.assessment.entry_speed import asked_speed
from simwarp.vehicle.assessment.maneuver_variants import Outcome
from simwarp.vehicle.results.maneuver_panels import draw_lanes
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, legend, title_of

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


def _figure(height: float) -> Figure:
    figure = Figure(figsize=(12.0, height))
    figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
    FigureCanvasAgg(figure)
    return figure


def shown_outcomes(found: Sequence[Outcome]) -> list[Outcome]:
    """The last of the leading runs that passed and the first that did not."""
    first = next((k for k, each in enumerate(found) if not each.passed), len(found))
    return list(found[max(first - 1, 0) : first + 1])


def _draw_way(axes: Any, outcome: Outcome) -> None:
    course = outcome.maneuver.course
    assert course is not None
    word = "passed" if outcome.passed else "failed"
    title_of(axes, f"{course.standard} at {asked_speed(outcome.maneuver):g} m/s: {word}, from above [m]")
    draw_lanes(axes, outcome.run, course)


def _draw_verdicts(axes: Any, found: Sequence[Outcome]) -> None:
    title_of(axes, "outline beyond the cones [m], negative: inside")
    speeds = [asked_speed(each.maneuver) for each in found]
    for lane, colour in enumerate(LANE_COLOURS):
        over = [each.verdicts[lane].value if len(each.verdicts) > lane else math.nan for each in found]
        axes.plot(speeds, over, "o-", color=colour, markersize=4, linewidth=1.2, label=f"lane {lane + 1}")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set_xlabel("speed to hold [m/s]", fontsize=9, color=INK)
    legend(axes)
