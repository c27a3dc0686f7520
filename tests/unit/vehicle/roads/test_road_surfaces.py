"""Random roads of ISO 8608 as surfaces: spectra along lines, coherence across, the same place in every window; and
roads of bitmaps."""

import json

import numpy as np
import pytest
from PIL import Image
from scipy import signal, stats

from simwarp.vehicle import SpecError
from simwarp.vehicle.rigs import RoadClass, displacement_spectrum
from simwarp.vehicle.roads import RoadSurface, load_road, random_road
from simwarp.vehicle.roads.random_roads import NODES, SPACING
from simwarp.vehicle.roads.road_files import road_of
from simwarp.vehicle.roads.road_profiles import track_correlation

LENGTH = NODES[0] * SPACING[0]
LINES = 32
"""3.2 m apart, over the whole width of a period."""
SEGMENT = 2048
"""Samples of a segment of Welch's method: 102.4 m."""


@pytest.fixture(scope="module")
def lines():
    """Heights along 32 lines of one period of a road of class C."""
    rows = []
    for k in range(LINES):
        y = 3.2 * k
        rows.append(random_road("C", seed=4, x=(0.0, LENGTH - SPACING[0]), y=(y, y + 2.0)).heights)
    return np.array(rows, dtype=np.float64)


def octaves():
    """Edges of octaves within the band, where segments of 102.4 m have at least one frequency of their own."""
    return 0.04 * 2.0 ** np.arange(7)


def test_the_spectrum_lies_on_the_line_of_the_class(lines):
    n, density = signal.welch(lines[:, 0], 1.0 / SPACING[0], nperseg=SEGMENT, axis=1)
    ratio = density.mean(axis=0)[1:] / displacement_spectrum(n[1:], RoadClass.C)
    for low, high in zip(octaves()[:-1], octaves()[1:], strict=True):
        inside = (n[1:] >= low) & (n[1:] < high)
        # lines 3.2 m apart differ for waves shorter than 20 m; of halfway overlapping Hann segments about 0.53 of each
        # counts (Welch 1967), and a frequency shares 1.5 bins' with its neighbours
        segments = (2 * NODES[0] / SEGMENT - 1) * 0.53 * 1.5
        degrees = 2.0 * segments * LINES * max(1.0, inside.sum() / 1.5) * (0.25 if low < 0.1 else 1.0)
        bounds = stats.chi2.ppf([0.0005, 0.9995], degrees) / degrees
        assert bounds[0] < ratio[inside].mean() < bounds[1], (low, high)


def test_the_waviness_is_two(lines):
    n, density = signal.welch(lines[:, 0], 1.0 / SPACING[0], nperseg=SEGMENT, axis=1)
    inside = (n > 0.05) & (n < 2.5)
    # equal weight per octave
    slope = np.polyfit(np.log(n[inside]), np.log(density.mean(axis=0)[inside]), 1, w=n[inside] ** -0.5)[0]
    # a spread of 1 / sqrt(32 x 19 x 0.8) = 4.5 % per frequency, some 250 frequencies over 5.6 octaves: about 0.005
    assert slope == pytest.approx(-2.0, abs=0.02)


def test_tracks_agree_as_on_an_isotropic_surface(lines):
    """The cross-spectrum of two tracks over their density: x K1(x), x = 2 pi n b (Dodds and Robson)."""
    distance = 1.8
    left, right = lines[:, 0], lines[:, round(distance / SPACING[1])]
    fs = 1.0 / SPACING[0]
    n, cross = signal.csd(left, right, fs, nperseg=SEGMENT, axis=1)
    own = signal.welch(left, fs, nperseg=SEGMENT, axis=1)[1] + signal.welch(right, fs, nperseg=SEGMENT, axis=1)[1]
    found = 2.0 * cross.mean(axis=0).real / own.mean(axis=0)
    for low, high in zip(octaves()[:-1], octaves()[1:], strict=True):
        inside = (n >= low) & (n < high)
        wanted = track_correlation(n[inside], distance).mean()
        # the spread of a correlation of k pairs is (1 - r²) / sqrt(k), five of them; long waves are the same for
        # neighbouring lines
        pairs = 16.0 * LINES * inside.sum() * (0.25 if low < 0.1 else 1.0)
        assert found[inside].mean() == pytest.approx(wanted, abs=5.0 * max(1.0 - wanted**2, 0.02) / np.sqrt(pairs))


