"""Panels of a page that only some manoeuvres have: what their results and verdicts are read from."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.patches import Polygon

from simwarp.vehicle.assessment.handling_results import (
    LEAST_DISPLACEMENT,
    RATIO_LIMITS,
    RATIO_TIMES,
    dwell_peak,
)
from simwarp.vehicle.assessment.lane_verdicts import outline_corners
from simwarp.vehicle.assessment.straight_results import (
    MOST_ROLLBACK,
    QUARTER_MILE,
    climbed,
    course_deviation,
    ground_speed,
    travelled,
)
from simwarp.vehicle.assessment.understeer import FIT_WINDOW, GRAVITY, understeer_curve
from simwarp.vehicle.driving.braking_maneuvers import HOLD
from simwarp.vehicle.driving.handling_maneuvers import SINE_END
from simwarp.vehicle.driving.lane_courses import LaneCourse
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, legend, spanned, title_of
from simwarp.vehicle.results.run_result import lateral_acceleration, since_zero, smoothed

Array = npt.NDArray[np.float64]

SPACING: Final = 6.0
"""Between drawn outlines of a vehicle, along the way [m]."""

Panel = Callable[[Any, Run, Maneuver], None]
"""Draws on axes a run from the manoeuvre's zero on."""


def draw_special(figure: Any, places: tuple[Any, Any], run: Run, maneuver: Maneuver) -> None:
    """Draws the two panels of a manoeuvre.

    Args:
        figure: of the page.
        places: of the panels in its grid.
        run: recorded.
        maneuver: one that `has_special`.
    """
    moving = since_zero(run)
    for place, panel in zip(places, _SPECIAL[maneuver.name], strict=True):
        axes = figure.add_subplot(place)
        dress(axes)
        if len(moving["t_s"]) > 3:
            panel(axes, moving, maneuver)


def has_special(maneuver: Maneuver) -> bool:
    """Whether a manoeuvre has panels of its own."""
    return maneuver.name in _SPECIAL


def draw_lanes(axes: Any, run: Run, course: LaneCourse) -> None:
    """Cones of a course, and the outline of the vehicle between them."""
    cones = course.cones()
    axes.plot([cone.x for cone in cones], [cone.y for cone in cones], "^", color=ORANGE, markersize=5)
    corners = outline_corners(run, course)
    middle = corners.mean(axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))])
    picked = np.searchsorted(way, np.arange(0.0, way[-1], min(SPACING, 1.5 * course.outline.length)))
    for corner in corners[picked]:
        axes.add_patch(Polygon(corner, closed=True, facecolor=BLUE, edgecolor=BLUE, alpha=0.25))
    for k in range(4):
        axes.plot(*corners[:, k].T, color=BLUE if k in (0, 1) else INK, linewidth=0.7)
    axes.set_xlim(course.start - 10.0, course.end + 10.0)
    low, high = min(lane.right for lane in course.lanes), max(lane.left for lane in course.lanes)
    axes.set_ylim(low - 1.5, high + 1.5)
    axes.set_aspect("equal")


def _understeer(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "angle less wheelbase / radius [deg]")
    curve = understeer_curve(run, maneuver)
    told: list[tuple[str, tuple[float, float], float]] = []
    shown = curve.rising & (smoothed(run["speed_mps"], FIT_WINDOW) > 0.2 * run["speed_mps"].max())
    for values, label, colour in (
        (curve.road_wheels, "road wheels", INK), (curve.steering_wheel, "steering wheel / ratio", BLUE),
    ):  # fmt: skip
        if np.isnan(values).any():
            continue
        axes.plot(curve.lateral[shown], np.degrees(values[shown]), color=colour, linewidth=1.2, label=label)
        for band in curve.bands():
            used = curve.rows(*band)
            line = np.polyfit(curve.lateral[used], np.degrees(values[used]), 1)
            axes.plot(band, np.polyval(line, band), color=ORANGE, linewidth=2.0)
            told.append((label, band, GRAVITY * float(line[0])))
    # a slide at the end would flatten what gradients are read from
    calm = shown & curve.rows(0.0, 0.9 * float(curve.lateral.max()))
    if calm.any():
        both = np.degrees(np.concatenate([curve.road_wheels[calm], curve.steering_wheel[calm]]))
        low, high = float(np.nanmin(both)), float(np.nanmax(both))
        size = max(high - low, 0.02)
        axes.set_ylim(low - 0.1 * size, high + (0.1 + 0.15 * len(told)) * size)  # the texts stand above
    for row, (label, band, gradient) in enumerate(sorted(told)):
        text = f"{label}, {band[0]:g} to {band[1]:.2g} m/s²: {gradient:+.2f} deg/g"
        axes.text(0.02, 0.97 - 0.09 * row, text, fontsize=8, color=ORANGE, va="top", transform=axes.transAxes)
    _under(axes, "lateral acceleration [m/s²]")
    legend(axes)


