"""Distributions of a study's keys: their texts, their quantiles, and what is refused."""

import numpy as np
import pytest

from simwarp.study.distributions import CUT, Kind, parse_distribution
from simwarp.study.draws import drawn_shares
from simwarp.study.study_error import StudyError

SHARES = np.linspace(0.0, 1.0, 1001)


@pytest.mark.parametrize(
    ("text", "kind", "ends", "relative"),
    [
        ("1..2", Kind.UNIFORM, (1.0, 2.0), False),
        ("1:2", Kind.UNIFORM, (1.0, 2.0), False),
        ("-1.5..2e3", Kind.UNIFORM, (-1.5, 2000.0), False),
        (".5...75", Kind.UNIFORM, (0.5, 0.75), False),
        ("-10%..10%", Kind.UNIFORM, (-0.1, 0.1), True),
        ("0..10%", Kind.UNIFORM, (0.0, 0.1), True),
        ("1..100:log", Kind.LOG_UNIFORM, (1.0, 100.0), False),
        ("5+-2", Kind.NORMAL, (-1.0, 11.0), False),
        ("0%+-5%", Kind.NORMAL, (-0.15, 0.15), True),
        ("3,1,2", Kind.CHOICES, (3.0, 1.0, 2.0), False),
    ],
)
def test_texts_are_read_and_written_again(text, kind, ends, relative):
    found = parse_distribution(text, "--vary k")
    assert (found.kind, found.relative) == (kind, relative)
    assert found.ends == pytest.approx(ends)
    assert parse_distribution(found.text, "--vary k") == found


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("2..1", "first number must be below"),
        ("1..1", "first number must be below"),
        ("0..1:log", "logarithm needs numbers above 0"),
        ("10%..20%:log", "no %"),
        ("1+-0", "standard deviation must be above 0"),
        ("1..10%", "all in % or none"),
        ("1,1", "choices must differ"),
        ("1e999..2e999", "finite"),
        ("soft", "must be LOW..HIGH"),
        ("1", "must be LOW..HIGH"),
        ("", "must be LOW..HIGH"),
        ("nan..1", "must be LOW..HIGH"),
    ],
)
def test_other_texts_are_refused_in_one_line(text, rule):
    with pytest.raises(StudyError, match=r"^--vary k: ") as error:
        parse_distribution(text, "--vary k")
    assert rule in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["1..3", "1..100:log", "5+-2", "-10%..10%", "1,2,3,7"])
def test_quantiles_rise_from_end_to_end(text):
    found = parse_distribution(text, "k")
    values = found.at(SHARES)
    assert np.all(np.diff(values) >= 0.0)
    assert (values[0], values[-1]) == pytest.approx((min(found.ends), max(found.ends)))


def test_quantiles_are_those_of_closed_forms():
    assert parse_distribution("2..6", "k").at(0.25) == pytest.approx(3.0)
    assert parse_distribution("1..100:log", "k").at(0.5) == pytest.approx(10.0)
    normal = parse_distribution("5+-2", "k")
    assert normal.at(0.5) == pytest.approx(5.0)
    # the quantile of one standard deviation; the cut at three takes 0.0027 of the whole away
    share = (0.8413447461 - 0.0013498980) / (1.0 - 2.0 * 0.0013498980)
    assert normal.at(share) == pytest.approx(7.0, abs=1e-6)
    assert normal.at(1.0) == pytest.approx(5.0 + CUT * 2.0)


def test_choices_are_alike_in_probability():
    values = parse_distribution("5,1,3", "k").at((np.arange(3000) + 0.5) / 3000)
    assert [np.count_nonzero(values == choice) for choice in (5.0, 1.0, 3.0)] == [1000] * 3


def test_the_draw_of_a_world_depends_on_seed_key_and_index_alone():
    whole = drawn_shares(["a", "b"], 3, 0, 40)
    assert np.array_equal(whole[7:19], drawn_shares(["a", "b"], 3, 7, 12))
    assert np.array_equal(whole[:, 1:], drawn_shares(["b"], 3, 0, 40))
    assert not np.array_equal(whole, drawn_shares(["a", "b"], 4, 0, 40))
    assert np.all((whole > 0.0) & (whole < 1.0))


def test_draws_are_uniform_and_independent():
    found = drawn_shares(["a", "b"], 0, 0, 4000)
    # standard deviations of mean, spread and correlation of 4000 draws are below 0.016: four of them
    assert found.mean(axis=0) == pytest.approx([0.5, 0.5], abs=4 * 0.2887 / 4000**0.5)
    one, other = found.T - found.mean(axis=0)[:, None]
    assert abs(one @ other) / np.linalg.norm(one) / np.linalg.norm(other) < 4 / 4000**0.5
