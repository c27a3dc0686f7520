"""Dense solves of the float64 reference: bilateral rows by truncated SVD, box constraints by active sets."""

from __future__ import annotations

import dataclasses

import numpy as np


class Bilateral:
    """Velocities that satisfy J v + b = 0 in the metric of `mass`, of least norm where rows are redundant.

    Args:
        mass: symmetric positive definite (n, n).
        jacobian: (m, n).
        rank: how many singular directions of the unit rows to keep; those above 1e-7 of the largest when None.
            A closed spatial linkage off its assembled manifold by some micrometres has more singular values
            above rounding than it has independent constraints, so the rank is fixed at assembly.
    """

    def __init__(self, mass: np.ndarray, jacobian: np.ndarray, rank: int | None = None) -> None:
        self.lower = np.linalg.cholesky(mass)
        self.inverse = np.linalg.inv(self.lower)
        y = self.inverse @ jacobian.T
        self.scale = 1.0 / np.maximum(np.linalg.norm(y, axis=0), 1e-300)
        u, s, vt = np.linalg.svd(y * self.scale, full_matrices=False)
        self.singular = s
        self.rank = int(np.sum(s > 1e-7 * s.max())) if rank is None and s.size else min(rank or 0, s.size)
        self.u, self.s, self.vt = u[:, : self.rank], s[: self.rank], vt[: self.rank]

    def project(self, velocity: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """The velocity nearest to `velocity` with J v + bias = 0."""
        w = self.lower.T @ velocity
        w = w - self.u @ (self.u.T @ w) - self.u @ ((self.vt @ (self.scale * bias)) / self.s)
        return self.inverse.T @ w

    def compliance(self, jacobian: np.ndarray) -> np.ndarray:
        """Columns P D: velocity per unit impulse along rows D, the bilateral rows held."""
        y = self.inverse @ jacobian.T
        return self.inverse.T @ (y - self.u @ (self.u.T @ y))

    def impulses(self, change: np.ndarray) -> np.ndarray:
        """Least-norm impulses of the rows that make the velocity change `change` (any part they can make)."""
        w = self.lower.T @ change
        return self.scale * (self.vt.T @ ((self.u.T @ w) / self.s))


@dataclasses.dataclass
class Boxes:
    """Box constraints: low <= gamma <= high, complementary to u = J v + bias + compliance * gamma."""

    jacobian: np.ndarray
    bias: np.ndarray
    compliance: np.ndarray
    low: np.ndarray
    high: np.ndarray


def solve_boxes(
    n: np.ndarray, r: np.ndarray, low: np.ndarray, high: np.ndarray, tolerance: float = 1e-11
) -> np.ndarray:
    """gamma in [low, high] with n gamma + r normal to the box; n positive semidefinite.

    Projected Gauss-Seidel finds the active set, a direct solve on it the digits.

    Raises:
        RuntimeError: the residual did not reach 1e-9.
    """
    gamma = np.clip(np.zeros(len(r)), low, high)
    diagonal = np.maximum(np.diag(n), 1e-300)
    scale = 1.0 + np.max(np.abs(r), initial=0.0)

    def residual(g: np.ndarray) -> float:
        return float(np.max(diagonal * np.abs(g - np.clip(g - (n @ g + r) / diagonal, low, high)), initial=0.0))

    for _ in range(400):
        for _ in range(25):
            for i in range(len(r)):
                gamma[i] = np.clip(gamma[i] - (n[i] @ gamma + r[i]) / diagonal[i], low[i], high[i])
        free = (gamma > low) & (gamma < high)
        trial = gamma.copy()
        if free.any():
            held = r[free] + n[np.ix_(free, ~free)] @ gamma[~free]
            trial[free] = np.clip(-np.linalg.lstsq(n[np.ix_(free, free)], held, rcond=1e-13)[0], low[free], high[free])
        best = min((gamma, trial), key=residual)
        if residual(best) <= tolerance * scale:
            return best.copy()
    if residual(best) > 1e-9 * scale:
        raise RuntimeError(f"solve_boxes: residual {residual(best):.3g} after 10000 sweeps; is n semidefinite?")
    return best.copy()
