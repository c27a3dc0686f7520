"""Faults that were planted in small programs are found on the emulated device, and their corrected forms pass."""

from __future__ import annotations

import functools

import pytest

from tests.emulated_cuda.emulated_runs import HERE, once_per_run, run_emulated
from tests.emulated_cuda.settings import Check, StreamOrder

EXPECTED = {
    "race": "races 64",
    "no_race": "races 0, 2.0",
    "lanes_that_meet": "races 0, [16, 17, 18, 19, 20, 21, 22, 23]races 0, [5, 4, 7, 6, 1, 0, 3, 2]",
    "lanes_that_do_not_meet": "races 64",
    "lanes_of_other_groups": "races 64",
    "a_lane_changes_what_all_have_read": "raced False, 1.0",
    "a_lane_changes_what_others_read": "raced True",
    "sums_of_lanes": "[[0.0, 4.0], [0.0, 32.0]]",
    "out_of_bounds": "error 700",
    "host_read_in_a_warp_capture": "capture failed",
    "host_read_in_a_torch_capture": "CUDA error",
    "legacy_stream_in_a_capture": "error 906",
    "allocation_in_a_capture": "Failed to allocate",
    "streams_with_synchronisation": "4.0",
    "torch_streams_with_synchronisation": "3.0",
    "tensor_freed_while_another_stream_uses_it": "illegal memory access",
    "tensor_kept_for_another_stream": "2.0",
    "pinned_copy_with_waiting": "3.0",
    "pageable_copy": "4.0",
    "array_of_the_host": "error 700",
    "tensor_of_the_host": "at least two devices",
    "replay_after_the_arguments_went": "10.0 14.0",
}
"""Part of what each program sees on lazy streams with a check of races."""
WRONG = {
    "streams_without_synchronisation": "4.0",
    "torch_streams_without_synchronisation": "3.0",
    "pinned_copy_without_waiting": "3.0",
}
"""What programs that do not synchronise see only by luck."""
FAULTS = {
    "host_read_in_a_warp_capture": "error 906",
    "host_read_in_a_torch_capture": "error 900",
    "legacy_stream_in_a_capture": "error 906",
    "allocation_in_a_capture": "error 900",
    "out_of_bounds": "out of bounds or freed: write",
    "array_of_the_host": "host memory: read",
    "tensor_freed_while_another_stream_uses_it": "was given back before it ran",
}
"""Part of the first fault that the device notes."""


@pytest.fixture(scope="session")
def found(tmp_path_factory):
    """What all programs saw on lazy streams, races checked."""

    def run() -> str:
        elsewhere = tmp_path_factory.mktemp("elsewhere")
        program = str(HERE / "planted_faults.py")
        return run_emulated(program, check=Check.RACE, streams=StreamOrder.LAZY, folder=elsewhere)

    return once_per_run(tmp_path_factory, "planted-lazy", run)


@pytest.fixture(scope="session")
def found_eagerly(tmp_path_factory):
    """What all programs saw on eager streams, without a check of races."""
    program = str(HERE / "planted_faults.py")
    return once_per_run(tmp_path_factory, "planted-eager", lambda: run_emulated(program))


@pytest.mark.parametrize("name", EXPECTED)
def test_a_program_sees_its_fault(found, name):
    assert EXPECTED[name] in found[name]["seen"]


@pytest.mark.parametrize("name", FAULTS)
def test_the_device_says_what_was_wrong(found, name):
    faults = found[name]["faults"]
    assert faults
    assert FAULTS[name] in faults[0]


@pytest.mark.parametrize("name", WRONG)
def test_what_is_not_synchronised_comes_too_late(found, name):
    assert found[name]["seen"] != WRONG[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_eager_streams_hide_a_missing_synchronisation(found_eagerly, name):
    """It is the order of streams that shows it."""
    assert found_eagerly[name]["seen"] == WRONG[name]


IN_SIMWARP = {
    "steps_as_they_are": ("same True, captured True", ""),
    "stream_is_not_shared": ("same False", ""),
    "scratch_as_it_is": ("races False", ""),
    "scratch_is_shared": ("races True", ""),
    "a_captured_step_reads_the_host": ("not captured: CUDA error", "error 900"),
    "a_step_gets_an_array_of_the_host": ("error 700", "host memory: read"),
}
"""What is seen with a part of simwarp taken out, and part of the first fault; nothing where all is there."""


@pytest.fixture(scope="session")
def found_in_simwarp(tmp_path_factory):
    """What all programs saw on lazy streams, races checked."""
    program = str(HERE / "planted_in_simwarp.py")
    run = functools.partial(run_emulated, program, check=Check.RACE, streams=StreamOrder.LAZY)
    return once_per_run(tmp_path_factory, "planted-in-simwarp", run)


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_SIMWARP)
def test_what_is_taken_out_of_simwarp_is_missed(found_in_simwarp, name):
    """A stream that is not shared, a race, a host read in a capture, an array of the host."""
    seen, fault = IN_SIMWARP[name]
    row = found_in_simwarp[name]
    assert seen in row["seen"]
    assert fault in row["faults"][0] if fault else row["faults"] == []


@pytest.mark.slow
def test_without_the_check_no_race_is_found(found_eagerly):
    assert found_eagerly["race"]["seen"] == "races 0"
