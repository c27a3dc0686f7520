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
            t = Triangle()
            low = wp.vec3()
            gap = float(0.0)
            height = float(1.0)
            sunk = int(0)
            wanted = int(1)
            if g.kind >= 0:
                t = ground_triangle(g, raw.triangle[k], assets)
                first = triangle_shape(t.p0, t.p1, t.p2, g.margin)
                low = b.x + support(b, -t.normal, assets) - rounding(b) * t.normal
                gap = wp.dot(t.normal, low - t.p0) - g.margin
                top = wp.dot(t.normal, b.x + support(b, t.normal, assets) - t.p0) + rounding(b) + g.margin
                height = wp.dot(t.normal, middle - t.p0)
                if height < 0.0 and covers(t, wp.where(g.kind == MESH, t.normal, up), middle):
                    sunk = 1
                if gap >= reach or top < 0.0:
                    wanted = 0
                if sunk == 1 and g.kind == HEIGHT_FIELD:
                    found = add_penetrating(found, t, low, gap)
                    wanted = 0
            if wanted == 1:
                if g.kind >= 0 and b.kind == SPHERE:
                    contacts = triangle_sphere(t, g.margin, b, reach, manifold)
                else:
                    contacts = collide(first, b, reach, assets, manifold)
                if g.kind >= 0:
                    if sunk == 1:
                        overlap = float(NEVER)
                        for i in range(contacts):
                            overlap = wp.min(overlap, manifold.gap[i])
                        if overlap < 0.0:
                            found = add_penetrating(found, t, low, gap)
                    else:
                        ahead = wp.where(height >= 0.0, 1, 0)
                        found = add_contacts(found, contacts, g, t, b, ahead, size, assets, manifold, raw)
        if g.kind >= 0 and count == TRIANGLE_BATCH:
            count = gather(g, raw.triangle[count - 1] + 1, raw.triangle, assets)
        else:
            count = 0
    if g.kind < 0:
        return contacts
    found.count = drop_internal_edge_contacts(found.count, g, size, assets, raw)
    return write_raw(found, flip, size, raw, manifold)
