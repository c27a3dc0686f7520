"""Paths in documents, factors of tables, and inertias that stay physical."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from simwarp.identify.document_numbers import matches, numbers_in, patch_of, path_of, replaced, scaled, value_at
from simwarp.identify.fit_error import FitError
from simwarp.identify.physical_inertia import inertia_of, numbers_of, second_moments

DOCUMENT: dict[str, Any] = {
    "mass": 2.0,
    "bodies": [{"name": "trunk", "com": [0, 1, 2]}, {"name": "leg.1", "com": [0, 0, 0]}],
    "springs": [{"curve": [[-1, -5], [0, 0], [1, 5]]}, {"curve": [[-1, -7], [1, 7]]}],
    "flag": True,
}


def test_every_number_has_a_path_that_leads_back_to_it():
    found = dict(numbers_in(DOCUMENT))
    assert ("flag",) not in found
    assert len(found) == 9
    for keys, value in found.items():
        assert matches(DOCUMENT, path_of(DOCUMENT, keys)) == [keys]
        assert value_at(DOCUMENT, keys) == value


@pytest.mark.parametrize(
    ("path", "count"),
    [("mass", 1), ("bodies[trunk].com[1]", 1), ("bodies[0].com[1]", 1), ("bodies[*].com[2]", 2),
     ("springs[*].curve", 2), ("bodies[leg*].com[0]", 1)],
)  # fmt: skip
def test_paths_find_items_by_index_name_and_pattern(path, count):
    assert len(matches(DOCUMENT, path)) == count


@pytest.mark.parametrize("path", ["masses", "bodies[arm].com[0]", "mass[0]", "bodies[trunk].com[7]", ".mass", "a["])
def test_a_path_that_leads_nowhere_is_one_line(path):
    with pytest.raises(FitError) as error:
        matches(DOCUMENT, path)
    assert "\n" not in str(error.value)


def test_a_near_name_is_proposed():
    with pytest.raises(FitError, match="did you mean"):
        matches(DOCUMENT, "bodies[trunk].con[1]")


def test_a_change_leaves_the_document_as_it_was():
    changed: Any = replaced(DOCUMENT, {("bodies", 0, "com", 1): 5.0, ("mass",): 3.0})
    assert (changed["mass"], changed["bodies"][0]["com"]) == (3.0, [0, 5.0, 2])
    assert (DOCUMENT["mass"], DOCUMENT["bodies"][0]["com"]) == (2.0, [0, 1, 2])
    assert changed["springs"] is DOCUMENT["springs"]
    assert patch_of(DOCUMENT, changed) == {"mass": 3.0, "bodies": changed["bodies"]}


def test_a_factor_acts_on_efforts_and_not_on_places():
    assert scaled(2.0, 1.5) == 3.0
    assert scaled([1, 2], 2.0) == [2.0, 4.0]
    assert scaled([[-1, -5], [1, 5]], 2.0) == [[-1, -10.0], [1, 10.0]]
    assert scaled([[1, 0, 2], [0, 3, 0], [2, 0, 5]], 2.0) == [[2.0, 0.0, 4.0], [0.0, 6.0, 0.0], [4.0, 0.0, 10.0]]
    table = [[0.1, 0.2, 0.3], [-2.0, 2.0], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]]
    assert scaled(table, 2.0) == [table[0], table[1], [[2.0, 4.0, 6.0], [8.0, 10.0, 12.0]]]


@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_any_six_numbers_are_an_inertia_that_a_body_can_have(numbers):
    inertia = inertia_of(np.array(numbers))
    moments = np.linalg.eigvalsh(inertia)
    assert moments[0] > 0.0
    # the triangle inequality, but for rounding of the largest moment
    assert moments[0] + moments[1] >= moments[2] * (1.0 - 1e-12)
    np.testing.assert_allclose(inertia, inertia.T)


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_the_six_numbers_of_an_inertia_give_it_back(numbers):
    inertia = inertia_of(np.array(numbers))
    np.testing.assert_allclose(numbers_of(inertia, "body"), numbers, atol=1e-9)


def test_an_inertia_that_no_body_has_is_refused():
    with pytest.raises(FitError, match="each principal moment less than the sum of the others"):
        numbers_of(np.diag([1.0, 1.0, 3.0]), "bodies[trunk].inertia")


def test_second_moments_of_a_box_are_those_of_its_sides():
    mass, sides = 3.0, np.array([0.2, 0.5, 0.9])
    squares = mass / 12.0 * sides**2
    inertia = np.diag([squares[1] + squares[2], squares[0] + squares[2], squares[0] + squares[1]])
    np.testing.assert_allclose(second_moments(inertia), np.diag(squares))
