"""What many runs say together, on made-up numbers: quantiles, correlations, margins, passes, the order of the worst."""

import math

import numpy as np
import pytest

from simwarp.study.monte_carlo import StudyResult, StudyRow, Worst
from simwarp.study.study_figures import Figure, margin
from simwarp.study.study_summary import rank_correlation, summary_of
from simwarp.vehicle.assessment.verdict import at_least, at_most

FIGURE = Figure("roll", "peak roll", "deg")
RANDOM = np.random.default_rng(5)


def test_quantiles_of_a_monotone_figure_are_the_keys_own_mapped():
    keys = RANDOM.uniform(1.0, 2.0, (101, 1))
    found = summary_of(FIGURE, 1.0, np.exp(keys[:, 0]), keys)
    # of 101 values 5, 50 and 95 % are values themselves
    for part, value in found.quantiles.items():
        assert value == pytest.approx(math.exp(np.sort(keys[:, 0])[part]), rel=1e-12)
    assert found.correlations == pytest.approx((1.0,))
    falling = summary_of(FIGURE, 1.0, -np.exp(keys[:, 0]), keys)
    assert falling.correlations == pytest.approx((-1.0,))


def test_a_key_without_influence_is_not_correlated():
    keys = RANDOM.uniform(size=(2000, 2))
    found = summary_of(FIGURE, 1.0, keys[:, 0] ** 3, keys)
    assert found.correlations[0] == pytest.approx(1.0)
    # twice the bound of 95 %
    assert abs(found.correlations[1]) < 2.0 * found.chance
    assert found.chance == pytest.approx(1.96 / 1999**0.5)


def test_ties_share_their_ranks():
    # ranks 1.5 1.5 3 4 over 1 2 3 4: the correlation of ranks, by hand 4.5 / sqrt(4.5 * 5)
    assert rank_correlation(np.array([0.0, 0.0, 5.0, 9.0]), np.arange(4.0)) == pytest.approx(4.5 / 22.5**0.5)


def test_what_does_not_differ_has_no_correlation():
    assert math.isnan(rank_correlation(np.ones(9), np.arange(9.0)))
    assert math.isnan(rank_correlation(np.arange(2.0), np.arange(2.0)))


def test_runs_that_miss_a_figure_are_counted_and_left_out():
    values = np.array([1.0, math.nan, 3.0, 2.0])
    found = summary_of(FIGURE, 2.0, values, np.arange(4.0)[:, None])
    assert (found.count, found.missing, found.mean, found.deviation) == (3, 1, 2.0, 1.0)
    nothing = summary_of(FIGURE, 2.0, np.full(4, math.nan), np.arange(4.0)[:, None])
    assert math.isnan(nothing.mean)
    assert all(math.isnan(value) for value in nothing.quantiles.values())


def test_the_margin_is_the_least_distance_to_a_limit():
    lanes = [at_most("lane 1", -0.2, 0.0, "m"), at_most("lane 2", -0.05, 0.0, "m"), at_least("exit", 61.0, 60.9, "m")]
    assert margin(lanes, on_course=True) == pytest.approx(0.05)
    lanes[1] = at_most("lane 2", 0.07, 0.0, "m")
    assert margin(lanes, on_course=True) == pytest.approx(-0.07)
    lanes[2] = at_least("exit", 50.0, 60.9, "m")
    assert margin(lanes, on_course=True) == pytest.approx(-10.9)
    assert math.isnan(margin([*lanes, at_most("lane 3", math.nan, 0.0, "m")], on_course=True))
    shares = [at_most("yaw rate", 30.0, 35.0, "%"), at_least("aside", 2.0, 1.83, "m")]
    assert margin(shares, on_course=False) == pytest.approx(0.17 / 1.83)


def row(world, value, passed=True, trouble=""):
    return StudyRow(
        world=world, values=(float(world),), figures={} if trouble else {"margin": value}, passed=passed,
        trouble=trouble,
    )  # fmt: skip


ROWS = (
    row(0, 0.3),
    row(1, -0.1, False),
    row(2, 0.0, False, "diverged at 1.00 s"),
    row(3, math.nan, False),
    row(4, 0.1),
)
RESULT = StudyResult(keys=("k",), figures=(Figure("margin", "margin", "m"),), nominal={}, rows=ROWS)


def test_the_worst_are_the_diverged_then_those_without_the_figure():
    assert [each.world for each in RESULT.worst(Worst(key="margin", least=True), 9)] == [2, 3, 1, 4, 0]
    assert [each.world for each in RESULT.worst(Worst(key="margin", least=False), 3)] == [2, 3, 0]


def test_a_world_that_diverged_has_not_passed_and_is_in_no_mean():
    passes = RESULT.passes()
    assert passes is not None
    good, of, (low, high) = passes
    assert (good, of) == (2, 5)
    assert low < 0.4 < high
    (found,) = RESULT.summaries()
    assert (found.count, found.missing) == (3, 1)
    assert found.mean == pytest.approx(0.1)


def test_rows_are_written_with_what_was_drawn(tmp_path):
    RESULT.write_rows(tmp_path / "rows.csv")
    lines = (tmp_path / "rows.csv").read_text().splitlines()
    assert lines[0] == "world,k,margin,passed,trouble"
    assert lines[1] == "0,0,0.3,1,"
    assert lines[3] == "2,2,nan,0,diverged at 1.00 s"
