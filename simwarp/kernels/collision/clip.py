"""Contact manifold of two convex shapes whose normal is known: their support polygons, cut against each other.

Both polygons are seen along the normal, in coordinates (u, v, height); the contacts are the corners of what they
share, each with its own gap. Rows 0 and 1 of `polygon` are those of a and b; rows 1 and 2 alternate while b's is cut.
A side's label is its number, of a's polygon plus FACE_VERTICES; a corner's feature is made of the labels of its two
sides. Found contacts are kept as row 2: point, row 3: (feature, gap, distance from those chosen).
"""

import warp as wp

from simwarp.kernels.collision.axis import Axis
from simwarp.kernels.collision.polygon import support_polygon
from simwarp.kernels.collision.shape import (
    BOX,
    CAPSULE,
    FACE_VERTICES,
    HULL,
    MANIFOLD_CONTACTS,
    TRIANGLE,
    Assets,
    Manifold,
    Shape,
)
from simwarp.kernels.collision.support import rounding, sign_of

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

INSIDE = wp.constant(1.0e-5)  # times a side's length: a corner this far outside still counts as inside
PARALLEL_SINE = wp.constant(0.02)
SAME_DEPTH = wp.constant(8.0e-6)  # times the smaller shape: the deepest contact may miss the separation by this much
FEW = wp.constant(4)
BESIDE = wp.constant(0.03)  # times the manifold's width: a contact this near to others adds nothing
WITNESS = wp.constant(2048)  # feature of a contact that no corner of the polygons accounts for


@wp.struct
class View:
    """Coordinates along the normal: origin and axes."""

    origin: wp.vec3
    u: wp.vec3
    v: wp.vec3
    n: wp.vec3


@wp.func
def view_along(n: wp.vec3, origin: wp.vec3) -> View:
    """Right-handed axes with `n` as the third (Duff et al. 2017)."""
    view = View()
    sign = sign_of(n[2])
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    view.origin = origin
    view.u = wp.vec3(1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0])
    view.v = wp.vec3(b, sign + n[1] * n[1] * a, -n[1])
    view.n = n
    return view


@wp.func
def side_product(p: wp.vec3, q: wp.vec3) -> float:
    """Third component of p x q."""
    return p[0] * q[1] - p[1] * q[0]


@wp.func
def project_row(view: View, row: int, count: int, out: Manifold) -> wp.vec3:
    """Turns a row into view coordinates; returns Newell's normal of its polygon there."""
    normal = wp.vec3()
    first = wp.vec3()
    last = wp.vec3()
    for i in range(count):
        d = out.polygon[row, i] - view.origin
        p = wp.vec3(wp.dot(view.u, d), wp.dot(view.v, d), wp.dot(view.n, d))
        out.polygon[row, i] = p
        if i == 0:
            first = p
        else:
            normal += wp.cross(last - first, p - first)
        last = p
    return normal


@wp.func
def height_at(p: wp.vec3, corner: wp.vec3, normal: wp.vec3) -> float:
    """Height of a plane through `corner` above (u, v) of p."""
    return corner[2] - (normal[0] * (p[0] - corner[0]) + normal[1] * (p[1] - corner[1])) / normal[2]


@wp.func
def keep_contact(view: View, m: int, p: wp.vec3, height_a: float, gap: float, feature: int, out: Manifold) -> int:
    """Keeps contact `m`, whose surface of a is `height_a` above (u, v) of p; returns m + 1."""
    out.polygon[2, m] = view.origin + p[0] * view.u + p[1] * view.v + height_a * view.n
    out.polygon[3, m] = wp.vec3(float(feature), gap, 0.0)
    return m + 1


@wp.func
def cut_polygon(count_a: int, count_b: int, turn: float, out: Manifold) -> wp.vec2i:
    """Cuts row 1 by the sides of row 0, whose sense is `turn`; the row that holds the result, and its corners.

    The third coordinate of the result is the label of the side that begins at the corner.
    """
    row = int(1)
    count = int(count_b)
    for i in range(count_b):
        corner = out.polygon[1, i]
        out.polygon[1, i] = wp.vec3(corner[0], corner[1], float(i))
    c0 = out.polygon[0, count_a - 1]
    for k in range(count_a):
        c1 = out.polygon[0, k]
        e = turn * (c1 - c0)
        slack = INSIDE * (e[0] * e[0] + e[1] * e[1])
        side = float(FACE_VERTICES + k)
        m = int(0)
        if count > 0:
            p = out.polygon[row, count - 1]
            hp = side_product(e, p - c0) + slack
            for i in range(count):
                q = out.polygon[row, i]
                hq = side_product(e, q - c0) + slack
                if (hp >= 0.0) != (hq >= 0.0):
                    t = hp / (hp - hq)
                    label = wp.where(hp >= 0.0, side, p[2])
                    out.polygon[3 - row, m] = wp.vec3(p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t, label)
                    m += 1
                if hq >= 0.0:
                    out.polygon[3 - row, m] = q
                    m += 1
                p = q
                hp = hq
        c0 = c1
        row = 3 - row
        count = m
    return wp.vec2i(row, count)


