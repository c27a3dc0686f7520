"""The time model beside a measured GPU, from the files of both."""

from __future__ import annotations

import pytest

from benchmarks.gpu_model_check import error_factor, main, pairs, scenes


@pytest.mark.parametrize("scene", scenes())
def test_each_kernel_that_was_counted_was_measured(scene):
    found = pairs(scene)
    assert found, "some number of worlds was both counted and measured"
    assert all(each.measured_us > 0.0 and each.model_us > 0.0 for each in found)
    assert 1.0 < error_factor(found) < 2.5, "docs/gpu.md: within a factor of two or so"


@pytest.mark.parametrize("scene", ["ant", "hmmwv"])
def test_counters_of_a_gpu_agree_with_emulated_counts(scene):
    """Kernels whose lanes do the same in each world touch the same sectors, with the same registers."""
    found = [each for each in pairs(scene) if each.instructions is not None]
    assert len(found) == 16
    for each in found:
        assert each.registers == each.model_registers
        if each.kernel != "solve_by_apgd":  # it iterates until it is done, from other states
            assert each.sectors == pytest.approx(each.model_sectors, rel=0.01)
            assert each.lanes == pytest.approx(each.model_lanes, abs=0.03)


def test_it_prints_a_table_for_each_number_of_worlds(capsys):
    assert main(["ant"]) == 0
    shown = capsys.readouterr().out
    assert "ant, 8192 worlds: model over measured 1.28" in shown
    assert "ant, 32768 worlds: model over measured 1.08" in shown
    assert main(["pendulum"]) == 2
