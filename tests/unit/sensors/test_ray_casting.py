"""Rays against instances: Embree on meshes, meshes for primitives and height fields, places and looks per world."""

from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp

import simwarp as sw
from simwarp.core.types import ModelError, ShapeType
from simwarp.geometry.triangle_tree import LEAF_WORDS, NODE_WORDS, build_tree
from simwarp.kernels.collision.shape import Assets
from simwarp.sensors.ray_casting_kernels import any_hit, closest_hit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray
from simwarp.sensors.scene import Scene, Visuals

REACH = 1000.0


@wp.kernel(enable_backward=False)
def cast(
    scene: RayScene, assets: Assets, start: wp.array2d[wp.vec3d], direction: wp.array2d[wp.vec3],
    distance: wp.array2d[float], normal: wp.array2d[wp.vec3], found: wp.array2d[wp.vec3i],
):  # fmt: skip
    world, ray = wp.tid()  # type: ignore[misc]
    s = start_of_ray(world, start[world, ray], scene)  # type: ignore[index]
    hit = closest_hit(world, s, direction[world, ray], REACH, scene, assets)  # type: ignore[index]
    some = any_hit(world, s, direction[world, ray], REACH, scene, assets)  # type: ignore[index]
    distance[world, ray] = hit.t  # type: ignore[index]
    normal[world, ray] = hit.normal  # type: ignore[index]
    found[world, ray] = wp.vec3i(hit.instance, hit.triangle, some)  # type: ignore[index]


class Cast:
    """Rays in all worlds of a scene: distance, normal, instance, triangle, whether any_hit agrees."""

    def __init__(self, scene, simulation, start, direction, mask: int = 0x7FFFFFFF) -> None:
        worlds = scene.model.world_count
        start = np.broadcast_to(start, (worlds, *np.shape(start)[-2:]))
        direction = np.broadcast_to(direction, start.shape)
        rays = start.shape[1]
        arrays: list[Any] = [
            wp.zeros((worlds, rays), dtype=dtype, device="cpu") for dtype in (float, wp.vec3, wp.vec3i)
        ]
        tables = scene.tables(mask)
        scene.place(simulation.state, tables)
        wp.launch(
            cast, dim=(worlds, rays), outputs=arrays,
            inputs=[tables, scene.model.assets, wp.array(np.array(start), dtype=wp.vec3d, device="cpu"),
                    wp.array(np.array(direction), dtype=wp.vec3, device="cpu")], device="cpu",
        )  # fmt: skip
        self.t, self.normal, found = (array.numpy() for array in arrays)
        self.instance, self.triangle, self.any = found[..., 0], found[..., 1], found[..., 2]
        assert np.array_equal(self.instance >= 0, self.any == 1)
        assert np.array_equal(self.instance >= 0, self.t >= 0.0)


def built(add, worlds: int = 1, per_world=(), scene_per_world=(), **bodies) -> tuple[Scene, sw.Simulation]:
    """A scene; `add(builder, visuals)` fills it. There is one body unless told otherwise, at the origin."""
    builder = sw.ModelBuilder()
    builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0), **bodies)
    shapes = add(builder, None)
    visuals = Visuals(builder)
    if shapes is None:
        add(None, visuals)
    model = builder.finalize(worlds, "cpu", per_world=per_world)
    return visuals.finalize(model, per_world=scene_per_world), sw.Simulation(model, 1e-3)


def inward(count: int, seed: int, distance: float = 6.0, spread: float = 2.5):
    """Rays from a sphere of starts to points near the origin."""
    rng = np.random.default_rng(seed)
    start = rng.standard_normal((count, 3))
    start *= distance / np.linalg.norm(start, axis=1, keepdims=True)
    direction = rng.uniform(-spread, spread, (count, 3)) - start
    return start, (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)


