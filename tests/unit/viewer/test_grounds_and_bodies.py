"""Marks every metre where a pinhole sees them, quieter grounds, a camera that turns, boxes of bodies without shapes."""

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ShapeType
from simwarp.sensors.cameras.camera import look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.scene import Visuals
from simwarp.viewer import FollowCamera, Shot, paint
from simwarp.viewer.default_visuals import add_bodies, inertia_box
from simwarp.viewer.ground_marks import MARK

SIZE = (480, 320)


def world(yaw=0.0, texture=None):
    """A box 0.2 m above the ground that is turned about the vertical: simulation and scene."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    place = sw.pose((0.0, 0.0, 0.3), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))
    body = builder.add_body("box", mass=1.0, inertia=(0.1,) * 3, pose=place)
    builder.add_shape_box(body, half=(0.1, 0.1, 0.1))
    visuals = Visuals(builder)
    if texture is None:
        visuals.add_plane(name="ground")
    else:
        visuals.add_plane(name="ground", texture=visuals.texture(texture))
    visuals.add_box(sw.WORLD, half=(0.2, 0.2, 0.5), pose=sw.pose((1.0, 0.0, 0.5)), name="post")
    paint(visuals, tile=0.5)
    model = builder.finalize(1, "cpu")
    return sw.Simulation(model, 0.01), visuals.finalize(model)


def pixel(point, eye, target, fov):
    """Column and row at which a pinhole sees a point."""
    camera = look_at(eye, target)
    seen = (np.asarray(point) - camera.position) @ matrix_of(camera.rotation)
    column, row, depth = Pinhole(fov=fov).intrinsics(*SIZE) @ (-seen[1], -seen[2], seen[0])
    return column / depth, row / depth


def test_marks_are_at_whole_metres_and_behind_what_stands():
    sim, scene = world()
    eye, target = (-1.2, -4.0, 3.0), (0.3, 0.0, 0.0)
    shot = Shot(body=sw.WORLD, target=target, eye=tuple(np.subtract(eye, target)), fov=0.9)
    picture = FollowCamera(sim, scene, shot, width=SIZE[0], height=SIZE[1], marks=True).render(0.0)[0]
    white = np.abs(picture.astype(int) - MARK).max(axis=-1) < 60
    for place in ((-1.0, 0.0), (0.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        column, row = pixel((*place, 0.0), eye, target, 0.9)
        assert white[int(row), int(column)], place
        column, row = pixel((place[0] + 0.5, place[1] - 0.5, 0.0), eye, target, 0.9)
        assert not white[int(row) - 1 : int(row) + 2, int(column) - 1 : int(column) + 2].any(), place
    # the mark at (1, 0) is below the post
    column, row = pixel((1.0, 0.0, 0.5), eye, target, 0.9)
    assert not white[int(row), int(column)]


def test_a_quieter_ground_has_less_pattern_and_what_stands_on_it_is_as_before():
    sim, scene = world(texture=sw.sensors.CheckerTexture(colors=((0.05,) * 3, (0.6,) * 3), metres=0.1))
    shot = Shot(body=sw.WORLD, target=(0.0, 0.0, 0.2), eye=(-1.0, -2.0, 1.5))
    loud, quiet = (
        FollowCamera(sim, scene, shot, width=SIZE[0], height=SIZE[1], quiet=wanted).render(0.0)[0].astype(float)
        for wanted in (False, True)
    )
    left = np.s_[120:240, 10:120]  # nothing stands there
    assert quiet[left].std() < 0.6 * loud[left].std()
    assert quiet[left].mean() == pytest.approx(loud[left].mean(), rel=0.05)  # a blurred pattern has its mean
    middle = np.s_[158:162, 238:242]  # on the box
    np.testing.assert_array_equal(quiet[middle], loud[middle])


@pytest.mark.parametrize("yaw", [0.0, 0.5 * math.pi, -2.5])
def test_a_camera_from_behind_turns_with_the_body(yaw):
    sim, scene = world(yaw)
    shot = Shot(body="box", target=(0.5, 0.0, 0.0), eye=(-2.0, 0.0, 1.0), turns=True)
    studio = FollowCamera(sim, scene, shot, width=16, height=12, samples=1)
    studio.render(0.0)
    place = studio.camera._views.start.numpy()[0] + studio.camera._tables.origin.numpy()[0]
    expected = (-1.5 * math.cos(yaw), -1.5 * math.sin(yaw), 1.3)
    np.testing.assert_allclose(place, expected, atol=1e-5)  # float32 quaternion


def test_a_camera_that_does_not_follow_stays():
    sim, scene = world()
    shot = Shot(body="box", target=(0.0, 0.0, 0.0), eye=(-2.0, 0.0, 1.0), follows=False)
    studio = FollowCamera(sim, scene, shot, width=16, height=12, samples=1)
    for time, x in ((0.0, 0.0), (0.1, 0.2), (0.2, 0.4)):
        places = sim.state.body_x.numpy()
        places[0, 0, 0] = x
        sim.state.body_x.assign(places)
        studio.render(time)
        place = studio.camera._views.start.numpy()[0] + studio.camera._tables.origin.numpy()[0]
        np.testing.assert_allclose(place, [-2.0, 0.0, 1.3], atol=1e-5)  # float32 about another origin


@pytest.mark.parametrize("half", [(0.3, 0.2, 0.1), (0.5, 0.5, 0.02), (0.1, 0.7, 0.1)])
def test_the_box_of_an_inertia_has_it(half):
    rng = np.random.default_rng(4)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    mass, squares = 2.5, np.square(half)
    moments = mass / 3.0 * (squares.sum() - squares)
    found, turn = inertia_box(mass, rotation @ np.diag(moments) @ rotation.T)
    assert np.sort(found) == pytest.approx(np.sort(half), rel=1e-9)  # float64
    back = matrix_of(turn)
    assert np.linalg.det(back) == pytest.approx(1.0)
    again = back @ np.diag(mass / 3.0 * (np.square(found).sum() - np.square(found))) @ back.T
    np.testing.assert_allclose(again, rotation @ np.diag(moments) @ rotation.T, atol=1e-12)


def test_bodies_without_shapes_are_boxes_with_rods_to_their_joints():
    builder = sw.ModelBuilder()
    upper = builder.add_body("upper", mass=1.0, inertia=(0.02, 0.02, 0.001), pose=sw.pose((0.0, 0.0, 1.0)))
    lower = builder.add_body("lower", mass=1.0, inertia=(0.02, 0.02, 0.001), pose=sw.pose((0.0, 0.0, 0.4)))
    builder.add_joint_revolute("top", sw.WORLD, upper, anchor=(0.0, 0.0, 1.3), axis=(0.0, 1.0, 0.0))
    builder.add_joint_revolute("middle", upper, lower, anchor=(0.0, 0.0, 0.7), axis=(0.0, 1.0, 0.0))
    visuals = Visuals(builder)
    add_bodies(visuals)
    boxes = [instance for instance in visuals.instances if instance.kind == ShapeType.BOX]
    assert [box.body for box in boxes] == [upper, lower]
    # 1.5 (0.041 - 2 * 0.001) = 0.2419²
    assert max(boxes[0].size) == pytest.approx(math.sqrt(1.5 * 0.039))
    rods = [instance for instance in visuals.instances if instance.kind == ShapeType.CAPSULE]
    ends = sorted((rod.body, round(2.0 * float(rod.pose.position[2]), 6)) for rod in rods)
    assert ends == [(upper, -0.3), (upper, 0.3), (lower, 0.3)]
