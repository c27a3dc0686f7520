"""A recorded run as one page: motion, tires or tracks, powertrain, inputs, and the way seen from above."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simwarp.core.files import replacing
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.paths import Path
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.maneuver_panels import draw_lanes, draw_special, has_special
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, legend, spanned, title_of
from simwarp.vehicle.results.results import ON_TRACKS
from simwarp.vehicle.results.run_result import Result
from simwarp.vehicle.results.track_panels import arms, ground_or_pins, tensions, track_speeds

WHEELS: Final = {"FL": BLUE, "FR": "#5bb5d5", "RL": ORANGE, "RR": "#f0a35e"}
"""Front wheels blue, rear ones orange; the left ones darker."""
DPI: Final = 120
LINE: Final = 120
"""Characters of results side by side."""
NAMES: Final = {"FL": "front left", "FR": "front right", "RL": "rear left", "RR": "rear right"}


def draw_run(
    run: Run, target: FilePath, title: str, results: Iterable[Result] = (), path: Path | None = None,
    maneuver: Maneuver | None = None, verdicts: Iterable[Verdict] = (),
) -> None:  # fmt: skip
    """Writes a picture in the format of the file's suffix.

    Args:
        run: recorded channels.
        target: .png, .pdf or .svg.
        title: the heading; empty: none.
        results: numbers told below it.
        path: that the vehicle should follow.
        maneuver: that was driven, whose cones and panels of its own are drawn, too.
        verdicts: told behind the results.

    Raises:
        FileError: the target cannot be written to.
        OutputError: the disk did not take it.
    """
    figure = run_figure(run, title, results, path, maneuver, verdicts)
    with replacing(target) as draft:
        figure.savefig(draft, dpi=DPI)


def run_figure(
    run: Run, title: str, results: Iterable[Result] = (), path: Path | None = None, maneuver: Maneuver | None = None,
    verdicts: Iterable[Verdict] = (),
) -> Figure:  # fmt: skip
    """The page of `draw_run`, not written."""
    special = maneuver is not None and has_special(maneuver)
    round_way = is_round(run) and (maneuver is None or maneuver.course is None)
    figure = Figure(figsize=(12.0, 13.0 if special or round_way else 11.0))
    figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title, x=0.012, ha="left", fontsize=16, fontweight="bold", color=INK)
    told = [f"{item.label} {item.value_text} {item.unit_text}".rstrip() for item in results]
    told += [f"{item.rule} {item.value_text} {item.unit}: {'pass' if item.passed else 'FAIL'}" for item in verdicts]
    lines = joined(told)
    heights = [0.01 + 0.13 * len(lines), 1, 1, 1, 1, *([1.3] if special else []), 1.5]
    if round_way:
        # a way that is as wide as long fills one column; panels of the manoeuvre stand beside it
        heights[5:] = [1.6, 1.6] if special else [3.2]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    note = figure.add_subplot(grid[0, :])
    note.axis("off")
    note.text(0.0, 1.0, "\n".join(lines), fontsize=10, color=INK, va="top", linespacing=1.6)
    first: Any = None
    panels = _TRACK_PANELS if ON_TRACKS in run.columns else _PANELS
    for index, draw in enumerate(panels):
        axes = figure.add_subplot(grid[1 + index // 2, index % 2], sharex=first)
        first = axes if first is None else first
        dress(axes)
        draw(axes, run)
        if index >= len(panels) - 2:
            axes.set_xlabel("time [s]", fontsize=9, color=INK)
    first.set_xlim(run["t_s"][0], max(run["t_s"][-1], run["t_s"][0] + 0.01))
    above = figure.add_subplot(grid[5:, 0] if round_way and special else grid[-1, :])
    dress(above)
    if maneuver is not None and maneuver.course is not None:
        title_of(above, f"cones of {maneuver.course.standard} and the vehicle's outline, from above [m]")
        draw_lanes(above, run, maneuver.course)
    else:
        _draw_way(above, run, path)
    if maneuver is not None and special:
        draw_special(figure, (grid[5, 1], grid[6, 1]) if round_way else (grid[5, 0], grid[5, 1]), run, maneuver)
    return figure


def joined(told: Iterable[str]) -> list[str]:
    """Lines of a page's width, of whole results."""
    lines: list[str] = []
    for text in told:
        longer = f"{lines[-1]}   ·   {text}" if lines else text
        if lines and len(longer) <= LINE:
            lines[-1] = longer
        else:
            lines.append(text)
    return lines


def _speed(axes: Any, run: Run) -> None:
    title_of(axes, "speed [m/s]")
    axes.plot(run["t_s"], run["speed_mps"], color=INK, linewidth=1.4)
    spanned(axes, 0.05)


def _yaw_rate(axes: Any, run: Run) -> None:
    title_of(axes, "yaw rate [rad/s]")
    axes.plot(run["t_s"], run["yawrate_radps"], color=INK, linewidth=1.2)
    spanned(axes, 0.01)


def _lateral(axes: Any, run: Run) -> None:
    title_of(axes, "lateral acceleration [m/s²]")
    t = run["t_s"]
    axes.plot(t, run["latacc_com_mps2"], color=GREY, linewidth=0.8, label="of the centre of mass")
    axes.plot(t, run["v_times_yawrate_mps2"], color=INK, linewidth=1.2, label="speed x yaw rate")
    calm = np.concatenate([run[name][t >= 0.0] for name in ("latacc_com_mps2", "v_times_yawrate_mps2")])
    if calm.size:
        # the drop onto the ground before t = 0 would flatten all that follows
        low, high = min(-0.05, float(calm.min())), max(0.05, float(calm.max()))
        axes.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
    legend(axes)


