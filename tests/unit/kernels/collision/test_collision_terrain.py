"""Height fields and meshes: queries and contacts against brute force over all triangles, and motion on them."""

import dataclasses

import numpy as np
import pytest
import warp as wp

from simwarp import WORLD, Material, ModelBuilder, Simulation, SolverOptions, VelocityMotor, pose
from simwarp.core.types import ModelError, ShapeType
from simwarp.geometry.assets import add_ground_assets, height_field, neighbour_normals, triangle_mesh
from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.collision.surfaces import height_field_height, height_field_ray, mesh_ray
from tests.reference.collision import TRIANGLE, Solid, signed_distance
from tests.reference.terrain import (
    field_triangles,
    nearest_points,
    normals,
    ray_hit,
    surface_height,
    touching_points,
)
from tests.unit.kernels.collision.collision_pairs import random_rotation, rounded

# mypy: disable-error-code="index"
wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FAR = (10_000.0, -8_000.0, 300.0)
PYRAMID = (
    np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 1]], dtype=float),
    np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]]),
)


def grid_mesh(columns, rows, size, height=lambda x, y: 0.0 * x):
    """Vertices and triangles of a sheet that faces up."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, columns) * size[0], np.linspace(-0.5, 0.5, rows) * size[1])
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    i = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = (part.reshape(-1) for part in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def bumps(rng, rough, nodes=9, cell=0.25):
    """Random heights, the extent of the field, and its triangles."""
    heights = (rng.normal(size=(nodes, nodes)) * rough).astype(np.float32)
    size = ((nodes - 1) * cell, (nodes - 1) * cell)
    return heights, size, field_triangles(heights, size)


def turn(axis, angle):
    q = np.zeros(4)
    q[axis], q[3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    return q


@dataclasses.dataclass
class Found:
    """Contacts of one world, points in the world."""

    normal: np.ndarray
    gap: np.ndarray
    point0: np.ndarray
    point1: np.ndarray
    feature: np.ndarray


def contacts_of(sim, world=0, x=None):
    """The contacts that the last step used; `x`: where the bodies were before it."""
    c = sim.contacts
    count = int(c.contact_count.numpy()[world])
    x = sim.state.body_x.numpy()[world] if x is None else x
    bodies = sim.model.topology.shape_body.numpy()

    def point(arm, shape):
        body = bodies[shape.numpy()[world, :count]]
        return arm.numpy()[world, :count] + np.where(body[:, None] < 0, 0.0, x[body])

    return Found(
        c.contact_normal_w.numpy()[world, :count].astype(float), c.contact_gap.numpy()[world, :count].astype(float),
        point(c.contact_arm0, c.contact_shape0), point(c.contact_arm1, c.contact_shape1),
        c.contact_feature.numpy()[world, :count],
    )  # fmt: skip


def contacts_at_rest(builder, envelope):
    """Contacts of a builder's initial configuration."""
    sim = Simulation(builder.finalize(1, "cpu"), 1e-4, solver=SolverOptions(contact_margin=envelope))
    x = sim.state.body_x.numpy()[0].copy()
    sim.step()
    return contacts_of(sim, x=x)


# ---- queries ---------------------------------------------------------------------------------------------------------


@wp.kernel(enable_backward=False)
def query_field(
    scale: wp.vec3, start: wp.array[wp.vec3d], direction: wp.array[wp.vec3], max_t: float, assets: Assets,
    height: wp.array[wp.float64], normal: wp.array[wp.vec3], inside: wp.array[int], t: wp.array[float],
    hit_normal: wp.array[wp.vec3], mesh_t: wp.array[float], mesh_normal: wp.array[wp.vec3],
):  # fmt: skip
    """Heights under the starts, and rays, in field 0 and mesh 0."""
    i = wp.tid()
    p = start[i]
    found = height_field_height(0, scale, p[0], p[1], assets)
    height[i] = found.height
    normal[i] = found.normal
    inside[i] = found.inside
    hit = height_field_ray(0, scale, p, direction[i], max_t, assets)
    t[i] = hit.t
    hit_normal[i] = hit.normal
    other = mesh_ray(0, scale, wp.vec3(float(p[0]), float(p[1]), float(p[2])), direction[i], max_t, assets)
    mesh_t[i] = other.t
    mesh_normal[i] = other.normal


