"""Contacts of all pairs of shapes against a brute-force reference, and the properties that resting contact needs."""

import itertools

import numpy as np
import pytest
import warp as wp

from simwarp.kernels.collision.shape import Assets, Shape
from simwarp.kernels.collision.support import shape_bounds, shape_extent
from tests.reference.collision import TRIANGLE, Solid, corners, heights, separation, signed_distance, unit
from tests.unit.kernels.collision.collision_pairs import (
    BOX,
    CAPSULE,
    CONE,
    CYLINDER,
    ELLIPSOID,
    HULL,
    HULLS,
    KINDS,
    PLANE,
    SPHERE,
    Batch,
    collide_all,
    moved,
    random_rotation,
    random_solid,
    rounded,
)

# mypy: disable-error-code="index"
wp.set_module_options({"enable_backward": False, "max_unroll": 0})
PAIRS = list(itertools.combinations_with_replacement(KINDS, 2))
EYE = np.eye(3)


def name(kind):
    return getattr(kind, "name", "TRIANGLE")


def solid(kind, size, x=(0.0, 0.0, 0.0), rot=EYE, **options):
    s = Solid(int(kind), rounded(x), rounded(rot), rounded(size), **options)
    if kind == HULL:
        hull = HULLS[s.asset]
        s.vertices, s.normals, s.edges = rounded(hull.vertices), hull.normals, hull.edges
    return s


def triangle(points):
    return Solid(TRIANGLE, np.zeros(3), EYE, np.zeros(3), vertices=rounded(points))


