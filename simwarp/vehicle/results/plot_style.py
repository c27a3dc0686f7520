"""Colours and axes that the plots of runs share."""

from __future__ import annotations

from typing import Any, Final

INK: Final = "#1f2933"
GREY: Final = "#9aa5b1"
BLUE: Final = "#0b6e99"
ORANGE: Final = "#b8470f"
SIDE_COLORS: Final = {"L": BLUE, "R": ORANGE}
SIDE_NAMES: Final = {"L": "left", "R": "right"}


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


def spanned(axes: Any, size: float) -> None:
    """No magnified noise: the axis spans zero and a least size to either side."""
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -size), max(high, size))