def query(heights, size, scale, start, direction, max_t=1e6):
    """What the kernel finds in a field, and in the mesh of the same triangles."""
    assets = Assets()
    flat = field_triangles(heights, size).reshape(-1, 3)
    mesh = triangle_mesh(flat, np.arange(len(flat)).reshape(-1, 3))
    keep = add_ground_assets(assets, [height_field(heights, size)], [mesh], "cpu")
    n = len(start)
    out = [wp.zeros(n, dtype=kind, device="cpu") for kind in (wp.float64, wp.vec3, int, float, wp.vec3, float, wp.vec3)]
    wp.launch(
        query_field, n,
        [wp.vec3(*scale), wp.array(start, dtype=wp.vec3d, device="cpu"),
         wp.array(direction, dtype=wp.vec3, device="cpu"), max_t, assets, *out], device="cpu",
    )  # fmt: skip
    del keep
    return [array.numpy() for array in out]


def test_heights_are_those_of_the_triangles():
    rng = np.random.default_rng(0)
    heights, size, _ = bumps(rng, 0.3, nodes=7)
    scale = (2.0, 0.5, 3.0)
    triangles = field_triangles(heights, size, scale)
    start = np.column_stack([rng.uniform(-1.5, 1.5, 60), rng.uniform(-0.37, 0.37, 60), np.zeros(60)])
    start[0, :2] = 0.0  # a node
    height, normal, inside, *_ = query(heights, size, scale, start, np.zeros((60, 3)))
    for i, p in enumerate(start):
        truth, facing = surface_height(triangles, p[0], p[1])
        assert height[i] == pytest.approx(truth, abs=1e-9)  # float64 throughout
        if i > 0:
            np.testing.assert_allclose(normal[i], facing, atol=1e-6)
    assert inside.all()


def test_height_beyond_the_border_is_that_of_the_border():
    heights, size, _ = bumps(np.random.default_rng(1), 0.3, nodes=5)
    height, _, inside, *_ = query(
        heights, size, (1, 1, 1), np.array([[3.0, 0.25, 0.0], [0.0, 0.0, 0.0]]), np.zeros((2, 3))
    )
    assert height[0] == pytest.approx(heights[3, 4], abs=1e-7)
    assert inside.tolist() == [0, 1]


@pytest.mark.parametrize(("shift", "slack"), [(0.0, 2e-5), (3000.0, 1e-3)])
def test_rays_against_brute_force(shift, slack):
    """Float32 of a ray of 10 m keeps 1e-5 m at the angles drawn here; 3 km away, t itself only 2e-4."""
    rng = np.random.default_rng(2)
    heights, size, _ = bumps(rng, 0.3, nodes=12)
    scale = (1.5, 1.0, 2.0)
    triangles = field_triangles(heights, size, scale)
    count = 300
    start = rng.uniform(-3.0, 3.0, size=(count, 3))
    aim = rng.uniform(-1.0, 1.0, size=(count, 3)) * [2.0, 1.4, 0.3]
    direction = rounded((aim - start) / np.linalg.norm(aim - start, axis=1, keepdims=True))
    direction[:3] = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
    start[:3] = [[-4.0, 0.117, 0.1], [0.071, 3.0, 0.05], [0.317, 0.233, 5.0]]
    start -= shift * direction
    _, _, _, t, normal, mesh_t, mesh_normal = query(heights, size, scale, start, direction)
    facing, hits = normals(triangles), 0
    for i in range(count):
        truth, index = ray_hit(triangles, start[i], direction[i])
        if np.isinf(truth):
            assert t[i] < 0.0
            continue
        hits += 1
        steepness = abs(facing[index] @ direction[i])
        assert t[i] == pytest.approx(truth, abs=slack / max(steepness, 0.02))
        if shift == 0.0:
            np.testing.assert_allclose(normal[i], facing[index], atol=1e-5)
            assert mesh_t[i] == pytest.approx(truth, abs=slack / max(steepness, 0.02))
            np.testing.assert_allclose(mesh_normal[i], facing[index], atol=1e-5)
    assert hits > 100


def test_a_ray_ends_at_max_t():
    heights, size = np.zeros((5, 5)), (4.0, 4.0)
    start, down = np.array([[0.3, 0.4, 2.0], [5.0, 0.0, 2.0]]), np.array([[0.0, 0.0, -1.0]] * 2)
    assert query(heights, size, (1, 1, 1), start, down, 2.1)[3] == pytest.approx([2.0, -1.0])
    assert query(heights, size, (1, 1, 1), start, down, 1.9)[3].tolist() == [-1.0, -1.0]


