"""Flexible meshes in sight of rays, cameras and lidars: where they are, in every world, at the time of the look."""

import numpy as np
import pytest
import trimesh
import warp as wp

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.kernels.core.world_range import WorldRange
from simwarp.meshes.materials import Elastic, Rubber
from simwarp.sensors import (
    Camera,
    CameraConfig,
    Lidar,
    LidarConfig,
    Lighting,
    Mount,
    Pinhole,
    Schedule,
    Visuals,
    beam_grid,
    look_at,
)
from simwarp.sensors.ray_casting_kernels import cast_rays
from simwarp.sensors.surface_values import RAMP
from simwarp.viewer.free_camera import FreeCamera

RUBBER = Rubber(young=1e5, poisson=0.4, density=1000.0, damping_time=1e-3)
NYLON = Elastic(young=1e8, density=1100.0)
DOWN = (0.0, 0.0, -1.0)


def sheet(builder, *, cells=8, side=1.0, name="sheet", **options):
    """A square sheet about the origin in the plane z = 0."""
    line = np.linspace(-0.5 * side, 0.5 * side, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    beside = corner + cells + 1
    triangles = np.concatenate(
        [np.stack([corner, beside, beside + 1], 1), np.stack([corner, beside + 1, corner + 1], 1)]
    )
    return builder.add_shell(name, points, triangles, thickness=1e-3, material=NYLON, **options)


def rays(sim, scene, start, direction=DOWN):
    """Distance, normal, instance of rays in all worlds, from world positions."""
    worlds, device = scene.model.world_count, scene.model.device
    start = np.broadcast_to(start, (worlds, *np.shape(start)[-2:]))
    direction = np.broadcast_to(np.asarray(direction, float), start.shape)
    outputs = [wp.zeros(start.shape[:2], dtype=dtype, device=device) for dtype in (float, wp.vec3, int)]
    tables = scene.tables()
    scene.place(sim.state, tables)
    wp.launch(
        cast_rays, dim=start.shape[:2], device=device,
        inputs=[WorldRange(), tables, scene.model.assets, wp.array(np.array(start), dtype=wp.vec3d, device=device),
                wp.array(np.array(direction), dtype=wp.vec3, device=device), 1e3], outputs=outputs,
    )  # fmt: skip
    return [array.numpy() for array in outputs]


def bend(sim, mesh, shape, worlds=None):
    """Moves the nodes of a mesh to `shape` of their rest places, world axes."""
    x = sim.state.body_x.numpy().copy()
    nodes = list(mesh.nodes)
    for world in range(len(x)) if worlds is None else worlds:
        x[world, [mesh.bodies[node] for node in nodes]] = shape(mesh.points[nodes])
    sim.state.body_x.assign(x)
    sim.measure()


def simulated(builder, worlds=1, device="cpu", **options):
    visuals = Visuals(builder)
    model = builder.finalize(world_count=worlds, device=device)
    return sw.Simulation(model, dt=1e-3), visuals.finalize(model, **options)


def test_a_sheet_is_hit_where_its_triangles_are_from_both_sides():
    builder = sw.ModelBuilder()
    mesh = sheet(builder)
    sim, scene = simulated(builder)
    bend(sim, mesh, lambda p: p * (1.0, 1.0, 0.0) + np.stack([0 * p[:, 0], 0 * p[:, 0], 0.3 * p[:, 0] ** 2], 1))
    at = np.random.default_rng(1).uniform(-0.49, 0.49, (200, 2))
    for side, way in ((1.0, DOWN), (-1.0, (0.0, 0.0, 1.0))):
        t, normal, instance = rays(sim, scene, np.column_stack([at, np.full(200, side)]), way)
        cell = np.floor((at[:, 0] + 0.5) * 8) / 8 - 0.5
        # triangles of a sheet bent about y are chords of the parabola
        height = 0.3 * (cell**2 + (at[:, 0] - cell) * (2.0 * cell + 0.125))
        assert np.abs(side - np.sign(side) * t[0] - height).max() < 1e-6
        assert (instance == scene.instance("sheet")).all()
        slope = 0.3 * (2.0 * cell + 0.125)
        expected = np.stack([-slope, 0.0 * slope, 1.0 + 0.0 * slope], 1) / np.sqrt(1.0 + slope**2)[:, None]
        assert np.abs(normal[0] - expected).max() < 1e-5


def test_a_glued_plate_is_seen_where_its_body_goes():
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("plate", mass=5.0, inertia=(1.0, 1.0, 1.0))
    box = sw.flex.box((0.4, 0.2, 0.1), (4, 2, 1)).placed(sw.pose((0.0, 0.0, 0.05)))
    mesh = builder.add_solid_mesh("pad", box, material=RUBBER, glue={body: "z_max"})
    sim, scene = simulated(builder)
    angle = 0.3
    turn = (0.0, np.sin(0.5 * angle), 0.0, np.cos(0.5 * angle))
    rot = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    shift = np.array([2.0, -3.0, 5.0])
    rotations, x = sim.state.body_rot.numpy().copy(), sim.state.body_x.numpy().copy()
    rotations[0, body], x[0, body] = turn, shift
    own = list(mesh.nodes)
    x[0, [mesh.bodies[node] for node in own]] = mesh.points[own] @ rot.T + shift
    sim.state.body_rot.assign(rotations)
    sim.state.body_x.assign(x)
    sim.measure()
    # along the plate's own normal, from 1 m above its upper side and below its lower one
    t, normal, _ = rays(sim, scene, [shift + rot @ (0.13, 0.07, 1.1)], rot @ DOWN)
    assert t[0, 0] == pytest.approx(1.0, abs=1e-5)
    assert normal[0, 0] == pytest.approx(rot @ (0.0, 0.0, 1.0), abs=1e-5)
    t, normal, _ = rays(sim, scene, [shift + rot @ (-0.13, 0.07, -1.0)], rot @ (0.0, 0.0, 1.0))
    assert t[0, 0] == pytest.approx(1.0, abs=1e-5)
    assert normal[0, 0] == pytest.approx(rot @ DOWN, abs=1e-5)


def test_rays_agree_with_every_triangle_of_a_deformed_lattice():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    builder = sw.ModelBuilder()
    mesh = builder.add_solid_mesh(
        "ball", sw.flex.lattice((ball.vertices, ball.faces), spacing=0.02), material=RUBBER, radius=2e-3
    )
    sim, scene = simulated(builder)
    assert scene.names == ("ball",)  # spheres of nodes are not seen
    bend(sim, mesh, lambda p: np.column_stack([1.5 * p[:, 0] + 10.0 * p[:, 1] ** 2, p[:, 1], p[:, 2] + p[:, 0]]))
    places = np.zeros((len(mesh.points), 3))
    places[list(mesh.nodes)] = sim.state.body_x.numpy()[0, [mesh.bodies[node] for node in mesh.nodes]]
    a, b, c = mesh.surface.vertices(places)[mesh.surface.triangles].transpose(1, 0, 2)
    rng = np.random.default_rng(2)
    start = rng.normal(size=(300, 3))
    start *= 0.5 / np.linalg.norm(start, axis=1, keepdims=True)
    way = rng.uniform(-0.05, 0.05, (300, 3)) - start
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    t, _, _ = rays(sim, scene, start, way)
    # Möller and Trumbore in float64, all triangles
    h = np.cross(way[:, None], (c - a)[None])
    det = np.einsum("ti,rti->rt", b - a, h)
    s = start[:, None] - a[None]
    u = np.einsum("rti,rti->rt", s, h) / det
    q = np.cross(s, (b - a)[None])
    v = np.einsum("ri,rti->rt", way, q) / det
    far = np.einsum("ti,rti->rt", c - a, q) / det
    far = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0), far, np.inf).min(axis=1)
    hit = np.isfinite(far)
    assert 50 < hit.sum() < 300
    assert (np.isfinite(far) == (t[0] >= 0.0)).mean() > 0.99  # but along edges
    both = hit & (t[0] >= 0.0)
    assert np.abs(far[both] - t[0][both]).max() < 2e-6


