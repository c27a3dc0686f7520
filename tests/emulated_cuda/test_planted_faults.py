"""Faults that were planted in small programs are found on the emulated device, and their corrected forms pass."""

from __future__ import annotations

import functools
import json

import pytest

from tests.emulated_cuda.emulated_runs import HERE, run_emulated, skip_where_unavailable
from tests.emulated_cuda.settings import Check, StreamOrder

EXPECTED = {
    "race": "races 64",
    "no_race": "races 0, 2.0",
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


@functools.cache
def found(check: Check, streams: StreamOrder) -> dict[str, dict[str, str | list[str]]]:
    """What all programs saw."""
    skip_where_unavailable()
    out = run_emulated(str(HERE / "planted_faults.py"), check=check, streams=streams)
    programs: dict[str, dict[str, str | list[str]]] = json.loads(out.splitlines()[-1])
    return programs


@pytest.mark.parametrize("name", EXPECTED)
def test_a_program_sees_its_fault(name):
    assert EXPECTED[name] in found(Check.RACE, StreamOrder.LAZY)[name]["seen"]


@pytest.mark.parametrize("name", FAULTS)
def test_the_device_says_what_was_wrong(name):
    faults = found(Check.RACE, StreamOrder.LAZY)[name]["faults"]
    assert faults
    assert FAULTS[name] in faults[0]


@pytest.mark.parametrize("name", WRONG)
def test_what_is_not_synchronised_comes_too_late(name):
    assert found(Check.RACE, StreamOrder.LAZY)[name]["seen"] != WRONG[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_eager_streams_hide_a_missing_synchronisation(name):
    """It is the order of streams that shows it."""
    assert found(Check.MEMORY, StreamOrder.EAGER)[name]["seen"] == WRONG[name]


@pytest.mark.slow
def test_without_the_check_no_race_is_found():
    assert found(Check.MEMORY, StreamOrder.EAGER)["race"]["seen"] == "races 0"
