"""Hills and textures of grounds: heights where they are said to be, for rays too; level discs; seams that fit."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.scenery import TEXTURES, flattened, ground_texture, height_at, hills, steepness
from simwarp.sensors.cameras.appearance import ImageTexture
from simwarp.sensors.scene import Visuals
from tests.unit.sensors.test_ray_casting import Cast, built

SIZE = (120.0, 80.0)


@pytest.mark.parametrize("amplitude", [0.5, 2.5, 5.0])
@pytest.mark.parametrize("seed", range(4))
def test_hills_are_as_high_as_asked_and_can_be_driven(seed, amplitude):
    heights = hills(seed, size=SIZE, amplitude=amplitude)
    assert heights.shape == (81, 121)
    assert heights.dtype == np.float32
    assert np.abs(heights).max() == pytest.approx(amplitude, rel=1e-6)
    assert heights.mean() == pytest.approx(0.0, abs=1e-5 * amplitude)
    # hills on both sides of the mean, none of them a needle
    assert np.ptp(heights) > 1.2 * amplitude
    slope = steepness(heights, SIZE)
    assert slope == pytest.approx(np.arctan(amplitude * np.tan(steepness(hills(seed, size=SIZE, amplitude=1.0), SIZE))),
                                  rel=1e-3)  # fmt: skip
    # no wave is shorter than 35 m: the slope of a sine of that amplitude and length is the most there can be
    assert np.tan(slope) < 2.0 * np.pi * amplitude / 35.0
    assert np.tan(slope) > 2.0 * np.pi * amplitude / 180.0
    # and no crest is sharper than that of such a sine
    bend = np.abs(np.diff(heights.astype(float), 2, axis=1)).max()
    assert bend < amplitude * (2.0 * np.pi / 35.0) ** 2
    assert np.array_equal(heights, hills(seed, size=SIZE, amplitude=amplitude))
    assert np.abs(heights - hills(seed + 10, size=SIZE, amplitude=amplitude)).max() > 0.3 * amplitude


def test_flat_ground_and_finer_grids():
    assert (hills(1, amplitude=0.0) == 0.0).all()
    coarse, fine = (hills(3, size=SIZE, spacing=spacing) for spacing in (1.0, 0.5))
    assert fine.shape == (161, 241)
    # the same hills, but for their mean and their highest node
    assert np.corrcoef(coarse.reshape(-1), fine[::2, ::2].reshape(-1))[0, 1] > 0.9999


@pytest.mark.parametrize("seed", range(4))
def test_start_and_goal_are_level(seed):
    heights = hills(seed, size=SIZE, amplitude=4.0)
    discs = np.array([(-40.0, 10.0, 4.0), (30.0, -20.0, 6.0), (15.0, -20.0, 4.0)])  # slopes of the last two overlap
    ground = flattened(heights, SIZE, discs)
    assert ground.dtype == np.float32
    x, y = np.meshgrid(np.linspace(-60.0, 60.0, 121), np.linspace(-40.0, 40.0, 81))
    away = np.hypot(x[..., None] - discs[:, 0], y[..., None] - discs[:, 1])
    for index, (a, b, radius) in enumerate(discs):
        level = height_at(heights, SIZE, [(a, b)])[0]
        np.testing.assert_allclose(ground[away[..., index] <= radius], level, atol=1e-5)
    # as it was where no disc's slope reaches
    far = (away > discs[:, 2] + 12.0).all(axis=-1)
    assert np.array_equal(ground[far], heights[far])
    apart = flattened(heights, SIZE, discs[:2])
    assert np.tan(steepness(apart, SIZE)) < 2.2 * np.tan(steepness(heights, SIZE))
    assert np.abs(ground).max() <= 4.0 + 1e-6
    assert np.array_equal(flattened(heights, SIZE, np.zeros((0, 3))), heights)


def test_heights_are_those_of_the_nodes_and_of_the_triangles_between():
    heights = hills(2, size=SIZE, amplitude=3.0)
    x, y = np.meshgrid(np.linspace(-60.0, 60.0, 121), np.linspace(-40.0, 40.0, 81))
    nodes = np.stack([x.reshape(-1), y.reshape(-1)], axis=1)
    np.testing.assert_allclose(height_at(heights, SIZE, nodes), heights.reshape(-1), atol=1e-6)
    plane = 0.25 * x[:5, :5] - 0.5 * y[:5, :5] + 1.0
    inner = np.random.default_rng(0).uniform(-2.0, 2.0, (200, 2))
    expected = 0.25 * (inner[:, 0] - 58.0) - 0.5 * (inner[:, 1] - 38.0) + 1.0
    np.testing.assert_allclose(height_at(plane, (4.0, 4.0), inner), expected, atol=1e-9)
    # beyond the border: as at the border
    assert height_at(heights, SIZE, [(1e3, 1e3)])[0] == pytest.approx(heights[-1, -1])


def test_rays_meet_the_ground_at_its_height():
    heights = flattened(hills(5, size=SIZE, amplitude=4.0), SIZE, [(0.0, 0.0, 5.0)])
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.499, 0.499, (4000, 2)) * SIZE
    start = np.concatenate([points, np.full((4000, 1), 50.0)], axis=1)

    def field(builder, visuals):
        return builder and builder.add_shape_height_field(sw.WORLD, heights, size=SIZE) + 1

    rays = Cast(*built(field), start, np.broadcast_to([0.0, 0.0, -1.0], start.shape).astype(np.float32))
    assert (rays.instance[0] == 0).all()
    # single precision of 50 m
    np.testing.assert_allclose(50.0 - rays.t[0], height_at(heights, SIZE, points), atol=2e-5)


@pytest.mark.parametrize("kind", TEXTURES)
def test_textures_repeat_without_seams(kind):
    image = ground_texture(kind, 3, pixels=128)
    assert image.shape == (128, 128, 3)
    assert image.dtype == np.uint8
    assert np.array_equal(image, ground_texture(kind, 3, pixels=128))
    assert not np.array_equal(image, ground_texture(kind, 4, pixels=128))
    # the step across the seam is as any other step of a pixel; tiles and slabs have joints, one of them at the seam
    values = image.astype(float).mean(axis=2)
    for axis in (0, 1):
        steps = np.abs(np.diff(values, axis=axis)).mean(axis=1 - axis)
        seam = np.abs(np.take(values, 0, axis=axis) - np.take(values, -1, axis=axis)).mean()
        assert seam <= (1.05 * steps.max() if kind in ("tiles", "concrete") else 2.0 * steps.mean())
    assert 0.3 < TEXTURES[kind] < 20.0
    # neither black nor burnt out, and not one colour
    assert 30.0 < values.mean() < 252.0
    assert values.std() > 2.0


def test_textures_are_told_apart_and_taken_by_scenes():
    means = np.array([ground_texture(kind).mean(axis=(0, 1)) for kind in ("grass", "dirt", "snow", "sand", "asphalt")])
    apart = np.linalg.norm(means[:, None] - means[None], axis=2) + 1e3 * np.eye(5)
    assert apart.min() > 40.0
    assert means[0].argmax() == 1  # grass is green
    visuals = Visuals(sw.ModelBuilder())
    assert visuals.texture(ImageTexture(image=ground_texture("dirt", pixels=64), metres=TEXTURES["dirt"])) == 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hills(size=(0.0, 10.0)), "hills: size[0] must be positive, got 0.0; give metres"),
        (lambda: hills(amplitude=-1.0), "hills: amplitude must be zero or positive, got -1.0; give metres; 0 is flat"),
        (lambda: hills(spacing=20.0), "hills: 2 spacing <= shortest <= longest wavelength must hold, got spacing=20"),
        (lambda: flattened(np.zeros((5, 5)), (4.0, 4.0), [(0.0, 0.0, 1.0)], blend=0.0), "flattened: blend must be"),
        (lambda: ground_texture("lava"), "ground_texture: kind must be one of grass, dirt, gravel, asphalt,"),
        (lambda: ground_texture(pixels=8), "ground_texture: pixels must be at least 32, got 8; give pixels"),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_one_line(make, message):
    with pytest.raises(ModelError) as caught:
        make()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
