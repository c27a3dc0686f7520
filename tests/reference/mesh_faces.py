"""Contacts of balls on triangles between nodes, and a step with them by dense algebra, in float64."""

from __future__ import annotations

import dataclasses

import numpy as np

from tests.reference.contact_solve import Cones, solve_cones
from tests.reference.contact_step import tangents


@dataclasses.dataclass(frozen=True)
class FaceContact:
    """Shares of a triangle's corners, the normal from the triangle to the ball, and the gap [m]."""

    shares: np.ndarray
    normal: np.ndarray
    gap: float


def nearest_shares(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Shares of the corners in the point of a triangle that is nearest to a point: of its inside, edges and corners the
    nearest one.
    """
    best, least = np.zeros(3), np.inf
    for chosen in ((0, 1, 2), (0, 1), (1, 2), (2, 0), (0,), (1,), (2,)):
        base = corners[chosen[0]]
        axes = (corners[list(chosen[1:])] - base).T
        along = np.linalg.lstsq(axes, point - base, rcond=None)[0] if axes.size else np.zeros(0)
        part = np.array([1.0 - along.sum(), *along])
        apart = float(np.linalg.norm(base + axes @ along - point)) if axes.size else float(np.linalg.norm(base - point))
        if (part >= 0.0).all() and apart < least:
            best, least = np.zeros(3), apart
            best[list(chosen)] = part
    return best


def ball_on_face(centre: np.ndarray, radius: float, corners: np.ndarray, thick: float) -> FaceContact:
    """Contact of a ball with a triangle that is thickened by `thick` [m]."""
    shares = nearest_shares(centre, corners)
    apart = centre - shares @ corners
    distance = float(np.linalg.norm(apart))
    return FaceContact(shares, apart / distance, distance - radius - thick)


def change_with_contact(
    matrix: np.ndarray, impulse: np.ndarray, rows: np.ndarray, start: np.ndarray, jacobian: np.ndarray,
    contact: FaceContact, friction: float, h: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Change of all velocities in a step with one contact, and its impulse along the normal and two tangents.

    Args:
        matrix, impulse: of the velocities without joints and contacts.
        rows: velocities that joints keep at zero.
        start: velocities before.
        jacobian: (3, n) relative velocity in the contact, world axes.
        contact: of the step.
        friction: coefficient.
        h: step [s].
    """
    count, held = len(matrix), len(rows)
    whole = np.block([[matrix, rows.T], [rows, np.zeros((held, held))]])
    inverse = np.linalg.inv(whole)
    free = (inverse @ np.concatenate([impulse, -rows @ start]))[:count]
    frame = np.stack([contact.normal, *tangents(contact.normal)])
    j = frame @ jacobian
    delassus, u = np.zeros((6, 6)), np.zeros(6)
    delassus[:3, :3] = j @ inverse[:count, :count] @ j.T
    u[:3] = j @ (start + free)
    u[0] += max(contact.gap / h, -0.6)
    cones = Cones(np.zeros(0), np.zeros(0), np.array([[friction, 0.0, 0.0]]), np.zeros(1))
    found, residual = solve_cones(delassus, u, cones, exact=True, tolerance=1e-12)
    assert residual < 1e-9
    return free + (inverse[:count, :count] @ j.T) @ found[:3], found[:3]
