"""Algebra of the second-order cone {x0 >= |(x1, x2)|} for the interior point, in double precision registers.

W is the Nesterov-Todd scaling of a pair (x, z): W z = W^-1 x, W = eta [[w0, w^T], [w, 1 + w w^T / (1 + w0)]].
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(wp.float64(1.0e30))
TINY = wp.constant(wp.float64(1.0e-150))


@wp.func
def determinant(x: wp.vec3d) -> wp.float64:
    """x0^2 - x1^2 - x2^2, without cancellation near the boundary; at least a tiny number."""
    t = wp.sqrt(x[1] * x[1] + x[2] * x[2])
    return wp.max((x[0] - t) * (x[0] + t), TINY)


@wp.func
def reflected(x: wp.vec3d) -> wp.vec3d:
    """(x0, -x1, -x2)."""
    return wp.vec3d(x[0], -x[1], -x[2])


@wp.func
def scaling_point(x: wp.vec3d, z: wp.vec3d) -> wp.vec3d:
    """Point w of the scaling, of determinant one."""
    a = x / wp.sqrt(determinant(x))
    b = z / wp.sqrt(determinant(z))
    half = wp.sqrt(wp.float64(0.5) * (wp.float64(1.0) + wp.dot(a, b)))
    return (a + reflected(b)) / (wp.float64(2.0) * half)


@wp.func
def scaling_size(x: wp.vec3d, z: wp.vec3d) -> wp.float64:
    """Size eta of the scaling."""
    return wp.sqrt(wp.sqrt(determinant(x) / determinant(z)))


@wp.func
def scaled(w: wp.vec3d, v: wp.vec3d) -> wp.vec3d:
    """W v without eta; for W^-1 pass the mirrored w."""
    d = w[1] * v[1] + w[2] * v[2]
    f = v[0] + d / (wp.float64(1.0) + w[0])
    return wp.vec3d(w[0] * v[0] + d, v[1] + w[1] * f, v[2] + w[2] * f)


@wp.func
def jordan(a: wp.vec3d, b: wp.vec3d) -> wp.vec3d:
    """The product a o b = (a^T b, a0 b1 + b0 a1, a0 b2 + b0 a2)."""
    return wp.vec3d(wp.dot(a, b), a[0] * b[1] + b[0] * a[1], a[0] * b[2] + b[0] * a[2])


@wp.func
def jordan_divide(a: wp.vec3d, b: wp.vec3d) -> wp.vec3d:
    """The y with a o y = b."""
    y0 = (a[0] * b[0] - a[1] * b[1] - a[2] * b[2]) / determinant(a)
    return wp.vec3d(y0, (b[1] - y0 * a[1]) / a[0], (b[2] - y0 * a[2]) / a[0])


@wp.func
def longest_step(x: wp.vec3d, d: wp.vec3d) -> wp.float64:
    """The greatest s for which x + s d stays in the cone; x is inside."""
    c = determinant(x)
    b = x[0] * d[0] - x[1] * d[1] - x[2] * d[2]
    a = d[0] * d[0] - d[1] * d[1] - d[2] * d[2]
    step = wp.float64(FAR)
    root = b * b - a * c
    if root >= wp.float64(0.0):
        # Roots of a s^2 + 2 b s + c without cancellation.
        q = -b - wp.sqrt(root)
        if b < wp.float64(0.0):
            q = -b + wp.sqrt(root)
        if q != wp.float64(0.0):
            if c / q > wp.float64(0.0):
                step = wp.min(step, c / q)
        if a != wp.float64(0.0):
            if q / a > wp.float64(0.0):
                step = wp.min(step, q / a)
    if d[0] < wp.float64(0.0):
        step = wp.min(step, -x[0] / d[0])
    return step


@wp.func
def moved_inside_cone(x: wp.vec3d) -> wp.vec3d:
    """x, at least a hair inside the cone: rounding must not put it on the boundary."""
    t = wp.sqrt(x[1] * x[1] + x[2] * x[2])
    return wp.vec3d(wp.max(x[0], t * wp.float64(1.0 + 1.0e-14) + wp.float64(1.0e-60)), x[1], x[2])
