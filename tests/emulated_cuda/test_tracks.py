"""Tracks on the emulated device, as belts and shoe by shoe: as on the CPU, the same bits in every order."""

from __future__ import annotations

import pytest

from tests.emulated_cuda.emulated_runs import HERE, once_per_run, run_emulated
from tests.emulated_cuda.settings import Check
from tests.emulated_cuda.tracks_on_device import CASES

pytestmark = pytest.mark.slow  # kernels compile for many minutes

BOUND = 2e-5
"""Of each quantity, for the largest of it. Compilers round differently, by 1e-7. On the CPU alone, runs whose
velocities begin 6e-8 m/s and rad/s apart end with 6e-6 of the turning between them (soil; chains 3e-6): what differs by
more has another cause. Sweeps that followed the sign of a belt's speed, chosen by rounding at rest, made 7e-4."""
SCALES = {"sprockets": "turning"}
"""Sprockets of chains turn by 0.003 rad/s, found as what is between bodies that turn by 4 rad/s."""


@pytest.fixture(scope="session")
def rows(tmp_path_factory):
    """What tests/emulated_cuda/tracks_on_device.py found, races checked."""
    program = str(HERE / "tracks_on_device.py")
    return once_per_run(tmp_path_factory, "tracks", lambda: run_emulated(program, check=Check.RACE, timeout=5400))


@pytest.mark.parametrize("name", CASES)
def test_the_emulated_device_does_what_the_cpu_does(rows, name):
    row = rows[name]
    for quantity, difference in row["difference"].items():
        assert difference <= BOUND * row["largest"][SCALES.get(quantity, quantity)], quantity
    assert row["apart"] > 1e-3, "the worlds are driven in different ways"


@pytest.mark.parametrize("name", CASES)
def test_another_order_and_a_capture_give_the_same_bits_without_faults(rows, name):
    row = rows[name]
    assert row["equal"]
    assert row["faults"] == []
    assert row["races"] == 0