def _loads(axes: Any, run: Run) -> None:
    title_of(axes, "wheel loads [kN]" if run["Fz_FL_N"].max() > 1e3 else "wheel loads [N]")
    scale = 1e-3 if run["Fz_FL_N"].max() > 1e3 else 1.0
    for wheel, colour in WHEELS.items():
        axes.plot(run["t_s"], scale * run[f"Fz_{wheel}_N"], color=colour, linewidth=1.0, label=NAMES[wheel])
    late = run["t_s"] >= min(0.0, run["t_s"][-1])
    top = max(float(run[f"Fz_{wheel}_N"][late].max()) for wheel in WHEELS)
    axes.set_ylim(0.0, max(1.15 * scale * top, 1e-3))
    legend(axes)


def _wheels(axes: Any, run: Run) -> None:
    title_of(axes, "wheel speeds [rad/s]")
    for wheel, colour in WHEELS.items():
        axes.plot(run["t_s"], run[f"omega_{wheel}_radps"], color=colour, linewidth=1.0, label=NAMES[wheel])
    spanned(axes, 0.1)


def _engine(axes: Any, run: Run) -> None:
    title_of(axes, "engine [rad/s], and gear")
    axes.plot(run["t_s"], run["engine_radps"], color=INK, linewidth=1.2)
    spanned(axes, 1.0)
    gears = axes.twinx()
    gears.spines[["top", "left"]].set_visible(False)
    gears.spines[["right", "bottom"]].set_color(GREY)
    gears.step(run["t_s"], run["gear"], color=WHEELS["RL"], linewidth=1.2, where="post")
    gears.set_ylim(min(-0.2, run["gear"].min() - 0.2), max(3.0, run["gear"].max()) + 0.5)
    gears.set_yticks(range(int(min(0, run["gear"].min())), int(max(3, run["gear"].max())) + 1))
    gears.tick_params(colors=WHEELS["RL"], labelsize=9)


def _inputs(axes: Any, run: Run) -> None:
    title_of(axes, "inputs")
    for name, label, colour in (
        ("steer", "steering", INK), ("throttle", "throttle", WHEELS["FL"]), ("brake", "brake", WHEELS["RL"]),
    ):  # fmt: skip
        axes.plot(run["t_s"], run[name], color=colour, linewidth=1.2, label=label)
    axes.set_ylim(min(-0.1, 1.1 * run["steer"].min()), 1.1)
    legend(axes)


def _attitude(axes: Any, run: Run) -> None:
    title_of(axes, "pitch (nose down) and roll (to the right) [deg]")
    late = run["t_s"] >= min(0.0, run["t_s"][-1])
    for name, label, colour in (("pitch_rad", "pitch", WHEELS["FL"]), ("roll_rad", "roll", WHEELS["RL"])):
        axes.plot(run["t_s"], np.degrees(run[name]), color=colour, linewidth=1.2, label=label)
    both = np.degrees(np.concatenate([run["pitch_rad"][late], run["roll_rad"][late]]))
    low, high = min(-0.1, float(both.min())), max(0.1, float(both.max()))
    axes.set_ylim(low - 0.15 * (high - low), high + 0.15 * (high - low))
    legend(axes)


_PANELS: Final = (_speed, _yaw_rate, _lateral, _loads, _wheels, _engine, _inputs, _attitude)
_TRACK_PANELS: Final = (track_speeds, _yaw_rate, tensions, ground_or_pins, arms, _engine, _inputs, _attitude)


ROUND: Final = 0.4
"""Breadth over length from which on a way from above is drawn in a panel of its own shape."""


def is_round(run: Run) -> bool:
    """Whether the way from above is about as broad as long, such as a circle."""
    sizes = sorted(float(np.ptp(run[name])) for name in ("x_m", "y_m"))
    return sizes[0] > ROUND * sizes[1]


def _draw_way(axes: Any, run: Run, path: Path | None) -> None:
    title_of(axes, f"way{'' if is_round(run) else ' from above'} [m], a mark every second")
    x, y = run["x_m"], run["y_m"]
    width = max(float(np.ptp(x)), float(np.ptp(y)), 1.0)
    if path is not None:
        near = (path.points[:, 0] > x.min() - 0.05 * width) & (path.points[:, 0] < x.max() + 0.05 * width)
        # what is left out leaves a gap, and no chord across it
        axes.plot(*np.where(near[:, None], path.points, np.nan).T, color=GREY, linewidth=3.0, alpha=0.6, label="path")
        legend(axes)
    axes.plot(x, y, color=INK, linewidth=1.4)
    axes.plot(x[::100], y[::100], ".", color=WHEELS["RL"], markersize=4.0)
    # a straight run stays a line of readable height: its sideways drift is centimetres
    if is_round(run):
        axes.set_aspect("equal", adjustable="box")
    elif float(np.ptp(y)) > 0.04 * width:
        axes.set_aspect("equal", adjustable="datalim")
    else:
        axes.set_ylim(float(y.mean()) - 0.04 * width, float(y.mean()) + 0.04 * width)
        if float(np.ptp(x)) < width:
            axes.set_xlim(float(x.mean()) - 0.5 * width, float(x.mean()) + 0.5 * width)
    axes.set_xlabel("x [m]", fontsize=9, color=INK)
