"""Contacts of a convex shape with the triangles of a height field or mesh, one triangle at a time, and their reduction.

Triangles have one outer side; what lies behind them is solid. Their contacts are kept only where the whole surface
would have them: along the face normal, or, over an edge that bends away, between the normals of its two faces
("internal edges", Moravanszky and Terdiman 2004). Over flat and inner edges the neighbour's face does the work.
"""

import warp as wp

from simwarp.kernels.collision.shape import (
    MANIFOLD_CONTACTS,
    MESH,
    Assets,
    Manifold,
    Shape,
)
from simwarp.kernels.collision.support import rounding, safe_direction, support
from simwarp.kernels.collision.surfaces import (
    NEVER,
    TRIANGLE_BATCH,
    TriangleSurface,
    gather,
    ground_vertex,
    neighbour_normal,
)
from simwarp.kernels.core.scratch import ScratchGroup, scratch_array

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

RAW_CONTACTS = wp.constant(64)  # of all triangles before the reduction
THINNED = wp.constant(24)  # kept when they become too many on the way
SAME_NORMAL = wp.constant(2.0e-3)  # [rad] normals this close to a face's are that; edges that bend less are flat
MERGED_NORMAL = wp.constant(1.0e-4)  # squared difference of normals, and
MERGED = wp.constant(2.0e-3)  # distance in radii of the shape, below which two contacts are one
NEAR_EDGE = wp.constant(1.0e-3)  # of the triangle or the shape's radius: points this close to two edges are on both
TILT = wp.constant(0.02)  # [rad] of the directions along which lowest points are looked for
STEEP = wp.constant(10.0)  # they are deeper than the sideways overlap by this factor at most
AROUND = wp.constant(16)  # directions in which the outermost contacts are kept, the first at
FIRST_ANGLE = wp.constant(0.61)  # [rad] where boxes along the axes have one corner farthest out
SHALLOW = wp.constant(5.0)  # a contact that is farther out must not be shallower by a fifth of that
SLOPE = wp.constant(0.02)  # of the radius: a contact this much shallower than the deepest counts half in the reduction
EDGE_CONTACT = wp.constant(0x40000000)  # bit of the feature of contacts along other normals than the face's


@wp.struct
class Triangle:
    """A triangle in the pair's frame."""

    index: int
    p0: wp.vec3
    p1: wp.vec3
    p2: wp.vec3
    normal: wp.vec3


class RawContactScratch(ScratchGroup, packed=False, prefix="raw_"):
    """Contacts of all triangles, from the triangle to the convex shape; points on the triangle's surface."""

    triangle = scratch_array(wp.int32, TRIANGLE_BATCH)
    normal = scratch_array(wp.vec3, RAW_CONTACTS)
    point = scratch_array(wp.vec3, RAW_CONTACTS)
    gap = scratch_array(wp.float32, RAW_CONTACTS)
    feature = scratch_array(wp.int32, RAW_CONTACTS)
    spread = scratch_array(wp.float32, RAW_CONTACTS)


RawContacts = RawContactScratch.struct("RawContacts", __name__)


@wp.struct
class ContactAccumulator:
    """Raw contacts so far, and the shallowest of those that lift a sunk shape out."""

    count: int
    sunk: int  # 1: there is one
    gap: float
    normal: wp.vec3
    point: wp.vec3
    feature: int


@wp.func
def ground_triangle(g: TriangleSurface, index: int, assets: Assets) -> Triangle:
    """A triangle in the pair's frame."""
    t = Triangle()
    t.index = index
    t.p0 = ground_vertex(g, index, 0, assets)
    t.p1 = ground_vertex(g, index, 1, assets)
    t.p2 = ground_vertex(g, index, 2, assets)
    t.normal = safe_direction(wp.cross(t.p1 - t.p0, t.p2 - t.p0), wp.vec3(0.0, 0.0, 1.0))
    return t


@wp.func
def corner_of(t: Triangle, k: int) -> wp.vec3:
    """Corner k modulo 3."""
    if k == 1:
        return t.p1
    if k == 2:
        return t.p2
    return t.p0


@wp.func
def covers(t: Triangle, along: wp.vec3, p: wp.vec3) -> bool:
    """True if a line through p along a direction on the outer side meets the triangle."""
    inside = bool(True)
    for k in range(3):
        a = corner_of(t, k)
        if wp.dot(wp.cross(corner_of(t, (k + 1) % 3) - a, p - a), along) < 0.0:
            inside = False
    return inside


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
    """Where a shape is, seen from a triangle of the ground."""
    t = ground_triangle(g, index, assets)
    return seen_from(t, wp.where(g.kind == MESH, t.normal, up), g.margin, b, middle, reach, assets)


