"""Queries of contact, tires and ray sensors on height fields and meshes: heights, rays, triangles near a shape.

Unless a docstring says otherwise everything is in the shape's frame, scaled; its positions are float64, because terrain
may be kilometres wide. Edge k of a triangle goes from corner k to corner k + 1; corners are counter-clockwise seen from
outside (a field: from above).

A cell of a height field between columns i, i + 1 and rows j, j + 1 is cut from node (i, j) to node (i + 1, j + 1):
triangle 2 c lies on the side of larger x, triangle 2 c + 1 on that of larger y, where c = j (columns - 1) + i.
`field_node` alone says so, and `field_triangle_at` and `field_neighbour` follow it.
"""

import warp as wp

from simwarp.kernels.collision.shape import HEIGHT_FIELD, MESH, Assets, Shape
from simwarp.kernels.collision.support import Bounds, safe_direction
from simwarp.kernels.core.vector_math import to_double, to_float, turned_extent
from simwarp.kernels.rays.wide_tree import tree_ray

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

HIT_SLACK = wp.constant(1.0e-5)  # of a triangle's sides: a ray this far outside still hits, so that none slips through
NEVER = wp.constant(3.0e38)
TRIANGLE_BATCH = wp.constant(64)  # triangles gathered at a time


@wp.struct
class TriangleSurface:
    """A height field or mesh as one pair sees it."""

    kind: int  # ShapeType; -1: the pair has none
    asset: int
    scale: wp.vec3
    margin: float  # [m]
    x: wp.vec3d  # origin relative to the pair's, world axes [m]
    rot: wp.mat33  # its axes to world axes
    lower: wp.vec3d  # bounds of the other shape, in the shape's own frame [m]
    upper: wp.vec3d


@wp.struct
class SurfacePoint:
    """A point of a height field."""

    height: wp.float64  # [m]
    normal: wp.vec3  # unit, upwards
    inside: int  # 0: beyond the border, whose nearest point this is


@wp.struct
class SurfaceHit:
    """Hit of a ray on a surface."""

    t: float  # in lengths of the ray's direction; -1: nowhere
    normal: wp.vec3  # unit, on the outer side of the triangle
    triangle: int


@wp.func
def field_node(triangle: int, corner: int, columns: int) -> wp.vec2i:
    """Column and row of a triangle's corner; `columns` of nodes."""
    cell = triangle // 2
    upper = triangle % 2
    column = cell % (columns - 1)
    row = cell // (columns - 1)
    if corner == 2 or (corner == 1 and upper == 1):
        row += 1
    if corner == 1 or (corner == 2 and upper == 0):
        column += 1
    return wp.vec2i(column, row)


@wp.func
def field_neighbour(triangle: int, edge: int, columns: int, rows: int) -> int:
    """The triangle across an edge; -1 at the border."""
    upper = triangle % 2
    cell = triangle // 2
    column = cell % (columns - 1)
    row = cell // (columns - 1)
    if upper == 0 and edge == 0:
        row -= 1
    elif upper == 0 and edge == 1:
        column += 1
    elif upper == 1 and edge == 1:
        row += 1
    elif upper == 1 and edge == 2:
        column -= 1
    if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
        return -1
    return 2 * (row * (columns - 1) + column) + 1 - upper


@wp.func
def field_vertex(asset: int, scale: wp.vec3, triangle: int, corner: int, assets: Assets) -> wp.vec3d:
    """Corner of a triangle of a height field [m]."""
    nodes = assets.field_nodes[asset]
    spacing = assets.field_spacing[asset]
    node = field_node(triangle, corner, nodes[0])
    height = assets.field_height[assets.field_start[asset] + node[1] * nodes[0] + node[0]]
    s = to_double(scale)
    half = wp.float64(0.5)
    return wp.vec3d(
        s[0] * spacing[0] * (wp.float64(node[0]) - half * wp.float64(nodes[0] - 1)),
        s[1] * spacing[1] * (wp.float64(node[1]) - half * wp.float64(nodes[1] - 1)),
        s[2] * wp.float64(height),
    )


@wp.func
def field_normal(asset: int, scale: wp.vec3, triangle: int, assets: Assets) -> wp.vec3:
    """Upward unit normal of a triangle of a height field."""
    p = field_vertex(asset, scale, triangle, 0, assets)
    e = to_float(field_vertex(asset, scale, triangle, 1, assets) - p)
    f = to_float(field_vertex(asset, scale, triangle, 2, assets) - p)
    return wp.normalize(wp.cross(e, f))