def test_a_place_has_one_height():
    wide = random_road("D", seed=7, x=(-20.0, 40.0), y=(-6.0, 6.0))
    narrow = random_road("D", seed=7, x=(3.0, 9.0), y=(-1.0, 2.5))
    first = np.round(np.subtract(narrow.origin, wide.origin) / SPACING).astype(int)
    rows, columns = narrow.heights.shape
    part = wide.heights[first[1] : first[1] + rows, first[0] : first[0] + columns]
    assert np.array_equal(part, narrow.heights)
    again = random_road("D", seed=7, x=(3.0 + LENGTH, 9.0 + LENGTH), y=(-1.0, 2.5))
    assert np.array_equal(again.heights, narrow.heights)
    assert not np.allclose(random_road("D", seed=8, x=(3.0, 9.0), y=(-1.0, 2.5)).heights, narrow.heights, atol=1e-3)


def test_classes_differ_by_a_factor():
    a, h = (random_road(road, seed=1, x=(0.0, 5.0), y=(0.0, 1.0)).heights for road in "AH")
    np.testing.assert_allclose(h, 2.0**7 * a, rtol=1e-6)


def write_road(folder, **changes):
    """A road of 4 m x 2 m with all bitmaps."""
    height = np.arange(15, dtype=np.uint16).reshape(3, 5) * 1000
    Image.fromarray(height).save(folder / "height.png")
    Image.fromarray(np.array([[90, 30]], np.uint8)).save(folder / "friction.png")
    np.save(folder / "soil.npy", np.array([[0], [1]]))
    content = {
        "origin": [-1.0, -1.0], "size": [4.0, 2.0], "height": {"pixels": "height.png", "scale": 1e-5, "offset": -0.05},
        "friction": {"pixels": "friction.png", "scale": 0.01}, "soil": "soil.npy", "soils": ["mid", "hard"],
    } | changes  # fmt: skip
    path = folder / "road.json"
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))
    return path


def test_a_road_of_bitmaps(tmp_path):
    road = load_road(write_road(tmp_path))
    # pictures lie as maps do: the last row of pixels is the first of y
    np.testing.assert_allclose(road.heights[0], -0.05 + 1e-5 * 1000 * np.arange(10, 15), rtol=1e-6)
    assert road.height_at([(-1.0, 1.0), (3.0, -1.0)]) == pytest.approx([-0.05, 0.09])
    assert road.friction is not None
    np.testing.assert_allclose(road.friction, [[0.9, 0.3]])
    options = road.friction_options(0.9)
    np.testing.assert_allclose(options["friction_map"], [[1.0, 1.0 / 3.0]])
    assert options["friction_cell"] == (2.0, 2.0)
    assert road.soil_options()["map_cell"] == (4.0, 1.0)
    assert road.soil_options()["soil_map"].tolist() == [[0], [1]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"height": None}, r"road\.json.*height: "),
        ({"height": {"pixels": "none.png"}}, r"road\.json: height: 'none\.png' cannot be read: .*; give a \.png"),
        ({"height": {"pixels": "friction.png"}}, r"height: must have at least 16 bits, got uint8"),
        (
            {"height": {"pixels": "color.png"}},
            r"height: must be one number per pixel, got uint8 of the shape \(2, 2, 3\)",
        ),
        ({"height": {"pixels": "row.npy"}}, r"height: must have at least 2 x 2 pixels .*, got 3 x 1"),
        ({"height": {"pixels": "pixel.png"}}, r"height: must have at least 2 x 2 pixels .*, got 1 x 1 in 'pixel\.png'"),
        ({"height": {"pixels": "none.npy"}}, r"height: must have at least 2 x 2 pixels .*, got 0 x 0 in 'none\.npy'"),
        ({"height": {"pixels": "gaps.npy"}}, r"height: must hold finite numbers, got others in 'gaps\.npy'; fill"),
        ({"height": {"pixels": "height.png", "scale": 1.0}}, r"heights: must be from -10000 to 10000 m, got 11000"),
        ({"height": {"pixels": "road.json"}}, r"height: 'road\.json' cannot be read: .*; give a \.png or \.npy file"),
        ({"height": {"pixels": ""}}, r"height: '' cannot be read: it is a folder"),
        ({"soil": "gaps.npy"}, r"soil: must hold finite numbers, got others in 'gaps\.npy'"),
        ({"friction": {"pixels": "gaps.npy"}}, r"friction: must hold finite numbers, got others in 'gaps\.npy'"),
        ({"friction": {"pixels": "friction.png"}}, r"road\.json: friction: must be .* 0\.0001 to 10, got 90"),
        ({"soils": ["mid"]}, r"road\.json: soil: must be .* indices below 1, got 1; name more soils"),
        ({"size": [4.0, 0.0]}, r"road\.json.*size.*must be"),
    ],
)
def test_bitmaps_that_are_none(tmp_path, changes, message):
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "color.png")
    np.save(tmp_path / "row.npy", np.zeros((1, 3)))
    np.save(tmp_path / "none.npy", np.zeros((0, 0)))
    np.save(tmp_path / "gaps.npy", np.array([[0.0, np.nan], [0.0, 0.0]]))
    Image.fromarray(np.full((1, 1), 7, np.uint16)).save(tmp_path / "pixel.png")
    with pytest.raises(SpecError, match=message) as caught:
        load_road(write_road(tmp_path, **changes))
    assert "\n" not in str(caught.value)


