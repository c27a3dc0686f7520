"""Pace by the clock: waits, time that is lost, and lags."""

from __future__ import annotations

import pytest

from simwarp.ros2.real_time_pace import BEHIND, TOLERANCE, WINDOW, Pace


class Clock:
    """A clock that the test moves."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_steps_wait_for_the_clock(factor: float) -> None:
    clock = Clock()
    pace = Pace(factor, clock)
    begun = clock.now
    for step in range(1, 101):
        assert pace.wait() == pytest.approx(0.0, abs=1e-9)
        pace.step(0.02)
        wait = pace.wait()
        assert wait == pytest.approx(0.02 / factor, rel=1e-6)
        clock.now += wait
        assert clock.now - begun == pytest.approx(step * 0.02 / factor)
    assert pace.lost == 0.0
    assert pace.lag() is None


def test_a_short_delay_is_made_up_for_and_a_long_one_is_not() -> None:
    clock = Clock()
    pace = Pace(1.0, clock)
    clock.now += 0.8 * TOLERANCE
    pace.step(0.02)
    assert (pace.wait(), pace.lost) == (0.0, 0.0)
    for _ in range(3):
        pace.step(0.02)
    assert pace.wait() == pytest.approx(0.0, abs=1e-9)  # 0.08 s in a rush
    clock.now += 3.0
    pace.step(0.02)
    assert pace.lost == pytest.approx(2.98)
    assert pace.wait() == pytest.approx(0.0, abs=1e-9)
    pace.step(0.02)
    assert pace.wait() == pytest.approx(0.02)  # no rush


def test_a_slow_simulation_lags_once_a_window() -> None:
    clock = Clock()
    pace = Pace(2.0, clock)
    found = []
    while clock.now < 1000.0 + 2.0 * WINDOW + 0.5:
        pace.step(0.1)
        clock.now += 0.1  # real time, where twice of it is asked for
        reached = pace.lag()
        if reached is not None:
            found.append(reached)
    assert len(found) == 2
    assert found == pytest.approx([1.0, 1.0], rel=0.02)
    assert BEHIND * 2.0 > 1.0


def test_as_fast_as_it_goes_never_waits_and_never_lags() -> None:
    clock = Clock()
    pace = Pace(0.0, clock)
    for _ in range(100):
        pace.step(0.001)
        clock.now += 1.0
        assert pace.wait() == 0.0
    assert (pace.lost, pace.lag()) == (0.0, None)


def test_a_pause_is_no_lag() -> None:
    clock = Clock()
    pace = Pace(1.0, clock)
    pace.step(0.02)
    clock.now += 60.0
    pace.begin()
    assert pace.wait() == 0.0
    pace.step(0.02)
    assert pace.wait() == pytest.approx(0.02)
    assert (pace.lost, pace.lag()) == (0.0, None)