@wp.func
def field_place(asset: int, scale: wp.vec3, x: wp.float64, y: wp.float64, assets: Assets) -> wp.vec2d:
    """(x, y) [m] in columns and rows of nodes."""
    nodes = assets.field_nodes[asset]
    spacing = assets.field_spacing[asset]
    half = wp.float64(0.5)
    return wp.vec2d(
        x / (spacing[0] * wp.float64(scale[0])) + half * wp.float64(nodes[0] - 1),
        y / (spacing[1] * wp.float64(scale[1])) + half * wp.float64(nodes[1] - 1),
    )


@wp.func
def field_cell(asset: int, place: wp.vec2d, assets: Assets) -> wp.vec2i:
    """Column and row of the cell that holds a place, or of the border's cell nearest to it."""
    nodes = assets.field_nodes[asset]
    return wp.vec2i(
        int(wp.clamp(wp.floor(place[0]), wp.float64(0.0), wp.float64(nodes[0] - 2))),
        int(wp.clamp(wp.floor(place[1]), wp.float64(0.0), wp.float64(nodes[1] - 2))),
    )


@wp.func
def field_triangle_at(asset: int, place: wp.vec2d, assets: Assets) -> int:
    """The triangle above or below a place."""
    cell = field_cell(asset, place, assets)
    upper = int(0)
    if place[1] - wp.float64(cell[1]) > place[0] - wp.float64(cell[0]):
        upper = 1
    return 2 * (cell[1] * (assets.field_nodes[asset][0] - 1) + cell[0]) + upper


@wp.func
def height_field_height(
    asset: int, scale: wp.vec3, x: wp.float64, y: wp.float64, assets: Assets
) -> SurfacePoint:  # fmt: skip
    """Height and normal of a height field at (x, y) [m]: those of the triangle that contact uses. Beyond the border
    the height is that of the nearest point of the border.
    """
    found = SurfacePoint()
    nodes = assets.field_nodes[asset]
    place = field_place(asset, scale, x, y, assets)
    zero = wp.float64(0.0)
    near = wp.vec2d(
        wp.clamp(place[0], zero, wp.float64(nodes[0] - 1)), wp.clamp(place[1], zero, wp.float64(nodes[1] - 1))
    )
    triangle = field_triangle_at(asset, near, assets)
    p = field_vertex(asset, scale, triangle, 0, assets)
    e = field_vertex(asset, scale, triangle, 1, assets) - p
    f = field_vertex(asset, scale, triangle, 2, assets) - p
    n = wp.cross(e, f)
    spacing = assets.field_spacing[asset]
    half = wp.float64(0.5)
    dx = (near[0] - half * wp.float64(nodes[0] - 1)) * spacing[0] * wp.float64(scale[0]) - p[0]
    dy = (near[1] - half * wp.float64(nodes[1] - 1)) * spacing[1] * wp.float64(scale[1]) - p[1]
    found.height = p[2] - (n[0] * dx + n[1] * dy) / n[2]
    found.normal = wp.normalize(to_float(n))
    found.inside = int(1)
    if near[0] != place[0] or near[1] != place[1]:
        found.inside = 0
    return found


@wp.func
def triangle_ray(p0: wp.vec3, p1: wp.vec3, p2: wp.vec3, direction: wp.vec3) -> float:
    """Parameter of a ray from the origin at a triangle, from either side (Möller and Trumbore 1997); NEVER: miss."""
    e = p1 - p0
    f = p2 - p0
    h = wp.cross(direction, f)
    determinant = wp.dot(e, h)
    if determinant == 0.0:
        return NEVER
    u = -wp.dot(p0, h) / determinant
    q = wp.cross(-p0, e)
    v = wp.dot(direction, q) / determinant
    if u < -HIT_SLACK or v < -HIT_SLACK or u + v > 1.0 + HIT_SLACK:
        return NEVER
    return wp.dot(f, q) / determinant


@wp.func
def slab(low: wp.float64, high: wp.float64, rate: float, window: wp.vec2) -> wp.vec2:
    """The part of a window of t in which low <= rate t <= high."""
    if rate == 0.0:
        if low > wp.float64(0.0) or high < wp.float64(0.0):
            return wp.vec2(1.0, 0.0)
        return window
    a = float(low) / rate
    b = float(high) / rate
    return wp.vec2(wp.max(window[0], wp.min(a, b)), wp.min(window[1], wp.max(a, b)))