@wp.func
def face_on_face(
    view: View, count_a: int, count_b: int, na: wp.vec3, nb: wp.vec3, thick_a: float, thick: float, reach: float,
    out: Manifold,
) -> int:  # fmt: skip
    """Contacts of two polygons."""
    plane_a = out.polygon[0, 0]
    plane_b = out.polygon[1, 0]
    cut = cut_polygon(count_a, count_b, sign_of(na[2]), out)
    row = cut[0]
    count = cut[1]
    m = int(0)
    if count > 0:
        before = int(out.polygon[row, count - 1][2])
        for i in range(count):
            p = out.polygon[row, i]
            label = int(p[2])
            ha = height_at(p, plane_a, na)
            gap = height_at(p, plane_b, nb) - ha - thick
            if gap < reach:
                m = keep_contact(view, m, p, ha + thick_a, gap, 32 * before + label, out)
            before = label
    return m


@wp.func
def line_on_face(
    view: View, line: int, count: int, normal: wp.vec3, thick_a: float, thick: float, reach: float, out: Manifold
) -> int:
    """Contacts of a segment, in row `line` (0: it is a's), and a polygon in the other row."""
    p = out.polygon[line, 0]
    e = out.polygon[line, 1] - p
    face = 1 - line
    turn = sign_of(normal[2])
    low = float(0.0)
    high = float(1.0)
    label_low = int(0)
    label_high = int(1)
    for side in range(count):
        c0 = out.polygon[face, side]
        f = out.polygon[face, wp.where(side + 1 == count, 0, side + 1)] - c0
        h = turn * side_product(f, p - c0) + INSIDE * (f[0] * f[0] + f[1] * f[1])
        rate = turn * side_product(f, e)
        if rate == 0.0:
            if h < 0.0:
                high = -1.0
        else:
            t = -h / rate
            if rate > 0.0 and t > low:
                low = t
                label_low = FACE_VERTICES + side
            if rate < 0.0 and t < high:
                high = t
                label_high = FACE_VERTICES + side
    corner = out.polygon[face, 0]
    m = int(0)
    if low <= high:
        for k in range(2):
            q = p + e * wp.where(k == 0, low, high)
            label = wp.where(k == 0, label_low, label_high)
            other = height_at(q, corner, normal)
            ha = wp.where(line == 0, q[2], other)
            gap = wp.where(line == 0, other - q[2], q[2] - other) - thick
            if gap < reach and (k == 0 or high > low):
                m = keep_contact(view, m, q, ha + thick_a, gap, 64 * k + label, out)
    return m


@wp.func
def line_on_line(view: View, separation: float, thick_a: float, thick: float, reach: float, out: Manifold) -> int:
    """Contacts of two segments: the ends of what they share when parallel, else where they cross."""
    a = out.polygon[0, 0]
    d = out.polygon[0, 1] - a
    b = out.polygon[1, 0]
    e = out.polygon[1, 1] - b
    dd = d[0] * d[0] + d[1] * d[1]
    ee = e[0] * e[0] + e[1] * e[1]
    cross = side_product(d, e)
    if cross * cross > PARALLEL_SINE * PARALLEL_SINE * dd * ee:
        t = wp.clamp(side_product(b - a, e) / cross, 0.0, 1.0)
        p = a + t * d
        return keep_contact(view, 0, p, p[2] + thick_a, separation - thick, 512, out)
    if dd == 0.0 or ee == 0.0:
        return 0
    t0 = ((b[0] - a[0]) * d[0] + (b[1] - a[1]) * d[1]) / dd
    t1 = t0 + (e[0] * d[0] + e[1] * d[1]) / dd
    slope = e[2] / (t1 - t0)
    low = wp.max(0.0, wp.min(t0, t1))
    high = wp.min(1.0, wp.max(t0, t1))
    m = int(0)
    if low <= high + 1.0e-5:
        for k in range(2):
            t = wp.where(k == 0, low, high)
            p = a + t * d
            gap = b[2] + (t - t0) * slope - p[2] - thick
            if gap < reach and (k == 0 or high > low + 1.0e-3):
                m = keep_contact(view, m, p, p[2] + thick_a, gap, 256 + k, out)
    return m


@wp.func
def write_contact(k: int, n: wp.vec3, point: wp.vec3, gap: float, feature: int, flip: int, out: Manifold):
    """Contact `k` of the result; with `flip` the two shapes change places."""
    out.gap[k] = gap
    out.feature[k] = feature
    if flip == 1:
        out.normal[k] = -n
        out.point[k] = point + gap * n
    else:
        out.normal[k] = n
        out.point[k] = point


@wp.func
def between(taken: int, at: wp.vec3, slack: float, flip: int, out: Manifold) -> bool:
    """True if a point lies on the line between two contacts already taken, within sqrt(slack)."""
    for i in range(taken):
        p = out.point[i]
        if flip == 1:
            p = p + out.gap[i] * out.normal[i]
        for j in range(i):
            q = out.point[j]
            if flip == 1:
                q = q + out.gap[j] * out.normal[j]
            d = q - p
            t = wp.clamp(wp.dot(at - p, d) / wp.max(wp.length_sq(d), 1.0e-30), 0.0, 1.0)
            if wp.length_sq(at - p - t * d) < slack:
                return True
    return False


