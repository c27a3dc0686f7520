"""Equilibria of rods without elements, float64: the exact rod's differential equations by shooting; the catenary.

The rod x' = R (Gamma + e_1), R' = R [kappa] with Gamma = R^T n / (EA, kGA, kGA) and kappa = kappa_0 +
R^T m / (GJ, EI, EI), n' = -q, m' = -x' x n is integrated from its clamp by an eighth-order rule; Newton's method finds
the clamp's moment. It shares nothing with the elements of `tests.reference.rods`.

Sources: S.S. Antman, Nonlinear Problems of Elasticity, chapter 8; H.M. Irvine, Cable Structures, section 1.5.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from tests.reference.rods import Array


@dataclasses.dataclass(frozen=True)
class Cantilever:
    """A rod clamped at s = 0 with dead loads.

    Attributes:
        length: [m].
        stiffness: EA, kGA_y, kGA_z, GJ, EI_y, EI_z.
        force: at the tip [N].
        moment: at the tip, direction kept [N m].
        distributed: dead force per length [N/m].
        curvature: kappa_0, the same everywhere [1/m].
        frame: (3, 3) of the clamp.
    """

    length: float
    stiffness: Sequence[float]
    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    distributed: Sequence[float] = (0.0, 0.0, 0.0)
    curvature: Sequence[float] = (0.0, 0.0, 0.0)
    frame: Array = dataclasses.field(default_factory=lambda: np.eye(3))


def _integrate(rod: Cantilever, part: float, root_moment: Array) -> Array:
    """(15,) position, rotation by rows, moment at the tip, for a moment at the clamp."""
    c = np.array(rod.stiffness, float)
    force, line = part * np.array(rod.force), part * np.array(rod.distributed)
    curvature = np.array(rod.curvature)

    def slope(s: float, y: Array) -> Array:
        rotation = y[3:12].reshape(3, 3)
        n = force + line * (rod.length - s)
        along = rotation @ (rotation.T @ n / c[:3] + np.array([1.0, 0.0, 0.0]))
        k = curvature + rotation.T @ y[12:] / c[3:]
        hat = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
        return np.concatenate([along, (rotation @ hat).ravel(), -np.cross(along, n)])

    start = np.concatenate([np.zeros(3), np.asarray(rod.frame).ravel(), root_moment])
    return solve_ivp(slope, (0.0, rod.length), start, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]


def tip(rod: Cantilever, steps: int = 4, guess: Array | None = None) -> tuple[Array, Array]:
    """Position (3,) and rotation (3, 3) of the tip.

    Args:
        rod: what bends.
        steps: of the load; with a guess one step is made.
        guess: moment at the clamp, for the branch that is meant.

    Raises:
        RuntimeError: where Newton's method ends nowhere.
    """
    moment = np.zeros(3) if guess is None else np.array(guess)
    scale = max(float(np.max(rod.stiffness[3:])) / rod.length, 1e-300)
    parts = [1.0] if guess is not None else [(k + 1) / steps for k in range(steps)]
    for part in parts:

        def off(m: Array, part: float = part) -> Array:
            return (_integrate(rod, part, m * scale)[12:] - part * np.array(rod.moment)) / scale

        found = root(off, moment / scale, tol=1e-12)
        if np.abs(found.fun).max() > 1e-8:
            raise RuntimeError(f"the shooting found no moment of the clamp at {part:.3g} of the load: {found.message}")
        moment = found.x * scale
    end = _integrate(rod, 1.0, moment)
    return end[:3], end[3:12].reshape(3, 3)


@dataclasses.dataclass(frozen=True)
class Catenary:
    """An elastic cable between two points of one height, without bending stiffness.

    Attributes:
        span: distance of the ends [m].
        length: unstretched [m].
        weight: per unstretched length [N/m].
        axial: EA [N].
    """

    span: float
    length: float
    weight: float
    axial: float

    def horizontal(self) -> float:
        """Horizontal part of the tension [N]."""

        def gap(h: float) -> float:
            half = 0.5 * self.weight * self.length
            return h * self.length / self.axial + 2.0 * h / self.weight * np.arcsinh(half / h) - self.span

        return float(brentq(gap, 1e-6 * self.weight * self.length, 1e3 * self.weight * self.length + self.axial))

    def sag(self) -> float:
        """Depth of the middle below the ends [m]."""
        h, half = self.horizontal(), 0.5 * self.length
        end = self.weight * half / h
        return float(self.weight * half**2 / (2.0 * self.axial) + h / self.weight * (np.sqrt(1.0 + end**2) - 1.0))

    def end_force(self) -> tuple[float, float]:
        """Horizontal and vertical force of an end's support [N]."""
        return self.horizontal(), 0.5 * self.weight * self.length
