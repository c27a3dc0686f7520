"""A task, a robot and a camera on the emulated device: as on the CPU, and the same bits in any order of threads."""

from __future__ import annotations

import functools
import json
from typing import Any

import pytest

from tests.emulated_cuda.emulated_runs import HERE, run_emulated, skip_where_unavailable
from tests.emulated_cuda.settings import Check

BOUNDS = {"pendulum": 1e-6, "ant": 2e-4, "camera": 1.0}
"""Largest difference to the CPU. Compilers round differently, and contacts amplify: scripts/gpu_agreement.py has the
reason for the ant's bound, over as many steps; a byte of a picture may be rounded the other way."""
LAZY = ("pendulum",)


@functools.cache
def rows() -> dict[str, dict[str, Any]]:
    """What tests/emulated_cuda/agreement.py found in one process, races checked."""
    skip_where_unavailable()
    out = run_emulated(str(HERE / "agreement.py"), *BOUNDS, check=Check.RACE)
    found: dict[str, dict[str, Any]] = json.loads(out.splitlines()[-1])
    return found


@pytest.mark.parametrize("name", BOUNDS)
def test_the_emulated_device_does_what_the_cpu_does(name):
    row = rows()[name]
    assert row["arrays"] > 1
    assert row["difference"] <= BOUNDS[name]


@pytest.mark.parametrize("name", BOUNDS)
def test_captured_steps_and_another_order_of_threads_give_the_same_bits(name):
    row = rows()[name]
    assert row["equal"] == {"eager": True, "captured": True, **({"lazy": True} if name in LAZY else {})}
    assert row["captures"] > 0


@pytest.mark.parametrize("name", BOUNDS)
def test_no_fault_and_no_race(name):
    row = rows()[name]
    assert row["faults"] == []
    assert row["races"] == 0
