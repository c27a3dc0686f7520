"""First hit of a ray on the surface of a primitive shape, in the shape's frame, from outside or from inside."""

import warp as wp

from simwarp.kernels.collision.shape import BOX, CAPSULE, CONE, CYLINDER, ELLIPSOID, PLANE, SPHERE
from simwarp.kernels.collision.surfaces import SurfaceHit

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def nearer(best: SurfaceHit, t: float, normal: wp.vec3) -> SurfaceHit:
    """The nearer of two hits; those behind the start do not count."""
    found = best
    if t >= 0.0 and (best.t < 0.0 or t < best.t):
        found.t = t
        found.normal = normal
    return found


@wp.func
def no_hit() -> SurfaceHit:
    """A miss."""
    hit = SurfaceHit()
    hit.t = -1.0
    hit.triangle = -1
    return hit


@wp.func
def plane_ray(start: wp.vec3, direction: wp.vec3) -> SurfaceHit:
    """The plane z = 0."""
    hit = no_hit()
    if direction[2] != 0.0:
        hit = nearer(hit, -start[2] / direction[2], wp.vec3(0.0, 0.0, 1.0))
    return hit


@wp.func
def sphere_roots(start: wp.vec3, direction: wp.vec3, radius: float) -> wp.vec2:
    """Both t at which a line meets a sphere about the origin; the first is larger if it misses.

    The discriminant is that of the distance between line and centre (Haines et al. 2019): exact for far starts.
    """
    a = wp.dot(direction, direction)
    middle = -wp.dot(start, direction) / a
    near = start + middle * direction
    square = (radius * radius - wp.dot(near, near)) / a
    if square < 0.0:
        return wp.vec2(1.0, 0.0)
    half = wp.sqrt(square)
    return wp.vec2(middle - half, middle + half)


@wp.func
def first_root(roots: wp.vec2) -> float:
    """The first t >= 0 of two, -1 without."""
    t = float(-1.0)
    if roots[0] <= roots[1]:
        t = wp.where(roots[0] >= 0.0, roots[0], roots[1])
    return t


@wp.func
def ellipsoid_ray(start: wp.vec3, direction: wp.vec3, half: wp.vec3) -> SurfaceHit:
    """An ellipsoid or sphere, as the unit sphere of scaled space."""
    hit = no_hit()
    s = wp.cw_div(start, half)
    d = wp.cw_div(direction, half)
    t = first_root(sphere_roots(s, d, 1.0))
    if t >= 0.0:
        hit.t = t
        hit.normal = wp.normalize(wp.cw_div(s + t * d, half))
    return hit


@wp.func
def box_ray(start: wp.vec3, direction: wp.vec3, half: wp.vec3) -> SurfaceHit:
    """A box, by its slabs (Kay and Kajiya 1986)."""
    hit = no_hit()
    low = float(-3.0e38)
    high = float(3.0e38)
    axis_low = int(0)
    axis_high = int(0)
    for k in range(3):
        d = direction[k]
        if wp.abs(d) < 1.0e-18:
            if wp.abs(start[k]) > half[k]:
                return hit
        else:
            a = -start[k] / d
            b = half[k] / wp.abs(d)
            if a - b > low:
                low = a - b
                axis_low = k
            if a + b < high:
                high = a + b
                axis_high = k
    if low > high or high < 0.0:
        return hit
    n = wp.vec3()
    if low >= 0.0:
        hit.t = low
        n[axis_low] = -wp.sign(direction[axis_low])
    else:
        hit.t = high
        n[axis_high] = wp.sign(direction[axis_high])
    hit.normal = n
    return hit


@wp.func
def tube_roots(start: wp.vec3, direction: wp.vec3, radius: float) -> wp.vec2:
    """Both t at which a line meets an endless cylinder about z; the first is larger if it misses."""
    d = wp.vec3(direction[0], direction[1], 0.0)
    if d[0] * d[0] + d[1] * d[1] < 1.0e-18:
        return wp.vec2(1.0, 0.0)
    return sphere_roots(wp.vec3(start[0], start[1], 0.0), d, radius)


