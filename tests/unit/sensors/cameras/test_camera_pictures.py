"""Pictures: against a slow ray tracer, and against what geometry and optics say."""

import dataclasses
import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.sensors.cameras.camera import Camera, CameraConfig, look_at
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lenses import FishEye, Pinhole, Radial, directions
from simwarp.sensors.cameras.lights import Lamp, Lighting, Sun
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.scene import Visuals
from tests.reference.sensors import pictures
from tests.unit.sensors.cameras.camera_scenes import DARK, LINEAR, empty_builder, take, wall_visuals

OUTPUTS = ("rgb", "grey", "depth", "range", "normals", "instance", "semantic")
TILT = np.array([0.1, 0.2, 0.3, 0.9])
TILT /= np.linalg.norm(TILT)
EYE, TARGET = (-2.5, -1.5, 1.6), (0.2, 0.1, 0.4)
LIGHTS = Lighting(
    suns=(Sun(direction=(0.5, -0.8, 1.0), color=(0.6, 0.5, 0.4)),),
    lamps=(Lamp(position=(-1.5, 1.0, 2.0), color=(0.5, 0.8, 1.0)),),
    ambient=(0.1, 0.12, 0.14), ambient_below=(0.05, 0.04, 0.03), sky=(0.2, 0.4, 0.8), horizon=(0.7, 0.8, 0.9),
    below=(0.2, 0.3, 0.1), fog_density=0.05, fog=(0.5, 0.6, 0.7),
)  # fmt: skip
THINGS = (
    pictures.Thing("plane", np.zeros(3), color=(0.4, 0.5, 0.3), label=1),
    pictures.Thing("sphere", np.array([0.3, -0.4, 0.5]), (0.5, 0.5, 0.5), color=(0.8, 0.2, 0.1), label=2),
    pictures.Thing("box", np.array([0.4, 0.9, 0.45]), (0.4, 0.3, 0.2), matrix_of(TILT), (0.1, 0.3, 0.8), 3),
)


def three_things():
    """The plane, ball and box of THINGS."""
    plane, ball, box = THINGS
    visuals = Visuals(empty_builder())
    visuals.add_plane(color=plane.color, label=plane.label)
    visuals.add_sphere(0, radius=0.5, pose=sw.pose(ball.centre), color=ball.color, label=ball.label)
    visuals.add_box(sw.WORLD, half=box.size, pose=sw.pose(box.centre, TILT), color=box.color, label=box.label)
    return visuals


def reference(rays, lighting=LIGHTS, reach=12.0):
    """The same by the slow ray tracer."""
    light = pictures.Light(
        tuple((sun.direction, sun.color) for sun in lighting.suns),
        tuple((lamp.position, lamp.color) for lamp in lighting.lamps),
        lighting.ambient, lighting.ambient_below, lighting.sky, lighting.horizon, lighting.below,
        lighting.fog_density, lighting.fog, lighting.shadows,
    )  # fmt: skip
    return pictures.take(THINGS, EYE, matrix_of(look_at(EYE, TARGET).rotation), rays, light, reach)


@pytest.mark.parametrize("lens", [Pinhole(fov=1.3), FishEye(fov=2.6), Radial(fov=1.3, k1=-0.15)], ids=str)
@pytest.mark.parametrize("shadows", [True, False])
def test_a_scene_is_that_of_the_slow_ray_tracer(lens, shadows):
    width, height = 32, 24
    lighting = dataclasses.replace(LIGHTS, shadows=shadows)
    found = take(
        three_things(), EYE, TARGET, lights=lighting, width=width, height=height, lens=lens, outputs=OUTPUTS,
        far=12.0, imaging=Imaging(),
    )  # fmt: skip
    wanted = reference(directions(lens, width, height), lighting)
    assert set(np.unique(wanted["instance"])) == {-1, 0, 1, 2}
    np.testing.assert_array_equal(found["instance"][0], wanted["instance"])
    labels = np.array([-1, 1, 2, 3])[wanted["instance"] + 1]
    np.testing.assert_array_equal(found["semantic"][0], labels)
    # rays of float32 directions (1e-7) meet the ground at a slant of up to 1 in 100
    np.testing.assert_allclose(found["range"][0], wanted["range"], rtol=3e-5)
    np.testing.assert_allclose(found["depth"][0], wanted["depth"], rtol=3e-5, atol=3e-5)
    np.testing.assert_allclose(found["normals"][0], wanted["normals"], atol=1e-5)
    # half a level of rounding, and the table of the response curve
    values = pictures.processed(wanted["light"])
    assert np.abs(found["rgb"][0] - values).max() < 0.6
    assert np.abs(found["grey"][0] - values.mean(axis=-1, keepdims=True)).max() < 0.6