@wp.func
def seen_from(
    t: Triangle, along: wp.vec3, margin: float, b: Shape, middle: wp.vec3, reach: float, assets: Assets
) -> FacingTriangle:
    """Where a shape is, seen from a triangle; it has sunk where its middle is behind that, seen along `along`."""
    f = FacingTriangle()
    low = b.x + support(b, -t.normal, assets) - rounding(b) * t.normal
    gap = wp.dot(t.normal, low - t.p0) - margin
    top = wp.dot(t.normal, b.x + support(b, t.normal, assets) - t.p0) + rounding(b) + margin
    f.t = t
    f.low = low
    f.gap = gap
    f.height = wp.dot(t.normal, middle - t.p0)
    f.wanted = 1
    if f.height < 0.0 and covers(t, along, middle):
        f.sunk = 1
    if gap >= reach or top < 0.0:
        f.wanted = 0
    return f


@wp.func
def nearest_on_triangle(t: Triangle, c: wp.vec3) -> wp.vec3:
    """The point of a triangle's border that is nearest to c, which is not above or below its inside."""
    best = t.p0
    least = float(NEVER)
    for k in range(3):
        a = corner_of(t, k)
        e = corner_of(t, (k + 1) % 3) - a
        s = wp.clamp(wp.dot(e, c - a) / wp.max(wp.length_sq(e), 1.0e-30), 0.0, 1.0)
        q = a + s * e
        d = wp.length_sq(c - q)
        if d < least:
            least = d
            best = q
    return best


@wp.func
def distance_to(t: Triangle, c: wp.vec3) -> float:
    """Distance of a point from a triangle [m]."""
    if covers(t, t.normal, c):
        return wp.abs(wp.dot(t.normal, c - t.p0))
    return wp.length(c - nearest_on_triangle(t, c))


@wp.func
def triangle_sphere(t: Triangle, margin: float, b: Shape, reach: float, out: Manifold) -> int:
    """Contact of a triangle and a sphere, from the triangle to the sphere."""
    n = t.normal
    distance = wp.dot(n, b.x - t.p0)
    if distance < 0.0:
        n = -n
        distance = -distance
    if not covers(t, t.normal, b.x):
        d = b.x - nearest_on_triangle(t, b.x)
        n = safe_direction(d, n)
        distance = wp.length(d)
    gap = distance - margin - rounding(b)
    if gap >= reach:
        return 0
    out.normal[0] = n
    out.point[0] = b.x - (distance - margin) * n
    out.gap[0] = gap
    out.feature[0] = 0
    return 1


@wp.func
def is_valid_contact_normal(t: Triangle, others: wp.mat33, n: wp.vec3, p: wp.vec3, size: float) -> bool:
    """True if a contact at p on a triangle along n, which is not the face's normal, is one of the whole surface: over
    every edge near p that n leans over the surface bends away by at least as much. Columns of `others` are the normals
    across the edges, zero at a border.
    """
    if wp.dot(n, t.normal) < -SAME_NORMAL:
        return False
    nearest = float(NEVER)
    longest = float(0.0)
    for k in range(3):
        a = corner_of(t, k)
        e = corner_of(t, (k + 1) % 3) - a
        longest = wp.max(longest, wp.length(e))
        nearest = wp.min(nearest, wp.dot(safe_direction(wp.cross(t.normal, e), wp.vec3()), p - a))
    slack = NEAR_EDGE * wp.min(longest, size)
    leans = bool(False)
    fits = bool(True)
    for k in range(3):
        a = corner_of(t, k)
        outwards = safe_direction(wp.cross(corner_of(t, (k + 1) % 3) - a, t.normal), wp.vec3())
        if -wp.dot(outwards, p - a) <= nearest + slack:
            angle = wp.atan2(wp.dot(n, outwards), wp.dot(n, t.normal))
            if angle > SAME_NORMAL:
                leans = True
                other = wp.vec3(others[0, k], others[1, k], others[2, k])
                if wp.length_sq(other) > 0.0:
                    bend = wp.atan2(wp.dot(other, outwards), wp.dot(other, t.normal))
                    if bend <= SAME_NORMAL or angle > bend + SAME_NORMAL:
                        fits = False
    return leans and fits


@wp.func
def feature_id(triangle: int, feature: int) -> int:
    """One number for a feature of a triangle."""
    return ((triangle * 73856093) ^ (feature * 19349663 + 83492791)) & 0x3FFFFFFF


@wp.func
def exchange(i: int, j: int, raw: RawContacts):
    """Two raw contacts change places."""
    normal = raw.normal[i]
    point = raw.point[i]
    gap = raw.gap[i]
    feature = raw.feature[i]
    spread = raw.spread[i]
    raw.normal[i] = raw.normal[j]
    raw.point[i] = raw.point[j]
    raw.gap[i] = raw.gap[j]
    raw.feature[i] = raw.feature[j]
    raw.spread[i] = raw.spread[j]
    raw.normal[j] = normal
    raw.point[j] = point
    raw.gap[j] = gap
    raw.feature[j] = feature
    raw.spread[j] = spread


