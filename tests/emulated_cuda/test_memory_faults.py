"""Faults of device code: memory, races, and what a failed launch does to later calls."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from tests.emulated_cuda.small_ptx import THREAD, kernel

LOAD = kernel("load", "ld.global.u32 %r1, [%rd20];\nst.global.u32 [%rd21], %r1;")
STORE = kernel("store", "ld.global.u32 %r1, [%rd21];\nst.global.u32 [%rd20], %r1;")
GENERIC = kernel("generic", "ld.u32 %r1, [%rd20];\nst.u32 [%rd21], %r1;")
WIDE = kernel("wide", "ld.global.v4.u32 {%r1, %r2, %r3, %r4}, [%rd20];\nst.global.u32 [%rd21], %r4;")
SLOT = "mul.wide.u32 %rd1, %r23, 4;\nadd.s64 %rd2, %rd21, %rd1;\n"
RACES = {
    "same_word": kernel("same_word", f"{THREAD}st.global.u32 [%rd21], %r23;"),
    "read_of_a_neighbour": kernel(
        "read_of_a_neighbour",
        f"{THREAD}{SLOT}st.global.u32 [%rd2], %r23;\nadd.s32 %r1, %r23, 1;\nrem.u32 %r1, %r1, 8;\n"
        "mul.wide.u32 %rd3, %r1, 4;\nadd.s64 %rd4, %rd21, %rd3;\nld.global.u32 %r2, [%rd4];",
    ),
    "atomic_and_write": kernel(
        "atomic_and_write",
        f"{THREAD}red.global.add.u32 [%rd21], 1;\nsetp.eq.u32 %p1, %r23, 5;\n@%p1 st.global.u32 [%rd21], 0;",
    ),
}
NO_RACES = {
    "own_words": kernel("own_words", f"{THREAD}{SLOT}st.global.u32 [%rd2], %r23;\nld.global.u32 %r1, [%rd2];"),
    "atomics": kernel("atomics", "red.global.add.u32 [%rd21], 1;"),
    "reads": kernel("reads", "ld.global.u32 %r1, [%rd21];"),
    "barrier_between": kernel(
        "barrier_between",
        f"{THREAD}{SLOT}st.global.u32 [%rd2], %r23;\nbar.sync 0;\nxor.b32 %r1, %r23, 1;\nmul.wide.u32 %rd3, %r1, 4;\n"
        "add.s64 %rd4, %rd21, %rd3;\nld.global.u32 %r2, [%rd4];",
    ),
}  # fmt: skip
HOST = (ctypes.c_uint32 * 16)()


@pytest.fixture
def out(ptx):
    """A block of eight words."""
    return ptx.array(np.zeros(8, np.uint32))


def freed(ptx):
    """Address of memory that was given back."""
    address = ptx.array(np.zeros(4, np.uint32))
    ptx.device.release(address)
    return address


BAD = {
    "behind the end": (lambda ptx: ptx.array(np.zeros(4, np.uint32)) + 16, 700, "out of bounds"),
    "before the begin": (lambda ptx: ptx.array(np.zeros(4, np.uint32)) - 4, 700, "out of bounds"),
    "freed": (freed, 700, "freed"),
    "misaligned": (lambda ptx: ptx.array(np.zeros(4, np.uint32)) + 2, 716, "misaligned"),
    "null": (lambda ptx: 0, 700, "null pointer"),
    "host": (lambda ptx: ctypes.addressof(HOST), 700, "host memory"),
}


@pytest.mark.parametrize("text", [LOAD, STORE, GENERIC], ids=["load", "store", "generic"])
@pytest.mark.parametrize("kind", BAD)
def test_a_bad_address_is_a_fault_that_names_the_thread(ptx, out, kind, text):
    address, code, word = BAD[kind]
    name = text.split("(")[0].split()[-1]
    assert ptx.launch(text, name, [address(ptx), out], grid=2) == code
    message = ptx.device.faults.violations[0][0]
    assert word in message
    assert f"thread (0,0,0) of block (0,0,0) in {name}" in message


def test_a_vector_that_runs_over_the_end_is_a_fault(ptx, out):
    address = ptx.array(np.zeros(6, np.uint32))
    assert ptx.launch(WIDE, "wide", [address, out]) == 0
    assert ptx.launch(WIDE, "wide", [address + 16, out]) == 700


def test_a_part_of_a_word_at_the_end_is_out_of_bounds(ptx, out):
    assert ptx.launch(LOAD, "load", [ptx.array(np.zeros(6, np.uint8)) + 4, out]) == 700


def test_a_failed_launch_makes_later_calls_fail(ptx, out):
    device = ptx.device
    assert ptx.launch(LOAD, "load", [0, out]) == 700
    assert ptx.launch(LOAD, "load", [out, out]) == 700
    assert not device.synchronize("here")
    device.faults.clear()
    assert ptx.launch(LOAD, "load", [out, out]) == 0
    assert device.synchronize("here")


def test_new_memory_holds_nan(ptx):
    values = ptx.read(ptx.device.allocate(16, "pool"), 4, np.float32)
    assert np.isnan(values).all()


def test_the_host_may_not_touch_the_device(ptx, out):
    device = ptx.device
    assert not device.is_valid(ctypes.addressof(HOST), 4)
    with device.open_to_host():
        assert ctypes.c_uint32.from_address(out).value == 0


def test_an_address_is_never_given_twice(ptx):
    first = ptx.device.allocate(64, "pool")
    ptx.device.release(first)
    assert ptx.device.allocate(64, "pool") != first
    ptx.device.release(first)
    assert "is no block of memory" in ptx.device.faults.violations[-1][0]


@pytest.mark.parametrize("name", RACES)
@pytest.mark.parametrize("seed", [0, 3])
def test_a_race_of_two_threads_is_found(ptx, out, name, seed):
    ptx.device.seed = seed
    assert ptx.launch(RACES[name], name, [0, out], block=8) == 0
    count, first = ptx.device.races()
    assert count > 0
    assert name in first


@pytest.mark.parametrize("name", NO_RACES)
def test_ordered_accesses_are_no_race(ptx, out, name):
    assert ptx.launch(NO_RACES[name], name, [0, out], block=8) == 0
    assert ptx.device.races() == (0, "")


def test_the_next_launch_may_read_what_this_one_wrote(ptx, out):
    for text, name in ((RACES["read_of_a_neighbour"], "read_of_a_neighbour"), (NO_RACES["reads"], "reads")):
        ptx.device.runtime.emu_clear_races()
        ptx.launch(text, name, [0, out], block=8)
    assert ptx.device.races() == (0, "")


def test_arguments_are_those_of_the_launch(lazy, ptx, out):
    """A launch that waits in its stream keeps the values that its arguments had."""
    handle = ptx.modules.kernel(ptx.load(STORE), "store")
    source = ptx.array(np.array([7], np.uint32))
    values = [ctypes.c_uint64(out), ctypes.c_uint64(source)]
    stream = lazy.streams.create(blocking=False).handle
    ptx.modules.launch(handle, (1, 1, 1), 1, 0, [ctypes.addressof(each) for each in values], stream)
    values[0].value = 0
    assert ptx.read(out, 1)[0] == 0
    lazy.streams.finish_stream(stream)
    assert ptx.read(out, 1)[0] == 7