def test_depth_and_range_of_a_wall():
    found = take(wall_visuals(2.0), width=16, height=12, lens=Pinhole(fov=1.5), outputs=("depth", "range", "normals"))
    # 2 m along the axis everywhere; longer along slanted rays
    np.testing.assert_allclose(found["depth"], 2.0, rtol=1e-6)
    rays = directions(Pinhole(fov=1.5), 16, 12)
    np.testing.assert_allclose(found["range"][0, ..., 0], 2.0 / rays[..., 0], rtol=1e-6)
    np.testing.assert_allclose(found["normals"], np.broadcast_to([-1.0, 0.0, 0.0], (1, 12, 16, 3)), atol=1e-6)


def test_near_and_reach_bound_what_is_seen():
    visuals = wall_visuals(2.0)
    visuals.add_box(sw.WORLD, half=(0.1, 5.0, 5.0), pose=sw.pose((0.3, 0.0, 0.0)))
    inside = take(visuals, width=4, height=4, lens=Pinhole(fov=0.2), outputs=("range", "instance"), near=0.5)
    assert (inside["instance"] == 0).all()
    np.testing.assert_allclose(inside["range"], 2.0, rtol=0.02)
    beyond = take(visuals, width=4, height=4, lens=Pinhole(fov=0.2), outputs=("range", "normals", "semantic"), near=0.5,
                  far=1.5)  # fmt: skip
    assert (beyond["range"] == 1.5).all()
    assert not beyond["normals"].any()
    assert (beyond["semantic"] == -1).all()


def test_groups_decide_what_a_camera_sees():
    visuals = wall_visuals(2.0, group=1)
    visuals.add_box(sw.WORLD, half=(0.1, 5.0, 5.0), pose=sw.pose((1.0, 0.0, 0.0)), group=2)
    seen = {
        groups: take(visuals, width=2, height=2, outputs=("instance",), groups=groups)["instance"].max()
        for groups in (1, 2, 4)
    }
    assert seen == {1: 0, 2: 1, 4: -1}


def test_a_shadow_is_where_geometry_says():
    visuals = Visuals(empty_builder())
    visuals.add_plane(color=(1.0, 1.0, 1.0))
    visuals.add_box(sw.WORLD, half=(0.5, 0.5, 0.01), pose=sw.pose((0.0, 0.0, 2.0)))
    lights = dataclasses.replace(DARK, suns=(Sun(direction=(1.0, 0.0, 2.0), color=1.0),))
    # from below the plate, looking down: the sun throws it by -1 m along x, onto x from -1.5 to -0.5
    found = take(visuals, (0.0, 0.0, 1.9), (0.0, 0.0, 0.0), lights=lights, width=40, height=40,
                 lens=Pinhole(fov=2.0 * math.atan(2.0 / 1.9)), outputs=("rgb",))["rgb"][0, ..., 0]  # fmt: skip
    # the image's upper side is X, its left side Y: 10 pixels per metre
    x = 2.0 - (np.arange(40) + 0.5) / 10.0
    dark = (np.abs(x[:, None] + 1.0) < 0.5) & (np.abs(x[None, :]) < 0.5)
    edge = np.minimum.outer(np.abs(np.abs(x + 1.0) - 0.5), np.full(40, 9.0)) < 0.02  # the plate is 2 cm thick
    edge |= (np.abs(np.abs(x) - 0.5) < 0.02)[None, :]
    np.testing.assert_array_equal((found == 0)[~edge], dark[~edge])
    assert np.abs(found[~dark & ~edge] - 255.0 * 2.0 / math.sqrt(5.0)).max() <= 0.51


