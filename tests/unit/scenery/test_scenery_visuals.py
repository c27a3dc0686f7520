"""Things of the scenery: closed, in their promised sizes, the same for the same seed, and where contact has them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import simwarp as sw
from simwarp import scenery
from simwarp.core.rotation import rotate
from simwarp.core.types import ShapeType
from simwarp.scenery import BUSHES, CONES, ROCKS, TREES, Label, Visual, add_collision, add_visual, arranged
from simwarp.sensors.scene import Visuals
from tests.unit.scenery.scenery_meshes import assert_outward, color_of, points_of
from tests.unit.sensors.test_ray_casting import Cast

SEEDED: dict[str, Callable[[int], Visual]] = {
    **{f"rock {kind}": partial(scenery.rock, kind) for kind in ROCKS},
    **{f"tree {kind}": partial(scenery.tree, kind) for kind in TREES},
    **{f"bush {kind}": partial(scenery.bush, kind) for kind in BUSHES},
    "crate": lambda seed: scenery.crate(size=(1.2, 0.8, 0.6), seed=seed),
}
PLAIN: dict[str, Callable[[], Visual]] = {
    **{f"{color} cone": partial(scenery.cone, color) for color in CONES},
    "pillar": scenery.pillar,
    "barrier": scenery.barrier,
    "chain": lambda: scenery.barrier_chain([(0.0, 0.0), (5.0, 0.0), (9.0, 3.0)]),
    "ring": lambda: scenery.barrier_chain([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)], closed=True),
}
MAKERS: dict[str, Callable[[], Visual]] = {**{name: partial(make, 3) for name, make in SEEDED.items()}, **PLAIN}
TRIANGLES = {"rock": 320, "tree": 600, "bush": 500, "crate": 108, "cone": 120, "pillar": 48, "barrier": 32,
             "chain": 160, "ring": 600}  # fmt: skip
"""At most, by kind: what a camera's rays have to search through."""
LABELS = {"rock": Label.ROCK, "tree": Label.TREE, "bush": Label.BUSH, "crate": Label.CRATE, "cone": Label.CONE,
          "pillar": Label.PILLAR, "barrier": Label.BARRIER, "chain": Label.BARRIER, "ring": Label.BARRIER}  # fmt: skip
ROCK_SIZES = [(3.183, 3.628), (4.012, 2.649), (2.531, 2.489), (3.802, 2.570), (2.418, 4.473)]
"""Length and width of the five rocks of the original off-road task [m]."""


def kind_of(name):
    return next(kind for kind in TRIANGLES if kind in name.split())


def outside(points, visual):
    """(N,) how far points are outside of the nearest proxy of a visual, or less than 0 inside [m]."""
    best = np.full(len(points), np.inf)
    for proxy in visual.proxies:
        planes = ConvexHull(proxy.corners()).equations
        best = np.minimum(best, (points @ planes[:, :3].T + planes[:, 3]).max(axis=1))
    return best


@pytest.mark.parametrize("name", MAKERS)
def test_meshes_are_closed_outward_and_few_triangles(name):
    visual = MAKERS[name]()
    assert_outward(visual.mesh)
    assert len(visual.mesh.triangles) <= TRIANGLES[kind_of(name)]
    assert visual.label == LABELS[kind_of(name)]
    assert color_of(visual.mesh).min() >= 0.0
    assert color_of(visual.mesh).max() <= 1.0


@pytest.mark.parametrize("name", MAKERS)
def test_things_stand_on_the_ground_about_their_origin(name):
    visual = MAKERS[name]()
    assert visual.lower[2] == pytest.approx(0.0, abs=0.02)
    if kind_of(name) not in ("chain", "ring") and name != "tree dead":
        middle = 0.5 * (visual.lower + visual.upper)
        # branches of trees are where they are
        slack = 0.12 * np.ptp(visual.mesh.vertices, axis=0)[:2].max() if "tree" in name else 1e-6
        assert (np.abs(middle[:2]) <= slack).all()


@pytest.mark.parametrize("name", SEEDED)
def test_a_seed_makes_one_thing(name):
    first, again, other = SEEDED[name](7), SEEDED[name](7), SEEDED[name](8)
    for field in ("vertices", "triangles", "color"):
        assert np.array_equal(getattr(first.mesh, field), getattr(again.mesh, field))
    assert not np.array_equal(color_of(first.mesh), color_of(other.mesh))


@pytest.mark.parametrize("name", MAKERS)
def test_what_contact_sees_is_near_the_picture(name):
    visual = MAKERS[name]()
    size = float(np.linalg.norm(visual.upper - visual.lower))
    if visual.proxies[0].kind == ShapeType.MESH:
        assert np.array_equal(points_of(visual.proxies[0]), visual.mesh.vertices)
        assert visual.proxies[0].triangles is visual.mesh.triangles
        return
    # of a dead tree contact has the trunk only; leaves and twigs stand out of the simple shapes a little
    stick_out = {"rock": 0.03, "tree": 0.06, "bush": 0.1}.get(kind_of(name), 1e-9)
    chosen = visual.mesh.vertices
    if name == "tree dead":
        chosen = chosen[np.linalg.norm(chosen[:, :2], axis=1) < 0.05 * size]
        chosen = chosen[chosen[:, 2] < 0.7 * size]
    assert outside(chosen, visual).max() <= stick_out * size
    # and no proxy reaches beyond the picture's own hull by more than that
    planes = ConvexHull(visual.mesh.vertices).equations
    for proxy in visual.proxies:
        assert (proxy.corners() @ planes[:, :3].T + planes[:, 3]).max() <= max(stick_out, 0.01) * size
    assert visual.radius >= np.linalg.norm(visual.hull[:, :2], axis=1).max() - 1e-9


