"""The rule for springs and dampers, as one reads it: the impulse of a step where the rate after it is `u`.

Positions belong to steps, rates to their middle: x⁺ = x + h u, and the position before was x⁻ = x - h u0. With
zeta = the numerical damping and beta = max(0, (1 - 2 zeta) / 4) a spring acts at beta x⁺ + (1 - 2 beta) x + beta x⁻ and
a damper at (1 - zeta)/2 u0 + (1 + zeta)/2 u. What damps numerically is a damper zeta h k. Laws are taken along their
tangents at x and u0.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64] | float


def average_of(zeta: float) -> float:
    """beta."""
    return max(0.0, (1.0 - 2.0 * zeta) / 4.0)


def spring_impulse(h: float, zeta: float, force: Values, stiffness: Values, u0: Values, u: Values) -> Values:
    """Impulse of a spring that pulls with `force` at x; `stiffness` is a number, or a matrix for vectors."""
    beta = average_of(zeta)
    moved = beta * (h * u) - beta * (h * u0)  # beta (x⁺ - x) + beta (x⁻ - x)
    slope = np.asarray(stiffness)
    stretch = slope @ np.asarray(moved) if slope.ndim == 2 else slope * moved
    drag = slope @ np.asarray(u) if slope.ndim == 2 else slope * u
    return h * (force - stretch - zeta * h * drag)


def damper_impulse(
    h: float, zeta: float, force: Values, damping: Values, u0: Values, u: Values, at: Values
) -> Values:  # fmt: skip
    """Impulse of a damper whose effort at the rate `at` is `force`."""
    acting = 0.5 * (1.0 - zeta) * u0 + 0.5 * (1.0 + zeta) * u
    return h * (force - damping * (acting - at))


def oscillate(
    zeta: float, h: float, steps: int, *, mass: Values, stiffness: Values, damping: Values, x: Values, u: Values
) -> tuple[np.ndarray, np.ndarray]:
    """Masses on springs and dampers to the ground, no load: positions (steps + 1, n) and rates, of which row k is half
    a step before position k. All are numbers, or matrices for n masses.
    """
    m, k, d = (np.atleast_2d(np.asarray(value, float)) for value in (mass, stiffness, damping))
    position, rate = np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(u, float))
    beta, positions, rates = average_of(zeta), [position], [rate]
    for _ in range(steps):
        # M (u - u0) = the two impulses, solved for u
        left = m + h * 0.5 * (1.0 + zeta) * d + h * h * (beta + zeta) * k
        right = (m - h * 0.5 * (1.0 - zeta) * d + h * h * beta * k) @ rate - h * k @ position
        rate = np.linalg.solve(left, right)
        position = position + h * rate
        positions.append(position)
        rates.append(rate)
    return np.array(positions), np.array(rates)
