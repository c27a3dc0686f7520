"""PTX instructions against values computed by hand, from the rules of NVIDIA's PTX manual."""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass

import numpy as np
import pytest

from tests.emulated_cuda.ptx.ptx_function import UnsupportedPtx
from tests.emulated_cuda.ptx.ptx_module import PtxModule
from tests.emulated_cuda.small_ptx import HEAD, THREAD, PtxRunner, kernel

NAN = 0x7FC00000
NAN64 = 0x7FF8 << 48
IS_NAN = "NaN"


def f32(value: float) -> int:
    """Bits of a single."""
    return int.from_bytes(struct.pack("<f", value), "little")


def f64(value: float) -> int:
    """Bits of a double."""
    return int.from_bytes(struct.pack("<d", value), "little")


@dataclass(frozen=True)
class Case:
    """Instructions on inputs 0, 1, 2, which are in %r, %rd, %f and %d; the result is register 9 of a kind."""

    text: str
    inputs: tuple[int, ...]
    expected: int | str
    kind: str = "r"

    @property
    def name(self) -> str:
        """Words for the case."""
        return f"{self.text.split(';')[0].strip()}({', '.join(hex(each) for each in self.inputs)})"


def integers(name: str, *rows: tuple[tuple[int, ...], int]) -> list[Case]:
    """Cases of an instruction on words."""
    return [_case(name, "r", inputs, expected) for inputs, expected in rows]


def _case(name: str, kind: str, inputs: tuple[int, ...], expected: int | str) -> Case:
    operands = ", ".join(f"%{kind}{index}" for index in range(len(inputs)))
    return Case(f"{name} %{kind}9, {operands};", inputs, expected, kind)


def singles(name: str, *rows: tuple[tuple[int, ...], int | str]) -> list[Case]:
    """Cases of an instruction on singles, given by their bits."""
    return [_case(name, "f", inputs, expected) for inputs, expected in rows]


def converted(name: str, source: str, target: str, *rows: tuple[int, int]) -> list[Case]:
    """Cases of a conversion."""
    return [Case(f"{name} %{target}9, %{source}0;", (value,), expected, target) for value, expected in rows]


def compared(name: str, source: str, *rows: tuple[tuple[int, int], int]) -> list[Case]:
    """Cases of a comparison."""
    text = f"{name} %p1, %{source}0, %{source}1; selp.u32 %r9, 1, 0, %p1;"
    return [Case(text, inputs, expected) for inputs, expected in rows]


