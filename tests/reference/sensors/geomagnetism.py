"""Reference of the magnetometer: the dipole's field by spherical trigonometry, on a sphere, in east, north and up."""

from __future__ import annotations

import math


def dipole(latitude: float, longitude: float, pole: tuple[float, float], strength: float, ratio: float) -> list[float]:
    """East, north and up [T] at a geocentric place [deg]; `ratio` is the reference radius over the distance.

    |B| = B0 ratio³ sqrt(1 + 3 cos² t) with the magnetic colatitude t, inclination atan2(2 cos t, sin t) downwards, and
    the horizontal part along the great circle to the pole.
    """
    phi, lam = math.radians(latitude), math.radians(longitude)
    phi_p, lam_p = math.radians(pole[0]), math.radians(pole[1])
    cosine = math.sin(phi) * math.sin(phi_p) + math.cos(phi) * math.cos(phi_p) * math.cos(lam_p - lam)
    sine = math.sqrt(1.0 - cosine**2)
    size = strength * ratio**3 * math.sqrt(1.0 + 3.0 * cosine**2)
    inclination = math.atan2(2.0 * cosine, sine)
    bearing = math.atan2(
        math.cos(phi_p) * math.sin(lam_p - lam),
        math.cos(phi) * math.sin(phi_p) - math.sin(phi) * math.cos(phi_p) * math.cos(lam_p - lam),
    )
    across = size * math.cos(inclination)
    return [across * math.sin(bearing), across * math.cos(bearing), -size * math.sin(inclination)]
