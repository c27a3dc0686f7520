"""Rotations of a body as observations tell them, and turns about the vertical. Quaternions are xyzw."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))


@wp.func
def rotate_back(q: wp.quat, v: wp.vec3) -> wp.vec3:
    """A vector of the world in the axes of a body."""
    axis = wp.vec3(q[0], q[1], q[2])
    twice = 2.0 * wp.cross(v, axis)
    return v + q[3] * twice + wp.cross(twice, axis)


@wp.func
def euler_123(q: wp.quat) -> wp.vec3:
    """Cardan angles: about x, then about the new y, then about the new z."""
    x = q[0]
    y = q[1]
    z = q[2]
    w = q[3]
    first = wp.atan2(2.0 * (w * x - y * z), 1.0 - 2.0 * (x * x + y * y))
    second = wp.asin(wp.clamp(2.0 * (x * z + w * y), -1.0, 1.0))
    third = wp.atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (y * y + z * z))
    return wp.vec3(first, second, third)


@wp.func
def heading_quaternion(angle: wp.float64) -> wp.quatd:
    """The turn by an angle about the vertical."""
    half = HALF * angle
    return wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.sin(half), wp.cos(half))


@wp.func
def rotate(q: wp.quatd, v: wp.vec3d) -> wp.vec3d:
    """A vector of a body's axes in those of the world."""
    axis = wp.vec3d(q[0], q[1], q[2])
    twice = TWO * wp.cross(axis, v)
    return v + q[3] * twice + wp.cross(axis, twice)


@wp.func
def quat_product(a: wp.quatd, b: wp.quatd) -> wp.quatd:
    """The second turn before the first."""
    return wp.quatd(
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@wp.func
def tilt_to(normal: wp.vec3d) -> wp.quatd:
    """The shortest turn that takes the vertical to a unit vector that looks upwards."""
    w = ONE + normal[2]
    length = wp.sqrt(normal[1] * normal[1] + normal[0] * normal[0] + w * w)
    return wp.quatd(-normal[1] / length, normal[0] / length, wp.float64(0.0), w / length)


@wp.func
def heading_of(q: wp.quatd) -> wp.float64:
    """Direction in which a body's x axis points, seen from above."""
    return wp.atan2(TWO * (q[3] * q[2] + q[0] * q[1]), ONE - TWO * (q[1] * q[1] + q[2] * q[2]))


@wp.func
def to_heading(away: wp.vec2, heading: float) -> wp.vec2:
    """A plane vector of the world in axes of a heading: ahead and to the left."""
    c = wp.cos(heading)
    s = wp.sin(heading)
    return wp.vec2(c * away[0] + s * away[1], c * away[1] - s * away[0])