@wp.func
def reduce_contacts(count: int, left: int, size: float, raw: RawContacts) -> int:
    """Keeps at most `left` contacts: the deepest; those farthest out around it, which hold the shape's edge; then
    always the one farthest, in place and normal, from those kept. Shallow ones count less. Returns how many.
    """
    if count <= left:
        return count
    best = int(0)
    for i in range(count):
        if raw.gap[i] < raw.gap[best]:
            best = i
    exchange(0, best, raw)
    deepest = raw.gap[0]
    n = raw.normal[0]
    u = safe_direction(wp.cross(n, wp.vec3(0.0, 1.0, 0.0)), wp.vec3(1.0, 0.0, 0.0))
    v = wp.cross(n, u)
    kept = int(1)
    directions = wp.min(left, AROUND)
    for k in range(directions):
        angle = FIRST_ANGLE + 6.2831853 * float(k) / float(directions)
        d = wp.cos(angle) * u + wp.sin(angle) * v
        best = int(0)
        highest = float(-NEVER)
        for i in range(count):
            height = wp.dot(d, raw.point[i]) - SHALLOW * (raw.gap[i] - deepest)
            if height > highest:
                highest = height
                best = i
        if best >= kept and kept < left:
            exchange(kept, best, raw)
            kept += 1
    for i in range(count):
        raw.spread[i] = NEVER
    for k in range(left):
        farthest = float(-1.0)
        for i in range(k + 1, count):
            apart = wp.length_sq(raw.point[i] - raw.point[k])
            apart += size * size * wp.length_sq(raw.normal[i] - raw.normal[k])
            raw.spread[i] = wp.min(raw.spread[i], apart)
            score = raw.spread[i] * SLOPE * size / (SLOPE * size + raw.gap[i] - deepest)
            if score > 1.001 * farthest:
                farthest = score
                best = i
        if k + 1 >= kept and k + 1 < left:
            exchange(k + 1, best, raw)
    return left


@wp.func
def add_raw(
    count: int, n: wp.vec3, point: wp.vec3, gap: float, feature: int, size: float, raw: RawContacts
) -> int:  # fmt: skip
    """Adds a contact unless an equal one is there, which then keeps the smaller gap; returns how many there are."""
    for i in range(count):
        near = wp.length_sq(raw.point[i] - point) < MERGED * MERGED * size * size
        if near and wp.length_sq(raw.normal[i] - n) < MERGED_NORMAL:
            raw.gap[i] = wp.min(raw.gap[i], gap)
            return count
    last = int(count)
    if last == RAW_CONTACTS:
        last = reduce_contacts(count, THINNED, size, raw)
    raw.normal[last] = n
    raw.point[last] = point
    raw.gap[last] = gap
    raw.feature[last] = feature
    return last + 1


@wp.func
def add_penetrating(found: ContactAccumulator, t: Triangle, low: wp.vec3, gap: float) -> ContactAccumulator:
    """A sunk shape leaves along the face normal; of several ways the shortest."""
    now = found
    if now.sunk == 0 or gap > now.gap:
        now.sunk = 1
        now.gap = gap
        now.normal = t.normal
        now.point = low - gap * t.normal
        now.feature = feature_id(t.index, 8191)
    return now


@wp.struct
class SurfaceContact:
    """A contact with one triangle as the whole surface has it."""

    kept: int  # 0: it has none
    normal: wp.vec3
    point: wp.vec3
    gap: float
    feature: int


@wp.func
def deepest_vertex(
    k: int, deepest: float, margin: float, t: Triangle, b: Shape, assets: Assets
) -> SurfaceContact:  # fmt: skip
    """Contact along the face normal at one of a shape's lowest points (corners, the ends of an edge) behind a triangle.

    For overlaps that leave the triangle sideways by less than they are deep, as that of a box's corner pushed into a
    node of the grid does for each triangle around it. `deepest`: that sideways overlap [m]; `k`: 0 to 3.
    """
    c = SurfaceContact()
    u = safe_direction(wp.cross(t.normal, t.p1 - t.p0), wp.vec3(1.0, 0.0, 0.0))
    v = wp.cross(t.normal, u)
    tilt = wp.where(k % 2 == 0, TILT, -TILT) * u + wp.where(k < 2, TILT, -TILT) * v
    low = b.x + support(b, wp.normalize(tilt - t.normal), assets) - rounding(b) * t.normal
    height = wp.dot(t.normal, low - t.p0)
    gap = height - margin
    distance = distance_to(t, low)
    if gap < 0.0 and gap > -STEEP * deepest and distance * distance < height * height + 0.25 * gap * gap:
        c.kept = 1
        c.normal = t.normal
        c.point = low - gap * t.normal
        c.gap = gap
        c.feature = feature_id(t.index, 8187 + k)
    return c


