"""The contact normal of two convex cores: the direction along which their separation is largest.

The separation along n is s(n) = min over b of n.x - max over a of n.x; its maximum over all unit n is the signed
distance. Trial normals are faces, cross products of edges, and the centres' direction. For polyhedra that overlap they
hold the answer. Otherwise the best one is improved: the cores are moved apart along the present normal m by t and the
direction n of their shortest distance, the maximum of s(n) + t n.m, is the next normal. s never decreases, and since
the moved cores are well apart, n is as accurate at a resting contact as elsewhere.
"""

import warp as wp

from simwarp.kernels.collision.gjk import facing_points, gjk
from simwarp.kernels.collision.shape import HULL, Assets, Shape
from simwarp.kernels.collision.support import (
    core_radius,
    edge_count,
    edge_direction,
    face_count,
    face_normal,
    inner_point,
    is_flat,
    is_polyhedron,
    rounding,
    safe_direction,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FACE_BIAS = wp.constant(5.0e-6)  # times the smaller shape: what an edge or a free direction must be better by
APART = wp.constant(0.03)  # times the smaller shape: distance of the moved cores
ROUNDS = wp.constant(12)
SHALLOW = wp.constant(1.0e-3)  # times the smaller shape: round shapes that overlap more get a second start
DEEP = wp.constant(0.03)  # times the smaller shape: overlaps beyond it are tried along SAMPLES more normals
SAMPLES = wp.constant(40)


@wp.struct
class Axis:
    """A contact normal from a to b."""

    normal: wp.vec3
    separation: float  # of the cores [m]
    at: wp.vec3  # a point of core a near the contact, relative to its origin
    pointed: int  # 1: `at` is set
    size: float  # radius of the smaller shape [m]


@wp.struct
class BestAxis:
    """Best of a set of trial normals, and the best face among them."""

    normal: wp.vec3
    separation: float
    face: wp.vec3
    face_separation: float


@wp.func
def trial_normal(a: Shape, b: Shape, k: int, faces_a: int, faces_b: int, centre: wp.vec3, assets: Assets) -> wp.vec3:
    """Trial normal `k`: faces of a, faces of b, edges of a times edges of b; zero where there is none."""
    if k < faces_a:
        return face_normal(a, k, centre, assets)
    i = k - faces_a
    if i < faces_b:
        return -face_normal(b, i, -centre, assets)
    i -= faces_b
    edges = edge_count(b, assets)
    n = wp.cross(edge_direction(a, i // edges, assets), edge_direction(b, i % edges, assets))
    length = wp.length(n)
    if length < 1.0e-4:
        return wp.vec3()
    return wp.where(wp.dot(n, centre) < 0.0, -n, n) / length


@wp.func
def sample_normal(k: int) -> wp.vec3:
    """Direction `k` of SAMPLES, evenly spread."""
    z = 1.0 - (2.0 * float(k) + 1.0) / float(SAMPLES)
    r = wp.sqrt(1.0 - z * z)
    t = 2.3999632 * float(k)
    return wp.vec3(r * wp.cos(t), r * wp.sin(t), z)


@wp.func
def try_normals(
    a: Shape, b: Shape, offset: wp.vec3, centre: wp.vec3, small: float, stop: float, assets: Assets
) -> BestAxis:
    """The best trial normal; ends early once a separation exceeds `stop`. `centre`: between inner points [m]."""
    trial = BestAxis()
    trial.separation = -3.0e38
    trial.face_separation = -3.0e38
    faces_a = face_count(a, assets)
    faces = faces_a + face_count(b, assets)
    last = faces + edge_count(a, assets) * edge_count(b, assets)
    bias = FACE_BIAS * small
    total = int(last + 1)
    k = int(0)
    while k < total:
        n = safe_direction(centre, wp.vec3(0.0, 0.0, 1.0))
        if k < last:
            n = trial_normal(a, b, k, faces_a, faces - faces_a, centre, assets)
        elif k > last:
            n = sample_normal(k - last - 1)
        # inner points lie inside, so that s(n) <= n.centre
        if wp.dot(n, centre) >= trial.separation and wp.length_sq(n) > 0.5:
            pair = facing_points(a, b, n, assets)
            s = wp.dot(n, offset + pair.b - pair.a)
            flat = is_flat(a, k)
            if k >= faces_a:
                flat = k < faces and is_flat(b, k - faces_a)
            if flat and s > trial.face_separation + bias:
                trial.face_separation = s
                trial.face = n
            if s > trial.separation + bias:
                trial.separation = s
                trial.normal = n
            if s > stop:
                total = 0
        if k == last and trial.separation < -DEEP * small and total > 0:
            total += SAMPLES
        k += 1
    return trial


@wp.func
def aligned_face(a: Shape, n: wp.vec3, assets: Assets) -> wp.vec3:
    """The outward normal of a hull's face nearest to the direction n; zero for other shapes."""
    best = wp.vec3()
    if a.kind == HULL and face_count(a, assets) == 0:
        cosine = float(-2.0)
        for face in range(assets.hull_face_start[a.asset + 1] - assets.hull_face_start[a.asset]):
            f = face_normal(a, face, n, assets)
            if wp.dot(f, n) > cosine:
                cosine = wp.dot(f, n)
                best = f
    return best


@wp.func
def refine_axis(
    a: Shape, b: Shape, offset: wp.vec3, start: Axis, small: float, large: float, stop: float, assets: Assets
) -> Axis:
    """Ascends s(n) from a trial normal; a direction must gain `FACE_BIAS` to replace it."""
    axis = start
    rounds = int(0)
    while rounds < ROUNDS:
        rounds += 1
        t = wp.max(0.0, APART * small - axis.separation)
        move = t * axis.normal
        reach = large + wp.length(offset + move)
        found = gjk(a, b, offset + move, axis.normal, reach, assets)
        s = found.separation - t * wp.dot(found.normal, axis.normal)
        gain = s - axis.separation
        if rounds == 1 or gain > 0.0:
            axis.at = found.at
            axis.pointed = 1
        if gain > 0.0:
            axis.normal = found.normal
            axis.separation = s
        if gain <= 2.0e-7 * reach or t == 0.0 or axis.separation > stop:
            rounds = ROUNDS
    return axis


@wp.func
def separation_axis(a: Shape, b: Shape, reach: float, assets: Assets) -> Axis:
    """The contact normal of two convex shapes, from a to b; its separation exceeds the reach if there is no contact."""
    offset = b.x - a.x
    centre = inner_point(b, assets) - inner_point(a, assets)
    stop = reach + rounding(a) + rounding(b)
    size_a = core_radius(a, assets) + rounding(a)
    size_b = core_radius(b, assets) + rounding(b)
    small = wp.min(size_a, size_b)
    large = size_a + size_b
    bias = FACE_BIAS * small
    trial = try_normals(a, b, offset, centre, small, stop, assets)
    axis = Axis()
    axis.normal = trial.normal
    axis.separation = trial.separation
    axis.size = small
    if trial.separation > stop:
        return axis
    if trial.separation <= 0.0 and is_polyhedron(a, assets) and is_polyhedron(b, assets):
        return axis
    start = axis
    starts = int(1)
    k = int(0)
    while k < starts:
        found = refine_axis(a, b, offset, start, small, large, stop, assets)
        if k == 0 or found.separation > axis.separation + bias:
            axis = found
        if k == 0 and axis.separation < -SHALLOW * small:
            # overlapping cores: the separation may have more than one peak
            starts = 2
            start.normal = safe_direction(centre, axis.normal)
            pair = facing_points(a, b, start.normal, assets)
            start.separation = wp.dot(start.normal, offset + pair.b - pair.a)
        k += 1
    # flat faces win over directions that are hardly better
    for snap in range(3):
        n = trial.face
        s = trial.face_separation
        if snap > 0:
            n = aligned_face(a, axis.normal, assets)
            if snap == 2:
                n = -aligned_face(b, -axis.normal, assets)
            s = -3.0e38
            if wp.dot(n, axis.normal) > 0.9:
                pair = facing_points(a, b, n, assets)
                s = wp.dot(n, offset + pair.b - pair.a)
        # apart, the direction found is exact
        if s >= axis.separation - wp.where(axis.separation > APART * small, 3.0e-7 * large, bias):
            axis.normal = n
            axis.separation = s
    return axis
