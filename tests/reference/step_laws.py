"""Laws along degrees of freedom of the float64 reference: implicit terms, prescribed motion, box constraints."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from simwarp.core.types import Dof, PositionDrive, PrescribedPosition, PrescribedSpeed, Table, VelocityMotor


def table_value_slope(table: Table, at: float) -> tuple[float, float]:
    """Value and slope of a piecewise linear table; at a knot the slope of the segment to its right."""
    x, y = np.asarray(table[0], float), np.asarray(table[1], float)
    k = int(np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2))
    slope = (y[k + 1] - y[k]) / (x[k + 1] - x[k])
    return float(y[k] + slope * (at - x[k])), float(slope)


def table_energy(table: Table, at: float) -> float:
    """Integral of a piecewise linear table from 0 to `at`: trapezia between its knots, which are exact."""
    low, high = min(at, 0.0), max(at, 0.0)
    knots = np.unique([low, high, *(x for x in table[0] if low < x < high)])
    area = np.trapezoid([table_value_slope(table, knot)[0] for knot in knots], knots)
    return float(np.copysign(1.0, at) * area)


@dataclasses.dataclass
class DofInput:
    """One degree of freedom at the start of a step, and its controls."""

    q: float
    qd: float
    force: float
    target_q: float
    target_qd: float
    eta: float


def bounds_of(drive: PositionDrive | VelocityMotor) -> tuple[float, float]:
    """Least and largest effort."""
    limit = drive.effort_limit
    return limit if isinstance(limit, tuple) else (-limit, limit)


def implicit_terms(dof: Dof, s: DofInput, h: float) -> tuple[float, float]:
    """(G, g) of the impulse gamma = -G u + g of everything along `dof` that has no bound."""
    spring, stiffness = dof.stiffness * (s.q - dof.rest), dof.stiffness
    if dof.spring_table is not None:
        spring, stiffness = table_value_slope(dof.spring_table, s.q - dof.rest)
    damper, damping = dof.damping * s.qd, dof.damping
    if dof.damper_table is not None:
        damper, damping = table_value_slope(dof.damper_table, s.qd)
    damping, stiffness = max(damping, 0.0), max(stiffness, 0.0)  # a law that falls counts with its force alone
    gain = dof.armature + h * damping + h * h * stiffness
    start = dof.armature * s.qd + h * (s.force + dof.preload - spring - damper + damping * s.qd)
    drive = dof.drive
    if isinstance(drive, PositionDrive) and all(map(math.isinf, bounds_of(drive))):
        gain += h * drive.damping + h * h * drive.stiffness
        start += h * (drive.stiffness * (s.target_q - s.q) + drive.damping * s.target_qd)
    return gain, start


def prescribed_speed(dof: Dof, s: DofInput, time: float, h: float) -> float | None:
    """The speed that a prescribed degree of freedom must have at the end of the step; None if it is not."""
    drive = dof.drive
    if isinstance(drive, PrescribedSpeed):
        return s.target_qd if drive.table is None else table_value_slope(drive.table, time + h)[0]
    if not isinstance(drive, PrescribedPosition):
        return None
    if drive.table is None:
        now, rate = s.target_q, s.target_qd
    else:
        now = table_value_slope(drive.table, time)[0]
        rate = (table_value_slope(drive.table, time + h)[0] - now) / h
    return rate + float(np.clip((now - s.q) / h, -s.eta, s.eta))


def box_constraints(dof: Dof, s: DofInput, h: float) -> list[tuple[float, float, float, float, float]]:
    """(sign of the row, bias, compliance, low, high) of every box constraint of `dof`."""
    rows = []
    if dof.limit is not None:
        lower, upper = dof.limit
        if math.isfinite(lower):
            rows.append((1.0, max((s.q - lower) / h, -s.eta), 0.0, 0.0, math.inf))
        if math.isfinite(upper):
            rows.append((-1.0, max((upper - s.q) / h, -s.eta), 0.0, 0.0, math.inf))
    if dof.friction > 0.0:
        rows.append((1.0, 0.0, 0.0, -h * dof.friction, h * dof.friction))
    drive = dof.drive
    if isinstance(drive, VelocityMotor):
        least, most = bounds_of(drive)
        rows.append((1.0, -s.target_qd, 0.0, h * least, h * most))
    if isinstance(drive, PositionDrive) and any(map(math.isfinite, bounds_of(drive))):
        k, d = drive.stiffness, drive.damping
        least, most = bounds_of(drive)
        gain = h * k + d
        if gain > 0.0:
            bias = -(k * (s.target_q - s.q) + d * s.target_qd) / gain
            rows.append((1.0, bias, 1.0 / (h * gain), h * least, h * most))
    return rows
