"""Statistics of features, against NumPy on all of the numbers at once."""

import numpy as np
import pytest

from simwarp.train.datasets.episode_statistics import QUANTILES, merged, of_images, of_rows

RANDOM = np.random.default_rng(5)


def test_rows_have_those_of_numpy_for_each_component():
    values = RANDOM.normal(3.0, 2.0, (70, 4)).astype(np.float32)
    found = of_rows(values)
    exact = values.astype(np.float64)
    assert np.array_equal(found["min"], exact.min(axis=0))
    assert np.array_equal(found["max"], exact.max(axis=0))
    assert np.allclose(found["mean"], exact.mean(axis=0), rtol=1e-14)
    assert np.allclose(found["std"], exact.std(axis=0), rtol=1e-14)
    for name, level in QUANTILES.items():
        assert np.allclose(found[name], np.quantile(exact, level, axis=0), rtol=1e-14)
    assert found["count"].tolist() == [70]


@pytest.mark.parametrize(
    ("shape", "components"), [((5,), 1), ((5, 1), 1), ((5, 3), 3), ((5, 4, 3), 3), ((5, 2, 3, 1), 1)]
)
def test_they_are_of_the_last_axis(shape, components):
    found = of_rows(RANDOM.integers(0, 2, shape).astype(bool))
    assert all(value.shape == ((1,) if name == "count" else (components,)) for name, value in found.items())
    assert found["count"].tolist() == [5]


def test_images_have_those_of_numpy_for_each_channel_in_parts_of_one():
    images = RANDOM.integers(0, 256, (60, 9, 7, 3)).astype(np.uint8)
    images[..., 2] //= 4
    found = of_images(images)
    flat = images.reshape(-1, 3) / 255.0
    for name, exact in (("min", flat.min(axis=0)), ("max", flat.max(axis=0))):
        assert np.array_equal(found[name].ravel(), exact), name
    assert np.allclose(found["mean"].ravel(), flat.mean(axis=0), rtol=1e-12)
    assert np.allclose(found["std"].ravel(), flat.std(axis=0), rtol=1e-9)  # E[x²] - E[x]²: rounding is 1e-16 of 0.3
    for name, level in QUANTILES.items():
        exact = np.quantile(flat, level, axis=0, method="inverted_cdf")
        assert np.array_equal(found[name].ravel(), exact), name
    assert found["mean"].shape == (3, 1, 1)
    assert found["count"].tolist() == [60]


def test_of_a_long_episode_a_sample_of_frames_counts_and_of_large_images_some_pixels():
    images = np.zeros((500, 4, 4, 3), np.uint8)
    assert of_images(images)["count"].tolist() == [105]  # 500 to the power of 0.75, as LeRobot has it
    large = np.zeros((1, 600, 800, 3), np.uint8)
    large[:, 1::2] = 255  # every fifth row and column is kept: 0, 5, 10, ... of 600
    assert of_images(large)["mean"].ravel()[0] == pytest.approx(0.5)


def test_those_of_two_episodes_are_those_of_all_rows():
    first, second = RANDOM.normal(0.0, 1.0, (30, 2)), RANDOM.normal(5.0, 3.0, (90, 2))
    found, exact = merged(of_rows(first), of_rows(second)), of_rows(np.concatenate([first, second]))
    for name in ("min", "max", "mean", "std", "count"):
        assert np.allclose(found[name], exact[name], rtol=1e-12), name
    # Quantiles of both cannot be known from those of each; LeRobot takes their mean, weighted by rows
    expected = 0.25 * np.median(first, axis=0) + 0.75 * np.median(second, axis=0)
    assert np.allclose(found["q50"], expected, rtol=1e-12)
