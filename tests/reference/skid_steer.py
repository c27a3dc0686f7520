"""Steady turning on the spot of a vehicle whose wheels do not steer, in float64 NumPy."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

Friction = Callable[[np.ndarray, float], np.ndarray]
"""(sliding velocity (2,) [m/s], speed of the tread |omega| r [m/s]) -> force over load (2,)."""


@dataclasses.dataclass(frozen=True)
class LugreFriction:
    """Canudas de Wit's law where nothing changes any more."""

    bristle_rate: tuple[float, float]
    kinetic: float
    static: float
    stribeck_speed: float
    carry_off: float
    patch_length: float
    scale: float = 1.0

    def __call__(self, slide: np.ndarray, tread_speed: float) -> np.ndarray:
        """Force over load."""
        v = float(np.linalg.norm(slide))
        g = self.scale * (
            self.kinetic + (self.static - self.kinetic) * math.exp(-math.sqrt(v / self.stribeck_speed))
        )  # fmt: skip
        s0 = np.array(self.bristle_rate)
        return -s0 * slide / (s0 * v / g + self.carry_off * tread_speed / self.patch_length)


def coulomb(slide: np.ndarray, tread_speed: float) -> np.ndarray:
    """Friction of one size, against the sliding."""
    return -slide / np.linalg.norm(slide)


def yaw_rate(tread_speed: float, places: np.ndarray, friction: Friction) -> float:
    """Of a vehicle whose right wheels run ahead and whose left ones run back at `tread_speed` [m/s] [rad/s].

    Args:
        tread_speed: of the wheels, omega r.
        places: (n, 2) of equally loaded points of contact from the middle [m].
        friction: of each.
    """

    def moment(rate: float) -> float:
        total = 0.0
        for x, y in places:
            slide = np.array([-rate * y + math.copysign(tread_speed, y), rate * x])
            force = friction(slide, tread_speed)
            total += x * force[1] - y * force[0]
        return total

    ideal = tread_speed / float(np.abs(places[:, 1]).min())
    return float(brentq(moment, 1.0e-6 * ideal, ideal, xtol=1e-12))
