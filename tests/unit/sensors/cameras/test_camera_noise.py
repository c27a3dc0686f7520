"""Noise of pictures: its moments, its independence, and that worlds and seeds own theirs."""

import dataclasses

import numpy as np
import pytest

from simwarp.core.types import ModelError
from simwarp.sensors.cameras.camera import CameraConfig
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lights import Lighting, Sun
from tests.unit.sensors.cameras.camera_scenes import DARK, take, wall_visuals

GREY = dataclasses.replace(DARK, ambient=0.5, ambient_below=0.5)
WHITE = (1.0, 1.0, 1.0)


def noisy(worlds=2, color=WHITE, width=64, height=64, lights=GREY, **options):
    """Values 0 to 1 of a wall of light 0.5 times its colour; (W, height, width, 3)."""
    imaging = {name: options.pop(name) for name in list(options) if name in Imaging.__dataclass_fields__}
    made = Imaging(gamma=1.0, **imaging)
    return take(
        wall_visuals(color=color), worlds=worlds, lights=lights, width=width, height=height, imaging=made, **options
    )["rgb"].astype(float) / 255.0  # fmt: skip


def held(values, mean, sigma):
    """Mean and deviation of independent values, to 4.5 of their own deviations."""
    count = values.size
    assert abs(values.mean() - mean) < 4.5 * sigma / np.sqrt(count)
    total = np.sqrt(sigma**2 + 1.0 / (12.0 * 255.0**2))  # rounding to levels
    assert abs(values.std() - total) < 4.5 * total / np.sqrt(2.0 * count)


def test_constant_noise_has_its_mean_and_deviation_per_channel():
    values = noisy(noise_mean=(0.02, 0.0, -0.03), noise_sigma=(0.02, 0.05, 0.08))
    for channel, (mean, sigma) in enumerate(((0.02, 0.02), (0.0, 0.05), (-0.03, 0.08))):
        held(values[..., channel], 0.5 + mean, sigma)


def test_noise_is_normal():
    values = (noisy(worlds=4, noise_sigma=0.05) - 0.5) / 0.05
    # skewness and kurtosis of N normal numbers: deviations sqrt(6 / N), sqrt(24 / N)
    assert abs((values**3).mean()) < 4.5 * np.sqrt(15.0 / values.size)
    assert abs((values**4).mean() - 3.0) < 4.5 * np.sqrt(96.0 / values.size) + 0.01


@pytest.mark.parametrize(("slope", "intercept"), [(0.02, 0.0), (0.0, 0.003), (0.01, 0.001)])
def test_pixel_dependent_noise_grows_with_the_root_of_the_value(slope, intercept):
    values = noisy(color=(1.0, 0.5, 0.3), noise_slope=slope, noise_intercept=intercept)
    for channel, value in enumerate((0.5, 0.25, 0.15)):
        sigma = np.sqrt(slope * value + intercept)
        # what is cut at 0: below 1e-3 of all here, except where sigma is a third of the value
        if value > 3.2 * sigma:
            held(values[..., channel], value, sigma)


def test_both_kinds_add_their_variances():
    held(noisy(noise_sigma=0.04, noise_slope=0.004, noise_intercept=0.001), 0.5, np.sqrt(0.0016 + 0.002 + 0.001))


def test_channels_pixels_and_worlds_are_independent():
    values = noisy(worlds=2, noise_sigma=0.05) - 0.5
    limit = 4.5 / np.sqrt(64 * 64)

    def correlation(a, b):
        return (a * b).mean() / (a.std() * b.std())

    first, second = values
    for other in (first[..., 1], first[..., 2], np.roll(first[..., 0], 1, 0), np.roll(first[..., 0], 1, 1)):
        assert abs(correlation(first[..., 0], other)) < limit
    assert abs(correlation(first, second)) < limit
    assert abs(correlation(first, noisy(worlds=1, noise_sigma=0.05, seed=1)[0] - 0.5)) < limit
    assert abs(correlation(first, noisy(worlds=1, noise_sigma=0.05, name="other")[0] - 0.5)) < limit


