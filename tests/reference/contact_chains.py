"""Contacts alone in float64 NumPy: alternating directions over all cones at once, which long chains take thousands of.

As `cones.solve`, whose projections are slow and plain; here they are closed, and for contacts without cohesion only.
"""

from __future__ import annotations

import numpy as np


def project_contacts(p: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """(3 C,) the points of the friction cones nearest to p."""
    n, t = p[0::3], np.hypot(p[1::3], p[2::3])
    outside = np.maximum((n + friction * t) / (1.0 + friction**2), 0.0)
    normal = np.where(t <= friction * n, n, outside)
    pull = np.where(t <= friction * n, 1.0, friction * normal / np.maximum(t, 1e-300))
    return np.stack([normal, pull * p[1::3], pull * p[2::3]], axis=1).ravel()


def contact_residual(n: np.ndarray, r: np.ndarray, friction: np.ndarray, gamma: np.ndarray, exact: bool) -> float:
    """Greatest residual of the natural map over the contacts [m/s]."""
    u = n @ gamma + r
    if exact:
        u[0::3] += friction * np.hypot(u[1::3], u[2::3])
    mean = np.repeat(np.diag(n).reshape(-1, 3).mean(axis=1), 3)
    gap = mean * (gamma - project_contacts(gamma - u / mean, friction))
    return float(np.linalg.norm(gap.reshape(-1, 3), axis=1).max())


def solve_contacts(
    n: np.ndarray, r: np.ndarray, friction: np.ndarray, *, exact: bool, tolerance: float = 1e-9, most: int = 200_000
) -> np.ndarray:
    """Impulses; the penalty is fixed, and De Saxcé's term follows every tenth iteration.

    Raises:
        AssertionError: the tolerance is not reached.
    """
    penalty = 0.05 * np.repeat(np.diag(n).reshape(-1, 3).max(axis=1), 3)
    inverse = np.linalg.inv(n + np.diag(penalty))
    z, y, shift = np.zeros_like(r), np.zeros_like(r), np.zeros_like(r)
    for iteration in range(most):
        x = 1.6 * (inverse @ (penalty * z - y - r - shift)) - 0.6 * z
        z = project_contacts(x + y / penalty, friction)
        y = y + penalty * (x - z)
        if iteration % 10 == 9:
            if exact:
                u = n @ z + r
                shift[0::3] = friction * np.hypot(u[1::3], u[2::3])
            if contact_residual(n, r, friction, z, exact) < tolerance:
                return z
    raise AssertionError(f"no solution to {tolerance:g} m/s in {most} iterations")
