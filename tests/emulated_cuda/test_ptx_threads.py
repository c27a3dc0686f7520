"""Threads that wait for each other: barriers, shuffles, votes, and deadlocks, in any order of threads."""

from __future__ import annotations

import numpy as np
import pytest

from tests.emulated_cuda.small_ptx import THREAD, PtxRunner, kernel

NOTHING = np.zeros(1, np.uint32)
ADDRESS = "mul.wide.u32 %rd1, %r23, 4;\nadd.s64 %rd2, %rd21, %rd1;\n"
STORE = f"{ADDRESS}st.global.u32 [%rd2], %r9;"
SHARED = ".shared .align 4 .b8 board[256];\n"
NEIGHBOUR = SHARED + kernel(
    "neighbour",
    f"{THREAD}mov.u32 %r1, board;\nmad.lo.s32 %r2, %r20, 4, %r1;\nst.shared.u32 [%r2], %r20;\nbar.sync 0;\n"
    "add.s32 %r3, %r20, 1;\nrem.u32 %r3, %r3, %r22;\nmad.lo.s32 %r4, %r3, 4, %r1;\nld.shared.u32 %r9, [%r4];\n" + STORE,
)
EARLY = kernel("early", f"{THREAD}setp.gt.u32 %p1, %r20, 7;\n@%p1 ret;\nbar.sync 0;\nmov.u32 %r9, 1;\n{STORE}")
DEADLOCK = kernel(
    "deadlock",
    f"{THREAD}setp.eq.u32 %p1, %r20, 3;\n@%p1 bra $L1;\nbar.sync 0;\nbra $L2;\n$L1:\nbar.sync 1;\n$L2:\n"
    f"mov.u32 %r9, 1;\n{STORE}",
)
LANE_AT_BARRIER = kernel(
    "lane",
    f"{THREAD}setp.eq.u32 %p1, %r20, 3;\n@%p1 bar.sync 0;\nshfl.sync.idx.b32 %r9, %r20, 0, 31, -1;\n{STORE}",
)
IN_A_FUNCTION = (
    ".func meet()\n{\nbar.sync 0;\nret;\n}\n"
    + SHARED
    + kernel(
        "function",
        f"{THREAD}mov.u32 %r1, board;\nmad.lo.s32 %r2, %r20, 4, %r1;\nst.shared.u32 [%r2], %r20;\ncall.uni meet;\n"
        "xor.b32 %r3, %r20, 1;\nmad.lo.s32 %r4, %r3, 4, %r1;\nld.shared.u32 %r9, [%r4];\n" + STORE,
    )
)


def one(name: str, instruction: str) -> str:
    """A kernel that stores %r9 of each thread."""
    return kernel(name, f"{THREAD}{instruction}\n{STORE}")


def run(ptx: PtxRunner, text: str, name: str, block: int, grid: int = 1) -> list[int]:
    """What each thread stores."""
    return ptx.run(text, name, NOTHING, grid * block, grid=grid, block=block).tolist()


@pytest.fixture(params=[0, 5])
def runner(ptx, request):
    """Runs PTX, with threads in two orders."""
    ptx.device.seed = request.param
    return ptx


def test_after_a_barrier_all_have_written(runner):
    expected = [(k + 1) % 48 for k in range(48)]
    assert run(runner, NEIGHBOUR, "neighbour", 48, grid=2) == expected * 2


def test_a_barrier_in_a_function_holds_for_its_callers(runner):
    assert run(runner, IN_A_FUNCTION, "function", 8) == [k ^ 1 for k in range(8)]


def test_threads_that_have_ended_are_not_waited_for(runner):
    assert run(runner, EARLY, "early", 16) == [1] * 8 + [0] * 8


@pytest.mark.parametrize(("text", "name"), [(DEADLOCK, "deadlock"), (LANE_AT_BARRIER, "lane")])
def test_threads_at_different_barriers_are_a_fault(runner, text, name):
    out = runner.array(np.zeros(8, np.uint32))
    assert runner.launch(text, name, [0, out], block=8) == 719
    assert "deadlock" in runner.device.faults.violations[0][0]


SHUFFLES = [
    ("idx", "shfl.sync.idx.b32 %r9, %r20, 3, 31, -1;", [3] * 32),
    ("idx_of_eight", "shfl.sync.idx.b32 %r9, %r20, 1, 6175, -1;", [k // 8 * 8 + 1 for k in range(32)]),
    ("down", "shfl.sync.down.b32 %r9|%p1, %r20, 4, 31, -1;", [min(k + 4, 31) if k + 4 < 32 else k for k in range(32)]),
    ("up", "shfl.sync.up.b32 %r9, %r20, 1, 0, -1;", [max(k - 1, 0) for k in range(32)]),
    ("bfly", "shfl.sync.bfly.b32 %r9, %r20, 16, 31, -1;", [k ^ 16 for k in range(32)]),
    ("in_range", "shfl.sync.down.b32 %r1|%p1, %r20, 4, 31, -1; selp.u32 %r9, 1, 0, %p1;", [1] * 28 + [0] * 4),
]
VOTES = [
    ("any", "setp.eq.u32 %p1, %r20, 5; vote.sync.any.pred %p2, %p1, -1; selp.u32 %r9, 1, 0, %p2;", [1] * 32),
    ("all", "setp.lt.u32 %p1, %r20, 31; vote.sync.all.pred %p2, %p1, -1; selp.u32 %r9, 1, 0, %p2;", [0] * 32),
    ("uni", "setp.lt.u32 %p1, %r20, 99; vote.sync.uni.pred %p2, %p1, -1; selp.u32 %r9, 1, 0, %p2;", [1] * 32),
    ("ballot", "setp.lt.u32 %p1, %r20, 3; vote.sync.ballot.b32 %r9, %p1, -1;", [7] * 32),
]
HALF = (
    "mov.u32 %r9, 0; setp.gt.u32 %p3, %r20, 15; @%p3 bra $L1; setp.gt.u32 %p1, %r20, 13; "
    "vote.sync.ballot.b32 %r9, %p1, 65535;\n$L1:\nbar.sync 0;"
)


@pytest.mark.parametrize(("name", "instruction", "expected"), SHUFFLES + VOTES, ids=lambda value: str(value)[:12])
def test_lanes_of_a_warp_exchange(runner, name, instruction, expected):
    assert run(runner, one(name, instruction), name, 32) == expected


def test_some_lanes_vote_while_the_others_wait_elsewhere(runner):
    assert run(runner, one("half", HALF), "half", 32) == [0xC000] * 16 + [0] * 16
