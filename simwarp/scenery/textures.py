"""Pictures of grounds and floors that repeat without seams, for `ImageTexture(image=..., metres=...)`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Ge, Meaning
from simwarp.geometry.visual_mesh import Image, srgb_from_linear
from simwarp.model.rules import RULES, word_of
from simwarp.scenery.solids import Array, between, stream, tone

Layer = Callable[[int, np.random.Generator], Array]


def noise(pixels: int, rng: np.random.Generator, coarse: float, fine: float, *, stretch: float = 1.0) -> Array:
    """(pixels, pixels) noise that repeats: mean 0, deviation 1, with `coarse` to `fine` waves across the picture;
    `stretch` > 1 draws it out along rows.
    """
    waves = np.fft.fftfreq(pixels, 1.0 / pixels)
    frequency = np.hypot(waves[None] * stretch, waves[:, None])
    band = (frequency >= coarse) & (frequency <= fine)
    weight = np.where(band, 1.0 / np.maximum(frequency, 1.0), 0.0)
    field = np.real(np.fft.ifft2(np.fft.fft2(rng.standard_normal((pixels, pixels))) * weight))
    return np.asarray((field - field.mean()) / max(float(field.std()), 1e-12))


def stones(pixels: int, rng: np.random.Generator, count: int) -> tuple[Array, npt.NDArray[np.int64], Array]:
    """Cells about random points that repeat: per pixel the distance to the nearest point over that to the second
    nearest, the nearest one's number, and its distance in widths of the picture.
    """
    side = max(1, round(math.sqrt(count)))
    grid = (np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2) + 0.5) / side
    points = np.mod(grid + rng.uniform(-0.4, 0.4, grid.shape) / side, 1.0)
    place = (np.arange(pixels) + 0.5) / pixels
    first = np.full((pixels, pixels), np.inf)
    second = first.copy()
    owner = np.zeros((pixels, pixels), np.int64)
    for index, (x, y) in enumerate(points):
        dx, dy = np.abs(place - x), np.abs(place - y)
        away = np.hypot(np.minimum(dx, 1.0 - dx)[None], np.minimum(dy, 1.0 - dy)[:, None])
        nearer = away < first
        second = np.where(nearer, first, np.minimum(second, away))
        first, owner = np.where(nearer, away, first), np.where(nearer, index, owner)
    return first / second, owner, first


def _share(values: Array, gain: float = 0.3) -> Array:
    return np.clip(0.5 + gain * values, 0.0, 1.0)


def _grass(pixels: int, rng: np.random.Generator) -> Array:
    color = between(tone("48672c"), tone("7f9a48"), _share(noise(pixels, rng, 1, 6)))
    color = between(color, tone("a59a5a"), 0.5 * _share(noise(pixels, rng, 2, 8) - 1.2))
    blades = noise(pixels, rng, 20, pixels / 3, stretch=0.35)
    return np.asarray(color * (1.0 + 0.22 * np.clip(blades, -2.0, 2.0))[..., None])


def _dirt(pixels: int, rng: np.random.Generator) -> Array:
    color = between(tone("6b4f36"), tone("a88661"), _share(noise(pixels, rng, 1, 10)))
    color = color * (1.0 + 0.12 * np.clip(noise(pixels, rng, 10, pixels / 3), -2.0, 2.0))[..., None]
    ratio, owner, _ = stones(pixels, rng, 144)
    pebble = (ratio < 0.35) & (rng.random(144)[owner % 144] < 0.3)
    return np.where(pebble[..., None], tone("a39584"), color)


def _gravel(pixels: int, rng: np.random.Generator) -> Array:
    ratio, owner, _ = stones(pixels, rng, 576)
    tint = between(tone("6f6a63"), tone("b9b2a6"), rng.random(576))[owner]
    return np.asarray(tint * (1.12 - 0.75 * ratio**3)[..., None])


def _asphalt(pixels: int, rng: np.random.Generator) -> Array:
    color = between(tone("47484b"), tone("66676a"), _share(noise(pixels, rng, 1, 5)))
    grain = np.clip(noise(pixels, rng, 30, pixels / 2), -2.5, 2.5)
    return np.asarray(color * (1.0 + 0.16 * grain)[..., None])


def _snow(pixels: int, rng: np.random.Generator) -> Array:
    color = between(tone("cfdae8"), tone("fbfcff"), _share(noise(pixels, rng, 1, 7, stretch=0.6), 0.35))
    return np.asarray(color * (1.0 + 0.02 * np.clip(noise(pixels, rng, 20, pixels / 3), -2.0, 2.0))[..., None])


def _sand(pixels: int, rng: np.random.Generator) -> Array:
    ripples = noise(pixels, rng, 4, 14, stretch=0.3)
    color = between(tone("b8996a"), tone("e2c998"), _share(ripples + 0.5 * noise(pixels, rng, 1, 3)))
    return np.asarray(color * (1.0 + 0.06 * np.clip(noise(pixels, rng, 30, pixels / 2), -2.0, 2.0))[..., None])


def _concrete(pixels: int, rng: np.random.Generator) -> Array:
    color = between(tone("8f8d88"), tone("b4b1aa"), _share(noise(pixels, rng, 1, 12)))
    edge = np.arange(pixels) < max(1, pixels // 64)
    joint = edge[None] | edge[:, None]
    return np.where(joint[..., None], tone("66645f"), color)


def _tiles(pixels: int, rng: np.random.Generator) -> Array:
    cell = (np.arange(pixels) * 4) // pixels
    odd = (cell[None] + cell[:, None]) % 2
    color = between(tone("8a939b"), tone("b9bfc2"), odd.astype(np.float64))
    color = color * (1.0 + 0.08 * rng.uniform(-1.0, 1.0, (4, 4)))[cell[:, None], cell[None]][..., None]
    within = (np.arange(pixels) * 4.0 / pixels) % 1.0 < 0.05
    return np.where((within[None] | within[:, None])[..., None], tone("5c6166"), color)


def _carpet(pixels: int, rng: np.random.Generator) -> Array:
    color = between(tone("3f4a5c"), tone("56647c"), _share(noise(pixels, rng, 1, 8)))
    weave = np.clip(noise(pixels, rng, 30, pixels / 2), -2.0, 2.0)
    return np.asarray(color * (1.0 + 0.15 * weave)[..., None])


_KINDS: Final[dict[str, tuple[float, Layer]]] = {
    "grass": (6.0, _grass), "dirt": (4.0, _dirt), "gravel": (2.0, _gravel), "asphalt": (5.0, _asphalt),
    "snow": (8.0, _snow), "sand": (5.0, _sand), "concrete": (3.0, _concrete), "tiles": (1.6, _tiles),
    "carpet": (2.0, _carpet),
}  # fmt: skip
TEXTURES: Final = {kind: metres for kind, (metres, _) in _KINDS.items()}
"""Kinds of grounds, and what one repeat should cover [m]."""


@RULES.arguments("ground_texture")
def ground_texture(
    kind: Annotated[str, word_of(*TEXTURES)] = "grass",
    seed: int = 0,
    *,
    pixels: Annotated[int, Ge(32), Meaning("pixels; 256 is usual")] = 256,
) -> Image:
    """(pixels, pixels, 3) uint8 sRGB of a ground; its edges fit each other.

    Args:
        kind: one of `TEXTURES`, whose value is a good length for `ImageTexture.metres`.
        seed: of the pattern.
        pixels: width and height, at least 32.

    Raises:
        ModelError: there is no such kind, or `pixels` is not usable.
    """
    linear = _KINDS[kind][1](pixels, stream(f"texture {kind}", seed))
    return np.asarray(np.round(255.0 * srgb_from_linear(np.clip(linear, 0.0, 1.0))), dtype=np.uint8)
