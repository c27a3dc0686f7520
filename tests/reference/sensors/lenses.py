"""Laws of lenses as they are written in their papers, in float64: where a point of the image looks.

Points (u, v): half widths from the middle of the image, v upwards. Directions: X forward, Y left, Z up.
"""

import numpy as np


def direction_at(angle, u, v):
    """Unit direction at an angle from the axis, on the side of (u, v)."""
    turn = np.arctan2(v, u)
    return np.stack([np.cos(angle), -np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn)], axis=-1)


def pinhole(u, v, fov):
    """A ray through a point of a screen at distance 1 / tan(fov / 2)."""
    return direction_at(np.arctan(np.hypot(u, v) * np.tan(0.5 * fov)), u, v)


def fov_lens(u, v, fov):
    """Devernay and Faugeras (2001), equation 14: r_u = tan(r_d w) / (2 tan(w / 2)), r in widths; below 180 degrees."""
    distorted = 0.5 * np.hypot(u, v)
    undistorted = np.tan(distorted * fov) / (2.0 * np.tan(0.5 * fov))
    # a pinhole of field w sees r_u = 1/2 at w / 2
    return direction_at(np.arctan(undistorted * 2.0 * np.tan(0.5 * fov)), u, v)


def moved(r, k):
    """Brown's radial law: where a pinhole's distance r (in focal lengths) comes to lie."""
    return r * (1.0 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6)


def drap_lefevre(r, k):
    """Inverse of `moved` as a power series (Drap and Lefevre 2016, table 1), good for small distortions only."""
    a, b, c = k
    s = r**2
    terms = (
        -a,
        3.0 * a**2 - b,
        -12.0 * a**3 + 8.0 * a * b - c,
        55.0 * a**4 - 55.0 * a**2 * b + 5.0 * b**2 + 10.0 * a * c,
    )
    return r * (1.0 + sum(term * s ** (index + 1) for index, term in enumerate(terms)))


def grid(width, height):
    """(u, v) of the middles of all pixels, (height, width) each; the first row is the top."""
    u = [(2.0 * column + 1.0) / width - 1.0 for column in range(width)]
    v = [(height - 2.0 * row - 1.0) / width for row in range(height)]
    return np.meshgrid(u, v)
