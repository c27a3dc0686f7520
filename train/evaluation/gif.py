"""Videos as GIF that are small enough to be sent."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

MOST_BYTES: Final = 2_000_000
"""Of a GIF of up to five seconds; a longer one may have as much more as it is longer."""
_SECONDS = 5.0
_PALETTE_FRAMES = 8
_HOPE = 0.92
"""Share of the size that a smaller picture is made for: bytes do not go exactly with pixels."""
_SMALLEST = 32
"""Width at which nothing is made smaller any more [pixels]."""

Images = Sequence[npt.NDArray[np.uint8]]


def gif_of(images: Images, rate: float) -> bytes:
    """Bytes of a GIF that repeats: every second image is left out, and then all get smaller, where it is too large.

    Args:
        images: (height, width, 3) each, of one size.
        rate: images per second.
    """
    most = MOST_BYTES * max(1.0, len(images) / rate / _SECONDS)
    made = _encoded(images, rate)
    if len(made) > most and len(images) > 2:
        images, rate = images[::2], 0.5 * rate
        made = _encoded(images, rate)
    shapes = images
    scale = 1.0
    while len(made) > most and images[0].shape[1] > _SMALLEST:
        scale *= min(0.95, _HOPE * math.sqrt(most / len(made)))
        images = [_smaller(image, scale) for image in shapes]
        made = _encoded(images, rate)
    return made


def _smaller(image: npt.NDArray[np.uint8], scale: float) -> npt.NDArray[np.uint8]:
    height, width = image.shape[:2]
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS), dtype=np.uint8)


def _encoded(images: Images, rate: float) -> bytes:
    # One palette for all images keeps a GIF of flat colours small; what comes into sight later has its colours in it
    some = np.unique(np.linspace(0, len(images) - 1, _PALETTE_FRAMES).round().astype(int))
    palette = Image.fromarray(np.concatenate([images[index] for index in some])).quantize(256)
    first, *rest = [Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    video = io.BytesIO()
    first.save(video, format="gif", save_all=True, append_images=rest, duration=round(1000.0 / rate), loop=0)
    return video.getvalue()