def test_a_lamp_falls_with_the_square_of_the_distance():
    for distance in (1.0, 2.0, 4.0):
        lights = dataclasses.replace(DARK, lamps=(Lamp(position=(2.0 - distance, 0.0, 0.0), color=(0.9, 0.6, 0.3)),))
        found = take(wall_visuals(2.0, color=(1.0, 1.0, 1.0)), (1.8, 0.0, 0.0), (2.0, 0.0, 0.0), lights=lights, width=1,
                     height=1)["rgb"][0, 0, 0]  # fmt: skip
        assert np.abs(found - 255.0 * np.array([0.9, 0.6, 0.3]) / distance**2).max() <= 0.51


def test_a_lamp_is_hidden_by_what_stands_before_it_and_not_behind():
    for x, lit in ((1.0, False), (-0.5, True)):
        visuals = wall_visuals(2.0, color=(1.0, 1.0, 1.0))
        visuals.add_box(sw.WORLD, half=(0.1, 1.0, 1.0), pose=sw.pose((x, 0.0, 0.0)))
        lights = dataclasses.replace(DARK, lamps=(Lamp(position=(0.0, 0.0, 0.0), color=1.0),))
        found = take(visuals, (1.9, 0.0, 0.0), (2.0, 0.0, 0.0), lights=lights, width=1, height=1)["rgb"].max()
        assert (found > 0) == lit


def test_surfaces_do_not_shadow_themselves():
    # everything that faces the sun is lit, far from the origin and at a slant too
    visuals = Visuals(empty_builder())
    visuals.add_plane(color=(1.0, 1.0, 1.0))
    visuals.add_sphere(sw.WORLD, radius=3.0, pose=sw.pose((300.0, 200.0, 3.0)), color=(1.0, 1.0, 1.0))
    lights = dataclasses.replace(DARK, suns=(Sun(direction=(0.0, 0.0, 1.0), color=1.0),))
    found = take(visuals, (290.0, 192.0, 12.0), (300.0, 200.0, 2.0), lights=lights, width=40, height=40,
                 lens=Pinhole(fov=0.6), outputs=("rgb", "normals", "instance"))  # fmt: skip
    up = matrix_of(look_at((290.0, 192.0, 12.0), (300.0, 200.0, 2.0)).rotation)[2]
    cosine = found["normals"][0] @ up
    ball = found["instance"][0, ..., 0] == 1
    assert ball.sum() > 100
    lit = ball & (cosine > 0.02)
    assert np.abs(found["rgb"][0, ..., 0][lit] - 255.0 * cosine[lit]).max() < 0.6


def test_fog_is_its_closed_form():
    lights = dataclasses.replace(DARK, ambient=0.8, ambient_below=0.8, fog_density=0.3, fog=(0.1, 0.5, 0.9))
    for distance in (0.5, 3.0, 10.0):
        found = take(wall_visuals(distance, color=(1.0, 0.5, 0.25)), lights=lights, width=1, height=1)["rgb"][0, 0, 0]
        clear = math.exp(-0.3 * distance)
        wanted = clear * 0.8 * np.array([1.0, 0.5, 0.25]) + (1.0 - clear) * np.array([0.1, 0.5, 0.9])
        assert np.abs(found - 255.0 * wanted).max() <= 0.51


def test_the_sky_goes_from_the_horizon_to_the_zenith():
    lights = dataclasses.replace(DARK, sky=(0.0, 0.0, 1.0), horizon=(1.0, 0.0, 0.0), below=(0.0, 1.0, 0.0))
    seen = []
    for target in ((0.0, 0.0, 1.0), (1.0, 0.0, math.tan(math.asin(0.25))), (1.0, 0.0, -0.1)):
        picture = take(wall_visuals(-50.0), (0.0, 0.0, 0.0), target, lights=lights, width=1, height=1, far=10.0)
        seen.append(picture["rgb"][0, 0, 0])
    # the root of 1/4 is half way
    np.testing.assert_allclose(seen, np.array([[0, 0, 255], [127.5, 0, 127.5], [0, 255, 0]]), atol=0.51)