def test_worlds_see_their_own_shape():
    found = []
    for worlds, bent in ((5, [3]), (5, []), (1, [])):
        builder = sw.ModelBuilder()
        mesh = sheet(builder)
        sim, scene = simulated(builder, worlds)
        bend(sim, mesh, lambda p: p + np.array([0.0, 0.0, 0.25]), worlds=bent)
        at = np.random.default_rng(3).uniform(-0.45, 0.45, (40, 2))
        found.append(rays(sim, scene, np.column_stack([at, np.full(40, 1.0)]))[0])
    bent, flat, alone = found
    for world in (0, 1, 2, 4):
        assert (bent[world] == alone[0]).all()
    assert (flat == alone).all()
    assert bent[3] == pytest.approx(0.75, abs=1e-6)


def test_a_sheet_ten_kilometres_away_is_as_sharp():
    builder = sw.ModelBuilder()
    mesh = sheet(builder, pose=sw.pose((1e4, 1e4, 0.0)))
    sim, scene = simulated(builder)
    start = np.array([[1e4 + 0.1, 1e4 + 0.2, 0.5]])
    assert rays(sim, scene, start)[0][0, 0] == pytest.approx(0.5, abs=1e-6)
    bend(sim, mesh, lambda p: p + np.array([1e4, 1e4, -0.001]))
    assert rays(sim, scene, start)[0][0, 0] == pytest.approx(0.501, abs=1e-6)


