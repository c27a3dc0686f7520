"""Rates of springs: at a length, over the way between the stops, and without what stops add."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from simwarp.vehicle.spec.parts import Array, ForceLine
from simwarp.vehicle.suspensions.corner import spring_force

NEAR: Final = 1.0e-5
"""Half the way over which a rate is measured [m]."""


def spring_rate(line: ForceLine, length: float) -> float:
    """Rise of the force over the compression of a spring, with its stops, at a length [N/m].

    A curve has a kink at each of its points: there it is the mean of both sides.

    Args:
        line: the spring.
        length: between its ends [m].
    """
    low, high = spring_force(line, np.array([length - NEAR, length + NEAR])).tolist()
    return float((low - high) / (2.0 * NEAR))


def without_stops(line: ForceLine) -> ForceLine:
    """The same line without what its stops add beyond its smallest and its largest length."""
    return dataclasses.replace(line, bump_curve=None)


def stop_depth(line: ForceLine, length: Array) -> Array:
    """(...,) how far a line is in its bump stop (positive) or its rebound stop (negative) at lengths (...,) [m]; 0
    between them, and of a line whose description has none.
    """
    found = np.zeros(np.shape(length))
    if line.bump_curve is None:
        return found
    if line.min_length is not None:
        found = np.maximum(line.min_length - length, 0.0)
    if line.max_length is not None:
        found = found - np.maximum(length - line.max_length, 0.0)
    return found


def rate_range(line: ForceLine) -> tuple[float, float]:
    """Smallest and largest rate of a spring between its stops, without them [N/m].

    Where the description has no stop, its curve ends the way.
    """
    bare, rest = without_stops(line), _rest(line)
    if line.spring_curve is None:
        return line.stiffness, line.stiffness
    low, high = (rest + end[0] for end in (line.spring_curve[0], line.spring_curve[-1]))
    low = low if line.min_length is None else max(low, line.min_length)
    high = high if line.max_length is None else min(high, line.max_length)
    knots = sorted({low, high, *(rest + x for x, _ in line.spring_curve if low < rest + x < high)})
    forces = spring_force(bare, np.array(knots))
    rates = -np.diff(forces) / np.diff(knots)
    return (float(rates.min()), float(rates.max())) if len(rates) else (spring_rate(bare, low),) * 2


def _rest(line: ForceLine) -> float:
    return math.dist(line.chassis_point, line.arm_point) if line.rest_length is None else line.rest_length
