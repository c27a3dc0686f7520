"""Roads of ISO 8608: spectra by Welch's method, coherence of both tracks, the same road from the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import coherence, welch

from simwarp.vehicle.rigs import RoadClass, displacement_spectrum, road_profile
from simwarp.vehicle.roads.road_profiles import BAND, track_correlation
from simwarp.vehicle.spec.vehicle_spec import SpecError

LENGTH, SPACING, SEGMENT = 20_000.0, 0.1, 4096


@pytest.mark.parametrize("road", list(RoadClass))
def test_the_spectrum_is_that_of_the_class(road):
    """Bands of an octave hold some hundred lines of 97 windows: their mean strays by 1 to 3 %."""
    profile = road_profile(road, LENGTH, spacing=SPACING, seed=3)
    n, density = welch(profile.height, fs=1.0 / SPACING, nperseg=SEGMENT, axis=1)
    for low in 0.03 * 2.0 ** np.arange(6):
        band = (n >= low) & (n < 2.0 * low)
        wanted = displacement_spectrum(n[band], road)
        assert (density[:, band] / wanted).mean() == pytest.approx(1.0, abs=0.1)
    beyond = n > 1.2 * BAND[1]
    assert density[:, beyond].max() < 1e-3 * displacement_spectrum(1.2 * BAND[1], road)


def test_classes_grow_by_four():
    found = [float(displacement_spectrum(0.1, road)) for road in RoadClass]
    assert found == pytest.approx([16e-6 * 4.0**step for step in range(8)])
    assert float(displacement_spectrum(1.0, RoadClass.A)) == pytest.approx(16e-8)


def test_tracks_agree_in_long_waves():
    profile = road_profile(RoadClass.B, LENGTH, spacing=SPACING, track=1.8, seed=1)
    n, found = coherence(*profile.height, fs=1.0 / SPACING, nperseg=SEGMENT)
    for low, high in ((0.02, 0.05), (0.1, 0.2), (0.3, 0.6)):
        band = (n > low) & (n < high)
        # of estimates of 97 windows, of which half overlap: within 0.05; that of none is 0.015
        assert found[band].mean() == pytest.approx((track_correlation(n[band], 1.8) ** 2).mean(), abs=0.05)
    assert track_correlation([0.0, 10.0], 1.8) == pytest.approx([1.0, 0.0], abs=1e-12)


def test_a_profile_repeats_itself_and_its_seed():
    first, second, other = (road_profile(RoadClass.C, 200.0, seed=seed) for seed in (7, 7, 8))
    assert (first.height == second.height).all()
    assert (first.height != other.height).any()
    assert first.at([12.3], 0) == pytest.approx(first.at([12.3 + first.length], 0), abs=1e-9)
    places = first.spacing * np.arange(10)
    assert first.at(places, 1) == pytest.approx(first.height[1, :10], abs=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"length": 50.0}, "length: must be at least the longest wave"),
        ({"length": 200.0, "spacing": 0.5}, "spacing: must"),
        ({"length": np.inf}, "length: must be at least the longest wave of 90.9 m and finite, got inf"),
        ({"length": 200.0, "track": np.nan}, "track: must be >= 0 m and finite"),
        ({"length": 200.0, "seed": -1}, "seed: must be 0 or more, got -1"),
    ],
)
def test_what_misses_waves_is_one_line(options, message):
    with pytest.raises(SpecError, match=message):
        road_profile(RoadClass.A, **options)
