"""Pages of plots of tires, suspensions and steerings on their rigs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from simwarp.core.files import replacing
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, clip_poles, dress, spanned, title_of
from simwarp.vehicle.rigs.steering_rig import SteeringCurve
from simwarp.vehicle.rigs.suspension_curves import SuspensionCurve, SuspensionMotion, SuspensionRun
from simwarp.vehicle.rigs.tire_rig import TireCurves
from simwarp.vehicle.spec.parts import Array

COLORS: Final = (BLUE, ORANGE, "#2b8a3e", "#7048a8", "#946200", "#c2255c")
"""Of the curves of one panel."""
STYLES: Final = ("-", "--", ":", "-.")
LOADED: Final = 6
"""Panel of a suspension's page from which on stops have a part in what is drawn."""
LEAST_SPANS: Final = (0.02, 0.02, 0.02, 0.2, 2.0, 2.0, 0.02, 0.2)
"""Of the axes of a suspension's page, in the units of its panels: less is noise."""
DOTS: Final = 80
"""Per inch, of a picture."""


@contextlib.contextmanager
def plot_page(target: Path, title: str, rows: int, columns: int, size: tuple[float, float]) -> Iterator[Any]:
    """Panels (rows, columns) of a page that is written to a file at the end of the block.

    Raises:
        FileError: the target cannot be written to.
        OutputError: the disk did not take it.
    """
    figure = Figure(figsize=size)
    figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.012, ha="left", fontsize=14, fontweight="bold", color=INK)
    panels = figure.subplots(rows, columns, squeeze=False)
    for axes in panels.flat:
        dress(axes)
    yield panels
    with replacing(target) as draft:
        figure.savefig(draft, dpi=DOTS, format=target.suffix[1:])


def label_axes(axes: Any, title: str, abscissa: str) -> None:
    """Title and abscissa of a panel."""
    title_of(axes, title)
    axes.set_xlabel(abscissa, fontsize=9, color=INK)


def outside_legend(figure: Any, handles: Sequence[Any], columns: int = 6) -> None:
    """One legend of a page, below its panels, where no curve comes."""
    figure.legend(
        handles=list(handles), loc="outside lower left", ncols=columns, frameon=False, fontsize=9, handlelength=2.4
    )  # fmt: skip


def draw_tires(curves: Mapping[str, TireCurves], target: Path, title: str) -> None:
    """Writes a page with tires over each other, at their first inclination and speed: a colour for a tire, a style of
    line for a load, and one legend below.

    Args:
        curves: by the names of the tires.
        target: .png, .pdf or .svg.
        title: the heading.
    """
    first = next(iter(curves.values())).sweep
    shades = dict(zip(curves, COLORS * len(curves), strict=False))
    with plot_page(target, title, 2, 3, (13.0, 8.0)) as panels:
        for name, found in curves.items():
            for number in range(len(found.sweep.loads)):
                style: Any = {"color": shades[name], "linestyle": STYLES[number % len(STYLES)], "linewidth": 1.3}
                _draw_load(panels, found, number, style)
                if len(curves) == 1 or number == len(found.sweep.loads) // 2:
                    _draw_combined(panels[1, 1], found, number, style)
            marks: Any = {"color": shades[name], "marker": "o", "markersize": 4}
            loads = 1e-3 * np.array(found.sweep.loads)
            panels[1, 2].plot(loads, found.peak_driving[:, 0, 0], **marks)
            lateral = 0.5 * (found.peak_left + found.peak_right)[:, 0, 0]
            panels[1, 2].plot(loads, lateral, markerfacecolor="none", **marks)
        label_axes(panels[0, 0], "F_x [kN]", "slip ratio")
        label_axes(panels[0, 1], "F_y [kN]", "slip angle [°]")
        label_axes(panels[0, 2], "M_z [N·m]", "slip angle [°]")
        lean = max(first.inclinations, key=abs)
        if lean != 0.0:
            label_axes(panels[1, 0], f"M_x [N·m] at an inclination of {np.rad2deg(lean):.3g}°", "slip angle [°]")
        else:
            label_axes(panels[1, 0], "M_y [N·m]", "slip ratio")
        spanned(panels[1, 0], 1.0)
        angles = ", ".join(f"{np.rad2deg(a):g}°" for a in first.combined_angles)
        among = "" if len(curves) == 1 else f", F_z {1e-3 * first.loads[len(first.loads) // 2]:.3g} kN"
        label_axes(panels[1, 1], f"F_y [kN] at slip angles of {angles}{among}" if angles else "F_y [kN]", "F_x [kN]")
        label_axes(panels[1, 2], "largest F_x, driving (filled), and F_y (hollow) over F_z", "F_z [kN]")
        handles = [Line2D([], [], color=color, linewidth=3.0, label=name) for name, color in shades.items()]
        handles += [
            Line2D([], [], color=INK, linestyle=STYLES[number % len(STYLES)], label=f"F_z {1e-3 * load:.3g} kN")
            for number, load in enumerate(first.loads)
        ]
        outside_legend(panels[0, 0].figure, handles)


def _draw_load(panels: Any, found: TireCurves, number: int, style: dict[str, Any]) -> None:
    """The curves of one load of a tire."""
    widest = int(np.abs(found.sweep.inclinations).argmax())
    along, across = found.longitudinal[:, number, 0, 0], found.lateral[number, 0, 0]
    angle = np.rad2deg(across.slip_angle)
    panels[0, 0].plot(along.slip_ratio[0], 1e-3 * along.fx[0], **style)
    panels[0, 1].plot(angle, 1e-3 * across.fy, **style)
    panels[0, 2].plot(angle, across.mz, **style)
    leaning = found.lateral[number, widest, 0]
    if found.sweep.inclinations[widest] != 0.0:
        panels[1, 0].plot(np.rad2deg(leaning.slip_angle), leaning.mx, **style)
    else:
        panels[1, 0].plot(along.slip_ratio[0], along.my[0], **style)