ONES = 0xFFFFFFFF
LONG_ONES = 2**64 - 1
TOP = 0x80000000
INTEGERS = [
    *integers("add.s32", ((0x7FFFFFFF, 1), TOP)),
    *integers("add.sat.s32", ((0x7FFFFFFF, 1), 0x7FFFFFFF), ((5, ONES), 4)),
    *integers("sub.sat.s32", ((TOP, 1), TOP)),
    Case("add.cc.u32 %r8, %r0, 1; addc.u32 %r9, %r1, %r2;", (ONES, 1, 2), 4),
    Case("add.cc.u32 %r8, %r0, 1; addc.cc.u32 %r7, %r1, %r2; addc.u32 %r9, 0, 0;", (ONES, ONES, 0), 1),
    Case("sub.cc.u32 %r8, %r0, 1; subc.u32 %r9, %r1, %r2;", (0, 5, 2), 2),
    Case("add.cc.u64 %rd8, %rd0, 1; addc.u64 %rd9, %rd1, %rd2;", (LONG_ONES, 1, 2), 4, "rd"),
    Case("mad.lo.cc.u32 %r8, %r0, %r1, %r2; madc.hi.u32 %r9, %r0, %r1, 0;", (ONES, ONES, ONES), ONES),
    *integers("mul.lo.s32", ((ONES, 3), ONES - 2)),
    *integers("mul.hi.s32", ((ONES, 2), ONES)),
    *integers("mul.hi.u32", ((ONES, 2), 1)),
    *integers("mad.lo.s32", ((3, 4, 5), 17)),
    Case("mul.wide.s32 %rd9, %r0, %r1;", (ONES, 2), LONG_ONES - 1, "rd"),
    Case("mad.wide.u32 %rd9, %r0, %r1, %rd2;", (ONES, 2, 1), 0x1FFFFFFFF, "rd"),
    _case("mul.hi.u64", "rd", (LONG_ONES, 2), 1),
    *integers("div.s32", ((ONES - 6, 2), ONES - 2), ((TOP, ONES), TOP)),
    *integers("rem.s32", ((ONES - 6, 2), ONES)),
    *integers("div.u32", ((ONES, 2), 0x7FFFFFFF)),
    *integers("shl.b32", ((1, 31), TOP), ((1, 32), 0), ((1, 0x100), 0)),
    *integers("shr.u32", ((TOP, 31), 1), ((TOP, 32), 0)),
    *integers("shr.s32", ((TOP, 31), ONES), ((TOP, 99), ONES), ((1, 99), 0)),
    Case("shl.b64 %rd9, %rd0, %r1;", (1, 64), 0, "rd"),
    Case("shl.b64 %rd9, %rd0, %r1;", (1, 63), 1 << 63, "rd"),
    *integers("shf.l.wrap.b32", ((TOP, 1, 33), 3)),
    *integers("shf.r.clamp.b32", ((5, 7, 40), 7), ((4, 1, 1), TOP | 2)),
    Case("bfe.u32 %r9, %r0, %r1, %r2;", (0x12345678, 8, 12), 0x456),
    Case("bfe.u32 %r9, %r0, %r1, %r2;", (ONES, 32, 4), 0),
    Case("bfe.s32 %r9, %r0, %r1, %r2;", (0xF000, 12, 4), ONES),
    Case("bfe.s32 %r9, %r0, %r1, %r2;", (TOP, 28, 32), ONES - 7),
    Case("bfe.s32 %r9, %r0, %r1, %r2;", (TOP, 40, 4), ONES),
    Case("bfe.u64 %rd9, %rd0, %r1, %r2;", (LONG_ONES, 60, 10), 15, "rd"),
    Case("bfi.b32 %r9, %r0, %r1, 4, 4;", (0xFF, 0), 0xF0),
    Case("bfi.b32 %r9, %r0, %r1, 32, 4;", (0xFF, 7), 7),
    *integers("brev.b32", ((1,), TOP), ((0x0000F001,), 0x800F0000)),
    _case("brev.b64", "rd", (1,), 1 << 63),
    *integers("popc.b32", ((0xFFFF0001,), 17)),
    Case("popc.b64 %r9, %rd0;", (LONG_ONES,), 64),
    *integers("clz.b32", ((0,), 32), ((1,), 31)),
    Case("clz.b64 %r9, %rd0;", (0,), 64),
    *integers("bfind.u32", ((0x80,), 7), ((0,), ONES)),
    *integers("bfind.s32", ((ONES,), ONES), ((ONES - 1,), 0)),
    *integers("bfind.shiftamt.u32", ((1,), 31)),
    *integers("prmt.b32", ((0x03020100, 0x07060504, 0x0123), 0x00010203), ((0x80, 0x44332211, 0x4889), 0x11FFFF00)),
    Case("lop3.b32 %r9, %r0, %r1, %r2, 0x96;", (0b1100, 0b1010, 0b0110), 0),
    Case("lop3.b32 %r9, %r0, %r1, %r2, 0xE8;", (0b1100, 0b1010, 0b0110), 0b1110),
    Case("lop3.b32 %r9, %r0, %r1, %r2, 0xCA;", (0b1100, 0b1010, 0b0110), 0b1010),
    *integers("min.s32", ((ONES, 1), ONES)),
    *integers("max.u32", ((ONES, 1), ONES)),
    *integers("abs.s32", ((ONES,), 1), ((TOP,), TOP)),
    *integers("neg.s32", ((1,), ONES)),
    *integers("not.b32", ((0xF,), 0xFFFFFFF0)),
    Case("slct.u32.s32 %r9, %r0, %r1, %r2;", (1, 2, ONES), 2),
    Case("mov.b64 %rd9, {%r0, %r1};", (1, 2), (2 << 32) | 1, "rd"),
    Case("mov.b64 {%r8, %r9}, %rd0;", ((5 << 32) | 1,), 5),
    Case("mov.u32 %r9, 7; setp.eq.u32 %p1, %r0, 3; @!%p1 mov.u32 %r9, 9;", (3,), 7),
    Case("setp.gt.and.s32 %p1|%p2, %r0, %r1, 1; selp.u32 %r9, 1, 0, %p2;", (1, 2), 1),
    Case("set.gt.s32.s32 %r9, %r0, %r1;", (3, 2), ONES),
    *converted("cvt.s32.s8", "r", "r", (0x180, 0xFFFFFF80)),
    *converted("cvt.u32.u8", "r", "r", (0x1FF, 0xFF)),
    *converted("cvt.s64.s32", "r", "rd", (ONES, LONG_ONES)),
    *converted("cvt.sat.u8.s32", "r", "r", (300, 255), (ONES, 0)),
    *converted("cvt.sat.s8.s32", "r", "r", (-300 & ONES, 0xFFFFFF80), (100, 100)),
    *compared("setp.lt.u32", "r", ((1, ONES), 1)),
    *compared("setp.lt.s32", "r", ((1, ONES), 0)),
]
ONE_THIRD = 0x3EAAAAAB
FLOATS = [
    # 1 + 2^-12 squared is 1 + 2^-11 + 2^-24, of which rounding leaves nothing after the product
    *singles("fma.rn.f32", ((0x3F800800, 0x3F800800, 0xBF801000), f32(2.0**-24))),
    Case("mul.rn.f32 %f8, %f0, %f0; add.rn.f32 %f9, %f8, %f1;", (0x3F800800, 0xBF801000), 0, "f"),
    *singles("add.rn.f32", ((f32(1.0), f32(2.0**-30)), f32(1.0))),
    *singles("add.rp.f32", ((f32(1.0), f32(2.0**-30)), 0x3F800001)),
    *singles("add.rm.f32", ((f32(-1.0), f32(-(2.0**-30))), 0xBF800001)),
    *singles("add.rz.f32", ((f32(-1.0), f32(-(2.0**-30))), f32(-1.0))),
    *singles("div.rn.f32", ((f32(1.0), f32(3.0)), ONE_THIRD)),
    *singles("div.rm.f32", ((f32(1.0), f32(3.0)), ONE_THIRD - 1)),
    *singles("rcp.rn.f32", ((f32(3.0),), ONE_THIRD)),
    *singles("sqrt.rn.f32", ((f32(2.0),), 0x3FB504F3)),
    *singles("rsqrt.approx.f32", ((f32(4.0),), f32(0.5))),
    *singles("ex2.approx.f32", ((f32(3.0),), f32(8.0))),
    *singles("lg2.approx.f32", ((f32(8.0),), f32(3.0))),
    *singles("min.f32", ((NAN, f32(1.0)), f32(1.0)), ((0, TOP), TOP), ((TOP, 0), TOP)),
    *singles("max.f32", ((f32(1.0), NAN), f32(1.0)), ((0, TOP), 0), ((TOP, 0), 0), ((NAN, NAN), IS_NAN)),
    *singles("min.NaN.f32", ((NAN, f32(1.0)), IS_NAN), ((f32(2.0), f32(1.0)), f32(1.0))),
    _case("max.f64", "d", (NAN64, f64(-2.0)), f64(-2.0)),
    *singles("add.sat.f32", ((f32(0.75), f32(0.5)), f32(1.0)), ((NAN, 0), 0), ((f32(-1.0), 0), 0)),
    *singles("mul.ftz.f32", ((f32(2.0**-100), f32(2.0**-30)), 0)),
    *singles("mul.f32", ((f32(2.0**-100), f32(2.0**-30)), f32(2.0**-130))),
    *singles("copysign.f32", ((f32(-2.0), f32(3.0)), f32(-3.0))),
    *singles("abs.f32", ((f32(-2.0),), f32(2.0))),
    *singles("neg.f32", ((0,), TOP)),
    _case("fma.rn.f64", "d", (f64(1 + 2.0**-30), f64(1 + 2.0**-30), f64(-1 - 2.0**-29)), f64(2.0**-60)),
    *converted("cvt.rzi.s32.f32", "f", "r", (f32(-1.9), ONES), (NAN, 0), (f32(3e9), 0x7FFFFFFF), (f32(-3e9), TOP)),
    *converted("cvt.rni.s32.f32", "f", "r", (f32(2.5), 2), (f32(3.5), 4)),
    *converted("cvt.rmi.s32.f32", "f", "r", (f32(-1.1), ONES - 1)),
    *converted("cvt.rpi.s32.f32", "f", "r", (f32(1.1), 2)),
    *converted("cvt.rzi.u32.f32", "f", "r", (f32(-1.0), 0), (f32(5e9), ONES)),
    *converted("cvt.rzi.u8.f32", "f", "r", (f32(300.0), 255)),
    *converted("cvt.rzi.s64.f32", "f", "rd", (NAN, 1 << 63), (f32(-1.0), LONG_ONES)),
    *converted("cvt.rzi.s32.f64", "d", "r", (NAN64, TOP), (f64(-1.5), ONES)),
    *converted("cvt.rn.f32.s32", "r", "f", (16777217, f32(16777216.0))),
    *converted("cvt.rp.f32.s32", "r", "f", (16777217, f32(16777218.0))),
    *converted("cvt.rn.f32.f64", "d", "f", (f64(1 + 2.0**-30), f32(1.0))),
    *converted("cvt.rzi.f32.f32", "f", "f", (f32(-1.9), f32(-1.0))),
    *converted("cvt.sat.f32.f32", "f", "f", (f32(2.0), f32(1.0)), (NAN, 0)),
    *converted("cvt.f64.f32", "f", "d", (f32(0.5), f64(0.5))),
    *compared("setp.lt.f32", "f", ((NAN, 0), 0)),
    *compared("setp.ltu.f32", "f", ((NAN, 0), 1), ((f32(1.0), 0), 0)),
    *compared("setp.ne.f32", "f", ((NAN, NAN), 0)),
    *compared("setp.neu.f32", "f", ((NAN, NAN), 1), ((0, TOP), 0)),
    *compared("setp.nan.f32", "f", ((NAN, 0), 1)),
    *compared("setp.num.f32", "f", ((f32(1.0), 0), 1)),
    Case("testp.subnormal.f32 %p1, %f0; selp.u32 %r9, 1, 0, %p1;", (1,), 1),
]
CASES = INTEGERS + FLOATS
LOADS = "".join(
    f"ld.global.u32 %r{k}, [%rd20+{8 * k}]; ld.global.u64 %rd{k}, [%rd20+{8 * k}]; "
    f"ld.global.f32 %f{k}, [%rd20+{8 * k}]; ld.global.f64 %d{k}, [%rd20+{8 * k}];\n"
    for k in range(3)
)
STORES = {"r": "b32", "rd": "b64", "f": "f32", "d": "f64"}


