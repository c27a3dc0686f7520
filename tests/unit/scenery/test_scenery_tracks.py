"""Tracks, corridors, race courses, roads and convoy paths: closed, clear of themselves, as wide as they promise."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenery
from simwarp.core.types import ShapeType
from simwarp.scenery import Label, beside, convoy_path, corridor, detour, indoor_track, race_course, race_track, rounded
from simwarp.vehicle.driving.paths import Path
from tests.unit.scenery.scenery_meshes import assert_outward, color_of, points_of

SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 8.0), (0.0, 8.0)]


def crossings(points):
    """How often a closed line (n, 2), its last point the first one again, crosses itself."""
    a, b = points[:-1], points[1:]

    def side(p, q, r):
        return np.sign((q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
                       - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0]))  # fmt: skip

    i, j = np.triu_indices(len(a), 2)
    keep = ~((i == 0) & (j == len(a) - 1))
    i, j = i[keep], j[keep]
    return int(((side(a[i], b[i], a[j]) * side(a[i], b[i], b[j]) < 0)
                & (side(a[j], b[j], a[i]) * side(a[j], b[j], b[i]) < 0)).sum())  # fmt: skip


def thinned(points, most=400):
    """The same line with fewer points, closed."""
    step = max(1, len(points) // most)
    kept = points[:-1:step]
    return np.concatenate([kept, kept[:1]])


def nearest(points, line):
    """(N,) distance of points from a polyline."""
    a, b = line[:-1], line[1:]
    best = np.full(len(points), np.inf)
    for start, end in zip(a, b, strict=True):
        along = end - start
        share = np.clip((points - start) @ along / max(along @ along, 1e-300), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - start - share[:, None] * along, axis=1))
    return best


def check_track(track, spacing):
    """What holds for every track."""
    points = track.points
    assert np.array_equal(points[0], points[-1])
    steps = np.diff(track.arc)
    assert 0.2 * spacing < steps.min()
    assert steps.max() < 1.05 * spacing
    assert track.length == pytest.approx(steps.sum())
    heading = np.diff(track.heading)
    assert np.abs(heading).max() < 0.3
    assert abs(track.heading[-1] - track.heading[0]) == pytest.approx(2.0 * np.pi, abs=0.02)
    assert crossings(thinned(points)) == 0
    for side in (1.0, -1.0):
        border = track.border(side)
        assert crossings(thinned(border)) == 0
        # all of the lane is there: its border is half a width from the whole centre line, not only from its own point
        assert nearest(thinned(border), thinned(points, 4000)).min() > 0.5 * track.width * 0.99


def test_a_rounded_square_is_what_geometry_says():
    track = rounded(SQUARE, 2.0, width=1.0, spacing=0.05)
    check_track(track, 0.05)
    assert track.length == pytest.approx(36.0 - 8.0 * 2.0 + 4.0 * np.pi, rel=1e-4)
    bent = track.curvature != 0.0
    np.testing.assert_allclose(track.curvature[bent], 0.5)
    np.testing.assert_allclose(track.path.curvature()[bent][5:40], 0.5, rtol=1e-3)
    # arcs are two metres from their middles, straights on the sides
    arc = track.points[:-1][bent[:-1]]
    middles = np.array([(2.0, 2.0), (8.0, 2.0), (8.0, 6.0), (2.0, 6.0)])
    np.testing.assert_allclose(np.linalg.norm(arc[:, None] - middles[None], axis=2).min(axis=1), 2.0, atol=1e-9)
    assert set(track.starts("turn")) == set(np.flatnonzero(bent[:-1]))
    assert set(track.starts("straight")) | set(track.starts("turn")) == set(track.starts())
    assert len(np.unique(track.section)) == 4
    clockwise = rounded(SQUARE[::-1], 2.0, width=1.0)
    np.testing.assert_allclose(clockwise.curvature[clockwise.curvature != 0.0], -0.5)


def test_places_along_a_track():
    track = rounded(SQUARE, 2.0, width=1.0, spacing=0.02)
    at = track.at([0.0, 0.3 * track.length, 1.3 * track.length, -0.7 * track.length])
    np.testing.assert_allclose(at[0, :2], track.points[0], atol=1e-9)
    np.testing.assert_allclose(at[1], at[2], atol=1e-9)
    np.testing.assert_allclose(at[1], at[3], atol=1e-9)
    marks = track.marks(1.0, -1.0)
    assert track.length / len(marks) <= 1.0
    np.testing.assert_allclose(nearest(marks[:, :2], track.points), 0.5, atol=1e-3)
    # outside of a square that runs counter-clockwise is on its right
    box = track.points.min(axis=0), track.points.max(axis=0)
    assert ((marks[:, :2] < box[0] - 0.1) | (marks[:, :2] > box[1] + 0.1)).any(axis=1).mean() > 0.5


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.sweep
def test_indoor_tracks_are_closed_wide_enough_and_of_moderate_length(seed):
    track = indoor_track(seed)
    check_track(track, 0.05)
    assert 25.0 < track.length < 70.0
    assert track.width == 1.1
    assert 1.0 / np.abs(track.curvature).max() >= 0.8 - 1e-9
    # there is a lane between the walls of the corridor everywhere, walls at right angles included
    ways = corridor(track, seed=seed, furnished=False)
    walls = [points[np.abs(points[:, 2]) < 1e-9][:, :2] for points in map(points_of, ways.walls.proxies)]
    for wall in walls:
        ring = np.concatenate([wall, wall[:1]])
        dense = np.concatenate([a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a)
                                for a, b in itertools.pairwise(ring)])  # fmt: skip
        assert nearest(dense, thinned(track.points, 2000)).min() > 0.5 * track.width
    again = indoor_track(seed)
    assert np.array_equal(again.points, track.points)
    assert not np.array_equal(indoor_track(seed + 100).points[:50], track.points[:50])


def test_indoor_tracks_come_in_many_forms():
    tracks = [indoor_track(seed) for seed in range(60)]
    # as many to the left as to the right
    turns = np.array([np.sign(track.heading[-1] - track.heading[0]) for track in tracks])
    assert 0.25 < (turns > 0.0).mean() < 0.75
    assert len({len(track.corners) for track in tracks}) >= 3
    assert max(len(indoor_track(seed, blocks=12).corners) for seed in range(5)) > 10
    # curves to both sides, or a policy learns one of them only
    assert all((track.curvature > 0.0).any() and (track.curvature < 0.0).any()
               for track in tracks if len(track.corners) > 4)  # fmt: skip


@pytest.mark.parametrize("square", [True, False])
@pytest.mark.parametrize("seed", [0, 1, 5])
@pytest.mark.sweep
def test_corridors_are_walls_about_their_track(square, seed):
    track = indoor_track(seed, min_radius=1.2)
    ways = corridor(track, seed=seed, square=square)
    assert_outward(ways.walls.mesh)
    assert len(ways.walls.mesh.triangles) < (6000 if square else 40000)
    assert ways.walls.label == Label.WALL
    assert [proxy.kind for proxy in ways.walls.proxies] == [ShapeType.MESH, ShapeType.MESH]
    assert ways.walls.lower[2] == pytest.approx(0.0)
    assert ways.walls.upper[2] == pytest.approx(ways.height)
    # floors look up, ceilings down; neither has seams that are folded over
    for mesh, sign, height in ((ways.floor, 1.0, 0.0), (ways.ceiling, -1.0, ways.height)):
        p = mesh.vertices[mesh.triangles]
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        assert (sign * normal[:, 2] > 0.0).all()
        np.testing.assert_allclose(mesh.vertices[:, 2], height)
        area = 0.5 * np.abs(normal[:, 2]).sum()
        length = track.length if not square else np.linalg.norm(np.diff(
            np.concatenate([track.corners, track.corners[:1]]), axis=0), axis=1).sum()  # fmt: skip
        assert area == pytest.approx(ways.width * length, rel=0.02)
    # lamps hang below the ceiling over the lane
    assert nearest(ways.lamps[:, :2], track.points).max() < 1e-6
    assert (ways.lamps[:, 2] < ways.height).all()
    assert len(ways.lamps) >= track.length / 3.0
    again = corridor(track, seed=seed, square=square)
    assert np.array_equal(again.walls.mesh.vertices, ways.walls.mesh.vertices)


def test_doors_and_pictures_leave_the_lane_free():
    track = indoor_track(3)
    ways = corridor(track, seed=3)
    low = ways.walls.mesh.vertices[ways.walls.mesh.vertices[:, 2] < 1.0]
    assert nearest(low[:, :2], thinned(track.points, 2000)).min() > 0.5 * track.width - 0.05


@pytest.mark.parametrize("seed", range(6))
def test_race_tracks_fit_their_square(seed):
    track = race_track(seed)
    check_track(track, 0.5)
    assert np.ptp(track.points, axis=0).max() < 100.0
    assert 180.0 < track.length < 400.0
    assert 1.0 / np.abs(track.curvature).max() >= 12.0 - 1e-9
    # lanes of parts that are far apart along the track do not meet
    points, arc = thinned(track.points)[:-1], np.linspace(0.0, track.length, len(thinned(track.points)))[:-1]
    along = np.abs(arc[:, None] - arc[None])
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    assert away[np.minimum(along, track.length - along) > 40.0].min() > 1.25 * track.width


@pytest.mark.parametrize("seed", [0, 2])
def test_courses_have_barriers_on_their_borders(seed):
    track = race_track(seed)
    course = race_course(track)
    for visual, side in ((course.left, 1.0), (course.right, -1.0)):
        assert_outward(visual.mesh)
        assert len(visual.mesh.triangles) < 10000
        feet = visual.mesh.vertices[visual.mesh.vertices[:, 2] < 1e-6][:, :2]
        away = nearest(feet, thinned(track.points, 2000))
        # blocks are straight: on the outside of a bend their middles come in a little
        assert away.min() > 0.5 * track.width - 0.1
        assert away.max() < 0.5 * track.width + 0.75 + 0.1
        assert np.array_equal(np.sign(visual.mesh.vertices[:, 2] - 2.0), -np.ones(len(visual.mesh.vertices)))
        middle = track.border(side, track.width + 0.75)
        assert nearest(visual.mesh.vertices[:, :2], thinned(middle, 2000)).max() < 0.5
    road = course.road
    assert road.vertices[:, 2] == pytest.approx(0.005)
    assert nearest(road.vertices[:, :2], thinned(track.points, 2000)).max() == pytest.approx(
        0.5 * track.width, abs=0.05
    )


def test_roads_have_white_borders_and_a_broken_line():
    path = Path(np.stack([np.linspace(0.0, 60.0, 121), np.zeros(121)], axis=1))
    mesh = scenery.road(path, width=6.0, dash=3.0)
    p = mesh.vertices[mesh.triangles]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert (normal[:, 2] > 0.0).all()
    assert 0.5 * normal[:, 2].sum() == pytest.approx(6.0 * 60.0)
    middle, bright = p.mean(axis=1), color_of(mesh).mean(axis=(1, 2)) > 0.6
    assert bright[np.abs(middle[:, 1]) > 2.86].all()
    line = np.abs(middle[:, 1]) < 0.07
    assert bright[line].mean() == pytest.approx(0.5, abs=0.05)
    assert not bright[~line & (np.abs(middle[:, 1]) < 2.8)].any()


def test_convoy_paths_are_sixteen_ways_through_their_nodes():
    paths = [convoy_path(index) for index in range(scenery.CONVOY_PATHS)]
    assert len(paths) == 16
    for first in range(16):
        for second in range(first):
            a, b = paths[first], paths[second]
            shares = np.linspace(0.0, 1.0, 41)
            places = [np.stack([np.interp(shares * p.length, p.arc, p.points[:, k]) for k in range(2)]) for p in (a, b)]
            assert np.abs(places[0] - places[1]).max() > 20.0
    # the nodes of the original, family by family, before flips and turns
    s_nodes = [(-90, -40), (-30, -40), (-30, 0), (30, 0), (30, 40), (90, 40)]
    c_nodes = [(-90, 40), (0, 32), (30, 20), (30, -20), (0, -32), (-90, -40)]
    flips, turns = [np.diag([1.0, 1.0]), np.diag([1.0, -1.0])], []
    right = np.array([[0.0, 1.0], [-1.0, 0.0]])
    for k in range(4):
        turns.append(np.linalg.matrix_power(right, k))
    for index, path in enumerate(paths):
        nodes = np.array((s_nodes, c_nodes)[index % 2], float) @ flips[index // 2 % 2].T @ turns[index // 4].T
        np.testing.assert_allclose(path.points[[0, -1]], nodes[[0, -1]], atol=1e-9)
        assert nearest(nodes, path.points).max() < 1e-6
        assert np.diff(path.arc).max() < 1.0
        # an HMMWV turns within about 6 m
        assert 1.0 / np.abs(path.curvature()).max() > 6.0
        assert crossings(path.points[::4]) == 0


@pytest.mark.parametrize("seed", range(8))
def test_detours_keep_clear_of_large_obstacles_on_the_straight_line(seed):
    way = detour(seed)
    assert way.obstacles.shape == (4, 3)
    np.testing.assert_allclose(way.path.points[[0, -1]], [(-100.0, 0.0), (100.0, 0.0)], atol=1e-9)
    gaps = np.linalg.norm(way.path.points[:, None] - way.obstacles[None, :, :2], axis=2).min(axis=0)
    assert (gaps - way.obstacles[:, 2]).min() >= way.clear - 1e-9
    assert (gaps - way.obstacles[:, 2]).max() < way.clear + 2.0  # and no further away than it must
    assert (np.abs(way.obstacles[:, 1]) < way.obstacles[:, 2]).all()  # they stand on the straight line
    assert 1.0 / np.abs(way.path.curvature()).max() > 10.0
    assert np.array_equal(detour(seed).path.points, way.path.points)
    assert not np.array_equal(detour(seed + 50).obstacles, way.obstacles)


def test_things_beside_a_path_keep_their_distance():
    for index in (0, 1, 6):
        path = convoy_path(index)
        places = beside(path, 8, index, distance=(5.0, 9.0))
        away = nearest(places[:, :2], path.points)
        assert (away > 5.0 - 0.05).all()
        assert (away < 9.0 + 0.05).all()
        assert np.array_equal(places, beside(path, 8, index, distance=(5.0, 9.0)))
        assert len(np.unique(places[:, 2])) == 8
    straight = Path(np.array([(-50.0, 0.0), (50.0, 0.0)]))
    sides = np.sign([beside(straight, 8, seed)[:, 1] for seed in range(10)])
    assert 0.3 < (sides > 0.0).mean() < 0.7


def test_scattered_things_are_apart_and_keep_clear():
    discs = [(-20.0, 0.0, 15.0), (20.0, 10.0, 15.0)]
    places = scenery.scattered(50, 3, half=60.0, apart=5.0, keep_clear=discs)
    away = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2) + 1e9 * np.eye(50)
    assert away.min() >= 5.0
    assert np.abs(places[:, :2]).max() <= 60.0
    for x, y, radius in discs:
        assert np.linalg.norm(places[:, :2] - (x, y), axis=1).min() >= radius
    assert np.array_equal(places, scenery.scattered(50, 3, half=60.0, apart=5.0, keep_clear=discs))
    assert scenery.scattered(0).shape == (0, 3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rounded(SQUARE, 5.0, width=1.0), "track: arcs must fit on the sides, but side"),
        (lambda: rounded(SQUARE, 0.4, width=1.0), "track: radii must exceed half the width (0.5 m), got 0.4 m"),
        (
            lambda: rounded(SQUARE[:2], 0.4, width=1.0),
            "track: corners must be 3 or more (x, y) of finite numbers, got shape",
        ),
        (
            lambda: rounded(SQUARE, 1.0, width=1.0).starts("bend"),  # type: ignore[arg-type]
            "track: where must be one of turn, straight, anywhere,",
        ),
        (lambda: indoor_track(blocks=0), "indoor_track: blocks must be at least 1, got 0; give whole blocks"),
        (lambda: indoor_track(min_radius=4.0), "indoor_track: half the width < min_radius <= half the pitch must"),
        (lambda: race_track(size=40.0), "race_track: 9 turns of radius >= 12 m, 12.5 m wide, must fit into 40 m;"),
        (lambda: corridor(indoor_track(), width=0.5), "corridor: width must be at least that of the track, 1.1 m,"),
        (lambda: corridor(indoor_track(), width=9.0), "line: there must be room"),
        (lambda: convoy_path(16), "convoy_path: index must be in 0..15, got 16"),
        (lambda: detour(length=50.0), "detour: least <= greatest radius"),
        (lambda: scenery.scattered(100, half=5.0), "scattered: 100 things 4 m apart must fit into a square of 10 m,"),
        (lambda: scenery.road(convoy_path(0), width=-1.0), "road: width must be"),
    ],
)
def test_mistakes_are_told_in_one_line(make, message):
    with pytest.raises(sw.ModelError) as caught:
        make()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