@wp.func
def field_window(
    asset: int, scale: wp.vec3, start: wp.vec3d, direction: wp.vec3, max_t: float, assets: Assets
) -> wp.vec2:
    """First and last t of a ray within the bounds of a height field; the first is larger if it passes by."""
    last = field_vertex(asset, scale, 0, 0, assets)  # minus the far corner, but for its height
    s = wp.float64(scale[2])
    z = assets.field_range[asset]
    slack = wp.float64(1.0e-6) * (wp.abs(last[0]) + wp.abs(last[1]) + wp.abs(start[2]))
    window = wp.vec2(0.0, max_t)
    window = slab(last[0] - start[0], -last[0] - start[0], direction[0], window)
    window = slab(last[1] - start[1], -last[1] - start[1], direction[1], window)
    return slab(s * wp.float64(z[0]) - slack - start[2], s * wp.float64(z[1]) + slack - start[2], direction[2], window)


@wp.func
def cell_ray(
    asset: int, scale: wp.vec3, cell: int, start: wp.vec3d, direction: wp.vec3, low: float, high: float, assets: Assets
) -> SurfaceHit:
    """Nearest hit of a ray, between t = low and high, with the two triangles of a cell."""
    hit = SurfaceHit()
    hit.t = NEVER
    p0 = to_float(field_vertex(asset, scale, 2 * cell, 0, assets) - start)
    p1 = to_float(field_vertex(asset, scale, 2 * cell, 1, assets) - start)
    p2 = to_float(field_vertex(asset, scale, 2 * cell, 2, assets) - start)
    p3 = to_float(field_vertex(asset, scale, 2 * cell + 1, 2, assets) - start)
    from_z = wp.min(low * direction[2], high * direction[2])
    to_z = wp.max(low * direction[2], high * direction[2])
    bottom = wp.min(wp.min(p0[2], p1[2]), wp.min(p2[2], p3[2]))
    top = wp.max(wp.max(p0[2], p1[2]), wp.max(p2[2], p3[2]))
    slack = 1.0e-5 * (wp.abs(p0[0] - p2[0]) + wp.abs(p0[1] - p2[1]) + wp.abs(top) + wp.abs(bottom))
    if to_z < bottom - slack or from_z > top + slack:
        return hit
    for upper in range(2):
        a = p1
        b = p2
        if upper == 1:
            a = p2
            b = p3
        t = triangle_ray(p0, a, b, direction)
        if t >= 0.0 and t < hit.t:
            hit.t = t
            hit.normal = wp.normalize(wp.cross(a - p0, b - p0))
            hit.triangle = 2 * cell + upper
    return hit


@wp.func
def height_field_ray(
    asset: int, scale: wp.vec3, start: wp.vec3d, direction: wp.vec3, max_t: float, assets: Assets
) -> SurfaceHit:
    """First hit of a ray with a height field, from above or below: walks the cells under the ray
    (Amanatides and Woo 1987) and tests their triangles.

    `direction` [m per unit of t] need not be normalised; the ray ends at `max_t`.
    """
    best = SurfaceHit()
    best.t = -1.0
    best.triangle = -1
    window = field_window(asset, scale, start, direction, max_t, assets)
    if not window[0] <= window[1]:
        return best
    # the walk is relative to where the ray comes in
    entry = start + to_double(direction) * wp.float64(window[0])
    length = window[1] - window[0]
    nodes = assets.field_nodes[asset]
    spacing = assets.field_spacing[asset]
    place = field_place(asset, scale, entry[0], entry[1], assets)
    first = field_cell(asset, place, assets)
    rate_x = direction[0] / (float(spacing[0]) * scale[0])
    rate_y = direction[1] / (float(spacing[1]) * scale[1])
    at_x = float(place[0] - wp.float64(first[0]))
    at_y = float(place[1] - wp.float64(first[1]))
    column = int(first[0])
    row = int(first[1])
    t = float(0.0)
    while column >= 0 and row >= 0 and column < nodes[0] - 1 and row < nodes[1] - 1 and t <= length:
        next_x = float(NEVER)
        next_y = float(NEVER)
        if rate_x > 0.0:
            next_x = (float(column + 1 - first[0]) - at_x) / rate_x
        elif rate_x < 0.0:
            next_x = (float(column - first[0]) - at_x) / rate_x
        if rate_y > 0.0:
            next_y = (float(row + 1 - first[1]) - at_y) / rate_y
        elif rate_y < 0.0:
            next_y = (float(row - first[1]) - at_y) / rate_y
        end = wp.min(length, wp.min(next_x, next_y))
        hit = cell_ray(asset, scale, row * (nodes[0] - 1) + column, entry, direction, t, end, assets)
        if hit.t <= length:
            best = hit
            best.t = hit.t + window[0]
            return best
        if next_x <= next_y:
            column += wp.where(rate_x > 0.0, 1, -1)
        else:
            row += wp.where(rate_y > 0.0, 1, -1)
        t = wp.min(next_x, next_y)
    return best