@functools.cache
def all_cases() -> str:
    """One module with a kernel for each case."""
    return "".join(
        kernel(f"case{k}", f"{LOADS}{case.text}\nst.global.{STORES[case.kind]} [%rd21], %{case.kind}9;")
        for k, case in enumerate(CASES)
    )


@pytest.fixture
def results(ptx: PtxRunner) -> list[int]:
    """What each case gives."""
    found = []
    for index, case in enumerate(CASES):
        values = np.array([*case.inputs, 0, 0, 0][:3], np.uint64)
        low, high = ptx.run(all_cases(), f"case{index}", values, 2)
        found.append(int(low) | int(high) << 32)
    return found


def test_instructions_give_what_the_manual_says(results):
    wrong = []
    for case, value in zip(CASES, results, strict=True):
        is_nan = value & 0x7F800000 == 0x7F800000 and value & 0x7FFFFF
        if not (is_nan if case.expected == IS_NAN else value == case.expected):
            wrong.append(f"{case.name}: {value:#x}, not {case.expected}")
    assert wrong == []


MEMORY = kernel(
    "vectors",
    "ld.global.v4.f32 {%f0, %f1, %f2, %f3}, [%rd20];\nst.global.v4.f32 [%rd21], {%f3, %f2, %f1, %f0};\n"
    "ld.global.v2.u64 {%rd1, %rd2}, [%rd20];\nst.global.v2.u64 [%rd21+16], {%rd2, %rd1};",
) + kernel(
    "locals",
    ".local .align 8 .b8 stack[32];\nmov.u64 %rd1, stack;\ncvta.local.u64 %rd2, %rd1;\nld.global.u32 %r1, [%rd20];\n"
    "st.u32 [%rd2+4], %r1;\nld.local.u32 %r2, [stack+4];\nst.global.u32 [%rd21], %r2;",
) + (
    ".func (.param .b32 result) twice(.param .b32 value)\n{\n.reg .b32 %r<3>;\nld.param.u32 %r1, [value];\n"
    "add.s32 %r2, %r1, %r1;\nst.param.b32 [result], %r2;\nret;\n}\n"
) + kernel(
    "calls",
    "ld.global.u32 %r1, [%rd20];\n{\n.param .b32 argument;\nst.param.b32 [argument], %r1;\n.param .b32 answer;\n"
    "call.uni (answer), twice, (argument);\nld.param.b32 %r2, [answer];\n}\nst.global.u32 [%rd21], %r2;",
) + kernel(
    "atomics",
    f"{THREAD}atom.global.add.u32 %r1, [%rd21], %r23;\nred.global.max.u32 [%rd21+4], %r23;\n"
    "atom.global.inc.u32 %r2, [%rd21+8], 9;\natom.global.cas.b32 %r3, [%rd21+12], %r23, 100;\n"
    "atom.global.exch.b32 %r4, [%rd21+16], 5;\nred.global.or.b32 [%rd21+20], %r23;\n"
    "red.global.add.f32 [%rd21+24], 0f3F000000;\natom.global.min.s32 %r5, [%rd21+28], -4;\n",
) + (
    ".global .align 4 .u32 table[3] = {5, 6, 7};\n"
) + kernel(
    "variables",
    "mov.u64 %rd1, table;\ncvta.global.u64 %rd2, %rd1;\nld.global.u32 %r1, [%rd2+8];\nst.global.u32 [%rd21], %r1;",
) + kernel(
    "loops", "mov.u32 %r1, 0;\nmov.u32 %r2, 0;\n$L1:\nadd.s32 %r2, %r2, %r1;\nadd.s32 %r1, %r1, 1;\n"
    "setp.lt.s32 %p1, %r1, 10;\n@%p1 bra $L1;\nst.global.u32 [%rd21], %r2;"
)  # fmt: skip