def test_vignetting_exposure_and_gamma_are_their_formulas():
    lights = dataclasses.replace(DARK, ambient=0.5, ambient_below=0.5)
    imaging = Imaging(exposure=1.3, gamma=1.8, vignetting=0.7)
    found = take(wall_visuals(2.0, color=(1.0, 0.3, 0.02)), lights=lights, width=20, height=10, lens=Pinhole(fov=1.6),
                 imaging=imaging)["rgb"][0]  # fmt: skip
    cosine = directions(Pinhole(fov=1.6), 20, 10)[..., :1]
    wanted = pictures.processed(0.5 * np.array([1.0, 0.3, 0.02]), 1.8, 1.3, 0.7, cosine)
    assert np.abs(found - wanted).max() < 0.55
    assert found[0, 0, 0] < found[5, 10, 0]


def test_white_is_the_brightest():
    lights = dataclasses.replace(DARK, ambient=9.0, ambient_below=9.0)
    assert (take(wall_visuals(color=(1.0, 0.5, 0.2)), lights=lights, width=2, height=2)["rgb"] == 255).all()


def half_wall(slope):
    """A bright box whose upper edge climbs across the image."""
    visuals = Visuals(empty_builder())
    angle = 0.5 * math.atan(slope)
    rotation = np.array([math.sin(angle), 0.0, 0.0, math.cos(angle)])
    middle = np.array([1.0, 0.0, 0.0]) - 50.0 * matrix_of(rotation)[:, 2]
    visuals.add_box(sw.WORLD, half=(1e-3, 50.0, 50.0), color=(1.0, 1.0, 1.0), pose=sw.pose(middle, rotation))
    return visuals


def test_supersampling_averages_an_edge():
    size, slope, side = 12, 0.3, 4
    lights = dataclasses.replace(DARK, ambient=1.0, ambient_below=1.0)
    found = take(half_wall(slope), lights=lights, width=size, height=size, lens=Pinhole(fov=2.0 * math.atan(0.5)),
                 samples=side)["rgb"][0, ..., 0] / 255.0  # fmt: skip
    # the front face is 1 mm nearer than 1 m. A pixel is 1 / size m wide; y is to the left
    fine = 64
    place = ((np.arange(size * fine) + 0.5) / (size * fine) - 0.5) * 0.999
    below = -place[:, None] < slope * -place[None, :]
    share = below.reshape(size, fine, size, fine).mean(axis=(1, 3))
    # a stratum that the edge crosses is right or wrong as a whole; an edge crosses at most 2 s - 1 of s²
    assert np.abs(found - share).max() <= 0.5 * (2 * side - 1) / side**2
    edge = (share > 0.0) & (share < 1.0)
    assert edge.sum() >= size
    # those errors are independent: their mean over the pixels of the edge is small
    assert abs((found - share)[edge].mean()) < 0.04
    np.testing.assert_array_equal(found[~edge], share[~edge])


def test_more_rays_are_nearer_to_the_truth():
    lights = dataclasses.replace(DARK, ambient=1.0, ambient_below=1.0)
    options = {"lights": lights, "width": 24, "height": 24, "lens": Pinhole(fov=1.0)}
    truth = take(half_wall(0.4), samples=16, **options)["rgb"].astype(float)
    errors = [
        np.abs(take(half_wall(0.4), samples=s, seed=3, **options)["rgb"] - truth).mean() for s in (1, 2, 4)
    ]  # fmt: skip
    assert errors[0] > 1.8 * errors[1] > 3.2 * errors[2]