# ---- contacts --------------------------------------------------------------------------------------------------------


def as_mesh(triangles):
    flat = triangles.reshape(-1, 3)
    return flat, np.arange(len(flat)).reshape(-1, 3)


@pytest.mark.parametrize("kind", ["field", "mesh"])
@pytest.mark.parametrize("rough", [0.01, 0.06, 0.15])
@pytest.mark.sweep
def test_a_sphere_finds_every_nearest_point_and_no_other(kind, rough):
    """Points may differ by 2e-3 radii: normals that close to a face's are taken as the face's."""
    rng = np.random.default_rng(3)
    extra = total = 0
    for _ in range(12):
        heights, size, triangles = bumps(rng, rough)
        radius = float(np.float32(rng.uniform(0.1, 0.4)))
        xy = rng.uniform(-0.4, 0.4, size=2)
        c = np.array([*xy, surface_height(triangles, *xy)[0] + radius * rng.uniform(0.8, 1.2)])
        builder = ModelBuilder(gravity=(0, 0, 0))
        if kind == "field":
            builder.add_shape_height_field(WORLD, heights, size=size)
        else:
            builder.add_shape_mesh(WORLD, *as_mesh(triangles))
        builder.add_solid("ball", "sphere", radius, mass=1.0, pose=pose(c))
        found = contacts_at_rest(builder, 0.05)
        truth = touching_points(triangles, c, radius + 0.05)
        distance = np.linalg.norm(nearest_points(triangles, c) - c, axis=1).min()
        if len(truth):
            assert found.gap.min() == pytest.approx(distance - radius, abs=2e-6)
        apart = np.linalg.norm(truth[:, None] - found.point0[None], axis=2)
        if len(truth) <= 8:
            assert (apart.min(axis=1) < 2e-3 * radius).all()
        total += len(found.gap)
        extra += int((apart.min(axis=0) > 2e-3 * radius).sum()) if len(truth) else len(found.gap)
    assert total > 10
    assert extra <= 0.03 * total  # edges that hardly bend: tolerances decide


@pytest.mark.quick("4")
@pytest.mark.parametrize("kind", [ShapeType.BOX, ShapeType.CYLINDER, ShapeType.CAPSULE, ShapeType.ELLIPSOID])
def test_the_nearest_point_of_a_convex_shape_is_among_its_contacts(kind):
    """To the accuracy of the narrow phase, 2e-5 of the smaller shape, and of float32 at a metre."""
    rng = np.random.default_rng(4)
    heights, size, triangles = bumps(rng, 0.1, nodes=6)
    for _ in range(2):
        half = rng.uniform(0.1, 0.4, size=3)
        if kind in (ShapeType.CYLINDER, ShapeType.CAPSULE):
            half[2] = half[0]
        rotation = random_rotation(rng)
        x = np.array([*rng.uniform(-0.2, 0.2, size=2), 0.75])
        body = Solid(int(kind), x, rotation, half)
        truth = min(
            signed_distance(Solid(TRIANGLE, np.zeros(3), np.eye(3), np.zeros(3), vertices=t), body)[0]
            for t in triangles
        )
        builder = ModelBuilder(gravity=(0, 0, 0))
        builder.add_shape_height_field(WORLD, heights, size=size)
        q = wp.quat_from_matrix(wp.mat33(*rotation.reshape(-1)))
        builder.add_body("body", mass=1.0, inertia=(1, 1, 1), pose=pose(x, [q[k] for k in range(4)]))
        sizes = {"radius": half[0], "half_length": half[1]}
        if kind in (ShapeType.BOX, ShapeType.ELLIPSOID):
            sizes = {"half": half}
        getattr(builder, f"add_shape_{kind.name.lower()}")(0, **sizes)
        assert contacts_at_rest(builder, 1.0).gap.min() == pytest.approx(truth, abs=1e-5)


