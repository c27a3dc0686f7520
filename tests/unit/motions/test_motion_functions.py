"""Motion functions against closed forms, SciPy and finite differences of their own values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import interpolate

import simwarp as sw
from simwarp.motions import (
    Constant,
    ConstantAcceleration,
    CubicSpline,
    MotionSequence,
    Polynomial345,
    Product,
    Ramp,
    Repeat,
    Samples,
    Sine,
    Smoothness,
    Sum,
)

TIMES = np.linspace(-0.7, 4.3, 1001) + 0.0012
"""None of them at a time where a function of these tests has a kink."""
EXACT = 1e-12
"""Of double precision, relative to values of some units: a dozen roundings."""

RISE = Polynomial345(rise=0.2, duration=1.0)
FALL = Constant(value=0.2) + Polynomial345(rise=-0.2, duration=0.5)
CAM = Repeat(part=MotionSequence(parts=[(RISE, 1.0), (Constant(value=0.2), 0.3), (FALL, 0.7)]), period=2.0)
KNOTS = (0.0, 0.5, 1.2, 2.0, 3.0)
HEIGHTS = (0.0, 1.0, -0.5, 0.4, 0.0)

SMOOTH = {
    "sine": Sine(amplitude=0.3, frequency=1.7, phase=0.4),
    "polynomial": RISE,
    "cam": CAM,
    "spline": CubicSpline(times=KNOTS, values=HEIGHTS),
    "product": Sine(amplitude=0.3, frequency=0.7) * (1.5 + Ramp(rate=0.4)) * 2.0,
    "sum": Sum(parts=[Ramp(rate=-0.4, start=0.1), RISE, Sine(amplitude=0.1, frequency=2.0)]),
    "nested": MotionSequence(parts=[(CAM, 2.0), (CAM * Sine(amplitude=1.0, frequency=1.0) * 0.0, 1.0), (CAM, 9.0)]),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_are_those_of_the_values(name):
    function, h = SMOOTH[name], 1e-4
    middle, before, after = (function.evaluate(TIMES + shift) for shift in (0.0, -h, h))
    rate = (after.value - before.value) / (2.0 * h)
    acceleration = (after.value - 2.0 * middle.value + before.value) / h**2
    # truncation h² f''' / 6 with f''' of 2000 per s³ at most, and at one step beside a kink of the third derivative;
    # rounding 4 eps / h² of the second difference
    assert np.abs(middle.rate - rate).max() < 1e-5
    assert np.abs(middle.acceleration - acceleration).max() < 0.05
    assert function.smoothness is Smoothness.ACCELERATION


def test_constants_ramps_and_sines_have_their_closed_forms():
    sine = Sine(amplitude=2.0, frequency=0.8, phase=0.3).evaluate(TIMES)
    omega = 2.0 * math.pi * 0.8
    assert np.allclose(sine.value, 2.0 * np.sin(omega * TIMES + 0.3), rtol=0.0, atol=EXACT)
    assert np.allclose(sine.rate, 2.0 * omega * np.cos(omega * TIMES + 0.3), rtol=0.0, atol=10 * EXACT)
    assert np.allclose(sine.acceleration, -2.0 * omega**2 * np.sin(omega * TIMES + 0.3), rtol=0.0, atol=100 * EXACT)
    ramp = Ramp(rate=-3.0, start=1.0).evaluate(TIMES)
    assert np.allclose(ramp.value, 1.0 - 3.0 * TIMES, rtol=0.0, atol=EXACT)
    assert (ramp.rate == -3.0).all()
    assert not ramp.acceleration.any()
    level = Constant(value=7.0).evaluate(1.5)
    assert (float(level.value), float(level.rate), float(level.acceleration)) == (7.0, 0.0, 0.0)
    assert level.value.shape == ()


def test_the_345_polynomial_has_its_peaks():
    h, duration = 0.25, 0.8
    found = Polynomial345(rise=h, duration=duration).evaluate(np.linspace(0.0, duration, 100_001))
    assert found.rate.max() == pytest.approx(1.875 * h / duration, rel=1e-9)
    # 10 / sqrt(3) at x = (3 ± sqrt(3)) / 6, between two of the times
    assert found.acceleration.max() == pytest.approx(5.7735 * h / duration**2, rel=1e-5)
    assert found.acceleration.min() == pytest.approx(-10.0 / math.sqrt(3.0) * h / duration**2, rel=1e-8)
    assert found.value[0] == 0.0
    assert found.value[-1] == pytest.approx(h, rel=EXACT)


@pytest.mark.parametrize(("starting", "stopping"), [(0.5, 0.5), (0.2, 0.3)])
def test_constant_acceleration_integrates_to_its_rise(starting, stopping):
    rise, duration = 1.6, 2.0
    function = ConstantAcceleration(rise=rise, duration=duration, speeding_up=starting, slowing_down=stopping)
    found = function.evaluate(TIMES)
    fastest = rise / (duration * (1.0 - 0.5 * (starting + stopping)))
    changes = (0.0, starting * duration, (1.0 - stopping) * duration, duration)
    levels = np.array([0.0, fastest / (starting * duration), 0.0, -fastest / (stopping * duration), 0.0])
    assert np.allclose(found.acceleration, levels[np.searchsorted(changes, TIMES)], rtol=0.0, atol=EXACT)
    coast = [starting * duration, (1.0 - stopping) * duration]
    assert np.allclose(found.rate, np.interp(TIMES, [0.0, *coast, duration], [0.0, fastest, fastest, 0.0]), atol=EXACT)
    assert function.evaluate([duration]).value == pytest.approx(rise, rel=EXACT)
    # trapezoids, which lose h² a / 8 at a corner
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (found.rate[1:] + found.rate[:-1]) * np.diff(TIMES))])
    assert np.allclose(found.value, sums, atol=1e-4)
    assert function.smoothness is Smoothness.RATE


@pytest.mark.parametrize(("ends", "smoothness"), [("natural", 3), ("clamped", 2), ("periodic", 2)])
def test_splines_are_scipys_and_straight_beyond(ends, smoothness):
    function = CubicSpline(times=KNOTS, values=HEIGHTS, ends=ends)
    reference = interpolate.CubicSpline(KNOTS, HEIGHTS, bc_type=ends, extrapolate=False)
    found, inside = function.evaluate(TIMES), np.abs(TIMES - 1.5) <= 1.5
    for order, values in enumerate(found):
        assert np.allclose(values[inside], reference(TIMES[inside], order), rtol=0.0, atol=1e-10)
    slope = float(reference(KNOTS[-1], 1))
    beyond = KNOTS[-1] < TIMES
    assert np.allclose(found.value[beyond], HEIGHTS[-1] + slope * (TIMES[beyond] - KNOTS[-1]), atol=1e-10)
    assert not found.acceleration[~inside].any()
    assert function.smoothness == smoothness


def test_samples_are_numpys_interpolation():
    values = np.array([0.0, 1.0, 0.5, -0.25])
    function = Samples(values=values, interval=0.5, start=0.25)
    found = function.evaluate(TIMES)
    assert np.allclose(found.value, np.interp(TIMES, 0.25 + 0.5 * np.arange(4), values), rtol=0.0, atol=EXACT)
    assert found.rate[TIMES < 0.2].any() == np.False_
    assert set(np.round(found.rate, 9)) == {0.0, 2.0, -1.0, -1.5}
    assert not found.acceleration.any()
    assert function.smoothness is Smoothness.VALUE


def test_a_sequence_hands_over_and_a_repetition_begins_again():
    sequence = MotionSequence(
        parts=[(Ramp(rate=2.0), 0.5), (Constant(value=1.0), 1.0), (Ramp(rate=-1.0, start=1.0), 1.0)]
    )
    t = TIMES
    expected = np.where(t < 0.5, 2.0 * t, np.where(t < 1.5, 1.0, 1.0 - (t - 1.5)))
    assert np.allclose(sequence.evaluate(t).value, expected, rtol=0.0, atol=EXACT)
    assert sequence.smoothness is Smoothness.VALUE
    turns = Repeat(part=sequence, period=2.5)
    wrapped = np.mod(t, 2.5)
    assert np.allclose(turns.evaluate(t).value, sequence.evaluate(wrapped).value, rtol=0.0, atol=EXACT)
    assert turns.smoothness is Smoothness.VALUE
    assert Repeat(part=sequence, period=2.4).smoothness is Smoothness.JUMPS
    assert Repeat(part=CubicSpline(times=KNOTS, values=HEIGHTS, ends="periodic"), period=3.0).smoothness == 2
    assert Repeat(part=Sine(amplitude=1.0, frequency=2.0), period=0.5).smoothness == 3


def test_every_number_may_differ_per_world():
    amplitude, period = np.array([0.1, 0.2, 0.3]), np.array([2.0, 2.5, 3.0])
    heights = np.array([HEIGHTS, np.multiply(2.0, HEIGHTS), np.zeros(5)])
    function = Repeat(
        part=MotionSequence(parts=[
            (Sine(amplitude=amplitude, frequency=1.0), [1.0, 1.5, 2.0]),
            (CubicSpline(times=KNOTS, values=heights), 9.0),
        ]) + Samples(values=heights[:, :3], interval=0.5),
        period=period,
    )  # fmt: skip
    found = function.evaluate(TIMES)
    assert found.value.shape == (3, len(TIMES))
    for world in range(3):
        alone = Repeat(
            part=MotionSequence(parts=[
                (Sine(amplitude=amplitude[world], frequency=1.0), 1.0 + 0.5 * world),
                (CubicSpline(times=KNOTS, values=heights[world]), 9.0),
            ]) + Samples(values=heights[world, :3], interval=0.5),
            period=period[world],
        ).evaluate(TIMES)  # fmt: skip
        for mine, other in zip(found, alone, strict=True):
            assert np.array_equal(mine[world], other)
    times = np.array([[0.1], [0.2], [0.3]])
    assert function.evaluate(times).value.shape == (3, 1)
    assert np.array_equal(function.evaluate(times).value[1], function.evaluate([0.2]).value[1])


WRONG = {
    "Sine: frequency must be a positive number": lambda: Sine(amplitude=1.0, frequency=-2.0),
    "Sine: amplitude must be a finite number": lambda: Sine(amplitude=math.nan, frequency=2.0),
    "Repeat: period must be a positive number": lambda: Repeat(part=RISE, period=[1.0, -1.0]),
    "Repeat: part must be a MotionFunction": lambda: Repeat(part=3.0, period=1.0),  # type: ignore[arg-type]
    "Polynomial345: duration must be a positive number": lambda: Polynomial345(rise=1.0, duration=0.0),
    "part 1 has -0.5": lambda: MotionSequence(parts=[(RISE, 1.0), (RISE, -0.5)]),
    "MotionSequence: parts must be a list of (function, duration)": lambda: MotionSequence(parts=[RISE]),  # type: ignore[list-item]
    "part 0 has none": lambda: MotionSequence(parts=[(1.0, 1.0)]),  # type: ignore[list-item]
    "CubicSpline: times must be two or more increasing times": lambda: CubicSpline(times=[0, 1, 1], values=[0, 1, 2]),
    "CubicSpline: values must be one for each of 3 times, got 2": lambda: CubicSpline(times=[0, 1, 2], values=[0, 1]),
    "the first and the last value must be equal": lambda: CubicSpline(times=[0, 1], values=[0, 1], ends="periodic"),
    "ends must be one of natural, clamped, periodic": lambda: CubicSpline(times=[0, 1], values=[0, 1], ends="open"),  # type: ignore[arg-type]
    "Samples: values must be two or more finite values": lambda: Samples(values=[1.0], interval=0.1),
    "speeding_up + slowing_down must be at most 1": lambda: ConstantAcceleration(rise=1, duration=1, speeding_up=0.6),
    "Sum: parts must be a list of motion functions": lambda: Sum(parts=[]),
    "Product: parts must be a list of motion functions": lambda: Product(parts=[1.0]),  # type: ignore[list-item]
    "evaluate: times must be finite": lambda: RISE.evaluate([0.0, math.inf]),
    "evaluate: times must be those of all worlds": lambda: Ramp(rate=[1.0, 2.0]).evaluate(np.zeros((3, 1))),
    "Sine.phase: must have one number, or 2": lambda: Sine(amplitude=[1, 2], frequency=1, phase=[1, 2, 3]).evaluate(0),
}


@pytest.mark.parametrize("message", WRONG)
def test_a_mistake_is_one_line_that_names_it(message):
    with pytest.raises(sw.ModelError) as caught:
        WRONG[message]()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