def test_vectors_are_loaded_and_stored(ptx):
    values = np.array([1, 2, 3, 4], np.float32)
    out = ptx.run(MEMORY, "vectors", values, 8).view(np.float32)
    assert out.tolist() == [4, 3, 2, 1, 3, 4, 1, 2]


def test_a_thread_has_memory_of_its_own_and_calls_functions(ptx):
    assert ptx.run(MEMORY, "locals", np.array([17], np.uint32), 1)[0] == 17
    assert ptx.run(MEMORY, "calls", np.array([17], np.uint32), 1)[0] == 34


def test_variables_of_a_module_and_loops(ptx):
    assert ptx.run(MEMORY, "variables", np.zeros(1, np.uint32), 1)[0] == 7
    assert ptx.run(MEMORY, "loops", np.zeros(1, np.uint32), 1)[0] == 45


@pytest.mark.parametrize("seed", [0, 7])
def test_atomics_of_all_threads_count(ptx, seed):
    ptx.device.seed = seed
    out = ptx.run(MEMORY, "atomics", np.zeros(1, np.uint32), 8, grid=2, block=16)
    assert out[0] == sum(range(32))
    assert out[1] == 31
    assert out[2] == 32 % 10  # counts to nine and begins anew
    assert out[3] == 100  # thread 0 found 0
    assert out[4] == 5
    assert out[5] == 31
    assert out[6:7].view(np.float32)[0] == 16.0
    assert out[7:8].view(np.int32)[0] == -4


def test_what_is_not_known_is_a_problem_of_its_kernel_only():
    module = PtxModule(HEAD + kernel("bad", "wgmma.fence.sync;") + kernel("good", "mov.u32 %r1, 0;"))
    text = module.translate()
    assert set(module.problems) == {"bad"}
    assert "wgmma" in module.problems["bad"]
    assert "k_good" in text
    assert "k_bad" not in text
    assert issubclass(UnsupportedPtx, Exception)
