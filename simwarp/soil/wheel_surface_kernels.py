"""Surface of a rigid wheel above a point of the ground: one quadratic and two flat sides."""

import warp as wp

wp.set_module_options({"enable_backward": False})

NOTHING = wp.constant(1.0e30)
"""Height where a wheel is not above a point."""
EDGE = wp.constant(0.99999)
"""Of the half width: where the edge of the tread is looked up."""
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
def below_share(t: float, long: float, short: float) -> float:
    """Share of a cell where its coordinate along a direction is below t: the sum of two uniform variables of widths
    `long` >= `short`.
    """
    if short < 1.0e-3 * long:
        return wp.clamp(t / long + 0.5, 0.0, 1.0)
    s = wp.clamp(t, -0.5 * (long + short), 0.5 * (long + short))
    total = float(0.0)
    for k in range(4):
        corner = wp.where(k < 2, long, -long) + wp.where(k % 2 == 0, short, -short)
        sign = wp.where(k == 0 or k == 3, 1.0, -1.0)
        ahead = wp.max(s + 0.5 * corner, 0.0)
        total += sign * ahead * ahead
    return wp.clamp(total / (2.0 * long * short), 0.0, 1.0)


@wp.struct
class Column:
    """What stands above a node's cell."""

    height: float  # of the wheel's lowest point, from its centre [m]; `NOTHING`
    share: float  # of the cell


@wp.func
def column_above(
    dx: float, dy: float, axis: wp.vec3, radius: float, half_width: float, crown: float, cell: float
) -> Column:
    """A node beside the tread counts as if moved along the axis to its edge, for the share of its cell that lies
    within the width; `cell` is its side [m], 0: nodes count in full or not at all.
    """
    c = Column()
    c.share = 1.0
    flat = wp.sqrt(axis[0] * axis[0] + axis[1] * axis[1])
    across = axis[0] * dx + axis[1] * dy
    a = 1.0 - axis[2] * axis[2]
    b = -across * axis[2]
    root = b * b - a * (dx * dx + dy * dy - across * across - radius * radius)
    if cell > 0.0 and flat > 1.0e-3 and root > 0.0:
        y = across + axis[2] * (-b - wp.sqrt(root)) / a
        level_x = axis[0] / flat
        level_y = axis[1] / flat
        long = cell * wp.max(wp.abs(level_x), wp.abs(level_y))
        short = cell * wp.min(wp.abs(level_x), wp.abs(level_y))
        inside = below_share((half_width - y) * flat, long, short) - below_share((-half_width - y) * flat, long, short)
        if inside > 0.0:
            shift = (wp.clamp(y, -EDGE * half_width, EDGE * half_width) - y) * flat
            c.share = inside
            c.height = lowest_point(dx + shift * level_x, dy + shift * level_y, axis, radius, half_width, crown)
            return c
    c.height = lowest_point(dx, dy, axis, radius, half_width, crown)
    return c
