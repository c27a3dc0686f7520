"""Cone complementarity in float64 NumPy for the contact reference: alternating directions over all blocks at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np


@dataclasses.dataclass
class Cones:
    """Box constraints first, then six rows per contact: n, t1, t2, r1, r2, s.

    Attributes:
        low, high: bounds of the leading rows.
        slopes: (contacts, 3) friction, rolling, spinning.
        apex: (contacts,) normal impulse that the contact can pull with.
    """

    low: np.ndarray
    high: np.ndarray
    slopes: np.ndarray
    apex: np.ndarray

    def project(self, p: np.ndarray) -> np.ndarray:
        """The nearest point of the set: the groups that slide are found by trying from the steepest ratio on."""
        boxes = len(self.low)
        q = p.copy()
        q[:boxes] = np.clip(p[:boxes], self.low, self.high)
        if not len(self.apex):
            return q
        c = p[boxes:].reshape(-1, 6)
        lengths = group_lengths(c)
        n = c[:, 0] + self.apex
        # m = n + sum of slope (length - slope m)+ : piecewise linear, its root is the largest over subsets of groups
        # of (n + sum slope length)/(1 + sum slope²), because every subset bounds the right side from below.
        m = np.maximum(n, 0.0)
        for subset in range(1, 8):
            chosen = np.array([subset >> k & 1 for k in range(3)], float)
            top = n + (self.slopes * lengths) @ chosen
            m = np.maximum(m, top / (1.0 + (self.slopes**2) @ chosen))
        out = np.empty_like(c)
        out[:, 0] = m - self.apex
        allowed = self.slopes * m[:, None]
        factor = np.where(lengths <= allowed, 1.0, allowed / np.maximum(lengths, 1e-300))
        out[:, 1:3] = c[:, 1:3] * factor[:, :1]
        out[:, 3:5] = c[:, 3:5] * factor[:, 1:2]
        out[:, 5] = c[:, 5] * factor[:, 2]
        q[boxes:] = out.reshape(-1)
        return q

    def shift(self, u: np.ndarray) -> np.ndarray:
        """De Saxcé's term on the normal rows."""
        boxes = len(self.low)
        added = np.zeros_like(u)
        added[boxes::6] = np.sum(self.slopes * group_lengths(u[boxes:].reshape(-1, 6)), axis=1)
        return added

    def means(self, n: np.ndarray) -> np.ndarray:
        """Per row a scale of its block's diagonal."""
        boxes, d = len(self.low), np.diag(n).copy()
        linear = d[boxes:].reshape(-1, 6)[:, :3].mean(axis=1) if len(self.apex) else np.zeros(0)
        d[boxes:] = np.repeat(linear, 6)
        return np.maximum(d, 1e-300)


def group_lengths(c: np.ndarray) -> np.ndarray:
    """(contacts, 3) lengths of slide, roll and spin."""
    return np.stack([np.hypot(c[:, 1], c[:, 2]), np.hypot(c[:, 3], c[:, 4]), np.abs(c[:, 5])], axis=1)


def solve_cones(
    n: np.ndarray, r: np.ndarray, cones: Cones, *, exact: bool, tolerance: float = 1e-9
) -> tuple[np.ndarray, float]:
    """Impulses and the natural residual [m/s] reached: alternating directions, then Newton on the natural map."""
    if not len(r):
        return r.copy(), 0.0
    means = cones.means(n)

    def residual(z: np.ndarray) -> np.ndarray:
        u = n @ z + r
        if exact:
            u = u + cones.shift(u)
        return means * (z - cones.project(z - u / means))

    z = np.zeros(len(r))
    for weight in (0.1, 0.02, 0.5, 0.004):
        z = _alternate(n, r, cones, exact, z, weight * means, residual)
        z = _newton(z, residual)
        if np.max(np.abs(residual(z))) < tolerance:
            break
    return z, float(np.max(np.abs(residual(z))))


def _alternate(
    n: np.ndarray, r: np.ndarray, cones: Cones, exact: bool, start: np.ndarray, penalty: np.ndarray, residual: Callable,
    most: int = 1000,
) -> np.ndarray:  # fmt: skip
    """The best of `most` iterations of alternating directions; De Saxcé's term follows every tenth."""
    inverse = np.linalg.inv(n + np.diag(penalty))
    z = best = start
    shift = cones.shift(n @ z + r) if exact else np.zeros(len(r))
    y = -(n @ z + r + shift)
    for iteration in range(most):
        x = inverse @ (penalty * z - y - r - shift)
        x = 1.6 * x - 0.6 * z
        z = cones.project(x + y / penalty)
        y = y + penalty * (x - z)
        if iteration % 10 == 9:
            if exact:
                shift = cones.shift(n @ z + r)
            if np.max(np.abs(residual(z))) < np.max(np.abs(residual(best))):
                best = z.copy()
            if np.max(np.abs(residual(best))) < 1e-7:
                break
    return best


def _newton(z: np.ndarray, residual: Callable, most: int = 30) -> np.ndarray:
    """Damped Newton steps with a Jacobian by differences, as long as they help."""
    for _ in range(most):
        f = residual(z)
        size = float(np.linalg.norm(f))
        if size < 1e-12:
            break
        width = 1e-7 * max(float(np.max(np.abs(z))), 1e-6)
        jacobian = np.stack([(residual(z + width * e) - f) / width for e in np.eye(len(z))], axis=1)
        change = np.linalg.lstsq(jacobian, -f, rcond=1e-10)[0]
        for halving in range(8):
            trial = z + 0.5**halving * change
            if np.linalg.norm(residual(trial)) < 0.9 * size:
                z = trial
                break
        else:
            break
    return z