@pytest.mark.parametrize(("kind", "size"), list(zip(ROCKS, ROCK_SIZES, strict=True)))
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rocks_have_the_sizes_of_the_originals(kind, size, seed):
    visual = scenery.rock(kind, seed)
    np.testing.assert_allclose((visual.upper - visual.lower)[:2], size, rtol=1e-9)
    assert visual.lower[2] == pytest.approx(0.0, abs=1e-9)
    asked = scenery.rock(kind, seed, size=(1.0, 2.0, 0.5), detail=1)
    np.testing.assert_allclose(asked.upper, (0.5, 1.0, 0.5), rtol=1e-9)
    assert len(asked.mesh.triangles) == 80
    # their feet do not come to a point: what is low is a good part of what is seen from above
    low = visual.mesh.vertices[visual.mesh.vertices[:, 2] < 0.12 * visual.upper[2]]
    assert np.ptp(low[:, 0]) * np.ptp(low[:, 1]) > 0.15 * size[0] * size[1]
    # a hull for contact of few corners, all on the rock
    hull = points_of(visual.proxies[0])
    assert 12 <= len(hull) <= 32
    assert (np.abs(hull[:, None] - visual.mesh.vertices[None]).max(axis=2).min(axis=1) == 0.0).all()


def test_plants_have_the_sizes_that_were_asked_for():
    for kind in TREES:
        visual = scenery.tree(kind, 4, height=10.0)
        assert visual.upper[2] == pytest.approx(10.0, rel=0.12)
        # the trunk, or the lowest branches, are what a vehicle meets first
        assert visual.proxies[0].kind == (ShapeType.CONE if kind == "spruce" else ShapeType.CYLINDER)
        assert visual.proxies[0].corners()[:, 2].min() < 1.5
    for kind in BUSHES:
        visual = scenery.bush(kind, 4, width=2.0)
        assert (visual.upper - visual.lower)[:2].max() == pytest.approx(2.0)
        assert 0.4 < visual.upper[2] < 3.0


def test_cones_pillars_crates_and_barriers_have_the_sizes_that_were_asked_for():
    np.testing.assert_allclose(scenery.cone(height=0.3).upper, (0.075, 0.075, 0.3), rtol=1e-9)
    np.testing.assert_allclose(scenery.pillar(width=1.0, height=4.0).upper, (0.5, 0.5, 4.0), rtol=1e-9)
    np.testing.assert_allclose(scenery.crate(size=(1.0, 2.0, 3.0)).upper, (0.5, 1.0, 3.0), rtol=1e-9)
    np.testing.assert_allclose(scenery.barrier(length=3.0, height=1.0).upper, (1.5, 0.375, 1.0), rtol=1e-9)
    red, green = (color_of(scenery.cone(color).mesh).mean(axis=(0, 1)) for color in ("red", "green"))
    assert red[0] > 4.0 * red[1]
    assert green[1] > 4.0 * green[0]


def test_a_ring_of_barriers_closes_and_alternates():
    points = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)])
    ring = scenery.barrier_chain(points, closed=True, length=2.0, height=1.0)
    blocks = len(ring.mesh.triangles) // 32
    assert blocks % 2 == 0  # no two of one colour meet where it closes
    assert 36.0 / blocks == pytest.approx(2.0, rel=0.1)
    ends = ring.mesh.vertices.reshape(blocks, -1, 3)[:, :16].reshape(blocks, 2, 8, 3).mean(axis=2)
    np.testing.assert_allclose(ends[:, 1, :2], np.roll(ends[:, 0, :2], -1, axis=0), atol=1e-9)


def test_rows_of_things_are_one_thing():
    places = np.array([(1.0, 2.0, 0.5), (-3.0, 0.0, -1.0), (0.0, 4.0, 3.0)])
    one = scenery.crate(size=(1.0, 2.0, 0.5))
    row = arranged(one, places)
    assert_outward(row.mesh)
    assert len(row.mesh.triangles) == 3 * len(one.mesh.triangles)
    assert len(row.proxies) == 3
    for index, (x, y, yaw) in enumerate(places):
        corners = row.proxies[index].corners()
        np.testing.assert_allclose(corners.mean(axis=0), (x, y, 0.25), atol=1e-12)
        along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        assert np.abs((corners - corners.mean(axis=0)) @ along).max() == pytest.approx(0.5)
        part = row.mesh.vertices.reshape(3, -1, 3)[index]
        assert outside(part, row).max() <= 1e-9
    with pytest.raises(sw.ModelError, match=r"^arranged: places must be \(n >= 1, 3\) finite numbers, got"):
        arranged(one, [])


