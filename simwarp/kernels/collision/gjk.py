"""Distance of two separated convex cores (Gilbert, Johnson, Keerthi 1988), well conditioned in float32.

The caller moves the shapes apart along a trial normal until their distance is a fair share of their size; then the
direction found is accurate, which it would not be at a resting contact.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets, Shape
from simwarp.kernels.collision.support import support

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

Corners = wp.types.matrix(shape=(4, 3), dtype=wp.float32)
GJK_ITERATIONS = wp.constant(48)


@wp.struct
class Pair:
    """Farthest points of two shapes towards each other, each relative to its own shape's origin [m]."""

    a: wp.vec3
    b: wp.vec3


@wp.struct
class Nearest:
    """The point of a triangle nearest to the origin and its barycentric coordinates."""

    v: wp.vec3
    weight: wp.vec3


@wp.struct
class Gap:
    """Result of `gjk`: `separation` is that along `normal`; `at` a point of the first core near the contact."""

    normal: wp.vec3
    separation: float
    at: wp.vec3


@wp.func
def facing_points(a: Shape, b: Shape, n: wp.vec3, assets: Assets) -> Pair:
    """Farthest point of `a` along n and of `b` against n."""
    pair = Pair()
    pair.a = support(a, n, assets)
    pair.b = support(b, -n, assets)
    return pair


@wp.func
def nearest_on_triangle(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> Nearest:
    """Nearest point to the origin; two or three corners may coincide."""
    result = Nearest()
    ab = b - a
    ac = c - a
    n = wp.cross(ab, ac)
    nn = wp.dot(n, n)
    g11 = wp.dot(ab, ab)
    g22 = wp.dot(ac, ac)
    if nn > 1.0e-10 * g11 * g22:
        g12 = wp.dot(ab, ac)
        r1 = -wp.dot(ab, a)
        r2 = -wp.dot(ac, a)
        s = (g22 * r1 - g12 * r2) / nn
        t = (g11 * r2 - g12 * r1) / nn
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            result.v = n * (wp.dot(n, a) / nn)  # along the normal exactly, however close the origin
            result.weight = wp.vec3(1.0 - s - t, s, t)
            return result
    best = float(3.0e38)
    corners = wp.matrix_from_rows(a, b, c)
    for k in range(3):
        p = corners[k]
        j = wp.where(k == 2, 0, k + 1)
        e = corners[j] - p
        ee = wp.dot(e, e)
        u = float(0.0)
        if ee > 0.0:
            u = wp.clamp(-wp.dot(p, e) / ee, 0.0, 1.0)
        v = p + u * e
        vv = wp.dot(v, v)
        if vv < best:
            best = vv
            result.v = v
            weight = wp.vec3()
            weight[k] = 1.0 - u
            weight[j] = weight[j] + u
            result.weight = weight
    return result


@wp.struct
class NearestFace:
    """The nearest point of a simplex, on its newest corner and the corners i0 and i1."""

    near: Nearest
    i0: int
    i1: int


@wp.func
def nearest_face(w: Corners, count: int) -> NearestFace:
    """The nearest point lies on a face with the newest corner; of a tetrahedron three have it."""
    found = NearestFace()
    best = float(3.0e38)
    last = count - 1
    faces = wp.where(count == 4, 3, 1)
    for face in range(faces):
        j0 = wp.min(face, wp.max(last - 1, 0))
        j1 = wp.where(count == 4, (face + 1) % 3, wp.min(1, last))
        if count == 2:
            j1 = 1
        near = nearest_on_triangle(w[last], w[j0], w[j1])
        vv = wp.dot(near.v, near.v)
        if vv < best:
            best = vv
            found.near = near
            found.i0 = j0
            found.i1 = j1
    return found


@wp.func
def gjk(a: Shape, b: Shape, offset: wp.vec3, start: wp.vec3, size: float, assets: Assets) -> Gap:
    """Direction of the shortest distance between core `a` and core `b`, its origin at `offset` from that of `a`.

    The cores must be apart. `start` is a unit vector along which they are; `size` the extent of the problem [m].
    """
    w = Corners()
    p = Corners()  # points of `a` that belong to w
    weight = wp.vec3()
    count = int(0)
    v = start
    distance = float(3.0e38)
    result = Gap()
    result.normal = start
    result.separation = -3.0e38
    resolution = 1.0e-7 * size
    running = int(1)
    iteration = int(0)
    while running == 1:
        n = v / wp.length(v)
        pair = facing_points(a, b, n, assets)
        corner = offset + pair.b - pair.a
        lower = wp.dot(n, corner)
        if lower > result.separation:
            result.separation = lower
            result.normal = n
        iteration += 1
        known = int(0)
        for k in range(count):
            if wp.length_sq(w[k] - corner) == 0.0:
                known = 1
        if known == 1 or distance - lower <= 2.0e-7 * distance + 0.5 * resolution or iteration > GJK_ITERATIONS:
            running = 0
        else:
            w[count] = corner
            p[count] = pair.a
            count += 1
            last = count - 1
            face = nearest_face(w, count)
            best = face.near
            i0 = face.i0
            i1 = face.i1
            # drop the corners without weight
            w0 = w[i0]
            p0 = p[i0]
            w1 = w[i1]
            p1 = p[i1]
            corner_a = p[last]
            next_count = int(0)
            share = best.weight
            if share[1] > 0.0:
                w[next_count] = w0
                p[next_count] = p0
                weight[next_count] = share[1]
                next_count += 1
            if share[2] > 0.0:
                w[next_count] = w1
                p[next_count] = p1
                weight[next_count] = share[2]
                next_count += 1
            if share[0] > 0.0:
                w[next_count] = corner
                p[next_count] = corner_a
                weight[next_count] = share[0]
                next_count += 1
            count = next_count
            length = wp.sqrt(wp.dot(best.v, best.v))
            if length >= distance or length == 0.0:
                running = 0
            else:
                distance = length
                v = best.v
    at = wp.vec3()
    for k in range(wp.min(count, 3)):
        at += weight[k] * p[k]
    result.at = at
    return result
