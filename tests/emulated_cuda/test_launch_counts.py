"""Counts of warps against what small kernels must do: slots of lanes that part, sectors, caches, rounds of loads."""

from __future__ import annotations

import numpy as np
import pytest

from tests.emulated_cuda.counts.launch_counts import KernelCount
from tests.emulated_cuda.native.kernel_modules import KernelModules
from tests.emulated_cuda.settings import Check
from tests.emulated_cuda.small_ptx import THREAD, PtxRunner, kernel

L1, L2 = 32 << 10, 1 << 20
WARP = 32


@pytest.fixture
def counting(ptx):
    """Runs PTX that is translated for counting."""
    ptx.modules = KernelModules(ptx.device, Check.COUNT)
    yield ptx
    ptx.device.counts.stop()
    ptx.device.counts.prepare("none", None, WARP)


def count(
    ptx: PtxRunner, body: str, *, words: int = 4096, block: int = WARP, grid: int = 1, runs: int = 1, l2: int = L2
) -> KernelCount:
    """Counts of a kernel that finds an array of zeros at %rd20 and its thread in %r23."""
    ptx.device.counts.start(l1_bytes=L1, l2_bytes=l2)
    address = ptx.array(np.zeros(words, np.uint32))
    for _ in range(runs):
        assert ptx.launch(kernel("f", THREAD + body, 1), "f", [address], grid=grid, block=block) == 0
    (row,) = ptx.device.counts.stop()
    return row


def load(stride: int, width: str = "u32", registers: str = "%r9") -> str:
    """Load from the thread times a stride in bytes."""
    return f"mul.wide.u32 %rd1, %r23, {stride};\nadd.s64 %rd2, %rd20, %rd1;\nld.global.{width} {registers}, [%rd2];"


@pytest.mark.parametrize(
    ("body", "sectors"),
    [
        (load(4), 4),
        (load(0), 1),
        (load(8), 8),
        (load(128), 32),
        (load(16, "v4.u32", "{%r9, %r10, %r11, %r12}"), 16),
        (load(12), 12),
    ],
    ids=["in a row", "one word", "every second", "a line each", "four words each", "vectors of three"],
)
def test_a_request_touches_as_many_sectors_as_its_lanes_do(counting, body, sectors):
    row = count(counting, body)
    assert (row.warps, row.loads, row.load_sectors) == (1, 1, sectors)
    assert row.l1_misses == row.l2_misses == sectors
    assert row.instructions["global_load"] == 1


def test_stores_go_through_the_first_cache_and_are_written_back_once_there_is_no_room(counting):
    store = "mul.wide.u32 %rd1, %r23, 32;\nadd.s64 %rd2, %rd20, %rd1;\nst.global.u32 [%rd2], %r23;"
    row = count(counting, store, words=64 * 8 * WARP, grid=64, l2=2048)
    assert (row.warps, row.stores, row.store_sectors, row.loads) == (64, 64, 64 * WARP, 0)
    assert row.written_back == 64 * WARP - 2048 // 32, "all but what fits"


def spin(register: str, label: str) -> str:
    """So many times five instructions, and three around them."""
    return (
        f"mov.u32 %r2, 0;\n$H{label}:\nsetp.ge.u32 %p1, %r2, {register};\n@%p1 bra $E{label};\nadd.u32 %r3, %r3, 1;\n"
        f"add.u32 %r2, %r2, 1;\nbra $H{label};\n$E{label}:"
    )


def test_lanes_that_part_issue_one_group_after_the_other_and_meet_again(counting):
    plain = count(counting, "mov.u32 %r9, 1;\nmov.u32 %r9, 1;")
    both = (
        "setp.lt.u32 %p1, %r20, 8;\n@%p1 bra $A;\n" + "add.u32 %r9, %r9, 1;\n" * 10 + "bra $B;\n$A:\n"
        + "add.u32 %r9, %r9, 2;\n" * 20 + "$B:\n" + "add.u32 %r9, %r9, 3;\n" * 100
    )  # fmt: skip
    row = count(counting, both)
    around = plain.slots - 2 + 2 + 100
    assert row.slots == around + 20 + 11
    assert row.longest_lane == around + 20
    assert row.lane_slots == WARP * around + 8 * 20 + 24 * 11


def test_a_loop_lasts_as_long_as_its_longest_lane(counting):
    """Lanes that leave a loop wait behind it: slots are those of the lane that stays longest."""
    row = count(counting, spin("%r20", "1"))
    alone = count(counting, "mov.u32 %r2, 31;\n" + spin("%r2", "2").replace("mov.u32 %r2, 0", "mov.u32 %r4, 0")
                  .replace("%r2, %r2, 1", "%r4, %r4, 1").replace("%p1, %r2", "%p1, %r4"))  # fmt: skip
    assert row.slots == alone.slots - 1 == row.longest_lane
    assert row.lane_slots == sum(row.longest_lane - 5 * (31 - lane) for lane in range(WARP))


