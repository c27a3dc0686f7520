"""Cameras of nobody: as a sensor would see it, going along with a body; colours, rods and words; one-line errors."""

import math

import numpy as np
import pytest
from PIL import Image

import simwarp as sw
from simwarp.core.types import ModelError, ShapeType
from simwarp.sensors.cameras.camera import Camera, CameraConfig, look_at
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.cameras.lights import Lighting, Lights
from simwarp.sensors.instances import GREY
from simwarp.sensors.interface import Mount
from simwarp.sensors.scene import Visuals
from simwarp.viewer import FollowCamera, FreeCamera, Polyline, Shot, add_skeleton, caption, draw_lines, grid, paint
from simwarp.viewer.default_visuals import PALETTE, STONE, body_colors
from simwarp.viewer.sheets import INK, PAPER, label

ALL = ("rgb", "grey", "depth", "range", "normals", "instance", "semantic")
EYE, TARGET = (-3.0, 1.0, 1.5), (0.5, 0.2, 0.4)


def rolling_world(worlds=1, speed=1.0, **options):
    """Balls that fly along X beside boxes that stand: simulation and scene."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    for index, y in enumerate((0.0, 1.0)):
        ball = builder.add_body(
            f"ball_{index}", mass=1.0, inertia=(0.1,) * 3, pose=sw.pose((0.0, y, 0.5)), velocity=(speed, 0.0, 0.0)
        )
        builder.add_shape_sphere(ball, radius=0.2)
    builder.add_shape_plane(name="ground")
    visuals = Visuals(builder)
    visuals.add_box(sw.WORLD, half=(0.3, 0.2, 0.6), pose=sw.pose((2.0, -0.8, 0.6)), color=(0.8, 0.2, 0.1), label=4)
    paint(visuals)
    model = builder.finalize(worlds, "cpu")
    return sw.Simulation(model, 0.01, **options), visuals.finalize(model)


@pytest.mark.parametrize("imaging", [Imaging(), Imaging(exposure=0.6, vignetting=1.0)])
def test_a_free_camera_sees_what_a_sensor_sees(imaging):
    config = CameraConfig(width=32, height=20, outputs=ALL, lens=Pinhole(fov=1.1), imaging=imaging)
    free_sim, scene = rolling_world()
    builder_sim, sensor_scene = rolling_world()
    camera = Camera(sensor_scene, Mount(sw.WORLD, look_at(EYE, TARGET)), config)
    sim = sw.Simulation(sensor_scene.model, 0.01, sensors=[camera])
    free = FreeCamera(scene, [0], config)
    free.render(free_sim.state, [look_at(EYE, TARGET)])
    assert sim.dt == builder_sim.dt
    for name in ALL:
        # directions are turned by the same matrix, but from a float64 quaternion rounded at another place
        mine, theirs = free.outputs[name].numpy().astype(float), camera.outputs[name].numpy().astype(float)
        if name in ("depth", "range"):
            near = theirs < 100.0
            assert ((mine < 100.0) == near).mean() > 0.998
            both = near & (mine < 100.0)
            np.testing.assert_allclose(mine[both], theirs[both], rtol=2e-5)
        elif name == "normals":
            assert (np.abs(mine - theirs).max(axis=-1) < 1e-5).mean() > 0.998
        else:
            # a ray at an edge may pass on its other side
            assert (np.abs(mine - theirs) <= (1 if name in ("rgb", "grey") else 0)).mean() > 0.998


def test_views_are_of_the_worlds_that_were_named():
    sim, scene = rolling_world(worlds=3)
    x = sim.state.body_x.numpy()
    x[:, :, 0] += np.array([0.0, 0.7, 1.4])[:, None]
    sim.state.body_x.assign(x)
    sim.measure()
    config = CameraConfig(width=24, height=16, outputs=("depth",))
    free = FreeCamera(scene, [2, 0, 2], config)
    views = free.render(sim.state, [look_at(EYE, TARGET)] * 3)
    np.testing.assert_array_equal(views[0], views[2])
    assert not np.array_equal(views[0], views[1])
    alone = FreeCamera(scene, [0], config).render(sim.state, [look_at(EYE, TARGET)])
    np.testing.assert_array_equal(alone[0], views[1])
    # radii 0.2 about 0.5 m above the ground; world 2 is shifted by 1.4 m
    np.testing.assert_allclose(free.extent(sim.state)[0], [[1.2, -0.2, 0.3], [1.6, 1.2, 0.7]], atol=1e-5)


def test_a_scene_without_bodies_has_no_extent():
    builder = sw.ModelBuilder()
    builder.add_body("anchor", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((3.0, 0.0, 1.0)))
    builder.add_shape_plane()
    model = builder.finalize(1, "cpu")
    free = FreeCamera(Visuals(builder).finalize(model), [0], CameraConfig(width=4, height=4))
    box = free.extent(sw.Simulation(model, 0.01).state)
    np.testing.assert_array_equal(box[:, 0], box[:, 1])


def test_what_a_free_camera_refuses():
    sim, scene = rolling_world(worlds=2)
    for worlds in ([], [2], [-1]):
        with pytest.raises(ModelError, match="free camera: worlds must be indices below 2"):
            FreeCamera(scene, worlds, CameraConfig())
    with pytest.raises(ModelError, match="CameraConfig: width must be at least 1, got 0"):
        FreeCamera(scene, [0], CameraConfig(width=0))
    free = FreeCamera(scene, [0, 1], CameraConfig(width=4, height=4))
    with pytest.raises(ModelError, match="there must be 2 poses, got 1; one per view"):
        free.render(sim.state, [look_at(EYE, TARGET)])


def place_of(studio):
    """Where the camera of a studio was when it last took a picture, from the origin of the rays [m]."""
    return studio.camera._views.start.numpy()[0] + studio.camera._tables.origin.numpy()[0]


def test_a_studio_follows_with_delay():
    sim, scene = rolling_world(speed=2.0)
    shot = Shot(body="ball_0", target=(0.0, 0.0, 0.0), eye=(-2.0, -2.0, 1.0), calm=0.5)
    studio = FollowCamera(sim, scene, shot, width=16, height=12, samples=1)
    studio.render(0.0)
    np.testing.assert_allclose(place_of(studio), [-2.0, -2.0, 1.5], atol=1e-6)
    for _ in range(50):
        sim.step()
    studio.render(0.5)
    # the ball is 1 m on; after its calm time the camera has made up 1 - 1/e of it
    np.testing.assert_allclose(place_of(studio), [-2.0 + 1.0 - math.exp(-1.0), -2.0, 1.5], atol=1e-5)
    studio.render(0.5)  # no time has passed
    np.testing.assert_allclose(place_of(studio)[0], -1.0 - math.exp(-1.0), atol=1e-5)
    for _ in range(200):
        sim.step()
    studio.render(2.5)  # a world that is elsewhere, as after a reset, is seen there at once
    np.testing.assert_allclose(place_of(studio), [-2.0 + 5.0, -2.0, 1.5], atol=1e-5)


def test_a_studio_that_stands_still_sees_all_that_moves():
    sim, scene = rolling_world()
    studio = FollowCamera(sim, scene, Shot(body=sw.WORLD), width=60, height=40, samples=1)
    first = studio.render(0.0)[0]
    place = place_of(studio)
    config = CameraConfig(width=60, height=40, outputs=("instance",), lens=Pinhole(fov=Shot().fov))
    middle = np.array([0.0, 0.5, 0.5])
    seen = FreeCamera(scene, [0], config).render(sim.state, [look_at(place, middle)])[0, ..., 0]
    for ball in range(2):
        rows, columns = np.nonzero(seen == ball)
        assert len(rows) > 10
        for places, size in ((rows, 40), (columns, 60)):
            assert 0 < places.min() <= places.max() < size - 1
    for _ in range(100):
        sim.step()
    assert not np.array_equal(studio.render(1.0)[0], first)
    np.testing.assert_allclose(place_of(studio), place, atol=1e-6)  # float32 about another origin


def drawn(points, depth=100.0, fov=1.0, size=(40, 60), width=2.0):
    """Opacity of a line in a picture through a camera at the origin that looks along X."""
    picture = np.full((*size, 3), 255, np.uint8)
    depths = np.broadcast_to(np.asarray(depth, np.float32), size)
    line = Polyline(np.array(points, float), width=width)
    image = draw_lines(picture, depths, look_at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), fov, [line])
    return 1.0 - image[..., 0] / 255.0


def test_a_line_runs_where_a_pinhole_sees_it():
    fov = 1.0
    ends = np.array([[4.0, 1.2, -0.5], [9.0, -2.0, 2.5]])
    cover = drawn(ends, fov=fov)
    matrix = Pinhole(fov=fov).intrinsics(60, 40)
    share = np.linspace(0.0, 1.0, 200)[:, None]
    seen = ((1.0 - share) * ends[0] + share * ends[1]) @ np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]) @ matrix.T
    column, row = (seen[:, :2] / seen[:, 2:]).T
    # opaque along the line, nothing farther than its width
    assert cover[row.astype(int), column.astype(int)].min() > 0.7
    y, x = np.nonzero(cover)
    distance = np.hypot(x[:, None] + 0.5 - column, y[:, None] + 0.5 - row).min(axis=1)
    assert distance.max() < 0.5 * 2.0 + 0.6
    # as much ink as a band two pixels wide and two half discs, 3.4 pixels together, at its ends; sampled: to 3 %
    length = np.hypot(*(np.array([column[-1] - column[0], row[-1] - row[0]])))
    assert cover.sum() == pytest.approx(2.0 * length + 3.4, rel=0.03)


def test_what_hides_a_line_leaves_it_faint():
    depth = np.full((40, 60), 100.0)
    depth[:, 30:] = 3.0  # a wall, nearer than the line on the right
    cover = drawn([[5.0, 2.0, 0.0], [5.0, -2.0, 0.0]], depth)
    assert cover[19:21, 10:29].max(axis=0).min() > 0.9
    assert cover[19:21, 32:50].max(axis=0).tolist() == pytest.approx([0.2] * 18, abs=0.02)
    lying = drawn([[5.0, 2.0, 0.0], [5.0, -2.0, 0.0]], 5.0)  # on the wall itself
    assert lying.max() > 0.9


def test_lines_behind_the_camera_beside_the_picture_and_without_numbers_do_no_harm():
    assert drawn([[-5.0, 1.0, 0.0], [-5.0, -1.0, 0.0]]).max() == 0.0
    assert drawn([[5.0, 50.0, 0.0], [5.0, 60.0, 0.0]]).max() == 0.0
    assert drawn([[5.0, math.nan, 0.0], [5.0, 1.0, 0.0]]).max() == 0.0
    assert drawn([[5.0, 0.0, 0.0]]).max() == 0.0
    # from behind the camera to before it: seen from the lower edge up
    through = drawn([[-5.0, 0.0, -1.0], [20.0, 0.0, -1.0]])
    assert through[-1].max() > 0.9
    assert through[:20].max() == 0.0


def test_a_studio_draws_lines_into_the_pictures_of_their_worlds():
    sim, scene = rolling_world(worlds=2)
    shot = Shot(body=sw.WORLD, target=(0.0, 0.0, 0.0), eye=(0.0, -8.0, 3.0))
    studio = FollowCamera(sim, scene, shot, worlds=(0, 1), width=60, height=40, samples=1)
    plain = studio.render(0.0)
    line = Polyline(np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]), (1.0, 0.0, 0.0))
    marked = studio.render(0.0, [(), (line,)])
    np.testing.assert_array_equal(marked[0], plain[0])
    red = marked[1, ..., 0].astype(int) - marked[1, ..., 1]
    assert (red > 150).sum() > 5


def test_what_a_studio_refuses():
    sim, scene = rolling_world()
    with pytest.raises(ModelError, match="studio"):
        FollowCamera(sim, scene, Shot(body="wheel"))
    with pytest.raises(ModelError, match="Shot: target"):
        FollowCamera(sim, scene, Shot(target=(0.0, math.nan, 0.0)))
    with pytest.raises(ModelError, match="Shot: eye"):
        FollowCamera(sim, scene, Shot(eye=(0.0, 1.0)))
    with pytest.raises(ModelError, match="Pinhole: fov"):
        FollowCamera(sim, scene, Shot(fov=40.0))


def chain():
    """Two links and a spare body: a builder with hinges."""
    builder = sw.ModelBuilder()
    links = [
        builder.add_body(f"link_{k}", mass=1.0, inertia=(1.0,) * 3, pose=sw.pose((0.5 + k, 0.0, 1.0))) for k in range(2)
    ]
    builder.add_joint_revolute("root", sw.WORLD, links[0], axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 1.0))
    builder.add_joint_revolute("knee", links[0], links[1], axis=(0.0, 1.0, 0.0), anchor=(1.0, 0.0, 1.0))
    builder.add_body("spare", mass=1.0, inertia=(1.0,) * 3, pose=sw.pose((0.0, 3.0, 1.0)))
    return builder


def test_rods_stand_where_joints_are():
    builder = chain()
    builder.add_shape_sphere(1, radius=0.1, pose=sw.pose((0.5, 0.0, 0.0)))
    visuals = Visuals(builder)
    add_skeleton(visuals, 0.05)
    rods = [instance for instance in visuals.instances if instance.kind == ShapeType.CAPSULE]
    # of link 0 from its root to its knee, of link 1 from the knee to its ball; the spare body has no joint
    assert [(rod.body, rod.size[1]) for rod in rods] == [(0, pytest.approx(0.5)), (1, pytest.approx(0.5))]
    np.testing.assert_allclose([rod.pose.position for rod in rods], np.zeros((2, 3)), atol=1e-12)
    model = builder.finalize(1, "cpu")
    free = FreeCamera(visuals.finalize(model), [0], CameraConfig(width=8, height=6))
    box = free.extent(sw.Simulation(model, 0.01).state)[0]
    np.testing.assert_allclose(box, [[-0.05, -0.1, 0.9], [2.1, 0.1, 1.1]], atol=1e-5)


def test_paint_leaves_what_is_painted():
    builder = chain()
    for body in range(3):
        builder.add_shape_sphere(body, radius=0.1)
    wall = builder.add_shape_box(sw.WORLD, half=(1.0, 1.0, 1.0), name="wall")
    builder.add_shape_plane(name="ground")
    mine = builder.add_shape_box(sw.WORLD, half=(1.0, 1.0, 1.0), name="mine")
    visuals = Visuals(builder)
    visuals.show(mine, color=(0.9, 0.1, 0.1))
    paint(visuals)
    looks = {instance.name: instance.appearance for instance in visuals.instances}
    spheres = [instance.appearance.color for instance in visuals.instances if instance.kind == ShapeType.SPHERE]
    # by the number of joints to the root; bodies without joints by their own number
    assert spheres == [PALETTE[0], PALETTE[1], PALETTE[2]] == body_colors(visuals)
    assert looks["wall"].color == STONE
    assert looks["mine"].color == (0.9, 0.1, 0.1)
    assert looks["ground"].texture == 0
    assert GREY not in (look.color for look in looks.values())
    assert wall >= 0


def test_pictures_side_by_side():
    pictures = [np.full((10, 15, 3), value, np.uint8) for value in (10, 20, 30)]
    sheet = grid(pictures, 2, gap=3)
    assert sheet.shape == (2 * 13 + 3 + 1, 2 * 18 + 3 + 1, 3)  # even, as videos want it
    assert (sheet[3:13, 3:18] == 10).all()
    assert (sheet[3:13, 21:36] == 20).all()
    assert (sheet[16:26, 3:18] == 30).all()
    assert (sheet[16:26, 21:36] == PAPER).all()
    assert (sheet[:3] == PAPER).all()


def test_words_on_pictures():
    picture = np.full((40, 120, 3), 90, np.uint8)
    told = caption(picture, "t = 1.00 s")
    band = len(told) - 40
    assert band % 2 == 0
    np.testing.assert_array_equal(told[band:], picture)
    assert (told[:band] == INK).all(axis=-1).sum() > 10  # ink on paper
    np.testing.assert_array_equal(told[0, -1], PAPER)
    assert not np.array_equal(told, caption(picture, "t = 2.00 s"))
    marked = label(picture, "world 3")
    np.testing.assert_array_equal(marked[20:], picture[20:])
    assert (marked[:20] > 180).all(axis=-1).sum() > 10
    Image.fromarray(marked)


def test_lights_may_be_shared():
    sim, scene = rolling_world()
    dark = Lights(Lighting(suns=(), ambient=0.0, ambient_below=0.0, sky=0.0, horizon=0.0), 1, scene.model.device)
    free = FreeCamera(scene, [0], CameraConfig(width=8, height=6), dark)
    assert free.lights is dark
    assert not free.render(sim.state, [look_at(EYE, TARGET)]).any()
    dark.sky_horizon.fill_(1.0)
    assert free.render(sim.state, [look_at(EYE, (5.0, 0.0, 4.0))]).any()
