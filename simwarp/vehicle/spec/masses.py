"""Masses of described parts: inertia matrices, and the one body that a chassis' components make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from simwarp.vehicle.spec.parts import RigidPart

Array: TypeAlias = npt.NDArray[np.float64]


def inertia_matrix(part: RigidPart) -> Array:
    """(3, 3) inertia about the centre of mass in the axes that it was given in [kg·m²]."""
    xy, xz, yz = part.products
    return np.diag(part.inertia) + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])


def merged(parts: Sequence[RigidPart]) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg·m²] of one body of all parts."""
    mass = sum(part.mass for part in parts)
    com = sum(part.mass * np.array(part.com) for part in parts) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        offset = np.array(part.com) - com
        inertia += inertia_matrix(part) + part.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return float(mass), np.asarray(com), inertia
