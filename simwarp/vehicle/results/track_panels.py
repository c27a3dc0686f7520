"""Panels of the page of a run on tracks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.plot_style import INK, SIDE_COLORS, SIDE_NAMES, legend, title_of
from simwarp.vehicle.results.track_readings import MOST_ARMS

ARM_SHADES: Final = (1.0, 0.4)
"""Opacity of the front and of the rear arm."""


def _both(axes: Any, run: Run, name: str, scale: float = 1.0) -> None:
    """A column of the left and the right side."""
    for side, colour in SIDE_COLORS.items():
        values = scale * run[name.format(side)]
        axes.plot(run["t_s"], values, color=colour, linewidth=1.0, label=SIDE_NAMES[side])


def _within(axes: Any, run: Run, curves: Iterable[Any], least: float, *, zero: bool = True) -> None:
    """The drop onto the ground before t = 0 would flatten all that follows: the axis spans what comes then."""
    late = run["t_s"] >= min(0.0, float(run["t_s"][-1]))
    values = np.concatenate([curve[late] for curve in curves])
    low, high = float(values.min()), float(values.max())
    if zero:
        low, high = min(low, -least), max(high, least)
    axes.set_ylim(low - 0.1 * (high - low) - 1e-9, high + 0.1 * (high - low) + 1e-9)


def track_speeds(axes: Any, run: Run) -> None:
    """Of the vehicle and of both tracks."""
    title_of(axes, "speed of the vehicle and of its tracks [m/s]")
    _both(axes, run, "track_speed_{}_mps")
    axes.plot(run["t_s"], run["speed_mps"], color=INK, linewidth=1.4, label="vehicle")
    curves = [run[name] for name in ("speed_mps", "track_speed_L_mps", "track_speed_R_mps")]
    _within(axes, run, curves, 0.05)
    legend(axes)


def tensions(axes: Any, run: Run) -> None:
    """Of the two runs around the idlers."""
    title_of(axes, "tension at the idlers [kN]")
    _both(axes, run, "tension_{}_N", 1e-3)
    _within(axes, run, [1e-3 * run[f"tension_{side}_N"] for side in SIDE_COLORS], 1.0)
    low, high = axes.get_ylim()
    axes.set_ylim(min(0.0, low) if low < -2.0 else 0.0, high)
    legend(axes)


def arms(axes: Any, run: Run) -> None:
    """Angles of all arms, the front ones darkest."""
    title_of(axes, "arms, positive with the wheel up [deg]; front ones dark")
    curves = []
    for side, colour in SIDE_COLORS.items():
        names = [name for name in (f"arm_{side}{k}_rad" for k in range(MOST_ARMS)) if name in run.columns]
        for k, name in enumerate(names):
            shade = np.interp(k, (0, max(len(names) - 1, 1)), ARM_SHADES)
            curves.append(np.degrees(run[name]))
            label = SIDE_NAMES[side] if k == 0 else None
            axes.plot(run["t_s"], curves[-1], color=colour, alpha=float(shade), linewidth=1.0, label=label)
    _within(axes, run, curves, 1.0)
    legend(axes)


def ground_or_pins(axes: Any, run: Run) -> None:
    """Greatest force of a pin; without records of pins, the ground's force."""
    if "pin_max_L_N" in run.columns:
        title_of(axes, "pins, mean and greatest force [kN]")
        _both(axes, run, "pin_mean_{}_N", 1e-3)
        for side, colour in SIDE_COLORS.items():
            axes.plot(run["t_s"], 1e-3 * run[f"pin_max_{side}_N"], color=colour, alpha=0.4, linewidth=0.6)
        _within(axes, run, [1e-3 * run[f"pin_max_{side}_N"] for side in SIDE_COLORS], 1.0)
        axes.set_ylim(0.0, axes.get_ylim()[1])
    else:
        title_of(axes, "force of the ground [kN]")
        for name, label, colour in (("ground_z_N", "up", INK), ("ground_x_N", "along x", SIDE_COLORS["L"])):
            axes.plot(run["t_s"], 1e-3 * run[name], color=colour, linewidth=1.0, label=label)
        _within(axes, run, [1e-3 * run["ground_z_N"], 1e-3 * run["ground_x_N"]], 1.0)
    legend(axes)
