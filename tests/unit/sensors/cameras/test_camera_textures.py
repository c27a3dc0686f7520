"""Textures and colours of meshes: known texels, files of all formats, and files that say nothing useful."""

import dataclasses
from typing import Any

import numpy as np
import PIL.Image
import pytest
import trimesh
import warp as wp

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.geometry.mesh_files import load_visual_mesh
from simwarp.geometry.visual_mesh import VisualMesh, linear_from_srgb, srgb_from_linear
from simwarp.sensors.cameras.appearance import AppearanceList, CheckerTexture, ImageTexture, NoiseTexture
from simwarp.sensors.cameras.appearance_kernels import (
    AppearanceArrays,
    checker_share,
    image_color,
    noise_share,
)
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.scene import Visuals
from tests.unit.sensors.cameras.camera_scenes import DARK, empty_builder, take

FLAT = dataclasses.replace(DARK, ambient=1.0, ambient_below=1.0)
RED, GREEN, BLUE, GOLD = (250, 10, 20), (30, 240, 40), (50, 60, 230), (200, 180, 70)
PICTURE = np.array([[RED, GREEN], [BLUE, GOLD]], np.uint8)
QUAD = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
FACES = np.array([(0, 1, 2), (0, 2, 3)])
CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)


@wp.kernel
def sample_image(appearance: AppearanceArrays, uv: wp.array[wp.vec2], color_out: wp.array[wp.vec3]):
    """Colours of texture 0."""
    i = wp.tid()
    color_out[i] = image_color(0, uv[i], appearance)  # type: ignore[index]


@wp.kernel
def sample_shares(place: wp.array[wp.vec3], checker_out: wp.array[float], noise_out: wp.array[float]):
    """Shares of the second colour at (x, y), for a pixel of width z."""
    i = wp.tid()
    p = place[i]
    checker_out[i] = checker_share(p[0], p[1], p[2])  # type: ignore[index]
    noise_out[i] = noise_share(p[0], p[1], p[2])  # type: ignore[index]


def shares(places):
    """Checker and noise at (N, 3) places."""
    outs = [wp.zeros(len(places), dtype=float, device="cpu") for _ in range(2)]
    wp.launch(sample_shares, dim=len(places), inputs=[wp.array(places, dtype=wp.vec3, device="cpu")], outputs=outs,
              device="cpu")  # fmt: skip
    return [out.numpy() for out in outs]


def bilinear(image, uv):
    """The textbook: texel centres at half numbers, top row first, repeated."""
    height, width = image.shape[:2]
    linear = linear_from_srgb(image / 255.0)
    out = []
    for u, v in uv:
        x, y = (u % 1.0) * width - 0.5, (1.0 - v % 1.0) * height - 0.5
        i, j = int(np.floor(x)), int(np.floor(y))
        s, t = x - i, y - j
        a, b, c, d = (linear[(j + m) % height, (i + k) % width] for m in (0, 1) for k in (0, 1))
        out.append((1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d))
    return np.array(out)


def from_above(visuals, size=2, width=1.0, **options):
    """Linear colours of the square from (0, 0) to (width, width), by row from its largest y; pixels along x."""
    height = 10.0
    found = take(
        visuals, (0.5 * width, 0.5 * width, height), (0.5 * width, 0.5 * width, 0.0), lights=FLAT, width=size,
        height=size, lens=Pinhole(fov=2.0 * np.arctan(0.5 * width / height)), **options,
    )["rgb"]  # fmt: skip
    # the image's upper side is X and its left side Y
    return found[:, ::-1, :].swapaxes(1, 2) / 255.0


def with_mesh(mesh, **appearance):
    visuals = Visuals(empty_builder())
    visuals.add_mesh(sw.WORLD, mesh, **appearance)
    return visuals


def test_srgb_has_an_inverse():
    levels = np.arange(256) / 255.0
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(levels)), levels, atol=1e-12)
    assert linear_from_srgb(0.5) == pytest.approx(0.21404, abs=1e-5)  # IEC 61966-2-1


def test_images_are_sampled_bilinearly():
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (3, 5, 3), dtype=np.uint8)
    textures = AppearanceList()
    textures.add(ImageTexture(image=image))
    uv = rng.uniform(-2.0, 3.0, (200, 2))
    out = wp.zeros(200, dtype=wp.vec3, device="cpu")
    uv32 = uv.astype(np.float32)
    wp.launch(sample_image, dim=200, inputs=[textures.tables([], "cpu"), wp.array(uv32, dtype=wp.vec2, device="cpu")],
              outputs=[out], device="cpu")  # fmt: skip
    # a place of up to 3 in float32 is off by 2e-7 of 5 texels; a texel's step is up to 1
    np.testing.assert_allclose(out.numpy(), bilinear(image, uv32.astype(float)), atol=5e-6)