def test_scale_is_the_same_as_scaled_geometry():
    rng = np.random.default_rng(5)
    heights, size, triangles = bumps(rng, 0.05)
    scale = np.array([2.0, 0.5, 3.0])
    found = []
    for case in range(4):
        builder = ModelBuilder()
        if case == 0:
            builder.add_shape_height_field(WORLD, heights, size=size, scale=scale)
        elif case == 1:
            builder.add_shape_height_field(WORLD, heights * 3.0, size=(2.0 * size[0], 0.5 * size[1]))
        elif case == 2:
            builder.add_shape_mesh(WORLD, *as_mesh(triangles), scale=scale)
        else:
            builder.add_shape_mesh(WORLD, *as_mesh(triangles * scale))
        builder.add_solid("box", "box", (0.3, 0.2, 0.1), mass=1.0, pose=pose((0.1, 0.0, 0.35), turn(0, 0.3)))
        found.append(contacts_at_rest(builder, 0.2))
    for other in found[1:]:
        np.testing.assert_allclose(other.gap, found[0].gap, atol=2e-6)
        np.testing.assert_allclose(other.point0, found[0].point0, atol=2e-5)


def test_a_ball_in_a_valley_on_a_ridge_and_on_a_pyramid():
    x = np.abs(np.linspace(-2.0, 2.0, 9))
    for sign, count in ((1.0, 2), (-1.0, 1)):
        builder = ModelBuilder()
        builder.add_shape_height_field(WORLD, sign * np.tile(0.5 * x, (9, 1)), size=(4.0, 4.0))
        rise = 0.3 * np.hypot(1.0, 0.5) if sign > 0 else 0.3
        builder.add_solid("ball", "sphere", 0.3, mass=1.0, pose=pose((0.0, 0.11, rise)))
        found = contacts_at_rest(builder, 1e-3)
        assert len(found.gap) == count
        assert np.abs(found.gap).max() < 1e-6
        assert sorted(found.normal[:, 0]) == pytest.approx([-1 / 5**0.5, 1 / 5**0.5] if sign > 0 else [0.0], abs=1e-6)
    s, h = 0.5**0.5, 6.0**-0.5
    for at, normal in (((0, 0, 1.0), (0, 0, 1)), ((0.4, 0.05, 0.6), (s, 0, s)), ((0.5, 0.5, 0.5), (h, h, 2.0 * h))):
        builder = ModelBuilder()
        builder.add_shape_mesh(WORLD, *PYRAMID)
        n = np.array(normal)
        builder.add_solid("ball", "sphere", 0.2, mass=1.0, pose=pose(np.array(at) + 0.2 * n))
        found = contacts_at_rest(builder, 1e-3)
        np.testing.assert_allclose(found.normal, [n], atol=1e-4)
        np.testing.assert_allclose(found.gap, [0.0], atol=1e-5)


@pytest.mark.parametrize("slope", [0.0, 0.08])
@pytest.mark.parametrize("cell", [0.1, 0.7])
def test_a_wheel_stands_on_its_whole_width(slope, cell):
    count = round(7.0 / cell) + 1
    y = np.linspace(-3.5, 3.5, count)
    material = Material(friction=0.8, rolling_friction=0.01)
    builder = ModelBuilder()
    builder.add_shape_height_field(
        WORLD, np.tile(np.tan(slope) * y[:, None], (1, count)), size=(7, 7), material=material
    )
    up = np.array([0.0, -np.sin(slope), np.cos(slope)])
    at = pose(np.array([0.03, 0.02, 0.02 * np.tan(slope)]) + 0.4 * up, turn(0, slope + 0.5 * np.pi))
    builder.add_solid("wheel", "cylinder", (0.4, 0.12), mass=20.0, pose=at, material=material)
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    for _ in range(100):
        sim.step()
        found = contacts_of(sim)
        along = found.point0 @ [0.0, np.cos(slope), np.sin(slope)]
        assert np.ptp(along) == pytest.approx(0.24, abs=2e-3)
        np.testing.assert_allclose(found.normal, np.tile(up, (len(found.gap), 1)), atol=2e-4)
    assert np.linalg.norm(sim.state.body_v.numpy()) < 1e-4


def test_a_box_over_hundreds_of_triangles_stands_on_its_corners():
    builder = ModelBuilder()
    builder.add_shape_height_field(WORLD, np.zeros((41, 41)), size=(2.0, 2.0))
    builder.add_solid("box", "box", (0.41, 0.33, 0.1), mass=1.0, pose=pose((0.01, 0.02, 0.1), turn(2, 0.3)))
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    for _ in range(5):
        sim.step()
    found = contacts_of(sim)
    corners = np.array([[x, y] for x in (-0.41, 0.41) for y in (-0.33, 0.33)])
    c, s = np.cos(0.3), np.sin(0.3)
    corners = corners @ [[c, s], [-s, c]] + [0.01, 0.02]
    assert np.linalg.norm(corners[:, None] - found.point0[None, :, :2], axis=2).min(axis=1).max() < 1e-3
    assert np.abs(found.gap).max() < 1e-6


