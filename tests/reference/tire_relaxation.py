"""Slips that follow over relaxation lengths: slow, float64, by many Runge-Kutta steps; and the lengths and limits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy import arctan, exp, sin

from simwarp.vehicle.tires.parameter_vector_kernels import Common, Pac89


def fine_ode(rate, v, z, dt):
    """dz/dt = v - rate z by many Runge-Kutta steps of fourth order."""
    n = max(20, int(20 * rate * dt))
    h = dt / n
    for _ in range(n):
        k1 = v - rate * z
        k2 = v - rate * (z + 0.5 * h * k1)
        k3 = v - rate * (z + 0.5 * h * k2)
        k4 = v - rate * (z + h * k3)
        z = z + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6
    return z


def lagged(slip, speed, lengths, limit, z, dt):
    """Slips of the contact after dt: those of the wheel, which they follow over their lengths; advances z."""
    slip = np.asarray(slip, dtype=float)
    if lengths[0] == 0.0:
        return slip
    for i in range(2):
        # ds'/dt = s speed / length - s' speed / length
        end = fine_ode(speed / lengths[i], slip[i] * speed / lengths[i], z[2 + i], dt)
        z[2 + i] = np.clip(end, -max(abs(slip[i]), limit[i]), max(abs(slip[i]), limit[i]))
    if np.linalg.norm(z[2:4]) > 2.0:
        z[2:4] = slip * min(1.0, 2.0 / np.linalg.norm(slip))
    return np.array(z[2:4])


def lengths_of(row):
    return row[[Common.RELAXATION_X, Common.RELAXATION_Y]]


def pac89_limit(row, fz, g, m):
    """Slip ratio and angle [rad] where all slides: three times the largest force over the slope."""
    a, b = row[Pac89.A : Pac89.A + 14], row[Pac89.B : Pac89.B + 11]
    x = (b[1] * fz**2 + b[2] * fz) / ((b[3] * fz**2 + b[4] * fz) * exp(-b[5] * fz))
    y = (a[1] * fz**2 + a[2] * fz) / (a[3] * sin(2 * arctan(fz / a[4])) * (1 - a[5] * abs(g)))
    return 3 * m * abs(x) / 100, 3 * m * np.radians(abs(y))


def pac02_lengths(p: Any, row, fz, g):
    """Relaxation lengths along x and y: given ones, those of the file, or none."""
    if row[Common.RELAXATION_X] > 0 or p.TRANSIENT == 0:
        return lengths_of(row)
    fz0 = p.FNOMIN * p.LFZO
    d = fz / fz0 - 1
    x = fz * (p.PTX1 + p.PTX2 * d) * exp(-p.PTX3 * d) * row[Common.RADIUS] / fz0 * p.LSGKP
    y = p.PTY1 * sin(2 * arctan(fz / (p.PTY2 * fz0))) * (1 - p.PKY3 * abs(p.LGAY * g))
    y *= row[Common.RADIUS] * p.LFZO * p.LSGAL
    return np.maximum([x, y], 1e-3)