def test_lanes_meet_within_a_loop(counting):
    """A branch in the body of a loop parts lanes for the branch alone, not for the rest of the loop."""
    odd = "and.b32 %r5, %r20, 1;\nsetp.eq.u32 %p2, %r5, 1;\n@%p2 bra $O;\nadd.u32 %r9, %r9, 1;\n$O:\n"
    body = "mov.u32 %r4, 16;\n" + spin("%r4", "1").replace("add.u32 %r3, %r3, 1;\n", odd)
    row = count(counting, body)
    assert row.slots == row.longest_lane, "even lanes do all that is to be done"
    assert row.lane_slots == WARP * row.slots - 16 * 16


def test_a_function_parts_lanes_until_it_returns(counting):
    function = (
        ".func f2(.param .b32 p)\n{\n.reg .pred %p<3>;\n.reg .b32 %r<5>;\nld.param.u32 %r1, [p];\n"
        "setp.lt.u32 %p1, %r1, 4;\n@%p1 ret;\n" + "add.u32 %r2, %r2, 1;\n" * 30 + "ret;\n}\n"
    )
    call = "{\n.param .b32 a;\nst.param.b32 [a], %r20;\ncall.uni f2, (a);\n}\n"
    text = function + kernel("f", THREAD + call + "add.u32 %r9, %r9, 1;\n" * 50, 1)
    counting.device.counts.start(l1_bytes=L1, l2_bytes=L2)
    assert counting.launch(text, "f", [counting.array(np.zeros(1, np.uint32))], block=WARP) == 0
    (row,) = counting.device.counts.stop()
    assert row.slots == row.longest_lane
    assert row.lane_slots == WARP * row.slots - 4 * 31


def test_a_warp_whose_lanes_wait_for_each_other_is_counted_as_any_other(counting):
    """Fibers run in turns; what they note is one warp's course all the same."""
    waits = "shfl.sync.bfly.b32 %r3, %r20, 16, 31, -1;\nbar.warp.sync -1;\n"
    alone, row = (count(counting, load(4) + "\n" + body + spin("%r20", "1"), grid=3) for body in ("", waits))
    assert (row.warps, row.loads, row.load_sectors) == (3, 3, 3 * 4)
    assert row.slots == alone.slots + 3 * 2
    assert row.lane_slots == alone.lane_slots + 3 * 2 * WARP


@pytest.mark.parametrize(("runs", "missed"), [(1, 128), (2, 128)])
def test_what_was_loaded_stays_in_the_second_cache(counting, runs, missed):
    row = count(counting, load(32), block=128, runs=runs)
    assert row.l1_misses == runs * missed, "each warp begins with an empty first cache"
    assert row.l2_misses == missed


def test_the_second_cache_forgets_what_does_not_fit(counting):
    row = count(counting, load(32), block=WARP, grid=64, words=64 * WARP * 8, runs=2, l2=16 << 10)
    assert row.l2_misses == 2 * 64 * WARP, "64 KiB in a row through 16 KiB"


def test_the_first_cache_serves_the_same_words_again(counting):
    row = count(counting, load(4) + "\n" + load(4) + "\nld.global.u32 %r10, [%rd2+4];")
    assert (row.loads, row.load_sectors, row.l1_misses) == (3, 4 + 4 + 5, 5)


@pytest.mark.parametrize(
    ("second", "rounds"),
    [
        ("ld.global.u32 %r10, [%rd2+4];", 1),
        ("mul.wide.u32 %rd3, %r9, 4;\nadd.s64 %rd4, %rd2, %rd3;\nld.global.u32 %r10, [%rd4];", 2),
    ],
    ids=["independent", "one after the other"],
)
def test_rounds_are_loads_that_wait_for_loads(counting, second, rounds):
    assert count(counting, load(4) + "\n" + second).rounds == rounds


@pytest.mark.parametrize("lanes", [1, 31, 33, 64])
def test_blocks_need_not_fill_warps(counting, lanes):
    row = count(counting, load(4), block=lanes)
    assert row.warps == -(-lanes // WARP)
    assert row.lane_slots == lanes * row.slots // row.warps


def test_guarded_instructions_take_their_slot(counting):
    never = count(counting, "setp.gt.u32 %p1, %r20, 99;\n@%p1 st.global.u32 [%rd20], %r20;")
    always = count(counting, "setp.lt.u32 %p1, %r20, 99;\n@%p1 st.global.u32 [%rd20], %r20;")
    assert never.slots == always.slots
    assert (never.stores, always.stores) == (0, 1)
