"""Angles of wheels from the directions of their axes, and where they touch level ground.

An axis is a unit vector to the left, in axes of which x points ahead, y to the left and z up. A side is 1 of a left
wheel, -1 of a right one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.spec.parts import Array


def steer_angles(axis: Array) -> Array:
    """(...,) headings of wheels with axes (..., 3), positive to the left [rad]."""
    return np.asarray(np.arctan2(-axis[..., 0], axis[..., 1]))


def toe_angles(axis: Array, side: npt.ArrayLike) -> Array:
    """(...,) toe of wheels with axes (..., 3) on sides (...,), positive where their fronts point inwards [rad]."""
    return -np.asarray(side) * steer_angles(axis)


def camber_angles(axis: Array, side: npt.ArrayLike) -> Array:
    """(...,) camber of wheels with axes (..., 3) on sides (...,), positive where their tops lean outwards [rad]."""
    return -np.asarray(side) * np.arcsin(np.clip(axis[..., 2], -1.0, 1.0))


def contact_points(center: Array, axis: Array, radius: float) -> Array:
    """(..., 3) lowest points of wheels: a radius below their centres (..., 3), in the planes across their axes [m]."""
    up = np.array([0.0, 0.0, 1.0]) - axis[..., 2:] * axis
    return np.asarray(center - radius * up / np.linalg.norm(up, axis=-1, keepdims=True))
