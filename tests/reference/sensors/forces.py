"""Reference of the force sensors: contact by contact, from recorded contacts and poses, in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from tests.reference.sensors.sensor_clock import frames, read

Array = npt.NDArray[np.float64]


def body_force(body: int, body0: npt.ArrayLike, body1: npt.ArrayLike, force: npt.ArrayLike) -> Array:
    """(3,) the sum over contacts: `force` acts on the second body, its opposite on the first."""
    total = np.zeros(3)
    for first, second, f in zip(np.asarray(body0), np.asarray(body1), np.asarray(force, np.float64), strict=True):
        if second == body:
            total += f
        if first == body:
            total -= f
    return total


def in_axes(q: Array, turn: Array, vector: Array) -> Array:
    """A world vector in axes of a sensor on a body."""
    return np.asarray((matrix_of(q) @ matrix_of(turn)).T @ vector)


def means(samples: Array, period: int, window: int, lag: int) -> Array:
    """(n + 1, channels) what is read after 0 to n sub-steps, of a sample after each; the first is that of the reset."""
    taken = frames(period, window, lag, 0, len(samples) - 1)
    values = {f.number: samples[list(f.substeps)].mean(axis=0) if f.substeps else samples[0] for f in taken}
    return np.array([values[read(taken, count).number] for count in range(len(samples))])