class Looks:
    """A block that falls on a floor, seen by a camera above it and a lidar beside it."""

    def __init__(self, worlds=1, threads=1) -> None:
        builder = sw.ModelBuilder()
        builder.add_shape_plane()
        box = sw.flex.box((0.12, 0.1, 0.08), (2, 2, 2))
        self.mesh = builder.add_solid_mesh(
            "block", box, material=RUBBER, pose=sw.pose((0.0, 0.0, 0.06)), radius=2e-3, surface=sw.Material()
        )
        visuals = Visuals(builder)
        visuals.show(self.mesh, color=(0.8, 0.1, 0.1), label=7, reflectance=0.9)
        model = builder.finalize(world_count=worlds, device="cpu")
        self.scene = visuals.finalize(model)
        config = CameraConfig(
            schedule=Schedule(rate=100.0), width=16, height=16, outputs=("depth", "semantic", "instance", "rgb")
        )
        self.camera = Camera(self.scene, Mount(sw.WORLD, look_at((0.0, 0.0, 0.5), (0.0, 0.0, 0.0))), config)
        beam = beam_grid(1, 1, azimuth=(0.1, -0.1))
        lidar = LidarConfig(schedule=Schedule(rate=100.0), beams=beam, outputs=("ranges",))
        self.lidar = Lidar(self.scene, Mount(sw.WORLD, sw.pose((-1.0, 0.01, 0.05))), lidar)
        self.sim = sw.Simulation(model, dt=1e-3, sensors=[self.camera, self.lidar], threads=threads)

    def frames(self):
        """What both see now."""
        return [*(array.numpy().copy() for array in self.camera.outputs.values()), self.lidar.ranges.numpy().copy()]


def test_camera_and_lidar_see_a_block_at_rest_where_it_lies():
    looks = Looks()
    looks.sim.step(1500)
    depth, semantic, instance, rgb, ranges = looks.frames()
    nodes = [looks.mesh.bodies[node] for node in looks.mesh.nodes]
    x = looks.sim.state.body_x.numpy()[0, nodes]
    # its upper side is flat but for its own weight, and lower than it was built by that
    top = x[:, 2].max()
    assert top == pytest.approx(0.08 + 2e-3, abs=1e-3)
    assert depth[0, 8, 8, 0] == pytest.approx(0.5 - top, abs=5e-4)
    assert semantic[0, 8, 8, 0] == 7
    assert instance[0, 8, 8, 0] == looks.scene.instance("block")
    assert semantic[0, 0, 0, 0] == 0
    assert depth[0, 0, 0, 0] == pytest.approx(0.5, abs=1e-5)
    red, green, _ = rgb[0, 8, 8].tolist()
    assert red > 2 * green
    # pressed by its weight the block is a little wider than it was built
    side = -x[:, 0].min()
    assert side == pytest.approx(0.06, abs=1e-3)
    assert ranges[0, 0, 0] == pytest.approx((1.0 - side, 0.9), abs=2e-3)