def test_noise_is_a_function_of_seed_and_world():
    one = noisy(worlds=1, noise_sigma=0.1, width=8, height=8)
    np.testing.assert_array_equal(one[0], noisy(worlds=3, noise_sigma=0.1, width=8, height=8)[0])


def test_noise_per_world():
    def change(scene, camera):
        camera.image_processing.noise_sigma[:] = [[0.0] * 3, [0.02] * 3, [0.1] * 3]
        camera.image_processing.exposure[:] = [1.0, 1.0, 0.5]

    values = noisy(worlds=3, change=change, per_world=("noise_sigma", "exposure"))
    assert values[0].std() == 0.0
    held(values[1], 0.5, 0.02)
    held(values[2], 0.25, 0.1 * 0.99)


def test_lights_per_world():
    def change(scene, camera):
        camera.lights.sun_color[:] = [[WHITE], [(0.5, 0.0, 0.0)]]

    lights = dataclasses.replace(DARK, suns=(Sun(direction=(-1.0, 0.0, 0.0)),))
    values = noisy(worlds=2, change=change, per_world=("sun_color",), lights=lights, width=2, height=2)
    np.testing.assert_allclose(values[:, 0, 0], np.array([WHITE, (0.5, 0.0, 0.0)]), atol=0.51 / 255.0)


def test_colors_per_world():
    def change(scene, camera):
        scene.color[:] = [[WHITE], [(0.0, 0.2, 0.4)]]

    values = noisy(worlds=2, change=change, scene_arrays=("color",), width=2, height=2)
    np.testing.assert_allclose(values[:, 0, 0], np.array([(0.5, 0.5, 0.5), (0.0, 0.1, 0.2)]), atol=0.51 / 255.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: noisy(noise_sigma=-0.1), r"noise_sigma must be zero or positive, got -0\.1"),
        (lambda: noisy(vignetting=1.5), r"vignetting must be in \[0, 1\], got 1\.5"),
        (lambda: noisy(exposure=float("nan")), "exposure must be a finite number"),
        (
            lambda: take(wall_visuals(), imaging=Imaging(gamma=0.0)),
            r"gamma must be positive, got 0\.0; give 1 for a linear response",
        ),
        (lambda: take(wall_visuals(), imaging=None), "imaging must be an Imaging"),
        (
            lambda: take(wall_visuals(), outputs=("rgb", "deep")),
            r"outputs\[1\] must be one of 'rgb', 'grey', 'depth', 'range'",
        ),
        (lambda: take(wall_visuals(), outputs="rgb"), "outputs must be a list, got 'rgb'"),
        (lambda: take(wall_visuals(), width=0), "width must be at least 1, got 0"),
        (lambda: take(wall_visuals(), samples=17), "samples must be from 1 to 16, got 17"),
        (lambda: take(wall_visuals(), near=2.0, far=1.0), "0 <= near < far must hold"),
        (lambda: take(wall_visuals(), per_world=("gain",)), "unknown parameter 'gain'; known: exposure"),
        (lambda: take(wall_visuals(), per_world="exposure"), "per_world must be a list of names, got 'exposure'"),
        (lambda: take(wall_visuals(), per_world=5), "per_world must be a list of names, got 5; leave it out"),
        (lambda: take(wall_visuals(), (0, 0, 0), (0, 0, 0)), "eye and target must be apart"),
        (lambda: take(wall_visuals(), lights=Lighting(fog_density=-1.0)), "fog_density must be zero or positive"),
        (lambda: take(wall_visuals(), lights=Lighting(ambient=-1.0)), "ambient must be >= 0"),
        (lambda: take(wall_visuals(), lights=Lighting(suns=(Sun(direction=(0, 0, 0)),))), "direction must"),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(ModelError, match=message):
        make()


def test_the_configuration_has_usable_defaults():
    assert take(wall_visuals(), width=CameraConfig().width, height=4)["rgb"].shape == (1, 4, 80, 3)
