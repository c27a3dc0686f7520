"""What the pictures of training and evaluation share: one look, and files that are whole or not there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK = "#1f2933"
GREY = "#9aa5b1"
PALE = "#e4e7eb"


def new_figure(width: float, height: float, title: str = "", note: str = "") -> Figure:
    """Return a figure without a window.

    Args:
        width: [inch].
        height: [inch].
        title: the heading, at the left.
        note: one small line at the bottom.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold", color=INK)
    if note:
        figure.supxlabel(note, x=0.01, ha="left", fontsize=7.5, color=INK)
    return figure


def dress(axes: Any) -> None:
    """Give axes the common look: thin grey frame, small labels."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.tick_params(colors=INK, labelsize=8)


def save_figure(figure: Figure, path: Path, dpi: int = 120) -> None:
    """Write a picture all at once."""
    # The suffix tells matplotlib the format: a temporary name must keep it
    temporary = path.with_name(f".{path.stem}.new{path.suffix}")
    try:
        figure.savefig(temporary, dpi=dpi)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
