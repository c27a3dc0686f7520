"""Pictures side by side, with words on them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from simwarp.core.files import write_file

Picture = npt.NDArray[np.uint8]

PAPER = (250, 250, 250)
INK = (30, 30, 30)


def write_image(path: Path, picture: Picture) -> None:
    """Writes a PNG, or a JPEG where the file's name does not end in .png.

    Raises:
        OutputError: the disk did not take it.
    """
    kind: dict[str, Any] = {"format": "png", "optimize": True}
    if path.suffix.lower() != ".png":
        kind = {"format": "jpeg", "quality": 88}
    content = io.BytesIO()
    Image.fromarray(picture).save(content, **kind)
    write_file(path, content.getvalue())


def grid(pictures: Sequence[Picture], columns: int, *, gap: int = 4) -> Picture:
    """(height, width, 3) pictures of one size in rows from the left, on paper; sides are even, as videos want them."""
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // columns)
    size = [rows * (height + gap) + gap, columns * (width + gap) + gap]
    sheet = np.full((size[0] + size[0] % 2, size[1] + size[1] % 2, 3), PAPER, np.uint8)
    for index, picture in enumerate(pictures):
        top = gap + (index // columns) * (height + gap)
        left = gap + (index % columns) * (width + gap)
        sheet[top : top + height, left : left + width] = picture
    return sheet


def caption(picture: Picture, text: str, *, size: int = 14) -> Picture:
    """A picture, (height, width, 3) uint8, below a line of text on paper; returns one with more rows.

    Args:
        picture: (height, width, 3) uint8 sRGB.
        text: one line.
        size: of the letters [pixels].
    """
    band = 2 * ((size + 10) // 2)
    strip = Image.new("RGB", (picture.shape[1], band), PAPER)
    ImageDraw.Draw(strip).text((6, band // 2), text, fill=INK, font=ImageFont.load_default(size), anchor="lm")
    return np.concatenate([np.asarray(strip, dtype=np.uint8), picture])


def label(picture: Picture, text: str, *, size: int = 11) -> Picture:
    """The picture with white words in its upper left corner, in a dark outline."""
    image = Image.fromarray(picture)
    ImageDraw.Draw(image).text(
        (5, 3), text, fill=(255, 255, 255), font=ImageFont.load_default(size), stroke_width=1, stroke_fill=INK
    )
    return np.asarray(image, dtype=np.uint8)
