"""Hills as height fields: band-limited noise, flat where things start, heights where things stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Meaning, NotNegative
from simwarp.core.types import ModelError
from simwarp.model.rules import RULES, Metres
from simwarp.scenery.solids import stream

Array = npt.NDArray[np.float64]
Heights = npt.NDArray[np.float32]

WAVES = 48
"""Plane waves that hills are a sum of."""


@RULES.arguments("hills")
def hills(
    seed: int = 0, *, size: tuple[Metres, Metres] = (120.0, 120.0), spacing: Metres = 1.0,
    amplitude: Annotated[NotNegative, Meaning("metres; 0 is flat")] = 2.5,
    wavelength: tuple[Metres, Metres] = (35.0, 90.0),
) -> Heights:  # fmt: skip
    """Smooth random hills for `add_shape_height_field(..., size=size)`: the field is centred on the origin.

    A sum of plane waves in random directions, whose lengths lie within `wavelength` and whose heights are in proportion
    to them, so that all have the same slope. The mean is 0; no height exceeds the amplitude.

    Args:
        seed: of the waves.
        size: along x and y [m].
        spacing: of the nodes, at most [m].
        amplitude: greatest height above or depth below 0 [m]; 0: flat.
        wavelength: shortest and longest [m].

    Returns:
        (rows, columns) float32 [m], rows along y.

    Raises:
        ModelError: a length is not positive, the amplitude is negative, or the waves are too short for the spacing.
    """
    short, long = wavelength
    if short > long or spacing > 0.5 * short:
        raise ModelError(
            f"hills: 2 spacing <= shortest <= longest wavelength must hold, got spacing={spacing:g}, "
            f"wavelength={wavelength}; use a finer grid or longer waves"
        )
    x, y = (np.linspace(-0.5 * length, 0.5 * length, math.ceil(length / spacing - 1e-9) + 1) for length in size)
    rng = stream("hills", seed)
    length = np.exp(rng.uniform(math.log(short), math.log(long), WAVES))
    angle = 2.0 * math.pi * (np.arange(WAVES) + rng.random(WAVES)) / WAVES
    phase = rng.uniform(0.0, 2.0 * math.pi, WAVES)
    k = 2.0 * math.pi / length
    along_x = np.exp(1j * np.outer(x, k * np.cos(angle)))
    along_y = np.exp(1j * (np.outer(y, k * np.sin(angle)) + phase))
    heights = np.real((along_y * length) @ along_x.T)
    heights -= heights.mean()
    return np.asarray(heights * (amplitude / np.abs(heights).max()), dtype=np.float32)


@RULES.arguments("flattened")
def flattened(
    heights: npt.ArrayLike, size: Sequence[float], discs: npt.ArrayLike, *, blend: Metres = 12.0
) -> Heights:  # fmt: skip
    """A ground with level discs, each as high as the ground was in its middle; slopes lead to them. Nodes in a
    disc have exactly its height, unless discs overlap. With narrow slopes the ground gets steeper than it was.

    Args:
        heights: (rows, columns) [m].
        size: of the field along x and y [m].
        discs: (k, 3) x, y and radius [m].
        blend: width of the slopes [m].

    Raises:
        ModelError: `blend` is not positive.
    """
    ground = np.array(heights, dtype=np.float64)
    rows, columns = ground.shape
    x = np.linspace(-0.5 * size[0], 0.5 * size[0], columns)
    y = np.linspace(-0.5 * size[1], 0.5 * size[1], rows)
    total, weights = ground.copy(), np.ones_like(ground)
    for a, b, radius in np.asarray(discs, dtype=np.float64).reshape(-1, 3):
        t = np.clip((np.hypot(x[None] - a, y[:, None] - b) - radius) / blend, 0.0, 1.0)
        share = t * t * (3.0 - 2.0 * t)
        # one disc alone gets the weight 1 - share; within a disc it outweighs the ground and all others
        weight = (1.0 - share) / np.maximum(share, 1e-9)
        total += weight * height_at(ground, size, [(a, b)])[0]
        weights += weight
    return np.asarray(total / weights, dtype=np.float32)


def height_at(heights: npt.ArrayLike, size: Sequence[float], points: npt.ArrayLike) -> Array:
    """(n,) heights [m] of a field at points: those of the triangles that contact, tires and rays meet.

    Args:
        heights: (rows, columns) [m].
        size: of the field along x and y [m].
        points: (n, 2) x, y [m]; beyond the border the nearest point on it counts.
    """
    ground = np.asarray(heights, dtype=np.float64)
    rows, columns = ground.shape
    at = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    u = np.clip((at[:, 0] / size[0] + 0.5) * (columns - 1), 0.0, columns - 1.0)
    v = np.clip((at[:, 1] / size[1] + 0.5) * (rows - 1), 0.0, rows - 1.0)
    i, j = np.minimum(u.astype(int), columns - 2), np.minimum(v.astype(int), rows - 2)
    s, t = u - i, v - j
    low, high = ground[j, i], ground[j + 1, i + 1]
    # cells are cut from node (i, j) to node (i + 1, j + 1)
    other = np.where(t > s, ground[j + 1, i], ground[j, i + 1])
    return np.where(t > s, low + t * (other - low) + s * (high - other), low + s * (other - low) + t * (high - other))


def steepness(heights: npt.ArrayLike, size: Sequence[float]) -> float:
    """Greatest slope of a field between neighbouring nodes [rad].

    Args:
        heights: (rows, columns) [m].
        size: of the field along x and y [m].
    """
    ground = np.asarray(heights, dtype=np.float64)
    rows, columns = ground.shape
    along = np.diff(ground, axis=1)[:-1] / (size[0] / (columns - 1))
    across = np.diff(ground, axis=0)[:, :-1] / (size[1] / (rows - 1))
    return math.atan(float(np.hypot(along, across).max()))