def _steering(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "steering [%], roll [deg]")
    lateral = smoothed(lateral_acceleration(run), FIT_WINDOW)
    shown = np.arange(len(lateral)) <= int(np.argmax(np.abs(lateral)))
    roll = np.degrees(smoothed(run["roll_rad"], FIT_WINDOW))
    axes.plot(lateral[shown], 100.0 * run["steer"][shown], color=INK, linewidth=1.2, label="steering")
    axes.plot(lateral[shown], roll[shown], color=ORANGE, linewidth=1.2, label="roll")
    _under(axes, "lateral acceleration [m/s²]")
    legend(axes)


def _under(axes: Any, text: str) -> None:
    axes.set_xlabel(text, fontsize=9, color=INK)


def _step(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "share of the steady value")
    _under(axes, "time [s]")
    t = run["t_s"]
    late = t > t[-1] - 1.0
    lateral = lateral_acceleration(run)
    for values, label, colour in (
        (run["yawrate_radps"], "yaw rate", INK), (lateral, "lateral acceleration", BLUE),
        (run["steer"], "steering", GREY),
    ):  # fmt: skip
        steady = float(values[late].mean())
        if abs(steady) > 1e-3:
            axes.plot(t, values / steady, color=colour, linewidth=1.2, label=label)
    axes.axhline(0.9, color=ORANGE, linewidth=0.8, linestyle="--")
    legend(axes)


def _dwell_rates(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "yaw rate over its second peak [%]")
    _under(axes, "time [s]")
    axes.plot(run["t_s"], 100.0 * run["yawrate_radps"] / dwell_peak(run), color=INK, linewidth=1.2, label="yaw rate")
    largest = max(float(np.abs(run["steer"]).max()), 1e-6)
    axes.plot(run["t_s"], -100.0 * run["steer"] / largest, color=GREY, linewidth=1.0, label="- steering")
    times = [SINE_END + time for time in RATIO_TIMES]
    axes.plot(times, RATIO_LIMITS, "v", color=ORANGE, markersize=7, label="at most")
    legend(axes)


def _dwell_way(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "lateral displacement [m]")
    _under(axes, "time [s]")
    off, _ = course_deviation(run)
    axes.plot(run["t_s"], np.abs(off), color=INK, linewidth=1.2)
    axes.plot([1.07], [LEAST_DISPLACEMENT], "^", color=ORANGE, markersize=7, label="at least")
    axes.set_xlim(0.0, 3.0)
    axes.set_ylim(0.0, 2.0 * LEAST_DISPLACEMENT + 0.5 * float(np.abs(off[run["t_s"] < 3.0]).max()))
    legend(axes)


def _sides(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "load of a side over that at the start [%]")
    _under(axes, "time [s]")
    for side, name, colour in (("L", "left", BLUE), ("R", "right", ORANGE)):
        load = run[f"Fz_F{side}_N"] + run[f"Fz_R{side}_N"]
        axes.plot(run["t_s"], 100.0 * load / max(load[0], 1e-6), color=colour, linewidth=1.2, label=name)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    legend(axes)