def test_a_falling_block_is_seen_where_it_is_at_the_time_of_the_frame():
    looks = Looks()
    looks.sim.step(50)
    fallen = 0.5 * 9.81 * 0.05 * 0.051  # of fifty steps whose velocities come first
    assert looks.frames()[0][0, 8, 8, 0] == pytest.approx(0.5 - 0.1 + fallen, abs=1e-5)
    before = looks.frames()
    looks.sim.step(5)  # until the next frame nothing changes
    assert all((one == other).all() for one, other in zip(before, looks.frames(), strict=True))


@pytest.mark.parametrize("threads", [1, 2])
def test_pictures_of_a_batch_are_those_of_each_world_alone(threads):
    alone, again, many = Looks(), Looks(), Looks(worlds=5, threads=threads)
    velocity = many.sim.state.body_v.numpy().copy()
    velocity[3, 0] += 1.0
    many.sim.state.body_v.assign(velocity)
    many.sim.measure()
    for looks in (alone, again, many):
        looks.sim.step(60)
    for one, same, other in zip(alone.frames(), again.frames(), many.frames(), strict=True):
        assert (one == same).all()
        assert all((other[world] == one[0]).all() for world in (0, 1, 2, 4))
    assert np.abs(many.frames()[0][3] - alone.frames()[0][0]).max() > 1e-3


def test_models_without_meshes_have_no_surfaces_and_launch_nothing_for_them():
    builder = sw.ModelBuilder()
    builder.add_shape_box(builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0)), half=(0.1, 0.1, 0.1))
    sim, scene = simulated(builder, 3)
    assert scene.surfaces is None
    assert scene.asset.shape == (1, 1)
    assert len(scene.record_place(sim, scene.tables())) == 1


def test_surfaces_can_be_hidden_and_spheres_seen():
    builder = sw.ModelBuilder()
    mesh = sheet(builder, cells=2, radius=0.02)
    assert [each.flexible for each in Visuals(builder).instances] == [0]
    balls = Visuals(builder, spheres=True)
    assert len(balls.instances) == len(mesh.shapes) == 9
    hidden = Visuals(builder)
    hidden.hide(mesh)
    assert hidden.instances == []
    with pytest.raises(ModelError, match="there must be a mesh 'sheet' in sight"):
        hidden.show(mesh, color=(1.0, 0.0, 0.0))
    painted = Visuals(builder)
    painted.show(mesh, texture=painted.texture(sw.sensors.CheckerTexture()))
    with pytest.raises(ModelError, match="a flexible mesh must have no texture"):
        painted.finalize(builder.finalize(world_count=1, device="cpu"))


def test_a_mesh_and_a_shape_may_have_one_name():
    builder = sw.ModelBuilder()
    mesh = sheet(builder, cells=2, name="pad")
    builder.add_shape_box(sw.WORLD, half=(0.1, 0.1, 0.1), pose=sw.pose((3.0, 0.0, 0.0)), name="pad")
    visuals = Visuals(builder)
    assert [each.name for each in visuals.instances] == ["pad", "pad (mesh)"]
    assert visuals.index_of(mesh) == 1


def test_a_surface_can_be_disabled_in_one_world():
    builder = sw.ModelBuilder()
    sheet(builder, cells=2)
    sim, scene = simulated(builder, 3, per_world=["enabled"])
    there = np.ones((3, 1), np.int32)
    there[1] = 0
    scene.enabled.assign(there)
    t = rays(sim, scene, [[0.1, 0.2, 1.0]])[0][:, 0]
    assert t.tolist() == pytest.approx([1.0, -1.0, 1.0])


