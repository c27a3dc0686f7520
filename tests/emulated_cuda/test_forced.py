"""Tests of the engine, sensors, vehicles and tasks, with all that they make on the emulated device."""

from __future__ import annotations

import pytest

from tests.emulated_cuda.cpu_tests import CPU_TESTS
from tests.emulated_cuda.emulated_runs import ROOT, run_emulated, skip_where_unavailable

FOLDERS = (
    "tests/unit/simulation", "tests/unit/sensors", "tests/unit/vehicle", "tests/unit/soil",
    "tests/tasks/framework", "tests/tasks/actuation", "tests/tasks/randomisation", "tests/tasks/arms",
    "tests/tasks/locomotion",
)  # fmt: skip
FORCED = ("-m", "pytest", "-p", "tests.emulated_cuda.force_cuda", "-p", "no:cacheprovider", "-q")


@pytest.mark.slow
@pytest.mark.parametrize("folder", FOLDERS)
def test_what_is_true_on_a_cpu_is_true_on_the_device(folder):
    """All but slow tests, those marked `cuda`, which run on it anyway, and those of `CPU_TESTS`."""
    skip_where_unavailable()
    out = run_emulated(*FORCED, "-m", "not slow and not cuda", folder, timeout=7200.0)
    assert " passed" in out


@pytest.mark.parametrize("name", CPU_TESTS)
def test_what_is_left_out_is_there_and_has_a_reason(name):
    path, _, test = name.partition("::")
    source = (ROOT / path).read_text(encoding="utf-8")
    assert not test or f"def {test.partition('[')[0]}" in source
    assert len(CPU_TESTS[name]) > 10