def test_pictures_take_the_place_of_their_shapes():
    builder = sw.ModelBuilder()
    at = scenery.yaw_pose(3.0, -1.0, 0.2, 0.7)
    things = [scenery.tree("oak", 1), scenery.cone(), scenery.barrier_chain([(0.0, 0.0), (4.0, 0.0)])]
    shapes = [add_collision(builder, thing, name=thing.name, at=at, scale=0.5) for thing in things]
    visuals = Visuals(builder)
    for thing, mine in zip(things, shapes, strict=True):
        index = add_visual(visuals, thing, name=f"{thing.name} seen", at=at, scale=0.5, shapes=mine)
        instance = visuals.instances[index]
        assert (instance.appearance.label, instance.appearance.reflectance) == (int(thing.label), thing.reflectance)
        np.testing.assert_allclose(instance.size, 0.5)
    assert [instance.shape for instance in visuals.instances] == [-1, -1, -1]
    # the trunk of the oak, in the world
    trunk, proxy = builder.shapes[shapes[0][0]], things[0].proxies[0]
    np.testing.assert_allclose(trunk.pose.position, at.position + 0.5 * proxy.pose.position)
    np.testing.assert_allclose(trunk.size[:2], 0.5 * np.array(proxy.size[:2]))


@pytest.mark.parametrize("name", [name for name in MAKERS if "tree" not in name or "spruce" in name])
@pytest.mark.sweep
def test_rays_meet_the_shapes_where_they_meet_the_picture(name):
    visual, at, scale = MAKERS[name](), scenery.yaw_pose(4.0, -2.0, 0.3, 1.1), 0.6
    size = scale * (visual.upper - visual.lower)
    rng = np.random.default_rng(5)
    # level rays from all around, towards the vehicle-high part of the thing
    middle = at.position + scale * rotate(at.rotation, 0.5 * (visual.lower + visual.upper))
    angle, height = rng.uniform(0.0, 2.0 * np.pi, 1500), rng.uniform(0.15, 0.6, 1500) * min(size[2], 2.5)
    way = np.stack([np.cos(angle), np.sin(angle), np.zeros(1500)], axis=1)
    target = middle + rng.uniform(-0.25, 0.25, (1500, 1)) * size[0] * np.cross(way, (0.0, 0.0, 1.0))
    target[:, 2] = at.position[2] + height
    start = target - 30.0 * way
    seen = []
    for picture in (True, False):
        builder = sw.ModelBuilder()
        builder.add_body("nobody", mass=1.0, inertia=(1.0, 1.0, 1.0))
        shapes = add_collision(builder, visual, name="shape", at=at, scale=scale)
        visuals = Visuals(builder)
        if picture:
            add_visual(visuals, visual, name="picture", at=at, scale=scale, shapes=shapes)
        model = builder.finalize(1, "cpu")
        scene = visuals.finalize(model)
        seen.append(Cast(scene, sw.Simulation(model, 1e-3), start, way.astype(np.float32)).t[0])
    both = (seen[0] >= 0.0) & (seen[1] >= 0.0)
    assert both.mean() > 0.3
    assert ((seen[0] >= 0.0) == (seen[1] >= 0.0)).mean() > 0.85
    off = np.abs(seen[0] - seen[1])[both] / np.linalg.norm(size[:2])
    exact = kind_of(name) in ("pillar", "chain", "ring")
    # crates have sunk panels, barriers hollow sides, cones a plate, leaves gaps
    assert np.median(off) < (1e-4 if exact else 0.1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: scenery.rock("pebble"), "rock: kind must be one of boulder, slab, shard, cobble, mossy, got 'pebble'"),
        (lambda: scenery.rock(size=(1.0, 0.0, 1.0)), "rock: size must be"),
        (
            lambda: scenery.rock(detail=9),
            "rock: detail must be from 1 to 3, got 9; give 1, 2 or 3; 2 has 320 triangles",
        ),
        (lambda: scenery.tree("palm"), "tree: kind must be one of spruce, oak, birch, poplar, dead, got 'palm'"),
        (lambda: scenery.tree(height=-1.0), "tree: height must be"),
        (lambda: scenery.bush("rose"), "bush: kind must be one of round, dry, juniper, got 'rose'; choose one"),
        (lambda: scenery.cone("blue"), "cone: color must be one of orange, red, green, got 'blue'; choose one"),
        (lambda: scenery.pillar(width=0.0), "pillar: width must be"),
        (lambda: scenery.crate(size=(1.0, 1.0)), "crate: size must be"),
        (lambda: scenery.barrier(length=np.nan), "barrier: length must be"),
        (
            lambda: scenery.barrier_chain([(0.0, 0.0)]),
            "barrier_chain: points must be 2 or more (x, y) of finite numbers, got shape",
        ),
    ],
)
def test_mistakes_are_told_in_one_line(make, message):
    with pytest.raises(sw.ModelError) as caught:
        make()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
