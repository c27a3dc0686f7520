"""Random roads of the classes of ISO 8608 as surfaces: heights that are a function of the seed and the place alone.

The surface is a Gaussian field, the same in all directions: over the spatial frequency n along the road its one-sided
spectral density is G_d(n) of the class (`road_profiles`), and two tracks at a distance b agree as isotropy demands
(Dodds and Robson 1973, "The description of road surface roughness"; `track_correlation`). It is a sum of waves with
frequencies that are multiples of 1/1024 m along and of 1/102.4 m across; those of one frequency n share its density in
proportion to (n² + n_across²)^(-3/2), the spectrum of an isotropic surface whose profiles fall with n^-2. So the road
repeats itself after 1024 m along and 102.4 m across, both longer than its longest wave of 91 m.
"""

from __future__ import annotations

import functools
import math
from typing import Final

import numpy as np
import numpy.typing as npt
import scipy.fft

from simwarp.vehicle.roads.road_profiles import BAND, RoadClass, displacement_spectrum
from simwarp.vehicle.spec.parts import refuse

NODES: Final = (20_480, 1_024)
"""Of one period along and across."""
SPACING: Final = (0.05, 0.1)
"""Of the nodes along x and y [m]."""
TOGETHER: Final = 16
"""Rows that are transformed at once, as many as processors take: the same numbers, whichever rows are asked for."""
MOST_NODES: Final = 40_000_000
"""Of one window: 160 MB."""

Heights = npt.NDArray[np.float32]


def random_heights(
    road: RoadClass, seed: int, x: tuple[float, float], y: tuple[float, float]
) -> tuple[Heights, tuple[float, float]]:
    """Heights of a random road within a window, at nodes 0.05 m apart along and 0.1 m across.

    Args:
        road: its class.
        seed: of the waves; the same seed and place give the same height in every window, and in every class the same
            road but for a factor of two from class to class.
        x: first and last of the window [m]; nodes at or just beyond them bound it.
        y: likewise.

    Returns:
        (rows along y, columns along x) heights [m], and x and y of the first node [m].

    Raises:
        SpecError: the seed or the window cannot be used.
    """
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**63:
        raise refuse("seed", "a whole number, 0 or more", seed)
    (left, right), (low, high) = (_nodes(*each) for each in zip("xy", (x, y), SPACING, strict=True))
    count = (right - left + 1) * (high - low + 1)
    if count > MOST_NODES:
        raise refuse("window", f"of at most {MOST_NODES:.3g} nodes", count, "take a shorter or narrower one")
    rows = np.arange(low, high + 1) % NODES[1]
    wanted = np.unique(rows)
    table = np.empty((len(wanted), NODES[0]), np.float32)
    waves = _waves(seed)
    for first in range(0, len(wanted), TOGETHER):
        chosen = wanted[first : first + TOGETHER]
        spectrum = np.zeros((TOGETHER, NODES[0] // 2 + 1), np.complex64)
        spectrum[: len(chosen), _columns()] = waves[chosen]
        table[first : first + TOGETHER] = scipy.fft.irfft(spectrum, NODES[0], axis=1)[: len(chosen)]
    columns = np.arange(left, right + 1) % NODES[0]
    heights = table[np.searchsorted(wanted, rows)[:, None], columns[None]]
    heights *= np.float32(math.sqrt(road.roughness / RoadClass.A.roughness))
    return heights, (left * SPACING[0], low * SPACING[1])


def _nodes(name: str, ends: tuple[float, float], spacing: float) -> tuple[int, int]:
    """First and last node of a window along an axis."""
    first, last = ends
    if not (math.isfinite(first) and math.isfinite(last) and first < last):
        raise refuse(name, "two finite numbers that rise [m]", ends, "swap them")
    return math.floor(first / spacing + 1e-6), math.ceil(last / spacing - 1e-6)


@functools.cache
def _columns() -> npt.NDArray[np.int64]:
    """Waves along one period that lie within the band of roads."""
    n = scipy.fft.rfftfreq(NODES[0], SPACING[0])
    return np.flatnonzero((n >= BAND[0]) & (n <= BAND[1]))


def shares(along: npt.NDArray[np.float64], across: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(across, along) shares of the waves across in the density at a frequency along; each column's sum is 1.

    Args:
        along: (n,) frequencies above zero [1/m].
        across: (m,) frequencies [1/m].
    """
    share = (along[None] ** 2 + across[:, None] ** 2) ** -1.5
    return np.asarray(share / share.sum(axis=0))


@functools.lru_cache(maxsize=2)
def _waves(seed: int) -> npt.NDArray[np.complex64]:
    """(rows, waves) complex amplitudes along every row of nodes, of class A."""
    step = 1.0 / (NODES[0] * SPACING[0])
    along = np.asarray(step * _columns(), np.float64)
    across = np.asarray(scipy.fft.fftfreq(NODES[1], SPACING[1]), np.float64)
    density = displacement_spectrum(along, RoadClass.A) * step
    # a wave with the amplitude c makes |c|² / 2 of the variance; c is twice what stands in the transform
    size = np.sqrt(0.25 * density * shares(along, across)) * (NODES[0] * NODES[1])
    drawn = np.random.default_rng([seed, 8608]).standard_normal((2, *size.shape), dtype=np.float32)
    amplitudes = ((drawn[0] + 1j * drawn[1]) * size.astype(np.float32)).astype(np.complex64)
    return np.asarray(scipy.fft.ifft(amplitudes, axis=0))
