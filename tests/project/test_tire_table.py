"""The table of grips in docs/vehicles.md is that of the tire kernel."""

import re

import numpy as np
import pytest

from scripts.tire_tables import BLOCK, PAGE, SHIPPED, rows


def printed():
    """Lines of the table on the page, vehicle by vehicle."""
    block = BLOCK.search(PAGE.read_text(encoding="utf-8"))
    assert block is not None
    lines = [line for line in block[0].splitlines() if line.startswith("| `")]
    return {name: [line for line in lines if line.startswith(f"| `{name}`")] for name in SHIPPED}


def numbers(line):
    return np.array([float(text) for text in re.findall(r"[\d.]+", line.split("|", 3)[3])])


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_the_table_of_grips_is_measured(name):
    made, page = rows(name), printed()[name]
    assert [line.split("|")[1:3] for line in made] == [line.split("|")[1:3] for line in page]
    for ours, theirs in zip(made, page, strict=True):
        # numbers of two or three digits, whose last one may round either way
        assert numbers(ours) == pytest.approx(numbers(theirs), abs=0.011, rel=0.006), ours


def test_the_page_has_every_vehicle_and_law():
    for name, lines in printed().items():
        assert {re.findall(r"`([^`]+)`", line)[1] for line in lines} == set(SHIPPED[name])