def random_mesh(seed: int, triangles: int = 3000):
    """Triangles of all sizes, with slivers, in a heap."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-2.0, 2.0, (triangles, 1, 3))
    size = 10.0 ** rng.uniform(-2.0, 0.0, (triangles, 1, 1))
    corners = middle + size * rng.standard_normal((triangles, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * triangles).reshape(-1, 3)


def edge_distance(hit_bary: np.ndarray) -> np.ndarray:
    """Smallest barycentric weight: how far from an edge a hit lies."""
    return np.minimum(hit_bary.min(axis=1), 1.0 - hit_bary.sum(axis=1))


@pytest.mark.parametrize("seed", range(4))
def test_meshes_agree_with_embree(seed):
    embree = pytest.importorskip("embreex.rtcore_scene")
    from embreex.mesh_construction import TriangleMesh

    vertices, triangles = random_mesh(seed)
    scene, sim = built(lambda builder, visuals: visuals and visuals.add_mesh(0, vertices, triangles))
    start, direction = inward(20000, seed + 10)
    ours = Cast(scene, sim, start, direction)
    oracle = embree.EmbreeScene()
    TriangleMesh(oracle, vertices, triangles.astype(np.int32))
    theirs = oracle.run(start.astype(np.float32), direction, output=True)
    hit, expected = ours.instance[0] >= 0, theirs["primID"] >= 0
    # rays that graze an edge of what they hit, or of what is behind it, may go either way: one in ten thousand
    assert (hit != expected).mean() < 1e-4
    both = hit & expected
    assert 0.3 < both.mean() < 0.999
    same = both & (ours.triangle[0] == theirs["primID"])
    assert same.sum() > 0.9995 * both.sum()
    np.testing.assert_allclose(ours.t[0][same], theirs["tfar"][same], rtol=1e-3)
    unit = theirs["Ng"][same] / np.linalg.norm(theirs["Ng"][same], axis=1, keepdims=True)
    side = np.abs((ours.normal[0][same] * unit).sum(axis=1))
    # slivers of 1:1000 have normals that are good to 1e-3
    assert (side > 0.999).mean() > 0.999


def solid(kind: ShapeType, size) -> trimesh.Trimesh:
    """A fine mesh of a primitive."""
    a, b, _ = size
    match kind:
        case ShapeType.BOX:
            return trimesh.creation.box(extents=2.0 * np.array(size))
        case ShapeType.SPHERE | ShapeType.ELLIPSOID:
            mesh = trimesh.creation.icosphere(subdivisions=5)
            mesh.apply_scale(size)
            return mesh
        case ShapeType.CYLINDER:
            return trimesh.creation.cylinder(radius=a, height=2.0 * b, sections=256)
        case ShapeType.CAPSULE:
            mesh = trimesh.creation.capsule(radius=a, height=2.0 * b, count=[128, 128])
            mesh.apply_translation((0.0, 0.0, -mesh.bounds.mean(axis=0)[2]))
            return mesh
    mesh = trimesh.creation.cone(radius=a, height=2.0 * b, sections=256)
    mesh.apply_translation((0.0, 0.0, -b))
    return mesh


PRIMITIVES: dict[str, tuple[ShapeType, tuple[float, ...], dict[str, Any]]] = {
    "box": (ShapeType.BOX, (0.5, 0.8, 1.2), {"half": (0.5, 0.8, 1.2)}),
    "sphere": (ShapeType.SPHERE, (0.9, 0.9, 0.9), {"radius": 0.9}),
    "ellipsoid": (ShapeType.ELLIPSOID, (0.5, 0.8, 1.2), {"half": (0.5, 0.8, 1.2)}),
    "cylinder": (ShapeType.CYLINDER, (0.7, 1.1, 0.7), {"radius": 0.7, "half_length": 1.1}),
    "capsule": (ShapeType.CAPSULE, (0.6, 0.9, 0.6), {"radius": 0.6, "half_length": 0.9}),
    "cone": (ShapeType.CONE, (0.8, 1.0, 0.8), {"radius": 0.8, "half_length": 1.0}),
}
TURNED = sw.pose((0.2, -0.3, 0.1), (0.18257418, 0.36514837, 0.54772256, 0.73029674))


@pytest.mark.parametrize("name", PRIMITIVES)
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.sweep
def test_primitives_agree_with_their_meshes(name, inside):
    kind, size, options = PRIMITIVES[name]
    mesh = solid(kind, size)

    def shape(builder, visuals):
        return visuals and getattr(visuals, f"add_{name}")(0, pose=TURNED, **options)

    def surface(builder, visuals):
        return visuals and visuals.add_mesh(0, mesh.vertices, mesh.faces, pose=TURNED)

    start, direction = inward(4000, 5, spread=1.5)
    if inside:
        start = np.broadcast_to(np.array(TURNED.position) + 0.05, start.shape)
    exact, faceted = (Cast(*built(add), start, direction) for add in (shape, surface))
    both = (exact.t[0] >= 0.0) & (faceted.t[0] >= 0.0)
    # facets of 256 sections lie 1e-4 radii inside the surface: a chord's sagitta; grazing rays differ more
    differ = (exact.t[0] >= 0.0) != (faceted.t[0] >= 0.0)
    assert differ.mean() < 0.01
    assert both.mean() > (0.99 if inside else 0.1)
    slope = np.abs((exact.normal[0] * direction).sum(axis=1))
    steep = both & (slope > 0.1)
    gap = np.abs(exact.t[0] - faceted.t[0])[steep] * slope[steep]
    assert np.quantile(gap, 0.995) < 1.2e-3  # 0.995: rays past a rim meet another face
    aligned = (exact.normal[0] * faceted.normal[0]).sum(axis=1)[steep]
    assert np.quantile(aligned, 0.01) > np.cos(np.radians(3.0))  # half an angle between facets, 1.4 to 2 degrees


def hills(rows: int = 24, columns: int = 31, seed: int = 0) -> np.ndarray:
    return 0.6 * np.random.default_rng(seed).standard_normal((rows, columns))


def field_mesh(heights, size):
    """The triangles that docs/conventions.md gives a height field."""
    rows, columns = heights.shape
    x = np.linspace(-0.5, 0.5, columns) * size[0]
    y = np.linspace(-0.5, 0.5, rows) * size[1]
    vertices = np.stack([*np.meshgrid(x, y), heights], axis=-1).reshape(-1, 3)
    row, column = (grid.reshape(-1) for grid in np.mgrid[: rows - 1, : columns - 1])
    a = row * columns + column
    lower = np.stack([a, a + 1, a + columns + 1], axis=1)
    upper = np.stack([a, a + columns + 1, a + columns], axis=1)
    return vertices, np.stack([lower, upper], axis=1).reshape(-1, 3)


def test_height_fields_agree_with_their_meshes():
    heights, size = hills(), (9.0, 7.0)
    scale, pose = (1.2, 0.8, 1.5), sw.pose((0.3, 0.1, -0.4), (0.0, 0.0, 0.38268343, 0.92387953))

    def field(builder, visuals):
        return builder and builder.add_shape_height_field(sw.WORLD, heights, size=size, scale=scale, pose=pose) + 1

    vertices, triangles = field_mesh(heights, size)

    def mesh(builder, visuals):
        return visuals and visuals.add_mesh(sw.WORLD, vertices, triangles, scale=scale, pose=pose)

    start, direction = inward(20000, 7, distance=5.0)
    marched, walked = (Cast(*built(add), start, direction) for add in (field, mesh))
    same = (marched.t[0] >= 0.0) == (walked.t[0] >= 0.0)
    assert same.mean() > 1.0 - 1e-4
    both = same & (marched.t[0] >= 0.0)
    assert both.mean() > 0.3
    agree = np.isclose(marched.t[0][both], walked.t[0][both], rtol=1e-4, atol=1e-4)
    assert agree.mean() > 1.0 - 3e-4  # rays that graze a crest
    triangle = marched.triangle[0][both][agree] == walked.triangle[0][both][agree]
    assert triangle.mean() > 0.999
    up = np.isclose(marched.normal[0][both][agree], walked.normal[0][both][agree], atol=2e-4).all(axis=1)
    assert up.mean() > 0.999


def test_hulls_and_model_shapes_are_seen_where_they_are():
    cube = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, -1).T

    def add(builder, visuals):
        return builder and builder.add_shape_hull(0, cube, scale=(0.5, 0.25, 1.0), pose=sw.pose((0.0, 0.0, 1.0))) + 1

    scene, sim = built(add, pose=sw.pose((2.0, 0.0, 0.0)))
    rays = Cast(scene, sim, [[0.0, 0.0, 1.0], [0.0, 0.3, 1.0]], [[1.0, 0.0, 0.0]] * 2)
    assert rays.t[0, 0] == pytest.approx(1.5, rel=1e-5)
    np.testing.assert_allclose(rays.normal[0, 0], (-1.0, 0.0, 0.0), atol=1e-6)
    assert rays.instance[0].tolist() == [0, -1]


def test_a_sprocket_is_seen_as_wide_as_its_tips_and_a_groove_is_not():
    def add(builder, visuals):
        builder.add_shape_groove(0, radius=2.0, half_width=2.0)
        return builder.add_shape_sprocket(
            0, arc_center_radius=0.6, arc_radius=0.2, tip_radius=0.5, teeth=5, half_width=0.25
        )

    scene, sim = built(add, pose=sw.pose((2.0, 0.0, 0.0)))
    rays = Cast(
        scene, sim, [[0.0, 0.0, 0.2], [0.0, 0.0, 0.3], [2.0, 0.0, 3.0]], [[1.0, 0, 0], [1.0, 0, 0], [0, 0, -1.0]]
    )
    np.testing.assert_allclose(rays.t[0, [0, 2]], (1.5, 2.75), rtol=1e-5)
    assert rays.instance[0].tolist() == [0, -1, 0]


def test_each_world_places_scales_enables_and_chooses_its_own():
    ball, cube = trimesh.creation.icosphere(subdivisions=3), trimesh.creation.box(extents=(2.0, 2.0, 2.0))

    def add(builder, visuals):
        if visuals is None:
            return None
        visuals.add_mesh(sw.WORLD, ball.vertices, ball.faces, name="thing")
        return visuals.add_mesh_asset(cube.vertices, cube.faces)

    scene, sim = built(add, worlds=4, scene_per_world=("x", "size", "asset", "enabled"))
    x, size = scene.x.numpy(), scene.size.numpy()
    x[1, 0] = (0.0, 0.0, 3.0)
    size[2, 0] = (0.5, 0.5, 0.5)
    scene.x.assign(x)
    scene.size.assign(size)
    scene.asset[3, 0] = 1  # type: ignore[index]
    rays = Cast(scene, sim, [[-5.0, 0.0, 0.0], [-5.0, 0.9, 0.9]], [[1.0, 0.0, 0.0]] * 2)
    np.testing.assert_allclose(rays.t[:, 0], (4.0, -1.0, 4.5, 4.0), atol=2e-3)  # 642 corners on the ball
    assert rays.t[:, 1].tolist() == [-1.0, -1.0, -1.0, pytest.approx(4.0, abs=1e-5)]
    scene.enabled[3, 0] = 0  # type: ignore[index]
    assert Cast(scene, sim, [[-5.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]).t[3, 0] == -1.0


def test_many_instances_are_all_found():
    """More boxes along one ray than are looked at in a go, nested ones too, and a plane under all."""
    rng = np.random.default_rng(1)
    places = np.stack([np.arange(60.0), rng.uniform(-0.3, 0.3, 60), rng.uniform(-0.3, 0.3, 60)], axis=1)

    def add(builder, visuals):
        if visuals is None:
            return None
        for place in places[rng.permutation(60)]:
            visuals.add_sphere(sw.WORLD, radius=0.1, pose=sw.pose(place))
        visuals.add_plane(pose=sw.pose((0.0, 0.0, -1.0)))
        return 1

    scene, sim = built(add)
    start = np.array([-3.0, 0.0, 0.0])
    aim = places - start
    distance = np.linalg.norm(aim, axis=1)
    direction = np.concatenate([aim / distance[:, None], [[0.0, 0.0, -1.0], [0.6, 0.0, 0.8]]])
    rays = Cast(scene, sim, np.broadcast_to(start, direction.shape), direction)
    # the nearest of all spheres that a ray meets, in float64
    along = (places - start) @ direction.T
    square = 0.01 - (((places - start) ** 2).sum(axis=1)[:, None] - along**2)
    entry = np.where(square >= 0.0, along - np.sqrt(np.maximum(square, 0.0)), np.inf)
    entry[entry < 0.0] = np.inf
    with np.errstate(divide="ignore"):
        ground = np.where(direction[:, 2] < 0.0, -1.0 / direction[:, 2], np.inf)
    expected = np.minimum(entry.min(axis=0), ground)
    np.testing.assert_allclose(rays.t[0], np.where(np.isfinite(expected), expected, -1.0), rtol=1e-3)


def test_a_mask_leaves_out_groups():
    def add(builder, visuals):
        if visuals is None:
            return None
        visuals.add_sphere(0, radius=0.5, group=2)
        visuals.add_sphere(sw.WORLD, radius=0.5, pose=sw.pose((3.0, 0.0, 0.0)), group=4)
        return 1

    scene, sim = built(add)
    start, direction = [[-2.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]
    for mask, t in ((6, 1.5), (4, 4.5), (1, -1.0)):
        assert Cast(scene, sim, start, direction, mask).t[0, 0] == pytest.approx(t, rel=1e-5)


def test_far_from_the_origin_hits_are_as_exact():
    """Rays are relative to a body: 10 km away, a sphere is found to a tenth of a millimetre."""
    away = np.array([1.0e4, -2.0e4, 300.0])

    def add(builder, visuals):
        if visuals is None:
            return None
        return visuals.add_sphere(sw.WORLD, radius=0.5, pose=sw.pose(away + np.array([3.0, 0.0, 0.0])))

    scene, sim = built(add, pose=sw.pose(away))
    rays = Cast(scene, sim, [away + np.array([0.001, 0.0, 0.0])], [[1.0, 0.0, 0.0]])
    assert rays.t[0, 0] == pytest.approx(2.499, abs=1e-5)


def test_worlds_do_not_touch_each_other():
    mesh = trimesh.creation.icosphere(subdivisions=3)

    def add(builder, visuals):
        if visuals is None:
            return None
        visuals.add_mesh(0, mesh.vertices, mesh.faces)
        return visuals.add_plane(pose=sw.pose((0.0, 0.0, -1.0)))

    scene, sim = built(add, worlds=5)
    start, direction = inward(500, 3)
    before = Cast(scene, sim, start, direction)
    x = sim.state.body_x.numpy()
    x[3, 0] += 0.3
    sim.state.body_x.assign(x)
    after = Cast(scene, sim, start, direction)
    others = [0, 1, 2, 4]
    assert np.array_equal(before.t[others], after.t[others])
    assert not np.array_equal(before.t[3], after.t[3])
    assert np.array_equal(before.t[0], before.t[4])


@pytest.mark.parametrize("count", [1, 7, 8, 9, 100, 5000])
def test_trees_hold_every_triangle_once_within_their_bounds(count):
    vertices, triangles = random_mesh(2, count)
    tree = build_tree(vertices, triangles)
    assert tree.nodes.shape[1:] == (NODE_WORDS,)
    assert tree.leaves.shape[1:] == (LEAF_WORDS,)
    seen: list[int] = []

    def visit(node: int, lower, upper) -> None:
        table = tree.nodes[node].reshape(7, 8)
        for k in np.flatnonzero(table[0] <= table[3]):
            low, high = table[:3, k], table[3:6, k]
            assert (low >= lower).all()
            assert (high <= upper).all()
            child = int(table[6].view(np.int32)[k])
            if child >= 0:
                visit(child, low, high)
                continue
            leaf = tree.leaves[-1 - child].reshape(10, 8)
            real = np.abs(leaf[3:9]).sum(axis=0) > 0.0
            members = leaf[9].view(np.int32)[real]
            seen.extend(members.tolist())
            corners = vertices[triangles[members]]
            assert (corners >= low - 1e-6).all()
            assert (corners <= high + 1e-6).all()

    everywhere = np.full(3, np.inf)
    visit(0, -everywhere, everywhere)
    assert sorted(seen) == list(range(count))


@pytest.mark.parametrize(
    ("add", "words"),
    [
        (lambda v: v.add_box(3, half=(1.0, 1.0, 1.0)), ("body must be WORLD or in 0..0", "3")),
        (lambda v: v.add_box(0, half=(1.0, -1.0, 1.0)), ("every size", "-1.0")),
        (lambda v: v.add_mesh(0, "nowhere.obj"), ("nowhere.obj", "check the path")),
        (lambda v: v.add_sphere(0, radius=1.0, color=(2.0, 0.0, 0.0)), ("color[0] must be in [0, 1]", "2.0")),
        (lambda v: v.add_sphere(0, radius=1.0, colour=(1.0, 0.0, 0.0)), ("unknown option 'colour'", "color")),
        (lambda v: v.hide(2), ("there must be a shape 2",)),
        (lambda v: [v.add_sphere(0, radius=1.0, name="a") for _ in range(2)], ("'a'", "unique")),
    ],
)
def test_mistakes_are_named(add, words):
    builder = sw.ModelBuilder()
    builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0))
    with pytest.raises(ModelError) as caught:
        add(Visuals(builder))
    assert all(word in str(caught.value) for word in words)
    assert "\n" not in str(caught.value)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("exponent", [100, 120])
def test_a_tree_of_any_size_is_that_of_its_unit(exponent):
    """In units of a power of two every number is the same but for its exponent: 2^100 m is 1e30 m."""
    vertices, triangles = random_mesh(2, 500)
    here, there = build_tree(vertices, triangles), build_tree(np.ldexp(vertices, exponent), triangles)
    nodes, far = (tree.nodes.reshape(-1, 7, 8) for tree in (here, there))
    np.testing.assert_array_equal(far[:, :6], np.ldexp(nodes[:, :6], exponent))
    np.testing.assert_array_equal(far[:, 6].view(np.int32), nodes[:, 6].view(np.int32))
    np.testing.assert_array_equal(there.leaves[:, :24], np.ldexp(here.leaves[:, :24], exponent))
