"""The weighting of vertical vibration in the figures of roads."""

import numpy as np
import pytest

from benchmarks.road_curves import rms, weighted, weighting

TABLE = {
    0.5: 0.418, 0.63: 0.459, 0.8: 0.477, 1.0: 0.482, 1.25: 0.484, 1.6: 0.494, 2.0: 0.531, 2.5: 0.631, 3.15: 0.804,
    4.0: 0.967, 5.0: 1.039, 6.3: 1.054, 8.0: 1.036, 10.0: 0.988, 12.5: 0.902, 16.0: 0.768, 20.0: 0.636, 25.0: 0.513,
    31.5: 0.405, 40.0: 0.314, 50.0: 0.246, 63.0: 0.186, 80.0: 0.132,
}  # fmt: skip
"""Frequency [Hz] -> W_k, table 3 of ISO 2631-1:1997."""


def test_the_weighting_is_that_of_the_table():
    for frequency, value in TABLE.items():
        # the table has three digits, some of them cut and not rounded
        assert abs(weighting(frequency)) == pytest.approx(value, abs=1e-3), frequency


def test_a_sine_is_weighted_by_its_frequency():
    t = 1e-3 * np.arange(20_000)
    wave = np.sin(2.0 * np.pi * 8.0 * t)
    assert rms(weighted(9.81 + wave, 1e-3)) == pytest.approx(abs(weighting(8.0)) * np.sqrt(0.5), rel=1e-9)
