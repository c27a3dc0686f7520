"""Levenberg and Marquardt on problems with closed forms, and what an uncertainty tells."""

import math

import numpy as np
import pytest

from simwarp.identify.identifiability import uncertainty_of
from simwarp.identify.levenberg_marquardt import LevenbergMarquardt, SearchSpace, cost_of, huber_weights

TIMES = np.linspace(0.0, 3.0, 60)
TRUTH = np.array([2.0, 0.5, 4.0])


def wave(point):
    """A decaying wave; the fourth number does nothing."""
    return point[0] * np.exp(-point[1] * TIMES) * np.cos(point[2] * TIMES)


def space(start, **changes):
    count = len(start)
    given = {
        "start": np.array(start), "low": np.zeros(count), "high": np.full(count, np.inf), "scale": np.full(count, 0.1),
        "difference": 0.05, "tolerance": 1e-6, "iterations": 60,
    }  # fmt: skip
    return SearchSpace(**{**given, **changes})


def solved(search, residuals):
    while not search.done:
        search.tell(np.array([residuals(point) for point in search.ask()]))
    return search


def test_a_curve_without_noise_gives_its_numbers_back():
    search = solved(LevenbergMarquardt(space([1.0, 1.0, 3.0, 1.0])), lambda point: wave(point) - wave(TRUTH))
    # differences of 2e-4 over numbers of one: the fit ends where the residuals vanish, whatever the Jacobian's error
    np.testing.assert_allclose(search.point[:3], TRUTH, rtol=1e-8)
    assert search.point[3] == 1.0


def test_a_linear_problem_is_solved_as_by_lstsq():
    rng = np.random.default_rng(3)
    matrix, right = rng.standard_normal((30, 4)), rng.standard_normal(30)
    wide = space(np.zeros(4), low=np.full(4, -np.inf))
    search = solved(LevenbergMarquardt(wide), lambda point: matrix @ point - right)
    np.testing.assert_allclose(search.point, np.linalg.lstsq(matrix, right, rcond=None)[0], atol=1e-6)
    # the Jacobian of a linear function by differences is exact but for rounding over steps of 2e-4
    np.testing.assert_allclose(search.jacobian, matrix, atol=1e-10)


def test_the_cost_never_rises_and_every_batch_has_one_size():
    search = LevenbergMarquardt(space([1.0, 1.0, 3.0]))
    last = math.inf
    while not search.done:
        points = search.ask()
        assert search.closing or len(points) == search.batch_size
        search.tell(np.array([wave(point) - wave(TRUTH) for point in points]))
        assert search.cost <= last
        last = search.cost