def test_known_texels_of_a_mesh():
    mesh = VisualMesh(
        vertices=QUAD, triangles=FACES, uv=CORNERS[FACES], texture=np.zeros(2, np.int32), images=(PICTURE,)
    )
    found = from_above(with_mesh(mesh))[0]
    # pixel middles are texel middles: v is up, as y
    np.testing.assert_allclose(found, linear_from_srgb(PICTURE / 255.0), atol=0.6 / 255.0)


def test_an_image_lies_on_a_ground_by_its_metres():
    visuals = Visuals(empty_builder())
    visuals.add_plane(color=(1.0, 1.0, 1.0), texture=visuals.texture(ImageTexture(image=PICTURE, metres=(2.0, 1.0))))
    found = from_above(visuals, size=4, width=2.0)[0]
    linear = linear_from_srgb(PICTURE / 255.0)
    # 2 m wide: a texel is 1 m along x and 0.5 m along y; it repeats after 1 m along y
    np.testing.assert_allclose(found[:2, 1:3].mean(axis=1), linear.mean(axis=1), atol=1.2 / 255.0)
    np.testing.assert_allclose(found[:2], found[2:], atol=0.6 / 255.0)


def test_an_instance_multiplies_and_replaces_textures():
    mesh = VisualMesh(
        vertices=QUAD, triangles=FACES, uv=CORNERS[FACES], texture=np.zeros(2, np.int32), images=(PICTURE,)
    )
    visuals = with_mesh(mesh, color=(0.5, 1.0, 0.25))
    np.testing.assert_allclose(
        from_above(visuals)[0], np.array([0.5, 1.0, 0.25]) * linear_from_srgb(PICTURE / 255.0), atol=0.6 / 255.0
    )
    visuals = Visuals(empty_builder())
    other = visuals.texture(ImageTexture(image=PICTURE[::-1].copy()))
    visuals.add_mesh(sw.WORLD, mesh, texture=other)

    def change(scene, camera):
        scene.texture[:] = [[other], [-1]]

    both = from_above(visuals, worlds=2, change=change, scene_arrays=("texture",))
    np.testing.assert_allclose(both[1], linear_from_srgb(PICTURE / 255.0), atol=0.6 / 255.0)
    np.testing.assert_allclose(both[0], both[1][::-1], atol=1e-9)


def test_colors_of_corners_are_interpolated():
    color = np.zeros((2, 3, 3), np.float32)
    color[..., 0] = QUAD[FACES][..., 0]
    color[..., 1] = QUAD[FACES][..., 1]
    found = from_above(with_mesh(VisualMesh(vertices=QUAD, triangles=FACES, color=color)), size=4)[0]
    middle = (np.arange(4) + 0.5) / 4.0
    np.testing.assert_allclose(found[..., 0], np.broadcast_to(middle, (4, 4)), atol=0.6 / 255.0)
    np.testing.assert_allclose(found[..., 1], np.broadcast_to(middle[::-1, None], (4, 4)), atol=0.6 / 255.0)


def test_a_checker_has_squares_and_blends_far_away():
    rng = np.random.default_rng(2)
    places = np.concatenate([rng.uniform(-9.0, 9.0, (300, 2)), rng.uniform(0.05, 3.0, (300, 1))], axis=1)
    found = shares(places.astype(np.float32))[0]
    fine = (np.arange(101) + 0.5) / 101.0 - 0.5
    for (x, y, width), share in zip(places, found, strict=True):
        odd = np.add.outer(np.floor(x + width * fine), np.floor(y + width * fine)) % 2
        assert share == pytest.approx(odd.mean(), abs=0.025)  # two sums of 101 points
    sharp = shares(np.array([(0.5, 0.5, 0.0), (1.5, 0.5, 0.0), (-0.5, 0.5, 0.0), (-0.5, -0.5, 0.0)], np.float32))[0]
    assert sharp.tolist() == [0.0, 1.0, 1.0, 0.0]


def test_a_checkered_ground():
    visuals = Visuals(empty_builder())
    colors = ((0.8, 0.8, 0.8), (0.2, 0.1, 0.0))
    visuals.add_plane(color=(1, 1, 1), texture=visuals.texture(CheckerTexture(colors=colors, metres=0.5)))
    found = from_above(visuals)[0]
    wanted = np.array([[colors[1], colors[0]], [colors[0], colors[1]]])
    np.testing.assert_allclose(found, wanted, atol=0.6 / 255.0)


