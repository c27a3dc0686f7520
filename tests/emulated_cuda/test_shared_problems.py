"""Lanes of a warp that share a cone problem find what a thread alone finds, without races."""

from __future__ import annotations

import pytest

from tests.emulated_cuda.emulated_runs import HERE, once_per_run, run_emulated
from tests.emulated_cuda.settings import Check
from tests.emulated_cuda.shared_problems import CASES, LANES

pytestmark = pytest.mark.slow  # kernels for three numbers of lanes compile for minutes

BOUND = 2e-5
"""Of velocities [m/s or rad/s], for each rad/s of the fastest body, a dozen steps on: sums of lanes are rounded in
another order (1e-7), and solves that stop at 1e-6 m/s differ by some of that in each step."""


@pytest.fixture(scope="session")
def found(tmp_path_factory):
    """What tests/emulated_cuda/shared_problems.py found, races checked."""
    program = str(HERE / "shared_problems.py")
    return once_per_run(tmp_path_factory, "shared", lambda: run_emulated(program, check=Check.RACE, timeout=5400))


@pytest.mark.parametrize("name", CASES)
def test_lanes_find_what_a_thread_finds(found, name):
    rows = found["rows"][name]
    for lanes in LANES:
        row = rows[str(lanes)]
        assert row["difference"] <= BOUND * max(1.0, row["speed"]), lanes
        assert max(row["iterations"]) > 0
        assert row["residual"] <= CASES[name][2].get("tolerance", 1e-6)
        assert row["same"], "whatever the order of threads"


def test_no_fault_and_no_race(found):
    assert found["faults"] == []
    assert found["races"][0] == 0, found["races"][1]