@pytest.mark.parametrize("kind", ["field", "mesh"])
@pytest.mark.parametrize("depth", [1e-4, 1e-2, 0.1])
def test_a_corner_pushed_into_a_node_is_held(kind, depth):
    """The shortest way out of each triangle around the node is sideways, yet the surface holds the corner upwards."""
    builder = ModelBuilder(gravity=(0, 0, 0))
    flat_ground(builder, kind, Material(), (0.0, 0.0, 0.0))
    tip = np.cross([1.0, 1.0, 1.0], [0.0, 0.0, 1.0]) / 3.0**0.5  # turns the cube's diagonal upright
    angle = np.arccos(3.0**-0.5)
    q = np.append(tip / np.linalg.norm(tip) * np.sin(0.5 * angle), np.cos(0.5 * angle))
    at = np.array([0.002, 0.001, 0.2 * 3.0**0.5 - depth])
    builder.add_solid("box", "box", 0.2, mass=1.0, pose=pose(at, q))
    found = contacts_at_rest(builder, 1e-3)
    assert found.gap.min() == pytest.approx(-depth, abs=1e-6)
    np.testing.assert_allclose(found.normal, np.tile([0.0, 0.0, 1.0], (len(found.gap), 1)), atol=1e-6)
    np.testing.assert_allclose(found.point1[found.gap.argmin()], [0.002, 0.001, -depth], atol=1e-6)


def test_the_same_contacts_keep_their_features():
    builder = ModelBuilder()
    builder.add_shape_height_field(WORLD, np.zeros((11, 11)), size=(5.0, 5.0))
    builder.add_solid("box", "box", 0.3, mass=1.0, pose=pose((0.1, 0.2, 0.3)))
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    sim.step()
    first = contacts_of(sim).feature
    for _ in range(20):
        sim.step()
    assert sorted(contacts_of(sim).feature) == sorted(first)
    assert len(set(first)) == len(first)


# ---- motion ----------------------------------------------------------------------------------------------------------


def flat_ground(builder, kind, material, at):
    if kind == "plane":
        builder.add_shape_plane(WORLD, material=material, pose=pose(at))
    elif kind == "field":
        builder.add_shape_height_field(WORLD, np.zeros((51, 51)), size=(25.0, 25.0), material=material, pose=pose(at))
    else:
        builder.add_shape_mesh(WORLD, *grid_mesh(51, 51, (25.0, 25.0)), material=material, pose=pose(at))


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), FAR], ids=["near", "far"])
@pytest.mark.parametrize("kind", ["plane", "field", "mesh"])
def test_a_flat_grid_is_a_plane(kind, at):
    """Rolling at 5 m/s over 20 cells no edge is felt; sliding is slowed down by friction alone."""
    material = Material(friction=0.5)
    builder = ModelBuilder()
    flat_ground(builder, kind, material, at)
    start = np.array(at)
    builder.add_solid(
        "ball", "sphere", 0.2, mass=1.0, pose=pose(start + np.array((-10.0, 0.013, 0.2))), velocity=(5.0, 0.3, 0.0),
        omega=(-0.3 / 0.2, 5.0 / 0.2, 0.0), material=material,
    )  # fmt: skip
    builder.add_solid(
        "wheel", "cylinder", (0.4, 0.12), mass=10.0,
        pose=pose(start + np.array((-10.0, 3.013, 0.4)), turn(0, 0.5 * np.pi)),
        velocity=(5.0, 0.0, 0.0), omega=(0.0, 5.0 / 0.4, 0.0), material=material,
    )  # fmt: skip
    builder.add_solid(
        "box", "box", (0.3, 0.4, 0.2), mass=1.0, pose=pose(start + np.array((-10.0, -3.013, 0.2))),
        velocity=(5.0, 0.7, 0.0), material=material,
    )  # fmt: skip
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    for _ in range(150):
        sim.step()
        assert np.abs(sim.state.body_v.numpy()[0, :, 2]).max() < 1e-4
    v = sim.state.body_v.numpy()[0]
    np.testing.assert_allclose(v[:2], [[5.0, 0.3, 0.0], [5.0, 0.0, 0.0]], atol=1e-4)
    assert np.linalg.norm(v[2]) == pytest.approx(np.hypot(5.0, 0.7) - 0.5 * 9.81 * 0.75, abs=1e-3 * 0.75)
    np.testing.assert_allclose(sim.state.body_x.numpy()[0, :, 2] - at[2], [0.2, 0.4, 0.2], atol=1e-6)


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), FAR], ids=["near", "far"])
def test_boxes_come_to_rest_on_rough_ground(at):
    """The default friction, 0.6, holds at these slopes; at rest nothing moves any more."""
    rng = np.random.default_rng(8)
    heights, size, _ = bumps(rng, 0.02, nodes=21)
    builder = ModelBuilder()
    builder.add_shape_height_field(WORLD, heights, size=size, pose=pose(at))
    for k in range(3):
        x = np.array(at) + np.array([-1.5 + 1.5 * k, 0.1, 0.3])
        builder.add_solid(f"box{k}", "box", (0.2 + 0.15 * k, 0.2, 0.1), mass=1.0, pose=pose(x))
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    for _ in range(400):
        sim.step()
    before = sim.state.body_x.numpy()[0].copy()
    for _ in range(400):
        sim.step()
    assert np.abs(sim.state.body_x.numpy()[0] - before).max() < 2e-4
    assert np.linalg.norm(sim.state.body_v.numpy()) < 1e-3
    assert contacts_of(sim).gap.min() > -1e-4
    assert sim.problems() == []


