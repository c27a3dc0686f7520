"""Small vector functions: frames, boxes, outer products, clamping, the exponential map."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def column(m: wp.mat33d, i: int) -> wp.vec3d:
    """Axis `i` of a frame given as a rotation matrix."""
    return wp.vec3d(m[0, i], m[1, i], m[2, i])


@wp.func
def to_float(v: wp.vec3d) -> wp.vec3:
    """Float32 of a difference that was formed in float64."""
    return wp.vec3(float(v[0]), float(v[1]), float(v[2]))


@wp.func
def to_double(v: wp.vec3) -> wp.vec3d:
    """Float64 of a float32 vector."""
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def matrix_to_float(m: wp.mat33d) -> wp.mat33:
    """Float32 of a rotation matrix."""
    return wp.mat33(
        float(m[0, 0]), float(m[0, 1]), float(m[0, 2]),
        float(m[1, 0]), float(m[1, 1]), float(m[1, 2]),
        float(m[2, 0]), float(m[2, 1]), float(m[2, 2]),
    )  # fmt: skip


@wp.func
def turned_extent(m: wp.mat33, half: wp.vec3) -> wp.vec3:
    """Half lengths, along the axes that `m` leads to, of the smallest box around a box of half lengths `half`."""
    reach = wp.vec3()
    for k in range(3):
        reach[k] = wp.dot(wp.abs(wp.vec3(m[k, 0], m[k, 1], m[k, 2])), half)
    return reach


@wp.func
def contact_frame(normal: wp.vec3) -> wp.mat33:
    """Rows: the normal and two tangents (Duff et al. 2017, continuous but at one pole)."""
    sign = wp.where(normal[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + normal[2])
    b = normal[0] * normal[1] * a
    return wp.mat33(
        normal[0], normal[1], normal[2],
        1.0 + sign * normal[0] * normal[0] * a, sign * b, -sign * normal[0],
        b, sign + normal[1] * normal[1] * a, -normal[1],
    )  # fmt: skip


@wp.func
def clamp_length(v: wp.vec3, limit: float) -> wp.vec3:
    """`v`, shortened to `limit`."""
    length = wp.length(v)
    if length > limit:
        return v * (limit / length)
    return v


@wp.func
def cross_columns(d: wp.vec3, m: wp.mat33) -> wp.mat33:
    """[d]x m."""
    return wp.mat33(
        d[1] * m[2, 0] - d[2] * m[1, 0], d[1] * m[2, 1] - d[2] * m[1, 1], d[1] * m[2, 2] - d[2] * m[1, 2],
        d[2] * m[0, 0] - d[0] * m[2, 0], d[2] * m[0, 1] - d[0] * m[2, 1], d[2] * m[0, 2] - d[0] * m[2, 2],
        d[0] * m[1, 0] - d[1] * m[0, 0], d[0] * m[1, 1] - d[1] * m[0, 1], d[0] * m[1, 2] - d[1] * m[0, 2],
    )  # fmt: skip


@wp.func
def inverse_cholesky(m: wp.mat33) -> wp.mat33:
    """L^-1 (lower triangular) of a symmetric positive definite m = L L^T."""
    a = wp.sqrt(m[0, 0])
    b = m[1, 0] / a
    c = m[2, 0] / a
    d = wp.sqrt(m[1, 1] - b * b)
    e = (m[2, 1] - b * c) / d
    f = wp.sqrt(m[2, 2] - c * c - e * e)
    ia = 1.0 / a
    jd = 1.0 / d
    jf = 1.0 / f
    i10 = -b * ia * jd
    return wp.mat33(ia, 0.0, 0.0, i10, jd, 0.0, -(c * ia + e * i10) * jf, -e * jd * jf, jf)


@wp.func
def rotation_vector_of(q: wp.quatd) -> wp.vec3d:
    """Rotation vector of a unit quaternion, of at most half a turn [rad]."""
    if q[3] < wp.float64(0.0):
        q = -q
    v = wp.vec3d(q[0], q[1], q[2])
    s = wp.length(v)
    if s < wp.float64(1e-9):
        return wp.float64(2.0) * v
    return v * (wp.float64(2.0) * wp.atan2(s, q[3]) / s)


@wp.func
def turned(q: wp.quatd, rotation: wp.vec3) -> wp.quatd:
    """exp(rotation) q for a world-frame rotation vector [rad]; renormalised."""
    half = wp.float64(0.5) * to_double(rotation)
    square = wp.dot(half, half)
    s = wp.float64(0.0)
    c = wp.float64(0.0)
    if square < wp.float64(0.01):
        # Taylor series of sinc and cos: the first omitted terms are below 1e-16 here
        s = wp.float64(1.0) + square * (
            wp.float64(-1.0 / 6.0)
            + square
            * (wp.float64(1.0 / 120.0) + square * (wp.float64(-1.0 / 5040.0) + square * wp.float64(1.0 / 362880.0)))
        )
        c = wp.float64(1.0) + square * (
            wp.float64(-0.5)
            + square
            * (wp.float64(1.0 / 24.0) + square * (wp.float64(-1.0 / 720.0) + square * wp.float64(1.0 / 40320.0)))
        )
    else:
        angle = wp.sqrt(square)
        s = wp.sin(angle) / angle
        c = wp.cos(angle)
    result = wp.quatd(half[0] * s, half[1] * s, half[2] * s, c) * q
    # one Newton step towards unit length: the drift of a step is of the order of rounding
    n2 = wp.dot(result, result)
    return result * (wp.float64(1.5) - wp.float64(0.5) * n2)