def _draw_combined(axes: Any, found: TireCurves, number: int, style: dict[str, Any]) -> None:
    """F_y over F_x of one load of a tire, a curve for each of the slip angles that are held."""
    along = found.longitudinal[:, number, 0, 0]
    for held in range(1, len(along.fx)):
        axes.plot(1e-3 * along.fx[held], 1e-3 * along.fy[held], **style)


def draw_suspension(run: SuspensionRun, target: Path, title: str) -> None:
    """Writes a page with the left wheel of an axle over travel, in parallel and (dashed) opposite travel.

    States in which a spring is in a stop are marked, and the wheel rate without what stops add is beside it. Axes leave
    out what goes beyond all bounds near the end of a linkage's reach, and say so.

    Args:
        run: of a bench.
        target: .png, .pdf or .svg.
        title: the heading.
    """
    with plot_page(target, title, 2, 4, (15.0, 7.6)) as panels:
        every: list[list[Array]] = [[] for _ in range(panels.size)]
        stopped = False
        for motion, style in ((SuspensionMotion.PARALLEL, "-"), (SuspensionMotion.OPPOSITE, "--")):
            curve = run.curves.get(motion)
            if curve is None:
                continue
            travel, stops = 1e3 * curve.travel[:, 0], curve.stop_names(0) != ""
            for number, (axes, value) in enumerate(zip(panels.flat, _suspension_values(curve), strict=True)):
                every[number].append(value)
                axes.plot(travel, value, style, color=BLUE, linewidth=1.3, label=motion.value)
                if number >= LOADED and stops.any():
                    stopped = True
                    axes.plot(travel[stops], value[stops], "o", color=ORANGE, markersize=3, markerfacecolor="none")
            free = 1e-3 * curve.free_wheel_rate[:, 0]
            if stops.any():
                every[-1].append(free)
                panels[1, 3].plot(travel, free, ":", color=INK, linewidth=1.3)
        for axes, text, values, least in zip(panels.flat, _suspension_titles(run), every, LEAST_SPANS, strict=True):
            label_axes(axes, text, "travel of the left wheel [mm]")
            axes.axvline(0.0, color=GREY, linewidth=0.6)
            clip_poles(axes, values, least)
        looks: tuple[tuple[SuspensionMotion, Any], ...] = (
            (SuspensionMotion.PARALLEL, "-"), (SuspensionMotion.OPPOSITE, "--"),
        )  # fmt: skip
        handles = [
            Line2D([], [], color=BLUE, linestyle=style, label=motion.value)
            for motion, style in looks
            if motion in run.curves
        ]
        if stopped:
            handles += [
                Line2D([], [], color=ORANGE, marker="o", markerfacecolor="none", linestyle="", label="in a stop"),
                Line2D([], [], color=INK, linestyle=":", label="wheel rate without stops"),
            ]
        outside_legend(panels[0, 0].figure, handles)


def _suspension_values(curve: SuspensionCurve) -> tuple[Array, ...]:
    """(n,) of each panel."""
    return (
        np.rad2deg(curve.toe[:, 0]), np.rad2deg(curve.camber[:, 0]), np.rad2deg(curve.caster[:, 0]),
        1e3 * curve.track_change, 1e3 * curve.roll_centre[:, 1], 1e2 * curve.anti_dive[:, 0],
        1e-3 * curve.wheel_load[:, 0], 1e-3 * curve.wheel_rate[:, 0],
    )  # fmt: skip


def _suspension_titles(run: SuspensionRun) -> tuple[str, ...]:
    braking = "anti-dive" if run.front else "anti-lift"
    return (
        "toe [°], positive inwards", "camber [°], positive outwards", "caster [°]", "track change [mm]",
        "roll centre above ground [mm]", f"{braking} in braking [%]", "wheel load [kN]", "wheel rate [N/mm]",
    )  # fmt: skip


def draw_steering(curve: SteeringCurve, target: Path, title: str) -> None:
    """Writes a page with the angles of a steered axle's wheels.

    Args:
        curve: from lock to lock.
        target: .png, .pdf or .svg.
        title: the heading.
    """
    with plot_page(target, title, 2, 2, (10.0, 7.6)) as panels:
        handwheel, mean = np.rad2deg(curve.handwheel), np.rad2deg(curve.steer.mean(axis=1))
        for column, (side, color) in enumerate((("left", BLUE), ("right", ORANGE))):
            panels[0, 0].plot(handwheel, np.rad2deg(curve.steer[:, column]), color=color, label=side)
            panels[1, 1].plot(handwheel, np.rad2deg(curve.camber[:, column]), color=color, label=side)
        difference = np.rad2deg(curve.steer[:, 0] - curve.steer[:, 1])
        panels[0, 1].plot(mean, difference, color=BLUE, label="as built")
        panels[0, 1].plot(mean, np.rad2deg(curve.ackermann_difference), ":", color=INK, label="Ackermann")
        panels[1, 0].plot(handwheel, curve.ratio, color=BLUE)
        label_axes(panels[0, 0], "angle of the wheels [°]", "handwheel [°], positive to the left")
        label_axes(panels[0, 1], "inner less outer wheel [°]", "mean angle of the wheels [°]")
        label_axes(panels[1, 0], "handwheel per mean angle of the wheels", "handwheel [°]")
        label_axes(panels[1, 1], "camber [°], positive outwards", "handwheel [°]")
        for axes in (panels[0, 0], panels[0, 1], panels[1, 1]):
            axes.legend(frameon=False, fontsize=8)