@wp.func
def mesh_ray(
    asset: int, scale: wp.vec3, start: wp.vec3, direction: wp.vec3, max_t: float, assets: Assets
) -> SurfaceHit:
    """First hit of a ray with a mesh; units as `height_field_ray`."""
    hit = SurfaceHit()
    hit.t = -1.0
    hit.triangle = -1
    found = tree_ray(asset, wp.cw_div(start, scale), wp.cw_div(direction, scale), max_t, 0, assets.trees)
    if found.triangle >= 0:
        hit.t = found.t
        hit.triangle = found.triangle
        hit.normal = wp.normalize(wp.cross(wp.cw_mul(scale, found.edge1), wp.cw_mul(scale, found.edge2)))
    return hit


@wp.func
def mesh_vertex(asset: int, scale: wp.vec3, triangle: int, corner: int, assets: Assets) -> wp.vec3d:
    """Corner of a triangle of a mesh [m]."""
    v = to_double(wp.mesh_get_point(assets.mesh[asset], 3 * triangle + corner))
    return wp.cw_mul(to_double(scale), v)


@wp.func
def rotate_wide(rot: wp.mat33, v: wp.vec3d) -> wp.vec3d:
    """The product rot v in float64."""
    return wp.vec3d(
        wp.float64(rot[0, 0]) * v[0] + wp.float64(rot[0, 1]) * v[1] + wp.float64(rot[0, 2]) * v[2],
        wp.float64(rot[1, 0]) * v[0] + wp.float64(rot[1, 1]) * v[1] + wp.float64(rot[1, 2]) * v[2],
        wp.float64(rot[2, 0]) * v[0] + wp.float64(rot[2, 1]) * v[1] + wp.float64(rot[2, 2]) * v[2],
    )


@wp.func
def is_triangle_surface(kind: int) -> bool:
    """True if a shape consists of triangles."""
    return kind == HEIGHT_FIELD or kind == MESH


@wp.func
def triangle_surface_bounds(a: Shape, assets: Assets) -> Bounds:
    """Bounds about the shape's origin, world axes; a height field is solid down to half its width below its lowest
    point, so that sunk shapes are found.
    """
    lower = wp.vec3()
    upper = wp.vec3()
    if a.kind == MESH:
        lower = wp.cw_mul(a.size, assets.mesh_lower[a.asset])
        upper = wp.cw_mul(a.size, assets.mesh_upper[a.asset])
    else:
        corner = to_float(field_vertex(a.asset, a.size, 0, 0, assets))
        z = assets.field_range[a.asset] * a.size[2]
        lower = wp.vec3(corner[0], corner[1], z[0] + wp.min(corner[0], corner[1]))
        upper = wp.vec3(-corner[0], -corner[1], z[1])
    middle = a.rot * (0.5 * (lower + upper))
    reach = turned_extent(a.rot, 0.5 * (upper - lower))
    slack = a.margin + 2.0e-6 * wp.max(reach)
    b = Bounds()
    b.lower = middle - reach - wp.vec3(slack, slack, slack)
    b.upper = middle + reach + wp.vec3(slack, slack, slack)
    return b


@wp.func
def triangle_surface_of(a: Shape, x: wp.vec3d, lower: wp.vec3, upper: wp.vec3, reach: float) -> TriangleSurface:
    """Ground `a` with its origin at x, and the part of it near bounds of the other shape; pair's frame [m]."""
    g = TriangleSurface()
    g.kind = a.kind
    g.asset = a.asset
    g.scale = a.size
    g.margin = a.margin
    g.x = x
    g.rot = a.rot
    middle = rotate_wide(wp.transpose(a.rot), to_double(0.5 * (lower + upper)) - x)
    half = 0.5 * (upper - lower) + wp.vec3(reach + a.margin, reach + a.margin, reach + a.margin)
    size = to_double(turned_extent(wp.transpose(a.rot), half))
    size += wp.vec3d(wp.float64(1.0), wp.float64(1.0), wp.float64(1.0)) * (wp.float64(1.0e-6) * wp.length(middle))
    g.lower = middle - size
    g.upper = middle + size
    return g