def test_points_stay_within_their_bounds():
    bounded = space([1.0, 1.0, 3.0], high=np.array([1.5, 2.0, 3.5]))
    search = LevenbergMarquardt(bounded)
    while not search.done:
        points = search.ask()
        assert (points >= bounded.low).all()
        assert (points <= bounded.high).all()
        search.tell(np.array([wave(point) - wave(TRUTH) for point in points]))
    assert search.point[0] == pytest.approx(1.5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bound_that_keeps_a_sign_is_approached_and_not_reached(sign):
    """From 1 to 0.01 in a logarithm, which has no value at zero: the first step is 4.6 long."""
    low, high = sorted([0.0, sign * math.inf])
    wide = space(
        [sign], low=np.array([low]), high=np.array([high]), signed=np.array([True])
    )  # fmt: skip
    search = LevenbergMarquardt(wide)
    while not search.done:
        points = search.ask()
        # differences at 0.01 are 2e-4 wide at least: no neighbour is at zero either
        assert (sign * points > 0.0).all()
        search.tell(np.log(sign * points / 0.01))
    assert search.diverged == 0
    assert search.point[0] == pytest.approx(0.01 * sign, rel=1e-6)


def test_where_the_model_diverges_no_point_ends_and_it_is_counted():
    def broken(point):
        return wave(point) - wave(TRUTH) if point[2] < 4.2 else np.full(len(TIMES), np.nan)

    search = solved(LevenbergMarquardt(space([1.0, 1.0, 3.0], scale=np.array([0.1, 0.1, 1.0]))), broken)
    np.testing.assert_allclose(search.point, TRUTH, rtol=1e-6)
    assert search.diverged > 0


def test_a_start_at_which_the_model_diverges_ends_the_search():
    search = solved(LevenbergMarquardt(space([1.0, 1.0, 3.0])), lambda point: np.full(len(TIMES), np.nan))
    assert search.reason == "the model diverges at the start"


def test_hubers_loss_takes_outliers_for_what_they_are():
    data = wave(TRUTH)
    data[::10] += 5.0
    off = solved(LevenbergMarquardt(space([1.5, 0.8, 3.8])), lambda point: (wave(point) - data) / 0.01)
    robust = solved(LevenbergMarquardt(space([1.5, 0.8, 3.8], huber=1.5)), lambda point: (wave(point) - data) / 0.01)
    assert np.abs(robust.point - TRUTH).max() < 0.02 < np.abs(off.point - TRUTH).max()


def test_hubers_loss_goes_on_straight_where_it_changes():
    at = np.array([[1.5 - 1e-9], [1.5 + 1e-9]])
    below, above = cost_of(at, 1.5)
    assert above - below == pytest.approx(1.5 * 2e-9, rel=1e-3)
    assert huber_weights(np.array([0.3, -3.0]), 1.5) == pytest.approx([1.0, 0.5])


@pytest.mark.parametrize("batches", [1, 2, 5])
def test_a_search_that_goes_on_later_is_the_same_bit_by_bit(batches):
    def residuals(points):
        return np.array([wave(point) - wave(TRUTH) for point in points])

    first, whole = LevenbergMarquardt(space([1.0, 1.0, 3.0])), LevenbergMarquardt(space([1.0, 1.0, 3.0]))
    for _ in range(batches):
        first.tell(residuals(first.ask()))
    later = LevenbergMarquardt(space([1.0, 1.0, 3.0]))
    later.restore(first.state())
    while not later.done:
        later.tell(residuals(later.ask()))
    while not whole.done:
        whole.tell(residuals(whole.ask()))
    for name, value in whole.state().items():
        assert np.array_equal(later.state()[name], value), name


def told(jacobian, residuals, known=True, scale=1.0):
    rows = [slice(0, len(residuals))]
    count = jacobian.shape[1]
    return uncertainty_of(np.zeros(count), np.full(count, scale), jacobian, residuals, rows, [known])


def test_the_deviation_is_that_of_linear_regression():
    rng = np.random.default_rng(1)
    matrix = rng.standard_normal((4000, 2)) * (3.0, 10.0)
    # unit residuals: the covariance is the inverse of the normal matrix; 4000 of them have a mean square of 1 +- 2 %
    found = told(matrix, rng.standard_normal(4000), known=False)
    wanted = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    np.testing.assert_allclose(found.deviation, wanted, rtol=0.05)
    assert found.identifiable.all()


def test_an_unknown_without_influence_is_named():
    matrix = np.random.default_rng(1).standard_normal((50, 3))
    matrix[:, 1] = 0.0
    found = told(matrix, np.ones(50))
    assert found.without_influence.tolist() == [False, True, False]
    assert found.identifiable.tolist() == [True, False, True]
    assert found.deviation[1] == math.inf


def test_a_pair_of_which_only_the_sum_acts_is_named():
    column = np.random.default_rng(2).standard_normal((50, 1))
    found = told(np.hstack([column, column, np.roll(column, 7)]), np.ones(50))
    assert found.identifiable.tolist() == [False, False, True]
    (direction,) = found.directions
    assert {index for index, _ in direction} == {0, 1}
    assert direction[0][1] == pytest.approx(-direction[1][1])