def colored(values, *, most, least=0.0, worlds=1):
    """Pictures from above of a sheet in colours of values."""
    builder = sw.ModelBuilder()
    mesh = sheet(builder, cells=4)
    visuals = Visuals(builder)
    visuals.show_values(mesh)
    model = builder.finalize(world_count=worlds, device="cpu")
    sim, scene = sw.Simulation(model, dt=1e-3), visuals.finalize(model)
    config = CameraConfig(width=8, height=8, lens=Pinhole(fov=0.8))
    bright = Lighting(suns=(), ambient=(1.0, 1.0, 1.0), shadows=False)
    camera = FreeCamera(scene, range(worlds), config, bright)
    if values is not None:
        given = values(mesh) if callable(values) else values
        scene.set_values(mesh, wp.array(given, dtype=float, device="cpu"), most=most, least=least)
    return camera.render(sim.state, [look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))] * worlds)


def developed(color):
    """Bytes of linear light, by the camera's own response."""
    return np.round(255.0 * np.array(color) ** (1.0 / 2.2))


@pytest.mark.parametrize(("share", "place"), [(-0.5, 0), (0.0, 0), (0.25, 1), (0.5, 2), (0.75, 3), (1.0, 4), (2.0, 4)])
def test_values_of_elements_are_colours_of_the_ramp(share, place):
    picture = colored(np.full((1, 32), 100.0 + 50.0 * share), least=100.0, most=150.0)
    assert np.abs(picture[0, 4, 4].astype(int) - developed(RAMP[place])).max() <= 1


def test_values_of_nodes_are_interpolated_in_each_world():
    def along_x(mesh):
        return np.stack([np.full(len(mesh.points), 0.25), 0.5 + mesh.points[:, 0]])

    picture = colored(along_x, most=1.0, worlds=2)
    assert np.abs(picture[0].astype(int) - developed(RAMP[1])).max() <= 1
    # +x goes along one side of the picture: what its pixels see, by the lens
    half = np.tan(0.4)
    shares = 0.5 + half * (2.0 * (np.arange(8) + 0.5) / 8.0 - 1.0)
    expected = np.array(
        [[np.interp(s, np.linspace(0.0, 1.0, 5), np.array(RAMP)[:, c]) for c in range(3)] for s in shares]
    )
    rows = picture[1, :, 4].astype(int)
    columns = picture[1, 4, :].astype(int)
    found = [np.abs(line - developed(expected[::way])).max() for line in (rows, columns) for way in (1, -1)]
    assert min(found) <= 1


def test_without_values_a_mesh_is_white_and_wrong_ones_are_refused():
    assert (colored(None, most=1.0)[0, 4, 4] == 255).all()
    with pytest.raises(ModelError, match=r"must be float32 \(worlds, 32\) of elements or \(worlds, 25\) of nodes"):
        colored(np.zeros((1, 7)), most=1.0)
    with pytest.raises(ModelError, match="least < most must hold"):
        colored(np.zeros((1, 32)), most=0.0)
    builder = sw.ModelBuilder()
    mesh = sheet(builder)
    _, scene = simulated(builder)
    with pytest.raises(ModelError, match=r"values must be of a mesh that is shown by them, got 'sheet'"):
        scene.set_values(mesh, wp.zeros((1, 128), dtype=float, device="cpu"), most=1.0)


