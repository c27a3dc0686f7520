"""Textures as a page has them: a picture that repeats, and where its corners lie on a surface."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.geometry.visual_mesh import srgb_from_linear
from simwarp.sensors.cameras.appearance import CheckerTexture, ImageTexture, Texture

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]

CELL: Final = 32
"""Pixels along a square of a checker: its borders are sharp."""
BAKED: Final = 1024
"""Most pixels along a side of a noise's picture."""
FINEST: Final = 16
"""Of these along the side of one of its largest patches."""
OCTAVES: Final = 4
"""Of a noise, as rays see it."""


@dataclasses.dataclass(frozen=True, eq=False)
class Skin:
    """A picture on a surface.

    Attributes:
        image: (height, width, 3) uint8 sRGB, top row first; it repeats.
        uv: (V, 2) of the vertices: u to the right, v upwards, 0 to 1 across the picture.
    """

    image: Picture
    uv: npt.NDArray[np.float32]


def skin_along(texture: Texture, places: Array) -> Skin | None:
    """A texture laid along x and y over places (V, 3) of the instance's frame [m], as rays see it; None: it goes by the
    coordinates of a mesh.
    """
    flat = np.asarray(places, np.float64)[:, :2]
    if isinstance(texture, ImageTexture):
        if texture.metres is None:
            return None
        return Skin(picture_of(texture), (flat / np.broadcast_to(texture.metres, 2)).astype(np.float32))
    cells = flat / float(np.max(texture.metres))
    if isinstance(texture, CheckerTexture):
        first, second = (_bytes(color) for color in texture.colors)
        squares = np.array([[second, first], [first, second]], np.uint8)  # the first lies at the origin, below left
        return Skin(squares.repeat(CELL, axis=0).repeat(CELL, axis=1), (0.5 * cells).astype(np.float32))
    low, high = np.floor(cells.min(axis=0)), np.ceil(cells.max(axis=0) + 1e-9)
    extent = np.maximum(high - low, 1.0)
    width, height = np.minimum(FINEST * extent, BAKED).astype(int)
    x = low[0] + extent[0] * (np.arange(width) + 0.5) / width
    y = high[1] - extent[1] * (np.arange(height) + 0.5) / height
    share = noise_share(*np.meshgrid(x, y))[..., None]
    color0, color1 = (np.asarray(color, np.float64) for color in texture.colors)
    return Skin(_bytes((1.0 - share) * color0 + share * color1), ((cells - low) / extent).astype(np.float32))


def picture_of(texture: ImageTexture) -> Picture:
    """(height, width, 3) uint8 sRGB, read where it is a file."""
    if isinstance(texture.image, np.ndarray):
        return texture.image
    from simwarp.geometry.mesh_files import read_image  # imports trimesh

    return read_image(texture.image)


def noise_share(x: Array, y: Array) -> Array:
    """Share of the second colour of a `NoiseTexture` at places in its cells: all octaves of what rays see."""
    total, strength = np.zeros_like(x), 0.5
    for octave in range(OCTAVES):
        column, row = np.floor(x), np.floor(y)
        s, t = x - column, y - row
        s, t = s * s * (3.0 - 2.0 * s), t * t * (3.0 - 2.0 * t)
        at = column.astype(np.int64) + 57 * octave, row.astype(np.int64)
        a, b = _lattice(at[0], at[1]), _lattice(at[0] + 1, at[1])
        c, d = _lattice(at[0], at[1] + 1), _lattice(at[0] + 1, at[1] + 1)
        total += strength * ((1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * c + s * d))
        strength, x, y = 0.5 * strength, 2.0 * x, 2.0 * y
    return total + strength


def _lattice(column: Any, row: Any) -> Array:
    """`lattice_value` of the kernels: a number in [0, 1) for every lattice point."""
    h = column.astype(np.uint32) * np.uint32(0x8DA6B343) + row.astype(np.uint32) * np.uint32(0xD8163841)
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
    h = (h ^ (h >> np.uint32(12))) * np.uint32(0x297A2D39)
    h = h ^ (h >> np.uint32(15))
    return np.asarray((h >> np.uint32(8)) * 2.0**-24, np.float64)


def _bytes(color: Any) -> Picture:
    return np.rint(255.0 * srgb_from_linear(np.clip(color, 0.0, 1.0))).astype(np.uint8)