def test_noise_is_smooth_and_between_its_colors():
    line = np.stack([np.linspace(-20.0, 20.0, 20001), np.full(20001, 0.3), np.full(20001, 1e-3)], axis=1)
    values = shares(line.astype(np.float32))[1]
    assert 0.0 <= values.min() < 0.3
    assert 0.7 < values.max() <= 1.0
    # four octaves of slope at most 1.5 each, in steps of 2 mm
    assert np.abs(np.diff(values)).max() < 4 * 1.5 * 0.002
    assert abs(values.mean() - 0.5) < 0.1
    far = shares(np.concatenate([line[:, :2], np.full((20001, 1), 2.0)], axis=1).astype(np.float32))[1]
    assert (far == 0.5).all()
    visuals = Visuals(empty_builder())
    ground = NoiseTexture(colors=((0.0, 0.0, 0.0), (1.0, 0.5, 0.25)), metres=0.2)
    visuals.add_plane(color=(1, 1, 1), texture=visuals.texture(ground))
    found = from_above(visuals, size=8)[0]
    assert found[..., 0].std() > 0.05
    np.testing.assert_allclose(found[..., 1], 0.5 * found[..., 0], atol=1.0 / 255.0)


# ---- files -----------------------------------------------------------------------------------------------------------


def textured_obj(folder, image="picture.png", coordinates=True, library=True):
    """A quad in two materials: the first triangle has a picture, the second is plain."""
    faces = ("f 1/1 2/2 3/3", "f 1/1 3/3 4/4") if coordinates else ("f 1 2 3", "f 1 3 4")
    lines = ["mtllib quad.mtl", *("v {} {} {}".format(*p) for p in QUAD)]
    lines += ["vt {} {}".format(*p) for p in CORNERS] if coordinates else []
    lines += ["usemtl painted", faces[0], "usemtl plain", faces[1]]
    (folder / "quad.obj").write_text("\n".join(lines) + "\n")
    if library:
        (folder / "quad.mtl").write_text(
            f"newmtl painted\nKd 0.1 0.1 0.1\nmap_Kd {image}\nnewmtl plain\nKd 0.2 0.4 0.6\n"
        )
    return folder / "quad.obj"


def test_an_obj_file_with_a_texture_and_a_plain_material(tmp_path):
    PIL.Image.fromarray(PICTURE).save(tmp_path / "picture.png")
    found = from_above(with_mesh(textured_obj(tmp_path)))[0]
    linear = linear_from_srgb(PICTURE / 255.0)
    # the diagonal from (0, 0) to (1, 1): below it the picture, above it the plain colour
    np.testing.assert_allclose(found[1, 1], linear[1, 1], atol=0.6 / 255.0)
    np.testing.assert_allclose(found[0, 0], linear_from_srgb([0.2, 0.4, 0.6]), atol=1.2 / 255.0)


@pytest.mark.parametrize("suffix", ["obj", "glb", "ply"])
def test_vertex_colors_of_files(tmp_path, suffix):
    levels = np.array([RED, GREEN, BLUE, GOLD], np.uint8)
    mesh = trimesh.Trimesh(QUAD, FACES, process=False, vertex_colors=np.c_[levels, np.full(4, 255)])
    mesh.export(tmp_path / f"quad.{suffix}")
    visual = load_visual_mesh(tmp_path / f"quad.{suffix}")
    assert visual.color is not None
    place = {tuple(p): index for index, p in enumerate(QUAD)}
    wanted = np.array([[levels[place[tuple(np.round(p))]] for p in visual.vertices[face]] for face in visual.triangles])
    # GLB stores linear light, the others sRGB
    expected = wanted / 255.0 if suffix == "glb" else linear_from_srgb(wanted / 255.0)
    np.testing.assert_allclose(visual.color, expected, atol=0.005)


def test_face_colors_of_an_stl_file(tmp_path):
    mesh = trimesh.Trimesh(QUAD, FACES, process=False, face_colors=[(255, 0, 0, 255), (0, 0, 255, 255)])
    mesh.export(tmp_path / "quad.ply")
    visual = load_visual_mesh(tmp_path / "quad.ply")
    assert visual.color is not None
    assert sorted(map(tuple, visual.color[:, 0].tolist())) == [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)]
    trimesh.Trimesh(QUAD, FACES, process=False).export(tmp_path / "quad.stl")
    plain = load_visual_mesh(tmp_path / "quad.stl")
    assert plain.uv is None
    assert len(plain.triangles) == 2