def test_surfaces_stand_beside_hulls_meshes_and_each_other():
    """Trees of five kinds of geometry in three worlds, and vertices that one and eight nodes carry."""
    builder = sw.ModelBuilder()
    cube = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])
    builder.add_shape_hull(sw.WORLD, cube, pose=sw.pose((0.0, 0.0, 0.0)), name="hull")
    box = trimesh.creation.box(extents=(0.2, 0.2, 0.2))
    builder.add_shape_mesh(sw.WORLD, box.vertices, box.faces, pose=sw.pose((1.0, 0.0, 0.0)), name="stone")
    flat = sheet(builder, cells=3, side=0.4, pose=sw.pose((2.0, 0.0, 0.0)))
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.2)
    builder.add_solid_mesh(
        "ball",
        sw.flex.lattice((ball.vertices, ball.faces), spacing=0.1),
        material=RUBBER,
        pose=sw.pose((3.0, 0.0, 0.0)),
    )
    solid = sw.flex.box((0.2, 0.2, 0.2), (2, 2, 2), elements="tetrahedra")
    block = builder.add_solid_mesh("block", solid, material=RUBBER, pose=sw.pose((4.0, 0.0, 0.0)))
    visuals = Visuals(builder)
    visuals.add_mesh(sw.WORLD, box.vertices, box.faces, name="seen", pose=sw.pose((5.0, 0.0, 0.0)))
    visuals.show_values(block)
    model = builder.finalize(world_count=3, device="cpu")
    sim, scene = sw.Simulation(model, dt=1e-3), visuals.finalize(model)
    bend(sim, flat, lambda p: p + np.array([2.0, 0.0, 0.3]), worlds=[1])
    bend(sim, block, lambda p: p * (1.0, 1.0, 2.0) + np.array([4.0, 0.0, 0.0]), worlds=[2])
    start = np.array([[x, 0.031, 1.0] for x in (0.011, 1.013, 2.017, 3.0, 4.019, 5.023)])
    t, _, instance = rays(sim, scene, start)
    names = [[scene.names[index] for index in row] for row in instance]
    assert names == [["hull", "stone", "sheet", "ball", "block", "seen"]] * 3
    # the ball's triangles are chords of it
    expected = np.array([0.9, 0.9, 1.0, 1.0 - np.sqrt(0.04 - 0.031**2), 0.9, 0.9])
    for world, changes in enumerate(({}, {2: 0.7}, {4: 0.8})):
        wanted = expected.copy()
        for place, value in changes.items():
            wanted[place] = value
        assert t[world] == pytest.approx(wanted, abs=5e-3)
        assert np.delete(t[world], 3) == pytest.approx(np.delete(wanted, 3), abs=1e-6)


def test_the_first_frame_has_the_surfaces_as_they_are_at_the_start():
    depth, semantic, *_ = Looks().frames()
    assert depth[0, 8, 8, 0] == pytest.approx(0.4, abs=1e-6)
    assert semantic[0, 8, 8, 0] == 7


def saddle(points):
    """A sheet bent two ways."""
    return points + np.outer(points[:, 0] ** 2 - points[:, 1] ** 2, (0.0, 0.0, 0.5))


def from_above(device="cpu", threads=None, worlds=3):
    """Hits of rays with a bent sheet."""
    builder = sw.ModelBuilder()
    mesh = sheet(builder, cells=20)
    sim, scene = simulated(builder, worlds, device)
    if threads is not None:
        scene.surfaces._threads = threads
    bend(sim, mesh, saddle, [0, 2])
    at = np.random.default_rng(4).uniform(-0.49, 0.49, (500, 2))
    return rays(sim, scene, np.column_stack([at, np.full(500, 1.0)]))


def test_threads_that_share_a_world_change_nothing():
    """As those of a GPU do."""
    for one, other in zip(from_above(), from_above(threads=(7, 5, 3)), strict=True):
        assert (one == other).all()


@pytest.mark.cuda
def test_a_gpu_sees_the_same_surfaces():
    for one, other in zip(from_above(), from_above("cuda:0"), strict=True):
        assert other == pytest.approx(one, abs=1e-5)


@pytest.mark.cuda
def test_a_graph_refits_what_moved_since_it_was_captured():
    builder = sw.ModelBuilder()
    mesh = sheet(builder)
    sim, scene = simulated(builder, 2, "cuda:0")
    tables = scene.tables()
    scene.place(sim.state, tables)
    with wp.ScopedCapture(device="cuda:0") as capture:
        scene.place(sim.state, tables)
    bend(sim, mesh, lambda p: p + np.array([0.0, 0.0, 0.25]), [1])
    wp.capture_launch(capture.graph)
    surface = scene.instance("sheet")
    heights = tables.lower.numpy()[:, surface, 2] + tables.origin.numpy()[:, 2]
    assert heights == pytest.approx([0.0, 0.25], abs=1e-5)