def moving_ball(window, samples=1, substeps=1, rate=10.0, seed=0, until=10):
    """Frames of a ball that crosses the picture, one per 10 ms step from the start."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("ball", mass=1.0, inertia=(1, 1, 1), pose=sw.pose((2.0, 0.4, 0.0)), velocity=(0.0, -6.0, 0.0))
    visuals = Visuals(builder)
    visuals.add_sphere(0, radius=0.3, color=(1.0, 1.0, 1.0))
    model = builder.finalize(1, "cpu")
    from simwarp.sensors.cameras.camera import Camera

    camera = Camera(
        visuals.finalize(model), Mount(),
        CameraConfig(schedule=Schedule(rate=rate, window=window), width=24, height=12, lens=Pinhole(fov=0.8),
                     samples=samples, outputs=("rgb", "depth"), imaging=LINEAR),
        lights=dataclasses.replace(DARK, ambient=1.0, ambient_below=1.0), seed=seed,
    )  # fmt: skip
    sim = sw.Simulation(model, 0.01, substeps=substeps, sensors=[camera])
    frames = [{name: array.numpy()[0].astype(float) for name, array in camera.outputs.items()}]
    for _ in range(until):
        sim.step()
        frames.append({name: array.numpy()[0].astype(float) for name, array in camera.outputs.items()})
    return frames


@pytest.mark.parametrize("samples", [1, 2])
def test_motion_blur_is_the_mean_over_the_window(samples):
    sharp = moving_ball(0.0, samples=1, rate=100.0)
    blurred = moving_ball(0.05, samples=samples)
    for step in range(5):  # the first frame collects from step 1 to 5: until then the one of the start is shown
        np.testing.assert_array_equal(blurred[step]["depth"], sharp[0]["depth"])
    mean = np.mean([frame["rgb"] for frame in sharp[1:6]], axis=0)
    if samples == 1:
        assert np.abs(blurred[5]["rgb"] - mean).max() <= 0.51
    else:  # five rays of random places stand for one
        assert np.abs(blurred[5]["rgb"] - mean).mean() < 0.1 * mean.mean()
    assert len(np.unique(blurred[5]["rgb"])) >= 5
    # depth is that of the end
    np.testing.assert_array_equal(blurred[5]["depth"], sharp[5]["depth"])
    np.testing.assert_array_equal(blurred[7]["rgb"], blurred[5]["rgb"])


def test_a_reset_shows_the_world_at_rest():
    sharp, blurred = moving_ball(0.0, until=0), moving_ball(0.05, until=0)
    np.testing.assert_array_equal(sharp[0]["rgb"], blurred[0]["rgb"])


def test_rays_are_cast_only_where_a_frame_is_due():
    frames = moving_ball(0.0, rate=25.0, until=8)
    changes = [step for step in range(1, 9) if not np.array_equal(frames[step]["rgb"], frames[step - 1]["rgb"])]
    assert changes == [4, 8]


@pytest.mark.parametrize("weights", [(1 / 3,) * 3, (0.5,) * 3, (1.0,) * 3, (-1.0, 0.0, 0.0)])
def test_grey_that_is_too_bright_or_negative_is_cut(weights):
    builder = sw.ModelBuilder()
    builder.add_body("c", mass=1.0, inertia=(1.0,) * 3)
    visuals = Visuals(builder)
    visuals.add_box(sw.WORLD, half=(0.1, 5.0, 5.0), pose=sw.pose((3.0, 0.0, 0.0)), color=(1.0, 1.0, 1.0))
    model = builder.finalize(1, "cpu")
    config = CameraConfig(width=4, height=4, outputs=("grey", "rgb"), grey_weights=weights)
    light = Lighting(suns=(Sun(direction=(-1.0, 0.0, 0.0)),), ambient=(0.0, 0.0, 0.0), shadows=False)
    camera = Camera(visuals.finalize(model), Mount(), config, lights=light)
    sw.Simulation(model, 0.01, sensors=[camera])
    rgb, grey = (camera.outputs[name].numpy()[0, 2, 2].astype(float).flatten() for name in ("rgb", "grey"))
    assert 60.0 < rgb.min() < rgb.max() < 255.0
    # three rounded levels, each with its weight
    assert grey[0] == pytest.approx(np.clip(np.dot(weights, rgb), 0.0, 255.0), abs=2.0)