def test_a_glb_file_with_a_texture(tmp_path):
    visual = trimesh.visual.TextureVisuals(
        uv=CORNERS,
        material=trimesh.visual.material.PBRMaterial(
            baseColorTexture=PIL.Image.fromarray(PICTURE), baseColorFactor=[255, 128, 255, 255]
        ),
    )
    trimesh.Trimesh(QUAD, FACES, visual=visual, process=False).export(tmp_path / "quad.glb")
    found = from_above(with_mesh(tmp_path / "quad.glb"))[0]
    factor = np.array([1.0, 128 / 255, 1.0])  # linear, as glTF says
    np.testing.assert_allclose(found, factor * linear_from_srgb(PICTURE / 255.0), atol=1.2 / 255.0)


def test_parts_of_a_scene_keep_their_looks(tmp_path):
    scene = trimesh.Scene()
    for x, color in ((0.0, (255, 0, 0, 255)), (1.0, (0, 255, 0, 255))):
        part = trimesh.Trimesh(QUAD, FACES, process=False, vertex_colors=np.tile(color, (4, 1)))
        scene.add_geometry(part, transform=trimesh.transformations.translation_matrix((x, 0.0, 0.0)))
    scene.export(tmp_path / "two.glb")
    found = from_above(with_mesh(tmp_path / "two.glb"), size=2, width=2.0)[0]
    np.testing.assert_allclose(found[1, :], [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], atol=0.01)


def test_errors_of_textures(tmp_path):
    for image in ("absent.png", "broken.png"):
        (tmp_path / "broken.png").write_text("no picture")
        with pytest.raises(ModelError, match=rf"'quad.obj': the texture '.*{image}' must be a readable image"):
            load_visual_mesh(textured_obj(tmp_path, image))
    PIL.Image.fromarray(PICTURE).save(tmp_path / "picture.png")
    with pytest.raises(ModelError, match=r"'quad.obj' has a texture, whose mesh must have texture coordinates \(UVs\)"):
        load_visual_mesh(textured_obj(tmp_path, coordinates=False))
    (tmp_path / "bad.glb").write_bytes(b"glTF nonsense")
    with pytest.raises(ModelError, match="must be readable"):
        load_visual_mesh(tmp_path / "bad.glb")
    with pytest.raises(ModelError, match="there must be a file"):
        load_visual_mesh(tmp_path / "absent.obj")


def test_errors_of_what_users_give():
    box = trimesh.creation.box()
    visuals = Visuals(empty_builder())
    picture = visuals.texture(ImageTexture(image=PICTURE))
    visuals.add_mesh(sw.WORLD, box.vertices, box.faces, name="crate", texture=picture)
    with pytest.raises(ModelError, match=r"'crate': an image needs texture coordinates \(UVs\)"):
        visuals.finalize(visuals.builder.finalize(1, "cpu"))
    visuals = Visuals(empty_builder())
    visuals.add_plane(name="ground", texture=3)
    with pytest.raises(ModelError, match="'ground': texture must be -1 or below 0, got 3"):
        visuals.finalize(visuals.builder.finalize(1, "cpu"))
    wrong: list[tuple[Any, str]] = [
        (ImageTexture(image=PICTURE.astype(float)), r"must be \(height, width, 3\) uint8 or a path"),
        (ImageTexture(image="absent.png"), "must be a readable image"),
        (ImageTexture(image=PICTURE, metres=0.0), "metres must be positive, got"),
        (CheckerTexture(colors=((1, 1, 1), (2, 0, 0))), r"colors\[1\]\[0\] must be in \[0, 1\], got 2"),
        (CheckerTexture(metres=-1.0), "metres must be positive, got"),
        ("wood", "must be an ImageTexture, CheckerTexture or NoiseTexture"),
    ]
    for texture, message in wrong:
        with pytest.raises(ModelError, match=message):
            Visuals(empty_builder()).texture(texture)
    with pytest.raises(ModelError, match=r"uv must have shape \(2, 3, 2\)"):
        VisualMesh(vertices=QUAD, triangles=FACES, uv=CORNERS)


def test_one_texture_has_one_number_and_one_copy():
    textures = AppearanceList()
    picture, checker = ImageTexture(image=PICTURE), CheckerTexture()
    assert [textures.add(t) for t in (picture, checker, picture)] == [0, 1, 0]
    assert textures.tables([], "cpu").texel.size == 4
