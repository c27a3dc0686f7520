"""Contacts of one pair of shapes: closed formulas for the cheap pairs, one general way for all others."""

import warp as wp

from simwarp.kernels.collision.axis import Axis, separation_axis
from simwarp.kernels.collision.clip import contact_manifold, write_contact, write_kept
from simwarp.kernels.collision.polygon import support_polygon
from simwarp.kernels.collision.shape import (
    BOX,
    CAPSULE,
    GROOVE,
    HULL,
    PLANE,
    POLYGON_CAPACITY,
    SPHERE,
    SPROCKET,
    Assets,
    Manifold,
    Shape,
)
from simwarp.kernels.collision.sprockets import sphere_groove, sphere_sprocket
from simwarp.kernels.collision.support import column, rounding, safe_direction, sign_of

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

ORDER = wp.constant(wp.vec3(0.4714, 0.2718, 0.8389))  # a direction along which no arrangement is likely to be level


@wp.func
def swapped(a: Shape, b: Shape) -> int:
    """1 if the pair is processed as (b, a), else 0: an order that does not depend on the arguments' order."""
    if a.kind != b.kind:
        return wp.where(a.kind > b.kind, 1, 0)
    d = wp.dot(ORDER, b.x) - wp.dot(ORDER, a.x)
    if d == 0.0:
        d = wp.length_sq(b.size) - wp.length_sq(a.size)
    return wp.where(d < 0.0, 1, 0)


@wp.func
def plane_corners(plane: Shape, b: Shape, assets: Assets, out: Manifold) -> int:
    """The points of a shape that may touch a plane, to row 2 of `polygon`."""
    count = int(0)
    if b.kind == BOX:
        count = 8
        for i in range(8):
            s = wp.vec3(float(i & 1), float((i >> 1) & 1), float(i >> 2)) * 2.0 - wp.vec3(1.0, 1.0, 1.0)
            out.polygon[2, i] = b.x + b.rot * wp.cw_mul(b.size, s)
    elif b.kind == HULL:
        start = assets.hull_vertex_start[b.asset]
        count = assets.hull_vertex_start[b.asset + 1] - start
        if count <= POLYGON_CAPACITY:
            for i in range(count):
                out.polygon[2, i] = b.x + b.rot * wp.cw_mul(b.size, assets.hull_vertex[start + i])
    if count == 0 or count > POLYGON_CAPACITY:
        count = support_polygon(b, -column(plane.rot, 2), 2, assets, out)
    return count


@wp.func
def plane_contacts(plane: Shape, b: Shape, reach: float, flip: int, assets: Assets, out: Manifold) -> int:
    """Contacts of a plane with anything convex."""
    n = column(plane.rot, 2)
    thick = rounding(b) + plane.margin
    if b.kind == SPHERE:
        height = wp.dot(n, b.x - plane.x)
        if height - thick >= reach:
            return 0
        write_contact(0, n, b.x + (plane.margin - height) * n, height - thick, 0, flip, out)
        return 1
    count = plane_corners(plane, b, assets, out)
    m = int(0)
    for i in range(count):
        p = out.polygon[2, i]
        h = wp.dot(n, p - plane.x)
        if h - thick < reach:
            out.polygon[2, m] = p + (plane.margin - h) * n
            out.polygon[3, m] = wp.vec3(float(i), h - thick, 0.0)
            m += 1
    return write_kept(m, n, flip, out)


@wp.func
def sphere_contact(
    a: Shape, nearest: wp.vec3, thick: float, inward: wp.vec3, reach: float, flip: int, out: Manifold
) -> int:
    """Contact of sphere `a` with the point of the other core that is nearest to its centre."""
    d = nearest - a.x
    n = safe_direction(d, inward)
    gap = wp.length(d) - a.size[0] - a.margin - thick
    if gap >= reach:
        return 0
    write_contact(0, n, a.x + (a.size[0] + a.margin) * n, gap, 0, flip, out)
    return 1


@wp.func
def across(v: wp.vec3) -> wp.vec3:
    """A unit vector across `v`, z-most."""
    other = wp.vec3(0.0, 0.0, 1.0)
    if wp.abs(v[2]) > 0.9 * wp.length(v):
        other = wp.vec3(1.0, 0.0, 0.0)
    return safe_direction(wp.cross(wp.cross(v, other), v), other)


