"""Laws along degrees of freedom of the float64 reference: implicit terms, prescribed motion, box constraints."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from simwarp.core.types import Dof, PositionDrive, PrescribedPosition, PrescribedSpeed, Table, VelocityMotor
from tests.reference.spring_rule import damper_impulse, spring_impulse
from tests.reference.step_rows import matrices, quat_exp, rotation_log


def table_value_slope(table: Table, at: float) -> tuple[float, float]:
    """Value and slope of a piecewise linear table; at a knot the slope of the segment to its right."""
    x, y = np.asarray(table[0], float), np.asarray(table[1], float)
    k = int(np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2))
    slope = (y[k + 1] - y[k]) / (x[k + 1] - x[k])
    return float(y[k] + slope * (at - x[k])), float(slope)


def table_integral(table: Table, at: float) -> float:
    """Integral of a table from 0 to `at`, segment by segment."""
    low, high = sorted((0.0, at))
    knots = np.array([low, *(x for x in table[0] if low < x < high), high])
    values = np.array([table_value_slope(table, x)[0] for x in knots])
    return float(math.copysign(1.0, at) * np.sum(0.5 * np.diff(knots) * (values[1:] + values[:-1])))


@dataclasses.dataclass
class DofInput:
    """One degree of freedom at the start of a step, and its controls; `qd` is the rate as published, along the axes of
    the last step, `before` along those of this one.
    """

    q: float
    qd: float
    before: float
    force: float
    target_q: float
    target_qd: float
    eta: float


def bounds_of(drive: PositionDrive | VelocityMotor) -> tuple[float, float]:
    """Least and largest effort."""
    limit = drive.effort_limit
    return limit if isinstance(limit, tuple) else (-limit, limit)


@dataclasses.dataclass(frozen=True)
class Rule:
    """How a step of `h` [s] integrates springs and dampers."""

    h: float
    zeta: float = 1.0

    def terms(self, s: DofInput, spring: float, stiffness: float, damper: float, damping: float) -> tuple[float, float]:
        """(G, g) of the impulse gamma = -G u + g of a spring and a damper with these efforts at the step's start."""

        def impulse(u: float) -> float:
            pull = spring_impulse(self.h, self.zeta, spring, stiffness, s.before, u)
            return float(pull + damper_impulse(self.h, self.zeta, damper, damping, s.before, u, s.qd))

        return impulse(0.0) - impulse(1.0), impulse(0.0)

    def spring_terms(self, u0: np.ndarray, torque: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of three springs about axes, whose stiffness is a matrix."""
        zero = np.asarray(spring_impulse(self.h, self.zeta, torque, stiffness, u0, np.zeros(3)))
        columns = [zero - spring_impulse(self.h, self.zeta, torque, stiffness, u0, u) for u in np.eye(3)]
        return np.array(columns).T, zero


def implicit_terms(dof: Dof, s: DofInput, rule: Rule) -> tuple[float, float]:
    """(G, g) of the impulse gamma = -G u + g of everything along `dof` that has no bound."""
    spring, stiffness = dof.stiffness * (s.q - dof.rest), dof.stiffness
    if dof.spring_table is not None:
        spring, stiffness = table_value_slope(dof.spring_table, s.q - dof.rest)
    damper, damping = dof.damping * s.qd, dof.damping
    if dof.damper_table is not None:
        damper, damping = table_value_slope(dof.damper_table, s.qd)
    damping, stiffness = max(damping, 0.0), max(stiffness, 0.0)  # a law that falls counts with its force alone
    gain, start = rule.terms(s, -spring, stiffness, -damper, damping)
    gain += dof.armature
    start += dof.armature * s.qd + rule.h * (s.force + dof.preload)
    drive = dof.drive
    if isinstance(drive, PositionDrive) and all(map(math.isinf, bounds_of(drive))):
        more, along = pd_terms(drive, s, rule)
        gain, start = gain + more, start + along
    return gain, start


def pd_terms(drive: PositionDrive, s: DofInput, rule: Rule) -> tuple[float, float]:
    """(G, g) of a PD drive on a coordinate of its own. Bounded ones know the rate before as published."""
    if not all(map(math.isinf, bounds_of(drive))):
        s = dataclasses.replace(s, before=s.qd)
    pull, damp = drive.stiffness * (s.target_q - s.q), drive.damping * (s.target_qd - s.qd)
    return rule.terms(s, pull, drive.stiffness, damp, drive.damping)


def relative_rotation(turn: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """log(exp(turn) exp(rest)^T) of rotation vectors [rad]."""
    rotation, origin = matrices(quat_exp(np.array([turn, rest])))
    return rotation_log(rotation @ origin.T)


def angle_gradients(theta: np.ndarray) -> np.ndarray:
    """(3, 3): row i is the gradient of theta_i over a turn about fixed axes, the inverse of the left Jacobian."""
    angle = np.linalg.norm(theta)
    cross = np.cross(theta, np.eye(3)).T
    if angle < 1e-4:
        return np.linalg.inv(np.eye(3) + cross / 2 + cross @ cross / 6)
    first, second = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    return np.linalg.inv(np.eye(3) + first * cross + second * cross @ cross)


def tangent_stiffness(stiffness: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """(3, 3): without the curvature of the angles, or the number that all three stiffnesses are."""
    if np.ptp(stiffness) == 0.0:
        return stiffness[0] * np.eye(3)
    return gradients.T @ np.diag(stiffness) @ gradients


def rotation_terms(dofs: list[Dof], inputs: list[DofInput], rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """(G, g) of `implicit_terms` for the three coordinates of a rotation vector: springs and drives are gradients of
    their potentials of the relative rotation, all else acts along the angular velocity.
    """
    inputs = [dataclasses.replace(s, before=s.qd) for s in inputs]  # as published, along the axes of the last step
    turn = np.array([s.q for s in inputs])
    rest = np.array([dof.rest for dof in dofs])
    without = [dataclasses.replace(dof, stiffness=0.0, spring_table=None, preload=0.0, drive=None) for dof in dofs]
    plain = np.array([implicit_terms(dof, s, rule) for dof, s in zip(without, inputs, strict=True)])
    theta = relative_rotation(turn, rest)
    pulls = [table_value_slope(dof.spring_table, angle) if dof.spring_table else (dof.stiffness * angle, dof.stiffness)
             for dof, angle in zip(dofs, theta, strict=True)]  # fmt: skip
    pull, stiffness = np.array(pulls).T
    gradients = angle_gradients(theta)
    rates = np.array([s.before for s in inputs])
    torque = gradients.T @ (np.array([dof.preload for dof in dofs]) - pull)
    springs = rule.spring_terms(rates, torque, tangent_stiffness(np.maximum(stiffness, 0.0), gradients))
    drives = drive_terms(dofs, inputs, rule, bounded=False)
    return np.diag(plain[:, 0]) + springs[0] + drives[0], plain[:, 1] + springs[1] + drives[1]


def drive_terms(dofs: list[Dof], inputs: list[DofInput], rule: Rule, *, bounded: bool) -> tuple[np.ndarray, np.ndarray]:
    """(G, g) of the PD drives of a rotation that have a bound, or of those that have none."""
    drives = [dof.drive if isinstance(dof.drive, PositionDrive)
              and any(map(math.isfinite, bounds_of(dof.drive))) == bounded else PositionDrive(stiffness=0.0)
              for dof in dofs]  # fmt: skip
    theta = relative_rotation(np.array([s.q for s in inputs]), np.array([s.target_q for s in inputs]))
    gradients = angle_gradients(theta)
    stiffness, damping = np.array([(drive.stiffness, drive.damping) for drive in drives]).T
    implicit = np.full(3, stiffness.max()) if bounded else stiffness
    rule = Rule(rule.h)  # backward Euler, whatever the numerical damping
    damp = damping * np.array([s.target_qd - s.qd for s in inputs])
    dampers = np.array([rule.terms(s, 0.0, 0.0, f, d) for s, f, d in zip(inputs, damp, damping, strict=True)])
    springs = rule.spring_terms(
        np.array([s.before for s in inputs]), -gradients.T @ (stiffness * theta), tangent_stiffness(implicit, gradients)
    )
    return np.diag(dampers[:, 0]) + springs[0], dampers[:, 1] + springs[1]


def prescribed_speed(dof: Dof, s: DofInput, time: float, rule: Rule) -> float | None:
    """The speed that a prescribed degree of freedom must have at the end of the step; None if it is not."""
    drive, h = dof.drive, rule.h
    if isinstance(drive, PrescribedSpeed):
        at = time + 0.5 * (1.0 + rule.zeta) * h
        return s.target_qd if drive.table is None else table_value_slope(drive.table, at)[0]
    if not isinstance(drive, PrescribedPosition):
        return None
    if drive.table is None:
        now, rate = s.target_q, s.target_qd
    else:
        now = table_value_slope(drive.table, time)[0]
        rate = (table_value_slope(drive.table, time + h)[0] - now) / h
    return rate + float(np.clip((now - s.q) / h, -s.eta, s.eta))


def box_constraints(
    dof: Dof, s: DofInput, rule: Rule, drive_term: tuple[float, float] | None = None
) -> list[tuple[float, float, float, float, float]]:
    """(sign of the row, bias, compliance, low, high) of every box constraint of `dof`; `drive_term` are the gain and
    the effort of its drive, where its own coordinate alone does not make them.
    """
    rows, h = [], rule.h
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
        least, most = bounds_of(drive)
        gain, start = drive_term or pd_terms(drive, s, rule)
        if gain > 0.0:
            rows.append((1.0, -start / gain, 1.0 / gain, h * least, h * most))
    return rows
