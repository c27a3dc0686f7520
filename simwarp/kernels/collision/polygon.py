"""Support polygons: the face, edge or vertex of a shape that faces a direction."""

import warp as wp

from simwarp.kernels.collision.shape import (
    BOX,
    CAPSULE,
    CONE,
    CYLINDER,
    FACE_VERTICES,
    HULL,
    TRIANGLE,
    Assets,
    Manifold,
    Shape,
)
from simwarp.kernels.collision.support import (
    column,
    hull_face_normal,
    hull_support_index,
    local_support,
    radial_axis,
    safe_direction,
    sign_of,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FLAT_SINE = wp.constant(0.17)  # features within 10 degrees of the tangent plane belong to the support polygon
FLAT_COSINE = wp.constant(0.985)
UPRIGHT_SINE = wp.constant(1.0e-4)  # below it the lowest point of a rim is noise: its polygon is fixed to the shape
RIM = wp.constant(8)  # corners that stand for a circle


@wp.func
def put_vertex(a: Shape, row: int, i: int, local: wp.vec3, out: Manifold):
    """Writes a point of the shape's frame, in the pair's frame."""
    out.polygon[row, i] = a.x + a.rot * local


@wp.func
def put_rim(a: Shape, row: int, d: wp.vec3, z: float, out: Manifold) -> int:
    """A regular polygon in the circle at height z, one corner towards d."""
    u = radial_axis(d, UPRIGHT_SINE)
    c = float(u[0]) * a.size[0]
    s = float(u[1]) * a.size[0]
    h = float(0.7071067811865476)
    for i in range(RIM):
        put_vertex(a, row, i, wp.vec3(c, s, z), out)
        t = (c - s) * h
        s = (c + s) * h
        c = t
    return RIM


@wp.func
def box_polygon(a: Shape, d: wp.vec3, row: int, out: Manifold) -> int:
    """Face, edge or corner of a box."""
    k = int(0)
    if wp.abs(d[1]) > wp.abs(d[0]):
        k = 1
    if wp.abs(d[2]) > wp.abs(d[k]):
        k = 2
    i = (k + 1) % 3
    j = (k + 2) % 3
    p = wp.vec3()
    p[k] = a.size[k] * sign_of(d[k])
    p[i] = a.size[i] * sign_of(d[i])
    p[j] = a.size[j] * sign_of(d[j])
    if wp.abs(d[i]) < FLAT_SINE and wp.abs(d[j]) < FLAT_SINE:
        for corner in range(4):
            p[i] = wp.where(corner == 0 or corner == 3, a.size[i], -a.size[i])
            p[j] = wp.where(corner < 2, a.size[j], -a.size[j])
            put_vertex(a, row, corner, p, out)
        return 4
    free = int(-1)
    if wp.abs(d[i]) < FLAT_SINE:
        free = i
    elif wp.abs(d[j]) < FLAT_SINE:
        free = j
    if free < 0:
        put_vertex(a, row, 0, p, out)
        return 1
    p[free] = a.size[free]
    put_vertex(a, row, 0, p, out)
    p[free] = -a.size[free]
    put_vertex(a, row, 1, p, out)
    return 2


@wp.func
def round_polygon(a: Shape, d: wp.vec3, row: int, assets: Assets, out: Manifold) -> int:
    """Cap or generator of a capsule, cylinder or cone; otherwise the farthest point."""
    z = a.size[1]
    radial = wp.sqrt(d[0] * d[0] + d[1] * d[1])
    if a.kind == CYLINDER and radial < FLAT_SINE:
        return put_rim(a, row, d, z * sign_of(d[2]), out)
    if a.kind == CONE and radial < FLAT_SINE and d[2] < 0.0:
        return put_rim(a, row, d, -z, out)
    rim = radial_axis(d, 1.0e-9) * a.size[0]
    top = wp.vec3(0.0, 0.0, z)
    if a.kind == CYLINDER:
        top = rim + top
    elif a.kind == CAPSULE:
        rim = wp.vec3()
    rim[2] = -z
    line = top - rim
    if (a.kind == CYLINDER or a.kind == CAPSULE or a.kind == CONE) and wp.abs(wp.dot(d, line)) < FLAT_SINE * wp.length(
        line
    ):
        put_vertex(a, row, 0, rim, out)
        put_vertex(a, row, 1, top, out)
        return 2
    put_vertex(a, row, 0, local_support(a, d, assets), out)
    return 1


@wp.func
def triangle_polygon(a: Shape, d: wp.vec3, row: int, out: Manifold) -> int:
    """Face, edge or corner of a triangle; `d` holds the heights of its corners."""
    p = column(a.rot, 0)
    q = column(a.rot, 1)
    r = column(a.rot, 2)
    n = safe_direction(wp.cross(q - p, r - p), wp.vec3())
    spread = wp.max(wp.length(q - p), wp.max(wp.length(r - p), wp.length(r - q)))
    rise = wp.max(d) - wp.min(d)
    if rise < FLAT_SINE * spread and wp.length_sq(n) > 0.5:
        for k in range(3):
            out.polygon[row, k] = a.x + column(a.rot, k)
        return 3
    low = int(0)
    if d[1] < d[0]:
        low = 1
    if d[2] < d[low]:
        low = 2
    i = (low + 1) % 3
    j = (low + 2) % 3
    e = column(a.rot, j) - column(a.rot, i)
    if wp.abs(d[j] - d[i]) < FLAT_SINE * wp.length(e):
        out.polygon[row, 0] = a.x + column(a.rot, i)
        out.polygon[row, 1] = a.x + column(a.rot, j)
        return 2
    top = wp.where(d[j] > d[i], j, i)
    out.polygon[row, 0] = a.x + column(a.rot, top)
    return 1


@wp.func
def hull_polygon(a: Shape, d: wp.vec3, row: int, assets: Assets, out: Manifold) -> int:
    """Face, edge or corner of a hull."""
    first_face = assets.hull_face_start[a.asset]
    last_face = assets.hull_face_start[a.asset + 1]
    start = assets.hull_vertex_start[a.asset]
    best = int(first_face)
    cosine = float(-2.0)
    for face in range(first_face, last_face):
        c = wp.dot(d, hull_face_normal(a, face - first_face, assets))
        if c > cosine:
            cosine = c
            best = face
    if cosine > FLAT_COSINE:
        first = assets.hull_face_vertex_start[best]
        total = assets.hull_face_vertex_start[best + 1] - first
        step = (total + FACE_VERTICES - 1) // FACE_VERTICES
        count = (total + step - 1) // step
        for k in range(count):
            vertex = assets.hull_vertex[start + assets.hull_face[first + k * step]]
            put_vertex(a, row, k, wp.cw_mul(a.size, vertex), out)
        return count
    top = hull_support_index(a.asset, wp.cw_mul(a.size, d), assets)
    p = wp.cw_mul(a.size, assets.hull_vertex[start + top])
    slope = float(FLAT_SINE)
    other = int(-1)
    for face in range(first_face, last_face):
        first = assets.hull_face_vertex_start[face]
        last = assets.hull_face_vertex_start[face + 1]
        for k in range(first, last):
            if assets.hull_face[k] == top:
                j = assets.hull_face[wp.where(k + 1 == last, first, k + 1)]
                e = wp.cw_mul(a.size, assets.hull_vertex[start + j]) - p
                fall = -wp.dot(d, e) / wp.length(e)
                if fall < slope:
                    slope = fall
                    other = j
    if other < 0:
        put_vertex(a, row, 0, p, out)
        return 1
    put_vertex(a, row, 0, wp.cw_mul(a.size, assets.hull_vertex[start + wp.min(top, other)]), out)
    put_vertex(a, row, 1, wp.cw_mul(a.size, assets.hull_vertex[start + wp.max(top, other)]), out)
    return 2


@wp.func
def support_polygon(a: Shape, n: wp.vec3, row: int, assets: Assets, out: Manifold) -> int:
    """Corners of the core's feature that faces the unit vector n, in order, to `polygon[row]`; returns how many."""
    d = n * a.rot
    if a.kind == BOX:
        return box_polygon(a, d, row, out)
    if a.kind == HULL:
        return hull_polygon(a, d, row, assets, out)
    if a.kind == TRIANGLE:
        return triangle_polygon(a, d, row, out)
    return round_polygon(a, d, row, assets, out)
