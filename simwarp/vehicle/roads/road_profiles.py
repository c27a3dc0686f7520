"""Random roads of the classes of ISO 8608: displacement spectra, and profiles of two wheel tracks that have them.

The one-sided spectral density of a road's height over the spatial frequency n [1/m] is G_d(n) = G_d(n_0) (n / n_0)^-2
with n_0 = 0.1 1/m; from class to class G_d(n_0) grows by a factor of four. The surface is taken as isotropic: two
tracks at a distance b have the cross-spectral density G_d(n) 2 pi n b K_1(2 pi n b), so that they agree in long waves
and not in short ones (Dodds and Robson 1973).
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import k1

from simwarp.core.object_repr import Readable
from simwarp.vehicle.spec.parts import Array, SpecError

REFERENCE_FREQUENCY: Final = 0.1
"""n_0 [1/m]."""
SMOOTHEST: Final = 16.0e-6
"""G_d(n_0) of class A, the geometric mean of its bounds [m³]."""
BAND: Final = (0.011, 2.83)
"""Spatial frequencies of a road [1/m]: waves of 91 m to 0.35 m."""


class RoadClass(enum.Enum):
    """Classes of ISO 8608: A to E from very good to very poor roads, F to H ground without a road."""

    A = "A"
    B = "B"
    C = "C"
    D = "D"
    E = "E"
    F = "F"
    G = "G"
    H = "H"

    @property
    def roughness(self) -> float:
        """G_d(n_0): spectral density at 0.1 1/m [m³]."""
        return SMOOTHEST * 4.0 ** "ABCDEFGH".index(self.value)


ROAD_CLASSES: Final = (RoadClass.A, RoadClass.B, RoadClass.C, RoadClass.D, RoadClass.E)
"""Those that roads have: F to H are unpaved ground."""


def displacement_spectrum(frequency: npt.ArrayLike, road: RoadClass) -> Array:
    """(...,) spectral density G_d of a road's height [m³] at spatial frequencies (...,) above zero [1/m]."""
    n = np.asarray(frequency, np.float64)
    return np.asarray(road.roughness * (n / REFERENCE_FREQUENCY) ** -2.0)


def track_correlation(frequency: npt.ArrayLike, distance: float) -> Array:
    """(...,) cross-spectral density of two tracks at a distance [m] over the density of each, the square root of their
    coherence, at spatial frequencies (...,) [1/m].
    """
    x = 2.0 * math.pi * np.asarray(frequency, np.float64) * distance
    return np.where(x > 1e-9, x * k1(np.maximum(x, 1e-9)), 1.0)


@dataclasses.dataclass(frozen=True, repr=False)
class RoadProfile(Readable):
    """Heights of two wheel tracks; the profile repeats itself.

    Attributes:
        road: its class.
        spacing: between two samples [m].
        height: (2, n) of the left and the right track [m].
    """

    road: RoadClass
    spacing: float
    height: Array

    def _readable_title(self) -> str:
        return f" of class {self.road.value}: {self.length:.4g} m, rms {1e3 * float(self.height.std()):.3g} mm"

    @property
    def length(self) -> float:
        """Length of one period [m]."""
        return self.spacing * self.height.shape[1]

    def at(self, distance: npt.ArrayLike, track: int) -> Array:
        """(...,) heights of a track (0 left, 1 right) at distances (...,) [m], between the samples along a line [m]."""
        place = np.mod(np.asarray(distance, np.float64), self.length) / self.spacing
        low = np.minimum(np.floor(place).astype(np.int64), self.height.shape[1] - 1)
        heights = self.height[track]
        share = place - low
        return np.asarray((1.0 - share) * heights[low] + share * heights[(low + 1) % len(heights)])


def road_profile(
    road: RoadClass, length: float, *, spacing: float = 0.05, track: float = 1.8, seed: int = 0
) -> RoadProfile:
    """A random road of a class: waves of the class's amplitudes with random phases.

    Args:
        road: its class.
        length: of one period, at least the longest wave of 91 m [m].
        spacing: between two samples, at most half the shortest wave of 0.35 m [m].
        track: between both wheel tracks [m].
        seed: of the phases; the same seed gives the same road.

    Raises:
        SpecError: the period holds no long wave, or the spacing misses short ones.
    """
    if not 1.0 / BAND[0] <= length < math.inf:
        raise SpecError(
            f"length: must be at least the longest wave of {1.0 / BAND[0]:.3g} m and finite, got {length:g} m"
        )
    if not 0.0 < spacing <= 0.5 / BAND[1]:
        raise SpecError(f"spacing: must be > 0 and at most {0.5 / BAND[1]:.3g} m, got {spacing:g} m")
    if not 0.0 <= track < math.inf:
        raise SpecError(f"track: must be >= 0 m and finite, got {track:g}")
    if seed < 0:
        raise SpecError(f"seed: must be 0 or more, got {seed}")
    count = round(length / spacing)
    n = np.fft.rfftfreq(count, spacing)
    inside = (n >= BAND[0]) & (n <= BAND[1])
    inside[-1] = False  # an even number of samples has no phase there
    size = np.zeros(len(n))
    size[inside] = np.sqrt(2.0 * displacement_spectrum(n[inside], road) * n[1])
    random = np.random.default_rng(seed)
    first, second = size * np.exp(2j * math.pi * random.random((2, len(n))))
    alike = np.zeros(len(n))
    alike[inside] = track_correlation(n[inside], track)
    other = alike * first + np.sqrt(1.0 - alike**2) * second
    heights = np.fft.irfft(np.stack([first, other]) * (0.5 * count), count, axis=1)
    return RoadProfile(road, length / count, heights)
