"""Common style of the pictures of training and evaluation, and files that are whole or not there."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..runs.run_files import write_run_file

INK = "#1f2933"
GREY = "#9aa5b1"
PALE = "#e4e7eb"
_NOTE_SIZE = 7.5
_LETTERS_PER_INCH = 17
"""Of a note."""
_LEGEND_WIDTH = 1.6
"""Of one entry [inch]."""


def new_figure(
    width: float, height: float, title: str = "", note: str = "", *, legend: Sequence[Artist] = ()
) -> Figure:
    """Return a figure without a window, with strips at the top and at the bottom that axes leave free.

    Args:
        width: [inch].
        height: [inch].
        title: the heading, at the left.
        note: small text at the bottom.
        legend: labelled artists, shown in a row below the heading.
    """
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    left, top, bottom = 0.1 / width, 0.0, 0.0
    if title:
        figure.text(left, 1.0 - 0.1 / height, title, va="top", fontsize=12, fontweight="bold", color=INK)
        top += 0.36
    if legend:
        columns = max(1, math.floor(width / _LEGEND_WIDTH))
        figure.legend(
            handles=legend, loc="upper left", bbox_to_anchor=(0.5 * left, 1.0 - (top - 0.06) / height), ncols=columns,
            frameon=False, fontsize=8, labelcolor=INK,
        )  # fmt: skip
        top += 0.1 + 0.18 * math.ceil(len(legend) / columns)
    if note:
        text = textwrap.fill(note, round(_LETTERS_PER_INCH * width), break_on_hyphens=False)
        figure.text(left, 0.08 / height, text, va="bottom", fontsize=_NOTE_SIZE, color=INK)
        bottom += 0.14 + 0.13 * text.count("\n") + 0.1
    free = (0.0, bottom / height, 1.0, 1.0 - (bottom + top) / height)
    figure.set_layout_engine("constrained", rect=free)
    return figure


def style_axes(axes: Any) -> None:
    """Give axes the common look: thin grey frame, small labels."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.tick_params(colors=INK, labelsize=8)


def save_figure(figure: Figure, path: Path, dpi: int = 120) -> None:
    """Write a picture all at once.

    Raises:
        OutputError: the disk did not take it, or its folder is gone.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=dpi, format=path.suffix[1:] or "png")
    write_run_file(path, buffer.getvalue())
