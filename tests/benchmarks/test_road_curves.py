"""The weighting of vertical vibration in the figures of roads."""

import numpy as np
import pytest

from benchmarks.road_curves import rms, weighted, weighting

TABLE = {0.5: 0.418, 1.0: 0.482, 2.0: 0.531, 4.0: 0.967, 6.3: 1.054, 8.0: 1.036, 16.0: 0.768, 31.5: 0.405, 80.0: 0.132}
"""Frequency [Hz] -> W_k, table 3 of ISO 2631-1:1997."""


def test_the_weighting_is_that_of_the_table():
    # the table has three digits, at the exact middle frequencies of third octaves: 31.5 stands for 10^1.5
    for frequency, value in TABLE.items():
        exact = 10.0 ** (round(10.0 * np.log10(frequency)) / 10.0)
        assert abs(weighting(exact)) == pytest.approx(value, abs=6e-4), frequency


def test_a_sine_is_weighted_by_its_frequency():
    t = 1e-3 * np.arange(20_000)
    wave = np.sin(2.0 * np.pi * 8.0 * t)
    assert rms(weighted(9.81 + wave, 1e-3)) == pytest.approx(abs(weighting(8.0)) * np.sqrt(0.5), rel=1e-9)
