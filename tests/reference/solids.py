"""Solid elements in float64: energies written down, forces as their slopes by differences, statics by Newton's method.

    Elastic   V (μ E:E + λ/2 (tr E)²),   E = (FᵀF - 1) / 2
    Rubber    V (μ/2 (tr FᵀF - 3) + (λ + μ)/2 (J - 1)² - μ (J - 1))

A hexahedron adds ½ q·K q with q = Rᵀ Σ γ_a x_a, R of the polar decomposition of F (by singular values).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

CORNERS = 2.0 * np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]) - 1.0


def middle_gradients(corners: Array) -> tuple[Array, float]:
    """Gradients of the shape functions in the middle of an element, and its volume by that point alone."""
    if len(corners) == 4:
        coefficients = np.linalg.inv(np.column_stack([np.ones(4), corners]))
        return coefficients[1:].T, abs(float(np.linalg.det(corners[1:] - corners[0]))) / 6.0
    jacobian = corners.T @ CORNERS / 8.0
    return CORNERS / 8.0 @ np.linalg.inv(jacobian), 8.0 * float(np.linalg.det(jacobian))


def rotation(gradient: Array) -> Array:
    """The rotation next to a deformation gradient."""
    left, _, right = np.linalg.svd(gradient)
    sign = np.diag([1.0, 1.0, np.linalg.det(left) * np.linalg.det(right)])
    found: Array = left @ sign @ right
    return found


def energy(
    x: Array, rest: Array, first: float, second: float, *, rubber: bool, hourglass: tuple[Array, Array] | None = None
) -> float:
    """Energy of one element [J].

    Args:
        x: (n, 3) corners.
        rest: the same at rest.
        first: Lamé's λ [Pa].
        second: Lamé's μ [Pa].
        rubber: the law.
        hourglass: shapes γ (4, 8) and stiffness (12, 12).
    """
    gradients, volume = middle_gradients(rest)
    f = x.T @ gradients
    if rubber:
        change = np.linalg.det(f) - 1.0
        density = 0.5 * second * (np.sum(f * f) - 3.0) + 0.5 * (first + second) * change**2 - second * change
    else:
        strain = 0.5 * (f.T @ f - np.eye(3))
        density = second * np.sum(strain * strain) + 0.5 * first * np.trace(strain) ** 2
    total = volume * density
    if hourglass is not None:
        shapes, stiffness = hourglass
        amounts = (shapes @ x @ rotation(f)).ravel()
        total += 0.5 * amounts @ stiffness @ amounts
    return float(total)


def slope(function: Callable[[Array], float], x: Array, step: float) -> Array:
    """Central differences of fourth order of a function of (n, 3)."""
    out = np.zeros_like(x)
    for index in np.ndindex(x.shape):
        change = np.zeros_like(x)
        change[index] = step
        near = function(x + change) - function(x - change)
        out[index] = (8.0 * near - function(x + 2 * change) + function(x - 2 * change)) / (12.0 * step)
    return out


def timoshenko(load: float, length: float, height: float, width: float, young: float, poisson: float) -> float:
    """Deflection of a cantilever's tip by bending and shear, P L³ / 3EI + P L / kGA with k = 5/6 [m]."""
    inertia, area = width * height**3 / 12.0, width * height
    shear = young / (2.0 * (1.0 + poisson))
    return load * length**3 / (3.0 * young * inertia) + load * length / (5.0 / 6.0 * shear * area)
