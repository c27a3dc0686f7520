"""A task, a robot, a camera and a lidar on the emulated device: as on the CPU, the same bits in every order."""

from __future__ import annotations

import pytest

from tests.emulated_cuda.emulated_runs import HERE, once_per_run, run_emulated
from tests.emulated_cuda.settings import Check

BOUNDS = {"pendulum": 1e-6, "ant": 2e-4, "camera": 1.0, "lidar": 1e-3}
"""Largest difference to the CPU. Compilers round differently, and contacts amplify: `simwarp.bench.agreement` has the
reason for the ant's bound, over as many steps, and for that of ranges [m]; a byte may be rounded the other way."""


@pytest.fixture(scope="session")
def rows(tmp_path_factory):
    """What tests/emulated_cuda/agreement.py found in one process, races checked."""
    program = str(HERE / "agreement.py")
    return once_per_run(tmp_path_factory, "agreement", lambda: run_emulated(program, *BOUNDS, check=Check.RACE))


@pytest.mark.parametrize("name", BOUNDS)
def test_the_emulated_device_does_what_the_cpu_does(rows, name):
    row = rows[name]
    assert row["arrays"] > 1
    assert row["difference"] <= BOUNDS[name]


@pytest.mark.parametrize("name", BOUNDS)
def test_captures_and_other_orders_and_another_layout_give_the_same_bits(rows, name):
    row = rows[name]
    assert row["equal"] == dict.fromkeys(("eager", "captured", "lazy", "random", "slot by slot"), True)
    assert row["captures"] > 0


@pytest.mark.parametrize("name", BOUNDS)
def test_no_fault_and_no_race(rows, name):
    row = rows[name]
    assert row["faults"] == []
    assert row["races"] == 0