@wp.func
def write_kept(count: int, n: wp.vec3, flip: int, out: Manifold) -> int:
    """Writes the kept contacts. Of more than four, the deepest and then always the one farthest from those taken, until
    there are enough. What lies beside one of them or between two adds nothing: faces that nearly match have their
    corners twice, and points where their sides cross.
    """
    if count <= FEW:
        for i in range(count):
            c = out.polygon[3, i]
            write_contact(i, n, out.polygon[2, i], c[1], int(c[0]), flip, out)
        return count
    last = int(0)
    for i in range(count):
        c = out.polygon[3, i]
        if c[1] < out.polygon[3, last][1]:
            last = i
        out.polygon[3, i] = wp.vec3(c[0], c[1], 3.0e38)  # squared distance from those taken; negative: taken
    taken = int(0)
    passed = int(0)
    span = float(0.0)
    farthest = float(3.0e38)
    while taken < MANIFOLD_CONTACTS and passed < count and farthest > BESIDE * BESIDE * span:
        chosen = out.polygon[3, last]
        at = out.polygon[2, last]
        out.polygon[3, last] = wp.vec3(chosen[0], chosen[1], -1.0)
        passed += 1
        if taken < FEW or not between(taken, at, BESIDE * BESIDE * span, flip, out):
            write_contact(taken, n, at, chosen[1], int(chosen[0]), flip, out)
            taken += 1
        farthest = float(-1.0)
        for i in range(count):
            c = out.polygon[3, i]
            c[2] = wp.min(c[2], wp.length_sq(out.polygon[2, i] - at))
            out.polygon[3, i] = c
            if c[2] > 1.001 * farthest:  # nearly equal ones keep their order
                farthest = c[2]
                last = i
        span = wp.max(span, farthest)
    return taken


@wp.func
def is_flat(a: Shape) -> bool:
    """True if the shape has flat faces only."""
    return a.kind == BOX or a.kind == HULL or a.kind == TRIANGLE


@wp.func
def contact_manifold(a: Shape, b: Shape, axis: Axis, reach: float, flip: int, assets: Assets, out: Manifold) -> int:
    """Contacts of two convex shapes along a known axis; at least one if they are within reach."""
    n = axis.normal
    thick_a = rounding(a)
    thick = thick_a + rounding(b)
    count_a = int(0)
    count_b = int(0)
    shape = a
    d = n
    for row in range(2):
        count_b = support_polygon(shape, d, row, assets, out)
        if row == 0:
            count_a = count_b
            shape = b
            d = -n
    view = view_along(n, out.polygon[0, 0])
    na = project_row(view, 0, count_a, out)
    nb = project_row(view, 1, count_b, out)
    corner_a = out.polygon[0, 0]
    corner_b = out.polygon[1, 0]
    middle = 0.5 * (out.polygon[0, count_a // 2] + out.polygon[1, count_b // 2])
    if axis.pointed == 1:
        at = a.x + axis.at - view.origin
        middle = wp.vec3(wp.dot(view.u, at), wp.dot(view.v, at), wp.dot(view.n, at))
    gap = axis.separation - thick
    m = int(0)
    if count_b == 1:
        m = keep_contact(view, 0, corner_b, corner_b[2] - axis.separation + thick_a, gap, 1024, out)
    elif count_a == 1:
        m = keep_contact(view, 0, corner_a, corner_a[2] + thick_a, gap, 1025, out)
    elif count_a == 2 and count_b == 2:
        m = line_on_line(view, axis.separation, thick_a, thick, reach, out)
    elif count_a == 2:
        m = line_on_face(view, 0, count_b, nb, thick_a, thick, reach, out)
    elif count_b == 2:
        m = line_on_face(view, 1, count_a, na, thick_a, thick, reach, out)
    else:
        m = face_on_face(view, count_a, count_b, na, nb, thick_a, thick, reach, out)
    deepest = float(3.0e38)
    shallowest = int(0)
    for i in range(m):
        # nothing is deeper than the separation; corners just outside, which count as inside, may seem so
        c = out.polygon[3, i]
        c[1] = wp.max(c[1], gap)
        out.polygon[3, i] = c
        deepest = wp.min(deepest, c[1])
        if out.polygon[3, i][1] > out.polygon[3, shallowest][1]:
            shallowest = i
    # flat faces meet in their corners alone; polygons stand for round edges with less than their depth
    flat = m > 0 and is_flat(a) and is_flat(b)
    if not flat and gap < reach and deepest > gap + SAME_DEPTH * axis.size:
        slot = m
        if m > 1 and (a.kind == CAPSULE or b.kind == CAPSULE):
            slot = shallowest
        keep_contact(view, slot, middle, middle[2] + thick_a, gap, WITNESS, out)
        m = wp.max(m, slot + 1)
    return write_kept(m, n, flip, out)