def test_a_tilted_field_is_an_incline():
    """A box that friction cannot hold: g (sin a - mu cos a)."""
    tilt, material = turn(1, 0.5), Material(friction=0.3)
    builder = ModelBuilder()
    builder.add_shape_height_field(
        WORLD, np.zeros((41, 41)), size=(20, 20), material=material, pose=pose(rotation=tilt)
    )
    down = np.array([np.cos(0.5), 0.0, -np.sin(0.5)])
    up = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    builder.add_solid(
        "box", "box", (0.2, 0.2, 0.1), mass=1.0, pose=pose(0.1 * up + 0.03 * down, tilt), material=material
    )
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    for _ in range(100):
        sim.step()
    expected = 9.81 * (np.sin(0.5) - 0.3 * np.cos(0.5)) * 0.5
    assert sim.state.body_v.numpy()[0, 0] @ down == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("kind", ["field", "mesh"])
def test_sunk_bodies_come_up(kind):
    """At the depenetration velocity, 0.6 m/s, and then rest on the surface."""
    builder = ModelBuilder()
    flat_ground(builder, kind, Material(), (0.0, 0.0, 0.0))
    builder.add_solid("ball", "sphere", 0.2, mass=1.0, pose=pose((0.1, 0.2, -0.1)))
    builder.add_solid("box", "box", 0.2, mass=1.0, pose=pose((2.1, 0.2, -0.1)))
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    for _ in range(400):
        sim.step()
    assert np.abs(sim.state.body_x.numpy()[0, :, 2] - 0.2).max() < 0.03  # the box may lean on an edge
    assert sim.state.body_x.numpy()[0, 0, 2] == pytest.approx(0.2, abs=1e-5)


def test_a_bowl_carries_a_ball():
    builder = ModelBuilder()
    bowl = builder.add_body("bowl", mass=5.0, inertia=(1, 1, 1), pose=pose((0.0, 0.0, 1.0)))
    builder.add_joint_prismatic(
        "rail", WORLD, bowl, axis=(1.0, 0.0, 0.0), anchor=(0.0, 0.0, 1.0), drive=VelocityMotor(effort_limit=1e4)
    )
    vertices, triangles = grid_mesh(21, 21, (1.0, 1.0), lambda x, y: x**2 + y**2)
    builder.add_shape_mesh(bowl, vertices, triangles)
    builder.add_solid("ball", "sphere", 0.1, mass=1.0, pose=pose((0.0, 0.0, 1.12)))
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    sim.control.joint_target_qd.fill_(0.5)
    for _ in range(400):
        sim.step()
    x = sim.state.body_x.numpy()[0].copy()
    assert x[0, 0] == pytest.approx(1.0, abs=5e-3)
    assert np.linalg.norm(x[1, :2] - x[0, :2]) < 0.3
    assert x[1, 2] > 1.09
    assert contacts_of(sim).gap.min() > -1e-3


