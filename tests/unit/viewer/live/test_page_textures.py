"""Textures on a page are where rays see them, and what the browser gets holds picture and coordinates."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.geometry.visual_mesh import VisualMesh, linear_from_srgb
from simwarp.sensors.cameras.appearance import CheckerTexture, ImageTexture, NoiseTexture, Texture
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.scene import Visuals
from simwarp.viewer import FreeCamera
from simwarp.viewer.live.batches import Batches
from simwarp.viewer.live.page_textures import skin_along

COLORS = ((0.1, 0.16, 0.05), (0.7, 0.5, 0.3))
RNG = np.random.default_rng(3)
IMAGE = RNG.integers(40, 215, (6, 9, 3)).astype(np.uint8).repeat(8, axis=0).repeat(8, axis=1)
"""Patches of eight pixels: most lie inside of one, where the nearest pixel is what lies between four."""
TEXTURES: list[Texture] = [
    CheckerTexture(colors=COLORS, metres=0.7), NoiseTexture(colors=COLORS, metres=1.5),
    ImageTexture(image=IMAGE, metres=(2.0, 3.0)),
]  # fmt: skip


def hills(texture: Texture | None = None, color: Any = (1.0, 1.0, 1.0)) -> tuple[sw.Simulation, Any]:
    """A level height field 6 m x 6 m with a texture, and a body above."""
    builder = sw.ModelBuilder()
    builder.add_body("anchor", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((3.0, 0.0, 9.0)))
    shape = builder.add_shape_height_field(sw.WORLD, np.zeros((13, 13), np.float32), size=(6.0, 6.0))
    visuals = Visuals(builder)
    visuals.show(shape, color=color, texture=-1 if texture is None else visuals.texture(texture))
    model = builder.finalize(1, "cpu")
    return sw.Simulation(model, 0.01), visuals.finalize(model)


def sampled(image: Any, uv: Any) -> Any:
    """Linear colours of the nearest pixels of a picture that repeats."""
    height, width, _ = image.shape
    column = np.floor((uv[:, 0] % 1.0) * width).astype(int) % width
    row = np.floor((1.0 - uv[:, 1] % 1.0) * height).astype(int) % height
    return linear_from_srgb(image[row, column] / 255.0)


@pytest.mark.parametrize("texture", TEXTURES, ids=lambda texture: type(texture).__name__)
def test_a_skin_is_what_rays_see(texture):
    simulation, scene = hills(texture)
    config = CameraConfig(width=64, height=64, samples=1, lens=Pinhole(fov=0.4), outputs=("rgb", "depth"))
    camera = FreeCamera(scene, [0], config)
    seen = camera.render(simulation.state, [look_at((0.1, 0.2, 6.0), (0.1, 0.2, 0.0))])[0].reshape(-1, 3)
    half = 6.0 * np.tan(0.2)
    across = half * ((np.arange(64) + 0.5) / 32.0 - 1.0)
    # straight down: the image's upper side is +x, its left side +y
    places = np.stack([0.1 - across[:, None] + np.zeros(64), 0.2 - across[None] + np.zeros((64, 1))], -1).reshape(-1, 2)
    skin = skin_along(texture, np.concatenate([places, np.zeros((len(places), 1))], axis=1))
    assert skin is not None
    mine, theirs = sampled(skin.image, skin.uv), linear_from_srgb(seen / 255.0)
    for channel in range(3):
        # the light is the same everywhere; edges of squares and pixels are sampled otherwise
        assert np.corrcoef(mine[:, channel], theirs[:, channel])[0, 1] > 0.9


def batch_of(scene: Any) -> Any:
    return next(batch for batch in Batches(scene, [0]).batches if len(batch.mesh.faces) > 1)


def test_a_height_field_has_the_picture_of_its_texture():
    _, scene = hills(TEXTURES[2])
    mesh = batch_of(scene).mesh
    np.testing.assert_array_equal(mesh.skin.image, IMAGE)
    np.testing.assert_allclose(mesh.skin.uv, mesh.vertices[:, :2] / (2.0, 3.0), atol=1e-6)
    assert batch_of(hills()[1]).mesh.skin is None


def test_a_mesh_has_the_picture_of_its_file():
    builder = sw.ModelBuilder()
    builder.add_body("anchor", mass=1.0, inertia=(1.0, 1.0, 1.0))
    visuals = Visuals(builder)
    uv = RNG.uniform(0.0, 1.0, (2, 3, 2)).astype(np.float32)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    road = VisualMesh(
        vertices=vertices, triangles=np.array([[0, 1, 2], [0, 2, 3]]), uv=uv, texture=np.zeros(2, np.int32),
        images=(IMAGE,),
    )  # fmt: skip
    visuals.add_mesh(sw.WORLD, road, name="road")
    mesh = batch_of(visuals.finalize(builder.finalize(1, "cpu"))).mesh
    np.testing.assert_array_equal(mesh.skin.image, IMAGE)
    np.testing.assert_array_equal(mesh.skin.uv[mesh.faces], uv)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], vertices[road.triangles])


def test_the_browser_gets_picture_coordinates_and_tint():
    trimesh = pytest.importorskip("trimesh")
    from simwarp.geometry.mesh_files import textured_mesh

    _, scene = hills(TEXTURES[2], color=(0.5, 0.25, 1.0))
    batch = batch_of(scene)
    made = textured_mesh(batch.mesh.vertices, batch.mesh.faces, batch.mesh.skin.uv, IMAGE, batch.key[4])
    file = io.BytesIO(trimesh.exchange.gltf.export_glb(trimesh.Scene(made)))
    (read,) = trimesh.load(file, file_type="glb").geometry.values()
    np.testing.assert_allclose(read.visual.uv, batch.mesh.skin.uv, atol=1e-6)
    np.testing.assert_array_equal(np.asarray(read.visual.material.baseColorTexture.convert("RGB")), IMAGE)
    np.testing.assert_allclose(read.visual.material.baseColorFactor[:3] / 255.0, (0.5, 0.25, 1.0), atol=0.01)


def test_a_plane_keeps_its_picture():
    builder = sw.ModelBuilder()
    builder.add_body("anchor", mass=1.0, inertia=(1.0, 1.0, 1.0))
    visuals = Visuals(builder)
    visuals.add_plane(texture=visuals.texture(ImageTexture(image=IMAGE, metres=(2.0, 2.0))), color=(0.5, 1.0, 1.0))
    (ground,) = Batches(visuals.finalize(builder.finalize(1, "cpu")), [0]).grounds
    assert ground.texture is not None
    assert ground.tint == (0.5, 1.0, 1.0)