@wp.func
def gather_field(g: TriangleSurface, first: int, listed: wp.array[int], assets: Assets) -> int:
    """Triangles of a height field from number `first` on that the other shape may touch, or has sunk below."""
    nodes = assets.field_nodes[g.asset]
    start = assets.field_start[g.asset]
    a = field_place(g.asset, g.scale, g.lower[0], g.lower[1], assets)
    b = field_place(g.asset, g.scale, g.upper[0], g.upper[1], assets)
    if wp.max(a[0] - wp.float64(nodes[0] - 1), a[1] - wp.float64(nodes[1] - 1)) > wp.float64(0.0):
        return 0
    if wp.min(b[0], b[1]) < wp.float64(0.0):
        return 0
    low = field_cell(g.asset, a, assets)
    high = field_cell(g.asset, b, assets)
    count = int(0)
    row = int(wp.max(low[1], first // 2 // (nodes[0] - 1)))
    bottom = float(g.lower[2])
    while row <= high[1]:
        column = int(low[0])
        while column <= high[0]:
            h = start + row * nodes[0] + column
            top = wp.max(
                wp.max(assets.field_height[h], assets.field_height[h + 1]),
                wp.max(assets.field_height[h + nodes[0]], assets.field_height[h + nodes[0] + 1]),
            )
            if top * g.scale[2] >= bottom:
                for upper in range(2):
                    triangle = 2 * (row * (nodes[0] - 1) + column) + upper
                    if triangle >= first and count < TRIANGLE_BATCH:
                        listed[count] = triangle
                        count += 1
            column += 1
        row += 1
        if count == TRIANGLE_BATCH:
            row = high[1] + 1
    return count


@wp.func
def gather_mesh(g: TriangleSurface, first: int, listed: wp.array[int], assets: Assets) -> int:
    """The lowest triangles of a mesh from number `first` on that are near, in order."""
    count = int(0)
    face = int(0)
    low = wp.cw_div(to_float(g.lower), g.scale)
    high = wp.cw_div(to_float(g.upper), g.scale)
    query = wp.mesh_query_aabb(assets.mesh[g.asset], low, high)
    while wp.mesh_query_aabb_next(query, face):
        place = int(count)
        if count == TRIANGLE_BATCH:
            place = count - 1
            if listed[place] < face:
                place = -1
        if face < first:
            place = -1
        if place >= 0:
            if count < TRIANGLE_BATCH:
                count += 1
            while place > 0 and listed[wp.max(place - 1, 0)] > face:
                listed[place] = listed[place - 1]
                place -= 1
            listed[place] = face
    return count


@wp.func
def gather(g: TriangleSurface, first: int, listed: wp.array[int], assets: Assets) -> int:
    """The next triangles, at most TRIANGLE_BATCH; a pair without ground has one piece."""
    if g.kind == HEIGHT_FIELD:
        return gather_field(g, first, listed, assets)
    if g.kind == MESH:
        return gather_mesh(g, first, listed, assets)
    return 1


@wp.func
def ground_vertex(g: TriangleSurface, triangle: int, corner: int, assets: Assets) -> wp.vec3:
    """Corner of a triangle in the pair's frame: float32 only after it is near the origin."""
    v = wp.vec3d()
    if g.kind == MESH:
        v = mesh_vertex(g.asset, g.scale, triangle, corner, assets)
    else:
        v = field_vertex(g.asset, g.scale, triangle, corner, assets)
    return to_float(g.x + rotate_wide(g.rot, v))


@wp.func
def neighbour_normal(g: TriangleSurface, triangle: int, edge: int, assets: Assets) -> wp.vec3:
    """Outward normal of the triangle across an edge, world axes; zero at a border."""
    if g.kind == MESH:
        n = assets.mesh_neighbour[3 * (assets.mesh_neighbour_start[g.asset] + triangle) + edge]
        return g.rot * safe_direction(wp.cw_div(n, g.scale), wp.vec3())
    nodes = assets.field_nodes[g.asset]
    other = field_neighbour(triangle, edge, nodes[0], nodes[1])
    if other < 0:
        return wp.vec3()
    return g.rot * field_normal(g.asset, g.scale, other, assets)