@wp.func
def tube_ray(start: wp.vec3, direction: wp.vec3, radius: float, half_length: float) -> SurfaceHit:
    """The side of a cylinder about z."""
    hit = no_hit()
    roots = tube_roots(start, direction, radius)
    if roots[0] <= roots[1]:
        for k in range(2):
            t = roots[k]
            p = start + t * direction
            if wp.abs(p[2]) <= half_length:
                hit = nearer(hit, t, wp.vec3(p[0], p[1], 0.0) / radius)
    return hit


@wp.func
def disc_ray(best: SurfaceHit, start: wp.vec3, direction: wp.vec3, radius: float, z: float, up: float) -> SurfaceHit:
    """The nearer of a hit and a disc about (0, 0, z) that faces up or down."""
    found = best
    if direction[2] != 0.0:
        t = (z - start[2]) / direction[2]
        p = start + t * direction
        if p[0] * p[0] + p[1] * p[1] <= radius * radius:
            found = nearer(best, t, wp.vec3(0.0, 0.0, up))
    return found


@wp.func
def cylinder_ray(start: wp.vec3, direction: wp.vec3, radius: float, half_length: float) -> SurfaceHit:
    """A cylinder about z."""
    hit = tube_ray(start, direction, radius, half_length)
    hit = disc_ray(hit, start, direction, radius, half_length, 1.0)
    return disc_ray(hit, start, direction, radius, -half_length, -1.0)


@wp.func
def capsule_ray(start: wp.vec3, direction: wp.vec3, radius: float, half_length: float) -> SurfaceHit:
    """A capsule about z."""
    hit = tube_ray(start, direction, radius, half_length)
    for end in range(2):
        side = wp.where(end == 0, -1.0, 1.0)
        s = start - wp.vec3(0.0, 0.0, side * half_length)
        roots = sphere_roots(s, direction, radius)
        if roots[0] <= roots[1]:
            for k in range(2):
                t = roots[k]
                p = s + t * direction
                if side * p[2] >= 0.0:
                    hit = nearer(hit, t, p / radius)
    return hit


@wp.func
def cone_ray(start: wp.vec3, direction: wp.vec3, radius: float, half_length: float) -> SurfaceHit:
    """A cone about z, its tip at half_length: x^2 + y^2 = (k (half_length - z))^2."""
    hit = disc_ray(no_hit(), start, direction, radius, -half_length, -1.0)
    k = radius / (2.0 * half_length)
    # from the point of the line nearest to the tip, so that far starts keep their digits
    s = start - wp.vec3(0.0, 0.0, half_length)
    base = -wp.dot(s, direction) / wp.dot(direction, direction)
    s = s + base * direction
    a = direction[0] * direction[0] + direction[1] * direction[1] - k * k * direction[2] * direction[2]
    b = s[0] * direction[0] + s[1] * direction[1] - k * k * s[2] * direction[2]
    c = s[0] * s[0] + s[1] * s[1] - k * k * s[2] * s[2]
    square = b * b - a * c
    if square < 0.0:
        return hit
    q = -b - wp.where(b < 0.0, -1.0, 1.0) * wp.sqrt(square)
    for root in range(2):
        t = float(-1.0)
        known = int(0)
        if root == 0 and wp.abs(a) > 1.0e-12:
            t = q / a
            known = 1
        elif root == 1 and wp.abs(q) > 1.0e-20:
            t = c / q
            known = 1
        p = s + t * direction
        if known == 1 and p[2] <= 0.0 and p[2] >= -2.0 * half_length:
            hit = nearer(hit, base + t, wp.normalize(wp.vec3(p[0], p[1], -k * k * p[2])))
    return hit


@wp.func
def primitive_ray(kind: int, size: wp.vec3, start: wp.vec3, direction: wp.vec3) -> SurfaceHit:
    """First hit of a ray on any of the shapes above; `size` as in `ShapeType`."""
    if kind == BOX:
        return box_ray(start, direction, size)
    if kind == SPHERE or kind == ELLIPSOID:
        return ellipsoid_ray(start, direction, size)
    if kind == CYLINDER:
        return cylinder_ray(start, direction, size[0], size[1])
    if kind == CAPSULE:
        return capsule_ray(start, direction, size[0], size[1])
    if kind == CONE:
        return cone_ray(start, direction, size[0], size[1])
    if kind == PLANE:
        return plane_ray(start, direction)
    return no_hit()
