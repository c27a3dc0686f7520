"""Colours and axes that the plots of runs share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

INK: Final = "#1f2933"
GREY: Final = "#9aa5b1"
BLUE: Final = "#0b6e99"
ORANGE: Final = "#b8470f"
SIDE_COLORS: Final = {"L": BLUE, "R": ORANGE}
SIDE_NAMES: Final = {"L": "left", "R": "right"}
MOST_WIDTHS: Final = 5.0
"""Of the middle half of a curve's values that an axis shows beyond it. About zero a square reaches 0.9 of it, a cubic
3.5, a pole at an end any number.
"""
MARGIN: Final = 0.05
"""Of an axis that is cut, at either end."""


def dress(axes: Any) -> None:
    """The frame and grid of a panel."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.tick_params(colors=INK, labelsize=9)
    axes.grid(alpha=0.3, linewidth=0.5)


def title_of(axes: Any, text: str) -> None:
    """The title of a panel."""
    axes.set_title(text, loc="left", fontsize=10, color=INK)


def legend(axes: Any) -> None:
    """Above the panel, beside its title, where no curve comes."""
    count = len(axes.get_legend_handles_labels()[0])
    axes.legend(
        frameon=False, fontsize=8, ncols=count, columnspacing=1.0, handlelength=1.2, loc="lower right",
        bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0,
    )  # fmt: skip


def sane_range(values: npt.ArrayLike) -> tuple[float, float]:
    """Smallest and largest value of a curve without the poles at its ends; (0, 0) of a curve without values.

    The middle half of the values (between their quartiles) spans a width; values count as far as `MOST_WIDTHS` of it
    beyond. Values that are all alike, or none, keep all.

    Args:
        values: of one curve; those that are not finite do not count.
    """
    known = np.asarray(values, np.float64).ravel()
    known = known[np.isfinite(known)]
    if len(known) == 0:
        return 0.0, 0.0
    lower, upper = np.quantile(known, (0.25, 0.75)).tolist()
    reach = MOST_WIDTHS * (upper - lower)
    if reach > 0.0:
        known = known[(known >= lower - reach) & (known <= upper + reach)]
    return float(known.min()), float(known.max())


def clip_poles(axes: Any, curves: Sequence[npt.ArrayLike], least: float) -> None:
    """Scale a panel to the sane ranges of its curves, and say above it what lies outside.

    Args:
        axes: the panel, with its curves.
        curves: values of each of them.
        least: smallest span of the axis, so that it does not magnify noise.
    """
    known = [np.asarray(values, np.float64).ravel() for values in curves]
    known = [values[np.isfinite(values)] for values in known if np.isfinite(values).any()]
    if not known:
        return
    lows, highs = zip(*(sane_range(values) for values in known), strict=True)
    every, low, high = np.concatenate(known), min(lows), max(highs)
    if high - low < least:
        axes.set_ylim(0.5 * (low + high - least), 0.5 * (low + high + least))
        return
    outside = every[(every < low) | (every > high)]
    if len(outside) == 0:
        return
    room = MARGIN * (high - low)
    axes.set_ylim(low - room, high + room)
    farthest = float(outside[np.abs(outside - 0.5 * (low + high)).argmax()])
    axes.text(
        1.0, 1.01, f"{len(outside)} of {len(every)} points cut off, to {farthest:.3g}", transform=axes.transAxes,
        fontsize=7, color=ORANGE, ha="right",
    )  # fmt: skip


def spanned(axes: Any, size: float) -> None:
    """No magnified noise: the axis spans zero and a least size to either side, with room beside a curve far from it."""
    low, high = axes.get_ylim()
    room = MARGIN * (max(high, size) - min(low, -size))
    axes.set_ylim(low - room if low < -size else -size, high + room if high > size else size)
