"""Convex hulls by their laws; masses and inertias against sums over random points."""

import numpy as np
import pytest
import trimesh

from simwarp.core.types import ModelError, ShapeType
from simwarp.geometry.assets import convex_hull, hull_assets, hull_mass, shape_mass

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)], dtype=float)
SIZE = (0.4, 0.7, 0.5)
SOLIDS = [ShapeType.SPHERE, ShapeType.CAPSULE, ShapeType.CYLINDER, ShapeType.BOX, ShapeType.ELLIPSOID, ShapeType.CONE]

BOXES = {
    ShapeType.SPHERE: (0.4, 0.4, 0.4), ShapeType.CAPSULE: (0.4, 0.4, 1.1), ShapeType.CYLINDER: (0.4, 0.4, 0.7),
    ShapeType.BOX: SIZE, ShapeType.ELLIPSOID: SIZE, ShapeType.CONE: (0.4, 0.4, 0.7),
}  # fmt: skip
"""Half lengths of a box around each."""


def inside(kind, p, size):
    """Whether (N, 3) points are inside a shape."""
    a, b, _ = size
    radial, z = np.hypot(p[:, 0], p[:, 1]), p[:, 2]
    if kind == ShapeType.SPHERE:
        return np.linalg.norm(p, axis=1) < a
    if kind == ShapeType.CAPSULE:
        return np.hypot(radial, np.maximum(np.abs(z) - b, 0.0)) < a
    if kind == ShapeType.CYLINDER:
        return (radial < a) & (np.abs(z) < b)
    if kind == ShapeType.BOX:
        return (np.abs(p) < size).all(axis=1)
    if kind == ShapeType.ELLIPSOID:
        return np.linalg.norm(p / size, axis=1) < 1.0
    return (np.abs(z) < b) & (radial < a * (b - z) / (2.0 * b))


@pytest.mark.parametrize("kind", SOLIDS, ids=lambda kind: kind.name)
def test_mass_of_a_primitive(kind):
    rng = np.random.default_rng(0)
    box = np.array(BOXES[kind])
    points = rng.uniform(-1.0, 1.0, size=(400_000, 3)) * box
    kept = points[inside(kind, points, SIZE)]
    found = shape_mass(kind, SIZE, 100.0)
    mass = 100.0 * 8.0 * box.prod() * len(kept) / len(points)
    assert found.mass == pytest.approx(mass, rel=0.01)
    np.testing.assert_allclose(found.centre, kept.mean(axis=0), atol=3e-3)
    second = np.cov(kept.T, bias=True) * mass
    np.testing.assert_allclose(found.inertia, np.trace(second) * np.eye(3) - second, atol=0.02 * found.inertia.max())


def test_mass_of_a_scaled_and_displaced_hull_is_that_of_its_box():
    hull = convex_hull(CUBE + np.array([5.0, 6.0, 7.0]))
    found = hull_mass(hull, 2.0, (0.5, 1.0, 2.0))
    box = shape_mass(ShapeType.BOX, (0.5, 2.0, 6.0), 2.0)
    assert found.mass == pytest.approx(box.mass)
    np.testing.assert_allclose(found.centre, [2.5, 6.0, 14.0], atol=1e-12)
    np.testing.assert_allclose(found.inertia, box.inertia, atol=1e-9)


def test_a_cube_has_six_faces_and_three_edge_directions():
    rng = np.random.default_rng(1)
    filling = rng.uniform(-1.0, 1.0, size=(500, 3)) * [1.0, 2.0, 3.0]
    on_faces = filling.copy()
    on_faces[np.arange(500), rng.integers(3, size=500)] = 0.5
    hull = convex_hull(np.concatenate([filling, CUBE, CUBE, on_faces]))
    assert len(hull.vertices) == 8
    assert sorted(len(face) for face in hull.faces) == [4] * 6
    assert len(hull.edges) == 3


def check_hull(points):
    """All points inside, faces that look outwards, every edge between two faces, Euler's formula, the volume."""
    hull = convex_hull(points)
    slack = 5e-6 * np.ptp(points, axis=0).max()
    for face, normal in zip(hull.faces, hull.normals, strict=True):
        corners = hull.vertices[list(face)]
        assert ((points - corners[0]) @ normal).max() < slack
        # counter-clockwise seen from outside
        area = sum(np.cross(corners[k] - corners[0], corners[k + 1] - corners[0]) for k in range(1, len(face) - 1))
        assert area @ normal > 0.0
    edges = {(a, b) for face in hull.faces for a, b in zip(face, face[1:] + face[:1], strict=True)}
    assert all((b, a) in edges for a, b in edges)
    assert len(hull.vertices) - len(edges) // 2 + len(hull.faces) == 2
    assert hull_mass(hull, 1.0).mass == pytest.approx(trimesh.convex.convex_hull(points).volume, rel=1e-6)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e8])
@pytest.mark.parametrize("count", [4, 5, 20, 300, 3000])
def test_hull_of_a_cloud(count, scale):
    rng = np.random.default_rng(count)
    check_hull((rng.normal(size=(count, 3)) * [1.0, 0.2, 3.0] + 10.0) * scale)


@pytest.mark.parametrize("count", [20, 300, 3000])
def test_hull_of_points_that_lie_in_planes_and_on_lines(count):
    rng = np.random.default_rng(count)
    grid = np.round(rng.normal(size=(count, 3)) * 2.0)
    check_hull(np.concatenate([CUBE, CUBE, grid])[:count])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    check_hull(grid @ turn.T)


@pytest.mark.parametrize("sides", range(30, 80, 5))
def test_hull_of_a_turned_drum(sides):
    # four points to an edge, in line up to rounding: slivers that may face anywhere
    angle = np.arange(sides) * 2.0 * np.pi / sides
    turn = np.linalg.qr(np.random.default_rng(sides).normal(size=(3, 3)))[0]
    rings = [np.stack([np.cos(angle), np.sin(angle), np.full(sides, z)], axis=1) for z in (-1.0, 0.0, 0.3, 1.0)]
    check_hull(np.concatenate(rings) @ turn.T)
    assert len(convex_hull(np.concatenate(rings) @ turn.T).faces) == sides + 2


def test_assets_are_concatenated():
    hulls = [convex_hull(CUBE), convex_hull(CUBE[[0, 1, 2, 4]])]
    assets = hull_assets(hulls, "cpu")
    assert assets.hull_vertex_start.numpy().tolist() == [0, 8, 12]
    assert assets.hull_face_start.numpy().tolist() == [0, 6, 10]
    assert assets.hull_face_vertex_start.numpy()[-1] == 24 + 12
    assert assets.hull_radius.numpy()[0] == pytest.approx(np.sqrt(14.0))
    empty = hull_assets([], "cpu")
    assert empty.hull_vertex_start.numpy().tolist() == [0]


@pytest.mark.parametrize(
    "points", [CUBE[:3], CUBE[CUBE[:, 0] > 0], np.full((5, 3), np.nan), np.zeros((6, 3)), CUBE * [1.0, 1.0, 2e-7]]
)
def test_points_without_volume_are_refused(points):
    with pytest.raises(ModelError, match="convex hull"):
        convex_hull(points)
