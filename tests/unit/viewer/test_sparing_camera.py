"""A camera that spares rays: what it looks at closely is what a free camera sees, the rest is nearly so."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ShapeType
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.scene import Scene, Visuals
from simwarp.viewer import FreeCamera, paint
from simwarp.viewer.sparing_camera import CONTRAST, SEEN, SparingCamera

CONFIG = CameraConfig(width=160, height=120, samples=2, lens=Pinhole(fov=0.8), far=200.0, outputs=SEEN)
POSES = [look_at((-3.0, 1.0, 1.5), (0.5, 0.2, 0.4)), look_at((4.0, -2.0, 2.0), (0.0, 0.0, 0.5))]


def things() -> tuple[sw.Simulation, Scene]:
    """Balls, a box and a bar above a ground of squares, under a sun that throws shadows."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    for index, y in enumerate((0.0, 1.0)):
        ball = builder.add_body(f"ball_{index}", mass=1.0, inertia=(0.1,) * 3, pose=sw.pose((0.0, y, 0.5)))
        builder.add_shape_sphere(ball, radius=0.2)
    builder.add_shape_plane(name="ground")
    visuals = Visuals(builder)
    visuals.add_box(sw.WORLD, half=(0.3, 0.2, 0.6), pose=sw.pose((2.0, -0.8, 0.6)), color=(0.8, 0.2, 0.1))
    visuals.add_box(sw.WORLD, half=(1.0, 0.02, 0.02), pose=sw.pose((0.5, 0.5, 0.9)), color=(0.1, 0.2, 0.8))
    paint(visuals)
    model = builder.finalize(2, "cpu")
    return sw.Simulation(model, 0.01), visuals.finalize(model)


@pytest.fixture(scope="module")
def pictures() -> tuple[FreeCamera, SparingCamera]:
    simulation, scene = things()
    free, sparing = FreeCamera(scene, [0, 1], CONFIG), SparingCamera(scene, [0, 1], CONFIG)
    for camera in (free, sparing):
        camera.render(simulation.state, POSES)
    return free, sparing


def test_it_spares_most_rays(pictures):
    assert 0.0 < pictures[1].close < 0.4


def test_images_are_nearly_those_of_all_rays(pictures):
    """A square that is not looked at closely differs by less than half the contrast from what lies between its
    neighbours; between two such squares the textures' own change comes on top, at most as much again. On average two
    bytes, which nobody sees: in images so small, the floor's squares have edges in a third of all pixels.
    """
    full, spared = (camera.outputs["rgb"].numpy().astype(int) for camera in pictures)
    apart = np.abs(full - spared).max(axis=-1)
    assert apart.max() <= 2 * CONTRAST
    assert apart.mean() < 2.0
    assert (apart == 0).mean() > 0.5


def test_edges_are_those_of_all_rays(pictures):
    """Wherever the instance changes from a pixel to its neighbours, all outputs are equal bit by bit."""
    free, sparing = pictures
    things = free.outputs["instance"].numpy()[..., 0]
    edge = np.zeros(things.shape, bool)
    edge[:, :, 1:] |= things[:, :, 1:] != things[:, :, :-1]
    edge[:, 1:] |= things[:, 1:] != things[:, :-1]
    same = np.all([
        (free.outputs[name].numpy() == sparing.outputs[name].numpy()).all(axis=-1)[edge] for name in SEEN
    ], axis=0)  # fmt: skip
    assert edge.sum() > 300
    # a thing that is thinner than a square may be missed where its end lies between two rays
    assert same.mean() > 0.98


def test_depths_lie_on_planes(pictures):
    """1 / depth is linear along a plane, so that what lies between is exact but for float32."""
    free, sparing = (camera.outputs["depth"].numpy()[..., 0] for camera in pictures)
    things = pictures[0].outputs["instance"].numpy()[..., 0]
    plane = next(k for k, each in enumerate(pictures[0].scene.visuals.instances) if each.kind == ShapeType.PLANE)
    inside = (things == plane) & (free < 20.0)
    inside[:, [0, -1]] = inside[:, :, [0, -1]] = False  # nothing lies beyond the image's border
    assert inside.sum() > 5000
    assert (np.abs(sparing - free)[inside] / free[inside]).max() < 1e-4


def test_what_it_suits():
    _, scene = things()
    assert SparingCamera.suits(scene, CONFIG)
    assert not SparingCamera.suits(scene, CameraConfig(width=161, height=120, samples=2, outputs=SEEN))
    assert not SparingCamera.suits(scene, CameraConfig(width=160, height=120, samples=1, outputs=SEEN))
    assert not SparingCamera.suits(scene, CameraConfig(width=160, height=120, samples=2, outputs=("rgb",)))