def test_worlds_with_different_fields_and_scales():
    builder = ModelBuilder()
    slot = builder.add_shape_height_field(WORLD, np.zeros((3, 3)), size=(4.0, 4.0))
    other = builder.add_height_field_asset(np.full((21, 11), 0.5), size=(4.0, 4.0))
    builder.add_solid("ball", "sphere", 0.2, mass=1.0, pose=pose((0.1, 0.2, 2.0)))
    model = builder.finalize(3, "cpu", per_world=["shape_asset", "shape_size"])
    asset, size = model.shape_asset.numpy(), model.shape_size.numpy()
    asset[1:, slot] = other
    size[2, slot] = (1.0, 1.0, 2.0)
    model.shape_asset.assign(asset)
    model.shape_size.assign(size)
    sim = Simulation(model, 0.005)
    for _ in range(300):
        sim.step()
    np.testing.assert_allclose(sim.state.body_x.numpy()[:, 0, 2], [0.2, 0.7, 1.2], atol=1e-5)


# ---- building --------------------------------------------------------------------------------------------------------


def test_neighbours_of_a_mesh():
    mesh = triangle_mesh(*PYRAMID)
    found = neighbour_normals(mesh)
    p = mesh.vertices[mesh.triangles].astype(float)
    own = normals(p)
    for t, corners in enumerate(mesh.triangles):
        for k in range(3):
            pair = {corners[k], corners[(k + 1) % 3]}
            others = [s for s, c in enumerate(mesh.triangles) if s != t and pair <= set(c)]
            np.testing.assert_allclose(found[t, k], own[others[0]], atol=1e-12)
    sheet = neighbour_normals(triangle_mesh(*grid_mesh(2, 2, (1, 1))))
    assert np.abs(sheet).sum(axis=2).tolist() == [[0, 0, 1], [1, 0, 0]]


def test_equal_assets_are_shared():
    builder = ModelBuilder()
    heights = np.zeros((4, 5))
    assert builder.add_height_field_asset(heights, size=(1, 1)) == builder.add_height_field_asset(heights, size=(1, 1))
    assert builder.add_height_field_asset(heights, size=(1, 2)) == 1
    assert builder.add_mesh_asset(*PYRAMID) == builder.add_mesh_asset(*PYRAMID) == 0
    assert builder.add_hull_asset(PYRAMID[0]) == 0
    hull = builder.add_shape_mesh(WORLD, *PYRAMID, convex=True)
    assert builder.shapes[hull].type == ShapeType.HULL
    assert len(builder.hulls) == 1


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda b: b.add_shape_height_field(WORLD, np.zeros(5), size=(1, 1)), r"heights must be .* got shape \(5,\)"),
        (lambda b: b.add_shape_height_field(WORLD, np.full((2, 2), np.nan), size=(1, 1)), "finite numbers"),
        (lambda b: b.add_shape_height_field(WORLD, np.zeros((2, 2)), size=(1, 0)), "size must be two lengths > 0 m"),
        (
            lambda b: b.add_shape_height_field(WORLD, np.zeros((2, 2)), size=(1, 1), scale=(1, -1, 1)),
            "got -1.0; mirror",
        ),
        (lambda b: b.add_shape_mesh(WORLD, PYRAMID[0]), "triangles must be given"),
        (lambda b: b.add_shape_mesh(WORLD, PYRAMID[0], [[0, 1, 7]]), "indices must be in 0..4, got 0..7"),
        (lambda b: b.add_shape_mesh(WORLD, PYRAMID[0], [[0, 1, 1]]), "triangles must have an area"),
        (lambda b: b.add_shape_mesh(WORLD, PYRAMID[0][:, :2], PYRAMID[1]), "vertices must be"),
        (lambda b: b.add_shape_mesh(WORLD, *PYRAMID, convex=True, decompose=True), "got both"),
        (lambda b: b.add_shape_mesh(WORLD, "a.obj", PYRAMID[1]), "which has its own triangles, got both"),
    ],
)
def test_errors_name_what_is_wrong(call, message):
    with pytest.raises(ModelError, match=message) as error:
        call(ModelBuilder())
    assert "\n" not in str(error.value)