def turn(axis, angle):
    """Rotation matrix about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    m = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    m[i, i], m[i, j], m[j, i], m[j, j] = c, -s, s, c
    return m


def near_pair(kind_a, kind_b, rng, gap, scale=1.0, ratio=1.0):
    """A random pair whose separation along some direction is `gap` times the smaller shape."""
    a, b = random_solid(kind_a, rng, scale), random_solid(kind_b, rng, scale * ratio)
    n = unit(rng.normal(size=(1, 3)))
    small = min(a.radius, b.radius)
    return (a, moved(b, n[0] * (heights(a, n)[0] + heights(b, -n)[0] + gap * small))), small


@pytest.mark.parametrize(("kind_a", "kind_b"), PAIRS, ids=[f"{name(a)}-{name(b)}" for a, b in PAIRS])
@pytest.mark.sweep
def test_deepest_gap_against_the_reference(kind_a, kind_b):
    rng = np.random.default_rng(7)
    pairs, sizes = zip(*[near_pair(kind_a, kind_b, rng, gap) for gap in (0.2, -1e-4, -0.02)], strict=True)
    for (a, b), small, found in zip(pairs, sizes, collide_all(list(pairs)), strict=True):
        truth, _ = signed_distance(a, b)
        assert len(found) > 0
        assert found.gap.min() == pytest.approx(truth, abs=2e-5 * small)
        assert separation(a, b, found.normal[:1])[0] == pytest.approx(truth, abs=2e-5 * small)


@pytest.mark.parametrize("kind", KINDS, ids=name)
def test_plane_against_the_reference(kind):
    rng = np.random.default_rng(3)
    pairs = []
    for gap in (0.2, 1e-5, -1e-5, -0.1, -1.0):
        plane = solid(PLANE, np.zeros(3), rot=random_rotation(rng))
        b = random_solid(kind, rng)
        n = plane.rot[:, 2]
        pairs.append((plane, moved(b, n * (heights(b, -n[None])[0] + gap))))
    for (a, b), found in zip(pairs, collide_all(pairs), strict=True):
        assert found.gap.min() == pytest.approx(signed_distance(a, b)[0], abs=1e-6)
        np.testing.assert_allclose(found.normal, np.broadcast_to(a.rot[:, 2], found.normal.shape), atol=1e-7)


@pytest.mark.parametrize("kind", [SPHERE, CYLINDER, BOX, HULL, ELLIPSOID], ids=name)
def test_deep_overlap_is_near_the_least(kind):
    rng = np.random.default_rng(11)
    pairs = [near_pair(kind, BOX, rng, -0.5)[0] for _ in range(4)]
    for (a, b), found in zip(pairs, collide_all(pairs), strict=True):
        truth, _ = signed_distance(a, b)
        assert found.gap.min() == pytest.approx(truth, rel=0.05)


def test_normals_where_the_distance_is_smooth():
    rng = np.random.default_rng(2)
    kinds = [(SPHERE, BOX), (SPHERE, ELLIPSOID), (SPHERE, CONE), (ELLIPSOID, ELLIPSOID), (CAPSULE, CYLINDER)]
    pairs = [near_pair(a, b, rng, gap)[0] for a, b in kinds for gap in (0.1, -0.01)]
    for (a, b), found in zip(pairs, collide_all(pairs), strict=True):
        assert np.linalg.norm(found.normal[0] - signed_distance(a, b)[1]) < 1e-3


@pytest.mark.parametrize(("scale", "ratio"), [(1e-2, 1.0), (1e2, 1.0), (0.1, 1000.0)])
def test_sizes_from_centimetres_to_hundred_metres(scale, ratio):
    rng = np.random.default_rng(5)
    kinds = [(BOX, BOX), (HULL, BOX), (CYLINDER, BOX), (CAPSULE, TRIANGLE), (ELLIPSOID, BOX)]
    pairs = [near_pair(a, b, rng, gap, scale, ratio)[0] for a, b in kinds for gap in (0.1, -0.01)]
    for (a, b), found in zip(pairs, collide_all(pairs), strict=True):
        truth, _ = signed_distance(a, b)
        assert found.gap.min() == pytest.approx(truth, abs=2e-5 * min(a.radius, b.radius) + 1e-6 * scale * ratio)


def mixed_pairs(count=3):
    rng = np.random.default_rng(13)
    return [near_pair(a, b, rng, gap)[0] for a, b in PAIRS for gap in np.linspace(-0.05, 0.05, count)]


def test_swapped_arguments_give_the_mirrored_contacts():
    pairs = mixed_pairs()
    for one, two in zip(collide_all(pairs), collide_all([(b, a) for a, b in pairs]), strict=True):
        np.testing.assert_array_equal(one.feature, two.feature)
        np.testing.assert_array_equal(one.gap, two.gap)
        np.testing.assert_array_equal(one.normal, -two.normal)
        np.testing.assert_allclose(two.point, one.point + one.gap[:, None] * one.normal, atol=1e-6)


def test_points_lie_on_both_thickened_surfaces_and_features_differ():
    pairs = mixed_pairs()
    for a, b in pairs:
        a.margin, b.margin = 0.015625, 0.03125
    for (a, b), found in zip(pairs, collide_all(pairs), strict=True):
        assert len(np.unique(found.feature)) == len(found)
        deepest = found.gap.argmin()
        n = found.normal[deepest]
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-6)
        assert found.point[deepest] @ n == pytest.approx(heights(a, n[None])[0], abs=3e-3)
        assert found.gap.min() == pytest.approx(separation(a, b, n[None])[0], abs=1e-5)
        assert (found.point @ n < heights(a, n[None])[0] + 1e-3).all()


def test_common_motion_moves_the_contacts_along():
    rng = np.random.default_rng(17)
    pairs = mixed_pairs()
    rot, shift = random_rotation(rng), np.array([0.3, -0.2, 0.5])

    def carried(s):
        vertices = rounded(s.vertices @ rot.T + shift) if s.kind == TRIANGLE else s.vertices
        return Solid(
            s.kind, rounded(rot @ s.x + shift), rounded(rot @ s.rot), s.size, s.margin, s.asset, vertices, s.normals,
            s.edges,
        )  # fmt: skip

    for one, two in zip(collide_all(pairs), collide_all([(carried(a), carried(b)) for a, b in pairs]), strict=True):
        assert two.gap.min() == pytest.approx(one.gap.min(), abs=2e-5)


@pytest.mark.parametrize("gap", [1e-5, 0.0, -1e-5, -1e-3])
def test_box_on_box_has_the_four_corners(gap):
    low = solid(BOX, (0.5, 0.5, 0.5))
    cases = [
        (solid(BOX, (0.5, 0.5, 0.5), (dx, 0.0, 1.0 + gap), turn(2, angle)), n)
        for dx, angle, n in ((0.0, 0.0, 4), (1e-6, 1e-6, 4), (0.2, 0.0, 4), (0.1, 0.5, 8))
    ]
    found = collide_all([(low, high) for high, _ in cases], reach=0.01)
    for (high, count), contacts in zip(cases, found, strict=True):
        assert len(contacts) == count
        np.testing.assert_allclose(contacts.gap, high.x[2] - 1.0, atol=1e-6)
        np.testing.assert_allclose(contacts.normal, np.broadcast_to([0.0, 0.0, 1.0], (count, 3)), atol=1e-7)
    np.testing.assert_allclose(np.abs(found[0].point[:, :2]), 0.5, atol=1e-6)


def test_voussoirs_share_their_joint():
    a = solid(HULL, (1.0, 1.0, 1.0), asset=0)
    for gap in (1e-5, 0.0, -1e-5):
        rot = turn(1, 0.2)
        x = (
            rot @ np.array([0.0, 0.0, 1.15])
            - np.array([0.0, 0.0, 1.15])
            + gap * np.array([np.cos(0.1), 0, -np.sin(0.1)])
        )
        (found,) = collide_all([(a, solid(HULL, (1.0, 1.0, 1.0), x, rot, asset=0))], reach=0.01)
        assert len(found) == 4
        np.testing.assert_allclose(found.gap, gap, atol=1e-6)
        expected = np.broadcast_to([np.cos(0.1), 0.0, -np.sin(0.1)], (4, 3))
        np.testing.assert_allclose(found.normal, expected, atol=1e-6)


def test_crossed_edges_touch_in_one_point():
    a = solid(BOX, (0.1, 1.0, 0.1), rot=turn(1, np.pi / 4))
    b = solid(BOX, (1.0, 0.1, 0.1), (0.2, 0.1, 2 * 0.1 * np.sqrt(2) - 1e-3), turn(0, np.pi / 4))
    (found,) = collide_all([(a, b)], reach=0.01)
    assert len(found) == 1
    np.testing.assert_allclose(found.normal, [[0.0, 0.0, 1.0]], atol=1e-5)
    np.testing.assert_allclose(found.point, [[0.0, 0.1, 0.1 * np.sqrt(2)]], atol=2e-2)
    assert found.gap[0] == pytest.approx(-1e-3, abs=1e-6)


GROUND = [
    solid(PLANE, (0.0, 0.0, 0.0)),
    triangle([[-3, -3, 0], [3, -3, 0], [0, 4, 0]]),
    solid(BOX, (3, 3, 1), (0, 0, -1)),
]


@pytest.mark.parametrize("ground", GROUND, ids=["plane", "triangle", "box"])
@pytest.mark.parametrize("gap", [1e-5, -1e-5])
def test_wheels_have_their_full_patch(ground, gap):
    lying = solid(CYLINDER, (0.5, 0.2, 0.5), (0.0, 0.0, 0.5 + gap), turn(0, np.pi / 2))
    standing = solid(CYLINDER, (0.5, 0.2, 0.5), (0.0, 0.0, 0.2 + gap))
    line, patch = collide_all([(ground, lying), (ground, standing)], reach=0.01)
    assert len(line) == 2
    np.testing.assert_allclose(sorted(line.point[:, 1]), [-0.2, 0.2], atol=1e-5)
    assert len(patch) >= 4
    np.testing.assert_allclose(np.linalg.norm(patch.point[:, :2], axis=1), 0.5, atol=1e-5)
    assert np.abs(patch.point[:, :2].mean(axis=0)).max() < 1e-5
    for found in (line, patch):
        np.testing.assert_allclose(found.gap, gap, atol=1e-6)
        np.testing.assert_allclose(np.abs(found.normal[:, 2]), 1.0, atol=1e-7)


@pytest.mark.parametrize("kind", [BOX, CYLINDER, HULL, CONE, CAPSULE], ids=name)
def test_features_stay_when_a_body_moves_a_little(kind):
    rng = np.random.default_rng(23)
    sizes = (0.5, 0.4, 0.3)
    body = solid(kind, sizes, asset=3 if kind == HULL else -1)
    rot = EYE
    if kind == CAPSULE:
        rot = turn(0, np.pi / 2)
    if kind == HULL:
        normal = unit(body.normals[3:4] / body.size)[0]
        axis = np.cross(normal, [0.0, 0.0, -1.0])
        sine, cosine = np.linalg.norm(axis), -normal[2]
        k = np.cross(EYE, axis / sine)
        rot = (EYE - sine * k + (1.0 - cosine) * k @ k).T if sine > 1e-9 else EYE
        rot = rot if (rot @ normal)[2] < -0.99 else rot.T
    body.rot = rounded(rot)
    body.x = rounded(np.array([0.0, 0.0, heights(body, np.array([[0.0, 0.0, -1.0]]))[0]]))
    for ground in GROUND:
        pairs = [(ground, body)]
        for _ in range(10):
            twist = turn(0, rng.normal() * 1e-5) @ turn(1, rng.normal() * 1e-5) @ turn(2, rng.normal() * 1e-5)
            pairs.append((ground, solid_moved(body, rng.normal(size=3) * 1e-5, twist)))
        found = collide_all(pairs, reach=0.01)
        assert len(found[0]) >= 2
        for contacts in found[1:]:
            assert sorted(contacts.feature) == sorted(found[0].feature)


def solid_moved(s, shift, rot):
    return Solid(s.kind, rounded(s.x + shift), rounded(rot @ s.rot), s.size, s.margin, s.asset, s.vertices, s.normals)


def test_nothing_beyond_reach():
    pairs = [near_pair(a, b, np.random.default_rng(29), 0.2)[0] for a, b in PAIRS]
    distances = np.array([c.gap.min() for c in collide_all(pairs)])
    assert all(len(c) == 0 for c in collide_all(pairs, distances - 1e-4))
    assert all(len(c) > 0 for c in collide_all(pairs, distances + 1e-4))


def test_degenerate_input_gives_finite_contacts():
    flat = [
        triangle([[0, 0, 0], [0, 0, 0], [0, 0, 0]]),
        triangle([[-1, 0, 0], [0, 0, 0], [1, 0, 0]]),
        triangle([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]),
    ]
    shapes = [solid(kind, (0.5, 0.5, 0.5), asset=2 if kind == HULL else -1) for kind in KINDS[:-1]] + flat
    pairs = list(itertools.product(shapes, shapes)) + [(GROUND[0], s) for s in shapes]
    for found in collide_all(pairs):
        assert len(found) > 0
        assert np.isfinite(found.normal).all()
        assert np.isfinite(found.point).all()
        assert np.isfinite(found.gap).all()
        np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=1e-5)


def test_results_repeat():
    batch = Batch(mixed_pairs(2), 1e6)
    batch.launch()
    first = [array.numpy().copy() for array in (*batch.out[:4], batch.out[5])]
    batch.launch()
    for before, after in zip(first, (*batch.out[:4], batch.out[5]), strict=True):
        np.testing.assert_array_equal(before, after.numpy())


@wp.kernel(enable_backward=False)
def measure_bounds(
    shapes: wp.array[Shape], assets: Assets, lower: wp.array[wp.vec3], upper: wp.array[wp.vec3], half: wp.array[wp.vec3]
):
    i = wp.tid()
    b = shape_bounds(shapes[i], assets)
    lower[i] = b.lower
    upper[i] = b.upper
    half[i] = shape_extent(shapes[i], assets)


def test_bounds_are_the_smallest():
    rng = np.random.default_rng(31)
    solids = [moved(random_solid(kind, rng), rng.normal(size=3)) for kind in KINDS] + [GROUND[0]]
    for s in solids:
        s.margin = 0.125
    batch = Batch([(s, s) for s in solids], 1.0)
    lower, upper, half = (wp.zeros(len(solids), dtype=wp.vec3, device="cpu") for _ in range(3))
    wp.launch(measure_bounds, len(solids), [batch.inputs[0], batch.assets, lower, upper, half], device="cpu")
    for i, s in enumerate(solids[:-1]):
        np.testing.assert_allclose(upper.numpy()[i], heights(s, EYE), atol=2e-6)
        np.testing.assert_allclose(lower.numpy()[i], -heights(s, -EYE), atol=2e-6)
        centre = s.vertices.mean(axis=0) if s.kind == TRIANGLE else s.x
        expected = np.maximum(heights(s, EYE) - centre, heights(s, -EYE) + centre)
        np.testing.assert_allclose(half.numpy()[i], expected, atol=2e-6)
        assert corners(s) is None or (corners(s) <= upper.numpy()[i]).all()
    assert (upper.numpy()[-1] >= 1e10).all()