def _roll_rate(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "roll rate [deg/s], steering [%]")
    _under(axes, "time [s]")
    t = run["t_s"]
    axes.plot(t, np.degrees(np.gradient(run["roll_rad"], t)), color=INK, linewidth=1.2, label="roll rate")
    axes.plot(t, 100.0 * run["steer"], color=GREY, linewidth=1.0, label="steering")
    legend(axes)


def _over_way(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "speed over the ground [m/s]")
    _under(axes, "way [m]")
    axes.plot(travelled(run), ground_speed(run), color=INK, linewidth=1.2)
    if maneuver.name == "acceleration" and travelled(run)[-1] > QUARTER_MILE:
        axes.axvline(QUARTER_MILE, color=ORANGE, linewidth=0.8, linestyle="--", label="quarter mile")
        legend(axes)
    spanned(axes, 0.1)


def _heading(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "heading [deg], distance from the line [m]")
    _under(axes, "time [s]")
    off, yaw = course_deviation(run)
    axes.plot(run["t_s"], np.degrees(yaw), color=INK, linewidth=1.2, label="heading")
    axes.plot(run["t_s"], off, color=ORANGE, linewidth=1.2, label="distance")
    spanned(axes, 0.1)
    legend(axes)


def _pull(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "acceleration, means of half a second [m/s²]")
    _under(axes, "speed [m/s]")
    axes.plot(run["speed_mps"], smoothed(np.gradient(run["speed_mps"], run["t_s"]), 51), color=INK, linewidth=1.2)
    spanned(axes, 0.1)


def _uphill(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "place along the slope [m]")
    _under(axes, "time [s]")
    way, t = climbed(run, maneuver), run["t_s"]
    held = float(np.interp(min(HOLD, t[-1]), t, way))
    axes.plot(t, way - held, color=INK, linewidth=1.2)
    axes.axhline(-MOST_ROLLBACK, color=ORANGE, linewidth=0.8, linestyle="--", label="rolls back at most")
    axes.axvline(HOLD, color=GREY, linewidth=0.8)
    near = (way - held) < 3.0
    axes.set_ylim(min(-1.5 * MOST_ROLLBACK, float((way - held).min()) - 0.1), float((way - held)[near].max()) + 0.5)
    legend(axes)


def _hold(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "the same on the brakes [mm]")
    _under(axes, "time [s]")
    t = run["t_s"]
    held = t <= HOLD
    way = 1e3 * climbed(run, maneuver)
    axes.plot(t[held], way[held] - way[held][-1], color=INK, linewidth=1.2)
    spanned(axes, 5.0)


def _over_bump(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "rise of the frame, and the road [mm]")
    _under(axes, "x [m]")
    axes.plot(run["x_m"], 1e3 * (run["z_m"] - run["z_m"][0]), color=INK, linewidth=1.2, label="frame")
    across = maneuver.bump
    if across is not None:
        x = np.linspace(run["x_m"][0], run["x_m"][-1], 1000)
        part = np.clip((x - across.start) / across.length, 0.0, 1.0)
        axes.plot(x, 1e3 * across.height * np.sin(math.pi * part), color=GREY, linewidth=1.2, label="road")
    legend(axes)


def _jolt(axes: Any, run: Run, maneuver: Maneuver) -> None:
    title_of(axes, "vertical acceleration of the frame [m/s²]")
    _under(axes, "x [m]")
    t = run["t_s"]
    axes.plot(run["x_m"], np.gradient(np.gradient(run["z_m"], t), t), color=INK, linewidth=1.0)


_SPECIAL: Final[dict[str, tuple[Panel, Panel]]] = {
    "steady-state-circle": (_understeer, _steering),
    "slow-steer": (_understeer, _steering),
    "step-input": (_step, _roll_rate),
    "sine-with-dwell": (_dwell_rates, _dwell_way),
    "fishhook": (_sides, _roll_rate),
    "braking": (_over_way, _heading),
    "split-braking": (_over_way, _heading),
    "brake-in-turn": (_over_way, _heading),
    "acceleration": (_over_way, _pull),
    "hill-start": (_uphill, _hold),
    "bump": (_over_bump, _jolt),
}
