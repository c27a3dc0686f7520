"""Tests that need a CUDA device, on the emulated one."""

import pytest

from tests.emulated_cuda.emulated_runs import run_emulated, skip_where_unavailable


@pytest.mark.slow
def test_what_needs_a_gpu_passes_on_the_emulated_one():
    """Control steps of tasks are captured, nothing changes under their graphs, arrays of the other device are moved."""
    skip_where_unavailable()
    out = run_emulated("-m", "pytest", "-m", "cuda", "-q", "-p", "no:cacheprovider", "tests", timeout=7200.0)
    assert " passed" in out
