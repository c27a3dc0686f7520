"""Axes of plots: poles are cut off and told, whole curves stay whole, and noise is not magnified."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simwarp.vehicle.results.plot_style import clip_poles, sane_range, spanned

U = np.linspace(-1.0, 1.0, 41)


def panel():
    figure = Figure(figsize=(4.0, 3.0))
    FigureCanvasAgg(figure)
    return figure.subplots()


@pytest.mark.parametrize("power", [1, 2, 3, 4])
@pytest.mark.parametrize("offset", [-50.0, 0.0, 3.0])
def test_polynomials_stay_whole(power, offset):
    values = offset + 7.0 * U**power
    assert sane_range(values) == (values.min(), values.max())


@pytest.mark.parametrize("end", [1.005, 1.02, -1.01])
@pytest.mark.parametrize("scale", [1.0, -30.0])
def test_poles_are_left_out(end, scale):
    values = scale / (end - U)
    low, high = sane_range(values)
    assert high - low < 0.5 * np.ptp(values)
    # the middle half is always there
    quartiles = np.quantile(values, (0.25, 0.75))
    assert low <= quartiles[0]
    assert high >= quartiles[1]


def test_of_nothing_and_of_one_value():
    assert sane_range([]) == (0.0, 0.0)
    assert sane_range([np.nan, np.inf]) == (0.0, 0.0)
    assert sane_range([3.0, np.nan]) == (3.0, 3.0)
    values = np.full(9, 2.0)
    values[0] = 5.0  # all others alike: no width to judge by
    assert sane_range(values) == (2.0, 5.0)


def test_a_cut_is_told_and_every_curve_keeps_its_own_range():
    axes, pole, other = panel(), 1.0 / (1.005 - U), 300.0 * U
    axes.plot(U, pole)
    axes.plot(U, other)
    clip_poles(axes, [pole, other], 1.0)
    assert axes.get_ylim()[0] < other.min()  # a curve of another size cuts nothing off
    assert len(axes.texts) == 0
    axes = panel()
    axes.plot(U, pole)
    clip_poles(axes, [pole], 1.0)
    high = axes.get_ylim()[1]
    (text,) = axes.texts
    assert text.get_text() == f"{(pole > high).sum()} of 41 points cut off, to 200"


def test_noise_is_not_magnified():
    axes = panel()
    clip_poles(axes, [5.0 + 1e-14 * U], 0.02)
    low, high = axes.get_ylim()
    assert high - low == pytest.approx(0.02)
    assert low < 5.0 < high


def test_a_nearly_constant_curve_far_from_zero_does_not_lie_on_the_frame():
    for sign in (1.0, -1.0):
        axes = panel()
        axes.plot(U, sign * (15.0 + 1e-3 * U))
        spanned(axes, 0.05)
        low, high = sorted(sign * end for end in axes.get_ylim())
        assert low == -0.05
        assert high > 15.0 * 1.04
