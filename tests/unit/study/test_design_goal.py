"""Goals and bounds of a search: the highest speed passed, by made-up runs."""

import math

import pytest

from simwarp.study.design_goal import Bound, Goal, parse_bound, pass_speed
from simwarp.study.study_error import StudyError

SPEEDS = (10.0, 12.0, 14.0)


def runs(*margins, roll=(1.0, 1.0, 1.0)):
    return [{"margin": value, "peak_roll": lean} for value, lean in zip(margins, roll, strict=True)]


def passes(figures):
    return [each.get("margin", -1.0) >= 0.0 for each in figures]


def found(figures, bounds=()):
    return pass_speed(SPEEDS, figures, passes(figures), bounds)


def test_the_pass_speed_is_where_the_margin_is_used_up():
    result = found(runs(0.3, 0.1, -0.3))
    assert (result.highest, result.decisive) == (12.0, 1)
    assert result.between == pytest.approx(12.5)


def test_a_speed_above_one_that_failed_does_not_count():
    assert found(runs(0.2, -0.2, 0.4)).highest == 10.0
    assert found(runs(0.2, -0.2, 0.4)).between == pytest.approx(11.0)


def test_a_bound_counts_as_a_rule():
    bound = parse_bound("peak_roll<=2")
    figures = runs(0.3, 0.2, 0.1, roll=(1.0, 1.8, 2.6))
    result = found(figures, [bound])
    assert result.highest == 12.0
    # 10 % of the limit are left, 30 % are missing: a quarter of the way
    assert result.between == pytest.approx(12.5)
    assert found(figures).between == 14.0


def test_a_run_that_broke_down_ends_at_the_speed_before():
    assert found([*runs(0.3, 0.1, 0.0)[:2], {}]).between == 12.0


def test_designs_that_pass_nothing_are_in_order_below_the_first_speed():
    near, far = found(runs(-0.1, -0.2, -0.3)), found(runs(-0.6, -0.7, -0.8))
    assert math.isnan(near.highest)
    assert SPEEDS[0] > near.between > far.between >= SPEEDS[0] - 2.0
    assert found([{}, {}, {}]).between == SPEEDS[0] - 2.0


def test_all_passed_is_the_last_speed():
    assert found(runs(0.3, 0.2, 0.1)).between == SPEEDS[-1]


@pytest.mark.parametrize(
    ("text", "bound"),
    [("peak_roll<=2.5", Bound("peak_roll", 2.5, True)), (" margin >= 0", Bound("margin", 0.0, False))],
)
def test_bounds_are_read(text, bound):
    assert parse_bound(text) == bound
    assert parse_bound(bound.text) == bound


@pytest.mark.parametrize("text", ["peak_roll", "peak_roll<2", "<=2", "peak_roll<=x", "peak_roll<=5%", ""])
def test_other_bounds_are_refused(text):
    with pytest.raises(StudyError, match=r"^--subject-to: must be"):
        parse_bound(text)


def test_distances_are_shares_of_the_limit():
    assert Bound("a", 2.0, True).distance(1.5) == pytest.approx(0.25)
    assert Bound("a", -2.0, False).distance(-3.0) == pytest.approx(-0.5)
    assert Bound("a", 0.0, False).distance(0.3) == pytest.approx(0.3)


def test_better_is_greater_or_smaller():
    assert Goal("a", maximise=True).better(2.0, 1.0)
    assert Goal("a", maximise=False).better(1.0, 2.0)
