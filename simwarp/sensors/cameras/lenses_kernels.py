"""Lenses: where a point of the image looks, as a direction in the camera's axes (X forward, Y left, Z up).

A point of the image is (u, v): u from -1 at the left edge to 1 at the right, v up, in the same unit (half widths).
"""

from enum import IntEnum

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


class LensKind(IntEnum):
    """Law between the distance from the middle of the image and the angle from the axis."""

    PINHOLE = 0
    FISH_EYE = 1
    RADIAL = 2


FISH_EYE = wp.constant(int(LensKind.FISH_EYE))
RADIAL = wp.constant(int(LensKind.RADIAL))
NEWTON_STEPS = wp.constant(24)  # most; two to five do unless the lens nearly folds
NEWTON_TOLERANCE = wp.constant(2.0e-7)  # relative


@wp.struct
class Lens:
    """Numbers of a lens, shared by all worlds."""

    kind: int  # LensKind
    scale: float  # tan(fov / 2), or fov / 2 of a fish-eye [rad]: at u = 1
    k: wp.vec3  # radial coefficients
    limit: float  # largest undistorted distance of the image, in focal lengths; the law rises up to there


@wp.func
def undistorted(target: float, k: wp.vec3, limit: float) -> float:
    """The distance that a radial lens moves to `target`: Newton's method, kept in a bracket by bisection."""
    low = float(0.0)
    high = limit
    r = wp.min(target, limit)
    for _ in range(NEWTON_STEPS):
        s = r * r
        error = r * (1.0 + s * (k[0] + s * (k[1] + s * k[2]))) - target
        if error > 0.0:
            high = r
        else:
            low = r
        slope = 1.0 + s * (3.0 * k[0] + s * (5.0 * k[1] + s * 7.0 * k[2]))
        following = r - error / slope
        # also where the slope is 0 or negative
        if not (following >= low and following <= high and slope > 0.0):
            following = 0.5 * (low + high)
        change = wp.abs(following - r)
        r = following
        if change <= NEWTON_TOLERANCE * r:
            break
    return r


@wp.func
def lens_direction(u: float, v: float, lens: Lens) -> wp.vec3:
    """Unit direction in the camera's axes of the point (u, v) of the image."""
    x = u * lens.scale
    y = v * lens.scale
    if lens.kind == FISH_EYE:
        # the FOV model (Devernay and Faugeras 2001) whose angle is that of the image: the angle from the axis grows
        # in proportion to the distance
        angle = wp.sqrt(x * x + y * y)
        across = float(1.0)
        if angle > 1.0e-4:
            across = wp.sin(angle) / angle
        return wp.vec3(wp.cos(angle), -across * x, across * y)
    if lens.kind == RADIAL:
        r = wp.sqrt(x * x + y * y)
        if r > 1.0e-6:
            factor = undistorted(r, lens.k, lens.limit) / r
            x *= factor
            y *= factor
    inverse = 1.0 / wp.sqrt(1.0 + x * x + y * y)
    return wp.vec3(inverse, -x * inverse, y * inverse)
