"""Surface of a rigid wheel above a point of the ground: one quadratic and two flat sides."""

import warp as wp

wp.set_module_options({"enable_backward": False})

NOTHING = wp.constant(1.0e30)
"""Height where a wheel is not above a point."""
UPRIGHT = wp.constant(1.0e-6)
"""Vertical part of an axis below which a wheel's sides are taken as vertical."""


@wp.func
def lowest_point(dx: float, dy: float, axis: wp.vec3, radius: float, half_width: float, crown: float) -> float:
    """Height of the lowest point of a wheel over (dx, dy), all from its centre [m]; `NOTHING` beside it.

    Args:
        dx, dy: of the vertical line, world axes.
        axis: unit.
        radius: in the middle plane.
        half_width: of the cylinder.
        crown: radius of the tread across; 0: it is flat. Taken where the line crosses the height of the centre.
    """
    across = axis[0] * dx + axis[1] * dy
    r = radius
    if crown > 0.0:
        r = radius - 0.5 * across * across / crown
    a = 1.0 - axis[2] * axis[2]
    if a <= UPRIGHT:  # it lies on its side: a disc
        if dx * dx + dy * dy > r * r:
            return NOTHING
        return -half_width
    b = -across * axis[2]
    c = dx * dx + dy * dy - across * across - r * r
    root = b * b - a * c
    if root <= 0.0:
        return NOTHING
    root = wp.sqrt(root)
    low = (-b - root) / a
    if wp.abs(axis[2]) < UPRIGHT:
        return wp.where(wp.abs(across) <= half_width, low, NOTHING)
    first = (-half_width - across) / axis[2]
    second = (half_width - across) / axis[2]
    low = wp.max(low, wp.min(first, second))
    if low > wp.min((-b + root) / a, wp.max(first, second)):
        return NOTHING
    return low


@wp.func
def share_inside(dx: float, dy: float, axis: wp.vec3, half_width: float, spacing: float) -> float:
    """Share of a node's cell that lies between the planes of the wheel's sides, 0 to 1."""
    flat = wp.sqrt(axis[0] * axis[0] + axis[1] * axis[1])
    if flat < UPRIGHT:
        return 1.0
    across = wp.abs(axis[0] * dx + axis[1] * dy) / flat
    # width of the cell across the wheel
    cell = spacing * (wp.abs(axis[0]) + wp.abs(axis[1])) / flat
    return wp.clamp((half_width / flat - across) / cell + 0.5, 0.0, 1.0)