@wp.func
def is_along_face(i: int, t: Triangle, manifold: Manifold) -> bool:
    """True if contact `i` of a triangle is along its normal."""
    return wp.length_sq(manifold.normal[i] - t.normal) < SAME_NORMAL * SAME_NORMAL


@wp.func
def face_contact(i: int, margin: float, t: Triangle, manifold: Manifold) -> SurfaceContact:
    """Contact `i` of a triangle, which is along its normal."""
    c = SurfaceContact()
    at = manifold.point[i] + manifold.gap[i] * manifold.normal[i]
    face_gap = wp.dot(t.normal, at - t.p0) - margin
    c.kept = 1
    c.normal = t.normal
    c.point = at - face_gap * t.normal
    c.gap = face_gap
    c.feature = feature_id(t.index, manifold.feature[i])
    return c


@wp.func
def edge_contact(i: int, t: Triangle, manifold: Manifold) -> SurfaceContact:
    """Contact `i` of a triangle, which is along another direction."""
    c = SurfaceContact()
    c.kept = 1
    c.normal = manifold.normal[i]
    c.point = manifold.point[i]
    c.gap = manifold.gap[i]
    c.feature = feature_id(t.index, manifold.feature[i]) | EDGE_CONTACT
    return c


@wp.func
def neighbour_normals(g: TriangleSurface, triangle: int, assets: Assets) -> wp.mat33:
    """Normals across the three edges of a triangle of the ground, as columns."""
    return wp.matrix_from_cols(
        neighbour_normal(g, triangle, 0, assets), neighbour_normal(g, triangle, 1, assets),
        neighbour_normal(g, triangle, 2, assets),
    )  # fmt: skip


@wp.func
def surface_contact(
    i: int, g: TriangleSurface, t: Triangle, size: float, assets: Assets, manifold: Manifold
) -> SurfaceContact:  # fmt: skip
    """Contact `i` of one triangle of the ground, if the surface as a whole has it."""
    c = SurfaceContact()
    if is_along_face(i, t, manifold):
        c = face_contact(i, g.margin, t, manifold)
    else:
        n = manifold.normal[i]
        others = neighbour_normals(g, t.index, assets)
        if is_valid_contact_normal(t, others, n, manifold.point[i] - g.margin * n, size):
            c = edge_contact(i, t, manifold)
    return c


@wp.func
def drop_internal_edge_contacts(count: int, g: TriangleSurface, size: float, assets: Assets, raw: RawContacts) -> int:
    """Drops contacts on edges and corners where a triangle around them reaches farther along the normal: the shape is
    nearer to another point of that triangle. Returns how many are left.
    """
    triangles = int(0)
    for i in range(count):
        if raw.feature[i] >= EDGE_CONTACT:
            triangles = TRIANGLE_BATCH
    if triangles > 0:
        triangles = gather(g, 0, raw.triangle, assets)
    while triangles > 0:
        for k in range(triangles):
            t = ground_triangle(g, raw.triangle[k], assets)
            for i in range(count):
                n = raw.normal[i]
                p = raw.point[i] - g.margin * n
                if raw.feature[i] >= EDGE_CONTACT and distance_to(t, p) < MERGED * size:
                    a = t.p0 - p
                    b = t.p1 - p
                    c = t.p2 - p
                    longest = wp.max(wp.length(a), wp.max(wp.length(b), wp.length(c)))
                    beyond = wp.max(wp.dot(n, a), wp.max(wp.dot(n, b), wp.dot(n, c)))
                    if beyond > 2.0 * SAME_NORMAL * longest:
                        raw.gap[i] = NEVER
        if triangles == TRIANGLE_BATCH:
            triangles = gather(g, raw.triangle[triangles - 1] + 1, raw.triangle, assets)
        else:
            triangles = 0
    left = int(0)
    for i in range(count):
        if raw.gap[i] < NEVER:
            if left < i:
                exchange(left, i, raw)
            left += 1
    return left


@wp.func
def write_raw(found: ContactAccumulator, flip: int, size: float, raw: RawContacts, out: Manifold) -> int:
    """The pair's contacts; with `flip` the ground is its shape 1."""
    left = MANIFOLD_CONTACTS - found.sunk
    count = reduce_contacts(found.count, left, size, raw)
    for i in range(count + found.sunk):
        n = found.normal
        point = found.point
        gap = found.gap
        feature = found.feature
        if i < count:
            n = raw.normal[i]
            point = raw.point[i]
            gap = raw.gap[i]
            feature = raw.feature[i]
        out.gap[i] = gap
        out.feature[i] = feature
        out.normal[i] = n
        out.point[i] = point
        if flip == 1:
            out.normal[i] = -n
            out.point[i] = point + gap * n
    return count + found.sunk
