"""Pages of plots of whole vehicles on posts and tilt tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.ticker import LogLocator

from simwarp.vehicle.results.plot_style import GREY, INK
from simwarp.vehicle.rigs.four_post import FourPostResponse, PostMode, RoadResponse
from simwarp.vehicle.rigs.rig_plots import COLORS, STYLES, label_axes, plot_page
from simwarp.vehicle.rigs.tilt_table import TiltTable


def draw_responses(response: FourPostResponse, target: Path, title: str) -> None:
    """Writes a page of transfer functions over the frequency, a colour for a mode.

    Args:
        response: of a four-post rig.
        target: .png, .pdf or .svg.
        title: the heading.
    """
    with plot_page(target, title, 2, 2, (11.0, 7.6)) as panels:
        for mode, color in zip(response.sweep.modes, COLORS, strict=False):
            chosen = response.of(mode)
            frequency = response.frequency[chosen]
            turn = response.roll if mode is PostMode.ROLL else response.pitch
            if mode is not PostMode.ROLL:  # a vehicle that rolls does not heave but for its asymmetry
                panels[0, 0].loglog(frequency, np.abs(response.heave[chosen]), color=color, label=mode.value)
            panels[0, 1].loglog(frequency, np.abs(turn[chosen]), color=color, label=mode.value)
            wheels = range(0, response.load.shape[1], 2)
            for wheel, style in zip(wheels, STYLES * len(wheels), strict=False):
                label = f"{mode.value}, axle {wheel // 2}"
                load, travel = 1e-3 * np.abs(response.load[chosen, wheel]), np.abs(response.travel[chosen, wheel])
                panels[1, 0].semilogx(frequency, load, style, color=color, label=label)
                panels[1, 1].semilogx(frequency, travel, style, color=color, label=label)
        angles = "pitch, in roll: roll" if PostMode.ROLL in response.sweep.modes else "pitch"
        label_axes(panels[0, 0], "heave of the chassis per motion of the posts", "frequency [Hz]")
        label_axes(panels[0, 1], f"{angles} of the chassis per motion of the posts [rad/m]", "frequency [Hz]")
        label_axes(panels[1, 0], "wheel load per motion of the posts [kN/m], left wheels", "frequency [Hz]")
        label_axes(panels[1, 1], "suspension travel per motion of the posts, left wheels", "frequency [Hz]")
        for axes in panels.flat:
            if axes.lines:
                axes.legend(frameon=False, fontsize=8)


def draw_roads(response: RoadResponse, target: Path, title: str) -> None:
    """Writes a page of what roads of all classes do, a mark for a speed.

    Args:
        response: of a four-post rig.
        target: .png, .pdf or .svg.
        title: the heading.
    """
    with plot_page(target, title, 1, 3, (12.0, 4.0)) as panels:
        names = np.array([road.value for road in response.roads])
        for speed, color in zip(dict.fromkeys(response.speed.tolist()), COLORS * len(names), strict=False):
            chosen = response.speed == speed
            values = (
                response.acceleration[chosen], response.load_variation[chosen].max(axis=1),
                1e3 * response.travel[chosen].max(axis=1),
            )  # fmt: skip
            for axes, value in zip(panels[0], values, strict=True):
                axes.semilogy(names[chosen], value, "o-", color=color, label=f"{speed:g} m/s")
        for axes in panels[0]:
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
            axes.yaxis.set_minor_formatter("{x:g}")
            axes.tick_params(axis="y", which="minor", labelsize=7, colors=INK)
        label_axes(panels[0, 0], "rms heave acceleration [m/s²]", "road class")
        label_axes(panels[0, 1], "rms of the wheel load over its mean, worst wheel", "road class")
        label_axes(panels[0, 2], "rms suspension travel [mm], worst wheel", "road class")
        panels[0, 0].legend(frameon=False, fontsize=8)


def draw_tilt(table: TiltTable, target: Path, title: str) -> None:
    """Writes a plot of the wheel loads over the angle of a tilt table.

    Args:
        table: that was run.
        target: .png, .pdf or .svg.
        title: the heading.
    """
    with plot_page(target, title, 1, 1, (8.0, 5.0)) as panels:
        axes, angle = panels[0, 0], np.rad2deg(table.angle)
        for wheel in range(table.load.shape[1]):
            side, style = ("left", "-") if wheel % 2 == 0 else ("right", "--")
            axes.plot(
                angle, 1e-3 * table.load[:, wheel], style, marker="o", markersize=3,
                color=COLORS[wheel // 2 % len(COLORS)], label=f"axle {wheel // 2}, {side}",
            )  # fmt: skip
        axes.axvline(np.rad2deg(table.rigid_angle), color=GREY, linestyle=":", label="rigid vehicle: track / 2 height")
        if np.isfinite(table.lift_angle):
            axes.axvline(np.rad2deg(table.lift_angle), color=INK, linewidth=0.8, label="first wheel lifts")
        label_axes(axes, "wheel loads [kN], the left side raised", "angle of the table [°]")
        axes.legend(frameon=False, fontsize=8)