def test_a_bitmap_of_one_colour_is_level(tmp_path):
    Image.fromarray(np.full((3, 4), 700, np.uint16)).save(tmp_path / "grey.png")
    road = load_road(write_road(tmp_path, height={"pixels": "grey.png", "scale": 0.001}))
    assert np.unique(road.heights).tolist() == [np.float32(0.7)]


@pytest.mark.parametrize("content", ["", "[]", "{}", "{nope"])
def test_a_file_without_a_road_is_one_line(tmp_path, content):
    (tmp_path / "road.json").write_text(content)
    with pytest.raises(SpecError, match=r"^road\.json: ") as caught:
        load_road(tmp_path / "road.json")
    assert "\n" not in str(caught.value)


def test_heights_that_are_none():
    for heights, message in (
        (np.full((2, 2), np.nan), "heights: must be from -10000 to 10000 m, got nan; check the height's scale"),
        (np.full((2, 2), 2e4), "heights: must be from -10000 to 10000 m, got 20000.0"),
        (np.zeros((1, 2)), r"heights: must be \(rows, columns\) numbers, at least 2 x 2, got \(1, 2\)"),
    ):
        with pytest.raises(SpecError, match=message):
            RoadSurface(heights=heights.astype(np.float32), origin=(0.0, 0.0), size=(1.0, 1.0))


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("iso8608:K", "road: must be of a class from A to H, got 'K'"),
        ("iso8608", "road: must be iso8608:CLASS"),
        ("iso8608:", "road: must be of a class from A to H, got ''"),
        ("iso8608:C:1:2", "road: must be iso8608:CLASS"),
        ("", "road: must be iso8608:CLASS"),
        ("iso8608:C:1.5", "a seed that is a whole number"),
        ("iso8608:C:99999999999999999999", "a seed that is a whole number"),
        ("iso8608:C:-1", "a seed that is a whole number"),
        ("gravel", "road: must be iso8608:CLASS"),
        ("none.json", "none.json: cannot be read"),
    ],
)
def test_words_that_are_no_road(word, message):
    with pytest.raises(SpecError, match=message):
        road_of(word, ((-1.0, 1.0), (-1.0, 1.0)))


def test_windows_that_are_none():
    with pytest.raises(SpecError, match=r"x: must be two finite numbers that rise"):
        random_road("C", x=(1.0, 0.0))
    with pytest.raises(SpecError, match=r"window: must be of at most 4e\+07 nodes"):
        random_road("C", x=(0.0, 1e5), y=(0.0, 100.0))
    with pytest.raises(SpecError, match=r"seed: must be a whole number"):
        random_road("C", seed=-1)
