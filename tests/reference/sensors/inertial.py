"""Reference of the inertial unit: second differences of a point's positions, in float64, from recorded poses alone."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of, quat_conjugate, quat_multiply

Array = npt.NDArray[np.float64]


def specific_force(x: Array, q: Array, point: Array, turn: Array, gravity: Array, dt: float) -> Array:
    """(n, 3) Rᵀ (a - g) at the middle of each three successive poses (n + 2 of them), in axes of the sensor.

    Args:
        x, q: (n + 2, 3) positions and (n + 2, 4) xyzw orientations of the body.
        point, turn: position and orientation of the sensor on the body.
        gravity: [m/s²].
        dt: between poses [s].
    """
    rotations = np.array([matrix_of(row) for row in q])
    places = x + rotations @ point
    acceleration = (places[2:] - 2.0 * places[1:-1] + places[:-2]) / dt**2
    axes = rotations[1:-1] @ matrix_of(turn)
    return np.asarray(np.einsum("nji,nj->ni", axes, acceleration - gravity))


def angular_velocity(q: Array, turn: Array, dt: float) -> Array:
    """(n, 3) the rotation between successive poses (n + 1 of them) over their time, in axes of the sensor [rad/s]."""
    found = []
    for before, after in itertools.pairwise(q):
        change = quat_multiply(quat_conjugate(before), after)
        change *= np.sign(change[3])
        sine = float(np.linalg.norm(change[:3]))
        angle = 2.0 * np.arctan2(sine, change[3])
        found.append(change[:3] * (angle / sine if sine > 0.0 else 0.0))
    return np.array(found) @ matrix_of(turn) / dt
