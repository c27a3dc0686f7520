"""Contacts of a pair of shapes: two convex ones, or a convex one with each triangle of a height field or mesh."""

import warp as wp

from simwarp.kernels.collision.narrow import collide
from simwarp.kernels.collision.shape import (
    HEIGHT_FIELD,
    MESH,
    SPHERE,
    Assets,
    Manifold,
    Shape,
    triangle_shape,
)
from simwarp.kernels.collision.support import core_radius, inner_point, rounding, support
from simwarp.kernels.collision.surfaces import NEVER, TRIANGLE_BATCH, TriangleSurface, gather
from simwarp.kernels.collision.triangles import (
    ContactAccumulator,
    RawContacts,
    Triangle,
    add_contacts,
    add_penetrating,
    covers,
    drop_internal_edge_contacts,
    ground_triangle,
    triangle_sphere,
    write_raw,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class FacingTriangle:
    """A triangle of the ground as a convex shape sees it."""

    t: Triangle
    low: wp.vec3  # the shape's lowest point
    gap: float  # of that along the triangle's normal [m]
    height: float  # of the shape's middle above it [m]
    sunk: int  # 1: the middle is below the triangle
    wanted: int  # 1: there may be contacts


@wp.func
def facing_triangle(
    g: TriangleSurface, index: int, b: Shape, middle: wp.vec3, up: wp.vec3, reach: float, assets: Assets
) -> FacingTriangle:
    """Where a shape is, seen from a triangle."""
    f = FacingTriangle()
    t = ground_triangle(g, index, assets)
    low = b.x + support(b, -t.normal, assets) - rounding(b) * t.normal
    gap = wp.dot(t.normal, low - t.p0) - g.margin
    top = wp.dot(t.normal, b.x + support(b, t.normal, assets) - t.p0) + rounding(b) + g.margin
    f.t = t
    f.low = low
    f.gap = gap
    f.height = wp.dot(t.normal, middle - t.p0)
    f.wanted = 1
    if f.height < 0.0 and covers(t, wp.where(g.kind == MESH, t.normal, up), middle):
        f.sunk = 1
    if gap >= reach or top < 0.0:
        f.wanted = 0
    return f


@wp.func
def take_contacts(
    before: ContactAccumulator, contacts: int, f: FacingTriangle, g: TriangleSurface, b: Shape, size: float,
    assets: Assets, manifold: Manifold, raw: RawContacts,
) -> ContactAccumulator:  # fmt: skip
    """Adds the contacts with one triangle to those of the others."""
    found = before
    if f.sunk == 1:
        overlap = float(NEVER)
        for i in range(contacts):
            overlap = wp.min(overlap, manifold.gap[i])
        if overlap < 0.0:
            found = add_penetrating(found, f.t, f.low, f.gap)
    else:
        ahead = wp.where(f.height >= 0.0, 1, 0)
        found = add_contacts(found, contacts, g, f.t, b, ahead, size, assets, manifold, raw)
    return found


@wp.func
def pair_contacts(
    a: Shape,
    b: Shape,
    g: TriangleSurface,
    flip: int,
    reach: float,
    assets: Assets,
    manifold: Manifold,
    raw: RawContacts,
) -> int:
    """Contacts of two shapes within `reach` [m], at most MANIFOLD_CONTACTS, to `manifold`; returns how many.

    If `g` is a ground, it stands for `a`, and with `flip` the two change places in the result.
    """
    found = ContactAccumulator()
    middle = inner_point(b, assets)
    size = core_radius(b, assets) + rounding(b)
    up = wp.vec3(g.rot[0, 2], g.rot[1, 2], g.rot[2, 2])
    contacts = int(0)
    count = gather(g, 0, raw.triangle, assets)
    while count > 0:
        for k in range(count):
            first = a
            f = FacingTriangle()
            f.wanted = 1
            if g.kind >= 0:
                f = facing_triangle(g, raw.triangle[k], b, middle, up, reach, assets)
                first = triangle_shape(f.t.p0, f.t.p1, f.t.p2, g.margin)
                if f.sunk == 1 and g.kind == HEIGHT_FIELD:
                    found = add_penetrating(found, f.t, f.low, f.gap)
                    f.wanted = 0
            if f.wanted == 1:
                if g.kind >= 0 and b.kind == SPHERE:
                    contacts = triangle_sphere(f.t, g.margin, b, reach, manifold)
                else:
                    contacts = collide(first, b, reach, assets, manifold)
                if g.kind >= 0:
                    found = take_contacts(found, contacts, f, g, b, size, assets, manifold, raw)
        if g.kind >= 0 and count == TRIANGLE_BATCH:
            count = gather(g, raw.triangle[count - 1] + 1, raw.triangle, assets)
        else:
            count = 0
    if g.kind < 0:
        return contacts
    found.count = drop_internal_edge_contacts(found.count, g, size, assets, raw)
    return write_raw(found, flip, size, raw, manifold)
