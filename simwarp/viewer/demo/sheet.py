"""A contact sheet: pictures with captions, colour bars and legends on a grid of cells."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.colors import Normalize
from PIL import Image, ImageDraw, ImageFont

Picture = npt.NDArray[np.uint8]
Color = tuple[int, int, int]

CAPTION: Final = 22
GAP: Final = 10
MARGIN: Final = 16
HEAD: Final = 58
PAPER: Final = (250, 250, 249)
INK: Final = (31, 41, 51)
GREY: Final = (110, 120, 131)
LINE: Final = 15
"""From line to line of the note of a sheet [pixels]."""
SMALLEST: Final = 7
"""Letters that can still be read [pixels]."""
BLANK: Final = (24, 27, 32)
"""Colour of pixels without a measurement."""


@dataclasses.dataclass(frozen=True)
class Bar:
    """A colour bar: a map of Matplotlib's from `low` to `high`, in a unit."""

    colors: str
    low: float
    high: float
    unit: str

    def paint(self, values: npt.NDArray[Any], seen: npt.NDArray[np.bool_] | None = None) -> Picture:
        """(..., 3) colours of values; what is not seen is `BLANK`."""
        shares = Normalize(self.low, self.high, clip=True)(np.asarray(values, dtype=np.float64))
        colors = np.asarray(matplotlib.colormaps[self.colors](shares))[..., :3]
        painted = np.round(255.0 * colors).astype(np.uint8)
        return painted if seen is None else np.where(seen[..., None], painted, np.array(BLANK, np.uint8))


@dataclasses.dataclass(frozen=True)
class Panel:
    """A picture in the sheet.

    Attributes:
        title: of the content; in bold.
        note: units, numbers; in grey behind the title.
        image: (height, width, 3).
        bar: of its colours, at the right end of the caption.
        legend: names of colours, at the lower edge of the picture.
    """

    title: str
    note: str
    image: Picture
    bar: Bar | None = None
    legend: Sequence[tuple[str, Color]] = ()


def font(size: int, bold: bool = False) -> Any:
    """DejaVu Sans, which Matplotlib brings along."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def fitted(text: str, width: float, size: int, bold: bool = False) -> Any:
    """The largest font of at most a `size` in which a text is no wider than `width` [pixels]; at least `SMALLEST`."""
    while size > SMALLEST and font(size, bold).getlength(text) > width:
        size -= 1
    return font(size, bold)


def wrapped(text: str, width: float, letters: Any) -> list[str]:
    """A text in lines that are no wider than `width` [pixels], where no word is wider."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and letters.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


class Sheet:
    """Paper for panels.

    Args:
        panel: width of a cell [pixels].
        heights: of the pictures in the rows [pixels].
        columns: cells of a row.
        title, note: of the sheet; the note takes as many lines as it needs.

    Attributes:
        head: height of what is above the first row [pixels].
    """

    def __init__(self, panel: int, heights: Sequence[int], columns: int, title: str, note: str) -> None:
        self.panel, self.heights = panel, tuple(heights)
        steps = [height + CAPTION + GAP for height in heights]
        width = columns * panel + (columns - 1) * GAP
        lines = wrapped(note, width, font(11))
        self.head = HEAD + (len(lines) - 1) * LINE
        self._tops = [self.head + sum(steps[:row]) for row in range(len(steps))]
        size = (2 * MARGIN + width, self.head + sum(steps) - GAP + MARGIN)
        self._paper = Image.new("RGB", size, PAPER)
        draw = ImageDraw.Draw(self._paper)
        draw.text((MARGIN, 20), title, fill=INK, font=fitted(title, width, 19, bold=True), anchor="lm")
        for index, line in enumerate(lines):
            draw.text((MARGIN, 43 + index * LINE), line, fill=GREY, font=font(11), anchor="lm")

    def width(self, cells: int) -> int:
        """Of a panel over several cells [pixels]."""
        return cells * self.panel + (cells - 1) * GAP

    def height(self, row: int, cells: int = 1) -> int:
        """Of the picture of a panel over several rows [pixels]."""
        return sum(self.heights[row : row + cells]) + (cells - 1) * (CAPTION + GAP)

    def put(self, row: int, column: int, panel: Panel, down: int = 0) -> None:
        """A panel whose upper left corner is in a cell, `down` pixels below its top."""
        left, top = MARGIN + column * (self.panel + GAP), self._tops[row] + down
        draw = ImageDraw.Draw(self._paper)
        plain = font(11)
        middle = top + CAPTION // 2
        right = left + panel.image.shape[1]
        if panel.bar is not None:
            right = self._bar(draw, panel.bar, right, middle)
        bold = fitted(panel.title, right - left - 1, 12, bold=True)
        draw.text((left + 1, middle), panel.title, fill=INK, font=bold, anchor="lm")
        room = left + 1 + draw.textlength(panel.title, font=bold) + 7
        if room + draw.textlength(panel.note, font=plain) <= right:
            draw.text((room, middle), panel.note, fill=GREY, font=plain, anchor="lm")
        image = Image.fromarray(panel.image)
        if panel.legend:
            _legend(image, panel.legend)
        self._paper.paste(image, (left, top + CAPTION))

    def _bar(self, draw: Any, bar: Bar, right: int, middle: int) -> int:
        """Draws a colour bar that ends at `right`; returns where it begins."""
        plain, length = font(10), min(64, self.panel // 5)
        ends = f"{bar.low:g}", f"{bar.high:g} {bar.unit}"
        after = right - draw.textlength(ends[1], font=plain)
        draw.text((after, middle), ends[1], fill=INK, font=plain, anchor="lm")
        colors = bar.paint(np.linspace(bar.low, bar.high, length))
        start = round(after) - 4 - length
        self._paper.paste(Image.fromarray(np.repeat(colors[None], 9, axis=0)), (start, middle - 4))
        before = start - 4 - draw.textlength(ends[0], font=plain)
        draw.text((before, middle), ends[0], fill=INK, font=plain, anchor="lm")
        return round(before) - 6

    def picture(self) -> Picture:
        """(height, width, 3)."""
        return np.asarray(self._paper, dtype=np.uint8)

    def save(self, file: Path) -> None:
        """Writes a PNG."""
        self._paper.save(file, optimize=True)


def _legend(image: Any, entries: Sequence[tuple[str, Color]]) -> None:
    """Squares with names along the lower edge of a picture, in as many lines as they take."""
    draw, plain = ImageDraw.Draw(image), font(10)
    lines: list[list[tuple[str, Color, float]]] = [[]]
    x = 5.0
    for name, color in entries:
        step = 13 + draw.textlength(name, font=plain) + 8
        if x + step > image.width and lines[-1]:
            lines.append([])
            x = 5.0
        lines[-1].append((name, color, x))
        x += step
    top = image.height - 14 * len(lines) - 3
    draw.rectangle((0, top, image.width, image.height), fill=BLANK)
    for index, line in enumerate(lines):
        middle = top + 8 + 14 * index
        for name, color, left in line:
            draw.rectangle((left, middle - 4, left + 8, middle + 4), fill=color)
            draw.text((left + 13, middle), name, fill=(235, 235, 235), font=plain, anchor="lm")
