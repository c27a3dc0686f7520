"""What a wheel meets of solids around it: slow, float64, from points that are inside or not.

A solid is a signed distance function of points (N, 3), negative inside. Along each ray the first point inside is
searched in small steps and then by bisection; normals are gradients by differences. Nothing is shared with the kernel
but the rule in its docstring.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tests.reference.tires import Wheel, unit

Solid = Callable[[np.ndarray], np.ndarray]
UP = np.array([0.0, 0.0, 1.0])


def half_space(normal, height=0.0) -> Solid:
    """All below a plane through (0, 0, height)."""
    n = unit(np.asarray(normal, dtype=float))
    return lambda p: (p - [0.0, 0.0, height]) @ n


def ball(centre, radius) -> Solid:
    return lambda p: np.linalg.norm(p - centre, axis=-1) - radius


def capsule(a, b, radius) -> Solid:
    """All within a radius of the segment from a to b."""
    a, along = np.asarray(a, dtype=float), np.subtract(b, a)

    def distance(p):
        t = np.clip((p - a) @ along / (along @ along), 0.0, 1.0)
        return np.linalg.norm(p - a - t[..., None] * along, axis=-1) - radius

    return distance


def box(centre, axes, half) -> Solid:
    """A box whose axes are the columns of a matrix."""

    def distance(p):
        d = np.abs((p - centre) @ axes) - half
        return np.linalg.norm(np.maximum(d, 0.0), axis=-1) + np.minimum(d.max(axis=-1), 0.0)

    return distance


def first_inside(solids: Sequence[Solid], start, direction, reach):
    """Distance along a ray to the first point in one of the solids that does not hold its start, and that solid."""
    t = np.linspace(0.0, reach, 1201)
    points = start + t[:, None] * direction
    best, found = reach, None
    for solid in solids:
        inside = solid(points) < 0.0
        if inside[0] or not inside.any():
            continue
        k = int(np.argmax(inside))
        low, high = t[k - 1], t[k]
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if solid((start + middle * direction)[None])[0] < 0.0 else (middle, high)
        if high < best:
            best, found = high, solid
    return best, found


def normal_at(solid: Solid, point) -> np.ndarray:
    steps = 1e-6 * np.eye(3)
    return unit(solid(point + steps) - solid(point - steps))


def envelope_of(wheel: Wheel, radius: float, width: float, solids: Sequence[Solid]):
    """Normal and deflection; None where nothing is met."""
    across = unit(np.cross(wheel.axis, UP))
    down = np.cross(wheel.axis, across)
    push, shared, lean = np.zeros(3), 0.0, 0.0
    for aside in (-width / 3.0, 0.0, width / 3.0):
        start, v = wheel.x + aside * wheel.axis, np.zeros(3)
        for angle in np.radians(2.0 * np.arange(120) - 119.0):
            direction = np.cos(angle) * down + np.sin(angle) * np.cross(down, wheel.axis)
            t, solid = first_inside(solids, start, direction, radius)
            if solid is None:
                continue
            share = 0.5 * (radius**2 - t**2)
            v = v + share * direction
            shared += share
            lean += share * normal_at(solid, start + t * direction) @ wheel.axis
        if np.any(v):
            push = push - deflection_of(np.linalg.norm(v) * np.radians(2.0) / radius**2, radius) * unit(v) / 3.0
    if not np.any(push):
        return None
    lean /= shared
    return np.sqrt(1.0 - lean**2) * unit(push) + lean * wheel.axis, float(np.linalg.norm(push))


def deflection_of(share, radius):
    """Deflection of a disc of which a straight line cuts off so much: sin q - cos² q asinh(tan q), by bisection."""
    low, high = 0.0, 1.55
    for _ in range(100):
        q = 0.5 * (low + high)
        low, high = (q, high) if np.sin(q) - np.cos(q) ** 2 * np.arcsinh(np.tan(q)) < share else (low, q)
    return radius * (1.0 - np.cos(low))
