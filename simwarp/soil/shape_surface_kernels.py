"""Surfaces of boxes, balls and capsules above a point of the ground, as wheels have theirs (`wheel_surface`)."""

import warp as wp

from simwarp.soil.wheel_surface_kernels import NOTHING, UPRIGHT, Column, below_share

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

GENTLE = wp.constant(0.2)
"""Vertical part of a face's normal above which the soil takes its whole area; steeper ones hardly press on it."""


@wp.func
def box_low(dx: float, dy: float, axes: wp.mat33, half: wp.vec3) -> float:
    """Height of the lowest point of a box over (dx, dy), from its centre; columns of `axes` are its axes.

    The last of the vertical line's entries into its three slabs (Kay and Kajiya 1986).
    """
    low = float(-NOTHING)
    high = float(NOTHING)
    for k in range(3):
        across = axes[0, k] * dx + axes[1, k] * dy
        rise = axes[2, k]
        if wp.abs(rise) < UPRIGHT:
            if wp.abs(across) > half[k]:
                return NOTHING
        else:
            middle = -across / rise
            reach = half[k] / wp.abs(rise)
            low = wp.max(low, middle - reach)
            high = wp.min(high, middle + reach)
    return wp.where(low <= high, low, NOTHING)


@wp.func
def lowest_face(axes: wp.mat33) -> int:
    """The axis whose face points down most."""
    k = wp.where(wp.abs(axes[2, 1]) > wp.abs(axes[2, 0]), 1, 0)
    return wp.where(wp.abs(axes[2, 2]) >= wp.abs(axes[2, k]), 2, k)


@wp.func
def box_column(dx: float, dy: float, axes: wp.mat33, half: wp.vec3, cell: float) -> Column:
    """A cell that lies partly below the lowest face counts for that part, at the face's nearest point to its node;
    `cell` as in `column_above`. Where another face goes on beyond an edge, as steep as `GENTLE` at most, nothing is
    cut off there: nodes below that face count in full.
    """
    c = Column()
    c.share = 1.0
    c.height = NOTHING
    face = lowest_face(axes)
    rise = axes[2, face]
    beyond = bool(cell <= 0.0 or wp.abs(rise) < UPRIGHT)
    if not beyond:
        depth = -wp.sign(rise) * half[face]
        z = (depth - axes[0, face] * dx - axes[1, face] * dy) / rise
        height = depth * rise
        share = float(1.0)
        for step in range(1, 3):
            k = (face + step) % 3
            place = axes[0, k] * dx + axes[1, k] * dy + axes[2, k] * z
            # how that coordinate grows along the ground, on the face
            lean = axes[2, k] / rise
            grow_x = axes[0, k] - lean * axes[0, face]
            grow_y = axes[1, k] - lean * axes[1, face]
            grow = wp.sqrt(grow_x * grow_x + grow_y * grow_y)
            long = cell * wp.max(wp.abs(grow_x), wp.abs(grow_y)) / grow
            short = cell * wp.min(wp.abs(grow_x), wp.abs(grow_y)) / grow
            inside = float(1.0)
            if axes[2, k] > -GENTLE:
                inside = below_share((half[k] - place) / grow, long, short)
            elif place > half[k]:
                beyond = True
            if axes[2, k] < GENTLE:
                inside -= below_share((-half[k] - place) / grow, long, short)
            elif place < -half[k]:
                beyond = True
            share *= wp.max(inside, 0.0)
            height += axes[2, k] * wp.clamp(place, -half[k], half[k])
        if share > 0.0 and not beyond:
            c.share = share
            c.height = height
    if beyond:
        c.height = box_low(dx, dy, axes, half)
    return c


@wp.func
def ball_low(dx: float, dy: float, radius: float) -> float:
    """Of a ball about the origin."""
    square = radius * radius - dx * dx - dy * dy
    if square <= 0.0:
        return NOTHING
    return -wp.sqrt(square)


@wp.func
def capsule_low(dx: float, dy: float, axis: wp.vec3, radius: float, half_length: float) -> float:
    """Of a capsule: the lowest of its two balls and its tube."""
    low = float(NOTHING)
    for end in range(2):
        along = wp.where(end == 0, -half_length, half_length)
        z = ball_low(dx - along * axis[0], dy - along * axis[1], radius)
        if z != NOTHING:
            low = wp.min(low, along * axis[2] + z)
    across = axis[0] * dx + axis[1] * dy
    a = 1.0 - axis[2] * axis[2]
    if a > UPRIGHT:
        b = -across * axis[2]
        root = b * b - a * (dx * dx + dy * dy - across * across - radius * radius)
        if root > 0.0:
            z = (-b - wp.sqrt(root)) / a
            if wp.abs(across + axis[2] * z) <= half_length:
                low = wp.min(low, z)
    return low