@wp.func
def sphere_segment(a: Shape, b: Shape, reach: float, flip: int, out: Manifold) -> int:
    """Sphere and capsule (or sphere: a segment of no length)."""
    half = wp.where(b.kind == CAPSULE, b.size[1], 0.0)
    axis = column(b.rot, 2)
    t = wp.clamp(wp.dot(axis, a.x - b.x), -half, half)
    return sphere_contact(a, b.x + t * axis, b.size[0] + b.margin, across(axis * half), reach, flip, out)


@wp.func
def sphere_box(a: Shape, b: Shape, reach: float, flip: int, out: Manifold) -> int:
    """Sphere and box, its centre outside or inside."""
    p = (a.x - b.x) * b.rot
    q = wp.vec3()
    face = int(0)
    for k in range(3):
        q[k] = wp.clamp(p[k], -b.size[k], b.size[k])
        if wp.abs(p[k]) - b.size[k] > wp.abs(p[face]) - b.size[face]:
            face = k
    d = q - p
    distance = wp.length(d)
    outward = wp.vec3()
    outward[face] = sign_of(p[face])
    if distance > 1.0e-6 * wp.max(b.size):
        outward = -d / distance
    else:
        distance = wp.abs(p[face]) - b.size[face]
    gap = distance - a.size[0] - a.margin - b.margin
    if gap >= reach:
        return 0
    n = -(b.rot * outward)
    write_contact(0, n, a.x + (a.size[0] + a.margin) * n, gap, 0, flip, out)
    return 1


@wp.func
def capsule_axis(a: Shape, b: Shape) -> Axis:
    """The normal of two capsules: between the nearest points of their segments, in the middle of parallel ones."""
    u = column(a.rot, 2)
    v = column(b.rot, 2)
    d = b.x - a.x
    ha = a.size[1]
    hb = b.size[1]
    c = wp.dot(u, v)
    du = wp.dot(d, u)
    dv = wp.dot(d, v)
    sine_sq = wp.length_sq(wp.cross(u, v))
    s = float(0.0)
    if sine_sq > 1.0e-8:
        s = wp.clamp((du - c * dv) / sine_sq, -ha, ha)
    else:
        s = 0.5 * (wp.clamp(du - hb, -ha, ha) + wp.clamp(du + hb, -ha, ha))
    t = wp.clamp(s * c - dv, -hb, hb)
    s = wp.clamp(t * c + du, -ha, ha)
    t = wp.clamp(s * c - dv, -hb, hb)
    gap = d + t * v - s * u
    otherwise = safe_direction(wp.cross(u, v), across(u))
    axis = Axis()
    axis.at = s * u
    axis.pointed = 1
    axis.size = wp.min(ha + a.size[0], hb + b.size[0])
    axis.separation = wp.length(gap)
    axis.normal = otherwise
    if axis.separation > 1.0e-6 * axis.size:
        axis.normal = gap / axis.separation
    return axis


@wp.func
def can_meet(low: int, high: int) -> bool:
    """False for kinds of shapes that never have contacts; `low` is the smaller kind."""
    return low == SPHERE or high < SPROCKET


@wp.func
def has_formula(low: int, high: int) -> bool:
    """True if the contacts of two shapes are written down, without a search; `low` is the smaller kind."""
    return low == PLANE or (low == SPHERE and (high <= CAPSULE or high == BOX or high == SPROCKET or high == GROOVE))


@wp.func
def formula_contacts(p: Shape, q: Shape, reach: float, flip: int, assets: Assets, out: Manifold) -> int:
    """Contacts of a pair that `has_formula`."""
    if p.kind == PLANE:
        return plane_contacts(p, q, reach, flip, assets, out)
    if q.kind <= CAPSULE:
        return sphere_segment(p, q, reach, flip, out)
    if q.kind == SPROCKET:
        return sphere_sprocket(p, q, reach, flip, assets, out)
    if q.kind == GROOVE:
        return sphere_groove(p, q, reach, flip, out)
    return sphere_box(p, q, reach, flip, out)


@wp.func
def axis_between(p: Shape, q: Shape, reach: float, assets: Assets) -> Axis:
    """The normal of two convex shapes without a formula."""
    axis = Axis()
    if p.kind == CAPSULE and q.kind == CAPSULE:
        axis = capsule_axis(p, q)
    else:
        axis = separation_axis(p, q, reach, assets)
    return axis


@wp.func
def axis_contacts(p: Shape, q: Shape, axis: Axis, reach: float, flip: int, assets: Assets, out: Manifold) -> int:
    """Contacts of two convex shapes whose normal is known."""
    if axis.separation - rounding(p) - rounding(q) >= reach:
        return 0
    return contact_manifold(p, q, axis, reach, flip, assets, out)
