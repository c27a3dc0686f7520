"""Queries of the narrow phase on a convex shape: support points, faces, edges, bounds.

A shape is a core thickened by `rounding`: a sphere's core is its centre, a capsule's its segment.
"""

import warp as wp

from simwarp.kernels.collision.shape import (
    BOX,
    CAPSULE,
    CONE,
    CYLINDER,
    ELLIPSOID,
    GROOVE,
    HULL,
    PLANE,
    SPHERE,
    SPROCKET,
    TRIANGLE,
    Assets,
    Shape,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FAR = wp.constant(1.0e10)
MANY_FACES = wp.constant(40)  # hulls with more faces are not searched face by face
MANY_EDGES = wp.constant(12)  # nor hulls with more edge directions edge by edge


@wp.struct
class Bounds:
    """A box along the world's axes in the pair's frame [m]."""

    lower: wp.vec3
    upper: wp.vec3


@wp.func
def sign_of(x: float) -> float:
    """1 or -1, 1 for zero."""
    return wp.where(x < 0.0, -1.0, 1.0)


@wp.func
def column(m: wp.mat33, i: int) -> wp.vec3:
    """Column `i`."""
    return wp.vec3(m[0, i], m[1, i], m[2, i])


@wp.func
def safe_direction(v: wp.vec3, otherwise: wp.vec3) -> wp.vec3:
    """Unit vector along `v`, whatever its scale; `otherwise` when it is zero."""
    largest = wp.max(wp.abs(v))
    if not largest > 1.0e-18:
        return otherwise
    w = v / largest
    return w / wp.length(w)


@wp.func
def rounding(a: Shape) -> float:
    """Distance of the surface from the core [m]."""
    if a.kind == SPHERE or a.kind == CAPSULE:
        return a.margin + a.size[0]
    return a.margin


@wp.func
def radial_axis(d: wp.vec3, least: float) -> wp.vec3:
    """Unit vector along the part of `d` across z; x if that part is shorter than `least`."""
    radial = wp.sqrt(d[0] * d[0] + d[1] * d[1])
    if radial > least:
        return wp.vec3(d[0] / radial, d[1] / radial, 0.0)
    return wp.vec3(1.0, 0.0, 0.0)


@wp.func
def hull_support_index(asset: int, d: wp.vec3, assets: Assets) -> int:
    """Index within the hull of the vertex farthest along `d` (unscaled axes)."""
    start = assets.hull_vertex_start[asset]
    best = int(0)
    height = float(-FAR)
    for i in range(assets.hull_vertex_start[asset + 1] - start):
        h = wp.dot(d, assets.hull_vertex[start + i])
        if h > height:
            height = h
            best = i
    return best


@wp.func
def local_support(a: Shape, d: wp.vec3, assets: Assets) -> wp.vec3:
    """Farthest point of the core along the unit vector `d`, both in the shape's frame; not for triangles."""
    s = a.size
    if a.kind == BOX:
        return wp.vec3(s[0] * sign_of(d[0]), s[1] * sign_of(d[1]), s[2] * sign_of(d[2]))
    if a.kind == CAPSULE:
        return wp.vec3(0.0, 0.0, s[1] * sign_of(d[2]))
    if a.kind == CYLINDER:
        p = radial_axis(d, 1.0e-9) * s[0]
        p[2] = s[1] * sign_of(d[2])
        return p
    if a.kind == CONE:
        radial = wp.sqrt(d[0] * d[0] + d[1] * d[1])
        if 2.0 * s[1] * d[2] >= s[0] * radial:
            return wp.vec3(0.0, 0.0, s[1])
        q = radial_axis(d, 1.0e-9) * s[0]
        q[2] = -s[1]
        return q
    if a.kind == ELLIPSOID:
        e = wp.cw_mul(s, d)
        return wp.cw_mul(s, e) / wp.max(wp.length(e), 1.0e-30)
    if a.kind == HULL:
        index = hull_support_index(a.asset, wp.cw_mul(s, d), assets)
        return wp.cw_mul(s, assets.hull_vertex[assets.hull_vertex_start[a.asset] + index])
    return wp.vec3()


@wp.func
def support(a: Shape, d: wp.vec3, assets: Assets) -> wp.vec3:
    """Farthest point of the core along the unit vector `d`, relative to the shape's origin, world axes [m]."""
    local = d * a.rot  # rot^T d: for a triangle the heights of its vertices
    if a.kind == TRIANGLE:
        best = int(0)
        if local[1] > local[0]:
            best = 1
        if local[2] > local[best]:
            best = 2
        return column(a.rot, best)
    return a.rot * local_support(a, local, assets)


@wp.func
def face_count(a: Shape, assets: Assets) -> int:
    """Flat faces, and axes of round shapes, that are worth trying as contact normals."""
    if a.kind == BOX or a.kind == ELLIPSOID:
        return 6
    if a.kind == TRIANGLE or a.kind == CONE:
        return 2
    if a.kind == CYLINDER:
        return 3
    if a.kind == HULL:
        count = assets.hull_face_start[a.asset + 1] - assets.hull_face_start[a.asset]
        return wp.where(count > MANY_FACES, 0, count)
    return 0


@wp.func
def hull_face_normal(a: Shape, face: int, assets: Assets) -> wp.vec3:
    """Outward unit normal of a hull's face, scaled as the shape is, in the shape's frame."""
    n = assets.hull_normal[assets.hull_face_start[a.asset] + face]
    s = a.size
    return wp.normalize(wp.vec3(n[0] / s[0], n[1] / s[1], n[2] / s[2]))


@wp.func
def is_flat(a: Shape, face: int) -> bool:
    """True if `face_normal` is that of a flat face."""
    if a.kind == CYLINDER:
        return face < 2
    if a.kind == CONE:
        return face == 0
    return a.kind != ELLIPSOID


@wp.func
def side_normal(a: Shape, d: wp.vec3) -> wp.vec3:
    """Unit normal of the side of a cylinder or cone that faces d, in the shape's frame."""
    n = radial_axis(d, 1.0e-9)
    if a.kind == CONE:
        n = n * (2.0 * a.size[1])
        n[2] = a.size[0]
        n = wp.normalize(n)
    return n


@wp.func
def face_normal(a: Shape, face: int, towards: wp.vec3, assets: Assets) -> wp.vec3:
    """Outward unit normal of a face, or of the side that faces `towards`; world axes."""
    if a.kind == TRIANGLE:
        p = column(a.rot, 0)
        n = safe_direction(wp.cross(column(a.rot, 1) - p, column(a.rot, 2) - p), wp.vec3(0.0, 0.0, 1.0))
        return wp.where(face == 0, n, -n)
    if a.kind == HULL:
        return a.rot * hull_face_normal(a, face, assets)
    if (a.kind == CYLINDER and face == 2) or (a.kind == CONE and face == 1):
        return a.rot * side_normal(a, towards * a.rot)
    axis = int(2)
    if face >= 2:
        axis = 1 - (face // 2 - 1)
    c = column(a.rot, axis)
    if a.kind == CONE or face % 2 == 1:
        c = -c
    return c


@wp.func
def edge_count(a: Shape, assets: Assets) -> int:
    """Directions of edges, or of straight generators."""
    if a.kind == BOX or a.kind == TRIANGLE:
        return 3
    if a.kind == CYLINDER or a.kind == CAPSULE:
        return 1
    if a.kind == HULL:
        count = assets.hull_edge_start[a.asset + 1] - assets.hull_edge_start[a.asset]
        return wp.where(count > MANY_EDGES, 0, count)
    return 0


@wp.func
def edge_direction(a: Shape, edge: int, assets: Assets) -> wp.vec3:
    """Unit vector along an edge, world axes."""
    if a.kind == TRIANGLE:
        return safe_direction(column(a.rot, (edge + 1) % 3) - column(a.rot, edge), wp.vec3())
    if a.kind == BOX:
        return column(a.rot, edge)
    if a.kind == HULL:
        e = wp.cw_mul(a.size, assets.hull_edge[assets.hull_edge_start[a.asset] + edge])
        return a.rot * wp.normalize(e)
    return column(a.rot, 2)


@wp.func
def is_polyhedron(a: Shape, assets: Assets) -> bool:
    """True if `face_normal` and `edge_direction` cover all faces and edges."""
    if a.kind == HULL:
        return face_count(a, assets) > 0 and edge_count(a, assets) > 0
    return a.kind == BOX or a.kind == TRIANGLE


@wp.func
def inner_point(a: Shape, assets: Assets) -> wp.vec3:
    """A point well inside the shape, pair's frame [m]."""
    if a.kind == HULL:
        return a.x + a.rot * wp.cw_mul(a.size, assets.hull_centre[a.asset])
    return a.x


@wp.func
def core_radius(a: Shape, assets: Assets) -> float:
    """Radius of a sphere about `inner_point` that holds the core [m]."""
    s = a.size
    if a.kind == BOX:
        return wp.length(s)
    if a.kind == CAPSULE:
        return s[1]
    if a.kind == CYLINDER or a.kind == CONE:
        return wp.sqrt(s[0] * s[0] + s[1] * s[1])
    if a.kind == ELLIPSOID:
        return wp.max(s)
    if a.kind == HULL:
        return assets.hull_radius[a.asset] * wp.max(s)
    if a.kind == TRIANGLE:
        return wp.max(wp.length(column(a.rot, 0)), wp.max(wp.length(column(a.rot, 1)), wp.length(column(a.rot, 2))))
    return 0.0


@wp.func
def shape_bounds(a: Shape, assets: Assets) -> Bounds:
    """The smallest box along the world's axes around a thickened shape; planes fill +-1e10."""
    b = Bounds()
    lower = wp.vec3(-FAR, -FAR, -FAR)
    upper = wp.vec3(FAR, FAR, FAR)
    if a.kind == SPHERE or a.kind == CAPSULE or a.kind == BOX:
        # the most frequent ones, in closed form
        half = wp.vec3()
        if a.kind == CAPSULE:
            half = wp.abs(column(a.rot, 2)) * a.size[1]
        elif a.kind == BOX:
            half = (
                wp.abs(column(a.rot, 0)) * a.size[0]
                + wp.abs(column(a.rot, 1)) * a.size[1]
                + wp.abs(column(a.rot, 2)) * a.size[2]
            )
        r = rounding(a)
        half += wp.vec3(r, r, r)
        lower = a.x - half
        upper = a.x + half
    elif a.kind == SPROCKET or a.kind == GROOVE:
        axis = column(a.rot, 2)
        disc = wp.vec3()
        for k in range(3):
            across = wp.sqrt(wp.max(1.0 - axis[k] * axis[k], 0.0))
            disc[k] = a.size[0] * across + a.size[1] * wp.abs(axis[k]) + a.margin
        lower = a.x - disc
        upper = a.x + disc
    elif a.kind <= HULL and a.kind != PLANE or a.kind == TRIANGLE:
        r = rounding(a)
        for k in range(3):
            d = wp.vec3()
            d[k] = 1.0
            upper[k] = a.x[k] + support(a, d, assets)[k] + r
            d[k] = -1.0
            lower[k] = a.x[k] + support(a, d, assets)[k] - r
    b.lower = lower
    b.upper = upper
    return b


@wp.func
def shape_extent(a: Shape, assets: Assets) -> wp.vec3:
    """Half lengths of the smallest box along the world's axes that is centred on a.x and holds the shape [m]."""
    b = shape_bounds(a, assets)
    return wp.max(wp.abs(b.lower - a.x), wp.abs(b.upper - a.x))
