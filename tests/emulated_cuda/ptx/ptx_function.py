"""One function of a PTX module as C: registers are typed locals, a call of the C function is one thread."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from tests.emulated_cuda.ptx.control_flow import ControlFlow

C_TYPES = {
    "b8": "uint8_t", "u8": "uint8_t", "s8": "int8_t", "b16": "uint16_t", "u16": "uint16_t", "s16": "int16_t",
    "b32": "uint32_t", "u32": "uint32_t", "s32": "int32_t", "b64": "uint64_t", "u64": "uint64_t", "s64": "int64_t",
    "f32": "float", "f64": "double", "pred": "uint8_t", "f16": "uint16_t",
}  # fmt: skip
SIZES = {name: 1 if name == "pred" else int(name[1:]) // 8 for name in C_TYPES}
"""Bytes of a value of each PTX type."""
UNSIGNED = {1: "uint8_t", 2: "uint16_t", 4: "uint32_t", 8: "uint64_t"}
SPECIAL = {
    **{f"%{n}.{a}": f"c->{n}[{i}]" for n in ("tid", "ntid", "ctaid", "nctaid") for i, a in enumerate("xyz")},
    "%laneid": "(c->tid[0] & 31u)", "%warpid": "(c->tid[0] >> 5)", "%nwarpid": "((c->ntid[0] + 31) >> 5)",
    "WARP_SZ": "32u", "%clock": "0u", "%clock64": "0ull", "%globaltimer": "0ull", "%smid": "0u", "%nsmid": "1u",
    "%lanemask_lt": "((1u << (c->tid[0] & 31u)) - 1)", "%lanemask_eq": "(1u << (c->tid[0] & 31u))",
    "%lanemask_le": "((2u << (c->tid[0] & 31u)) - 1)", "%lanemask_gt": "(~((2u << (c->tid[0] & 31u)) - 1))",
    "%lanemask_ge": "(~((1u << (c->tid[0] & 31u)) - 1))", "%dynamic_smem_size": "c->smem_dynamic",
    "%total_smem_size": "(c->smem_static + c->smem_dynamic)", "%gridid": "0ull",
}  # fmt: skip
"""Special registers as C expressions of the thread's context `c`."""
PTX_CHARACTERS = {"%": "", "$": "D_", ".": "_"}
MODULE_SPACES = ("param", "local", "module")
"""Spaces of symbols that the host's own memory stands for."""

Parameter = tuple[str, int, int]
"""Name, bytes and alignment of a parameter or result."""


class UnsupportedPtx(Exception):
    """The translator does not know an instruction, operand or directive."""


def c_name(name: str) -> str:
    """A PTX name as an identifier of C."""
    return re.sub(r"[^A-Za-z0-9_]", lambda match: PTX_CHARACTERS.get(match.group(), "_"), name)


def split_operands(text: str) -> list[str]:
    """Operands at commas that lie in no bracket."""
    parts, depth, current = [], 0, ""
    for character in text:
        depth += (character in "{[(") - (character in "}])")
        if character == "," and depth == 0:
            parts.append(current.strip())
            current = ""
        else:
            current += character
    return [*parts, current.strip()] if current.strip() else parts


@dataclass(frozen=True)
class Instruction:
    """An instruction without its guard, such as `add.f32 %f1, %f2, %f3`.

    Attributes:
        name: first word, `add`.
        modifiers: words after it, types included.
        operands: as written.
        type: last modifier that is a type, or the empty text.
        text: the whole instruction.
    """

    name: str
    modifiers: tuple[str, ...]
    operands: tuple[str, ...]
    type: str
    text: str

    @classmethod
    def parse(cls, text: str) -> Instruction:
        """Split an instruction into its parts."""
        name, _, rest = re.sub(r"\s+", " ", text).partition(" ")
        word, *modifiers = name.split(".")
        kind = next((each for each in reversed(modifiers) if each in C_TYPES), "")
        return cls(word, tuple(modifiers), tuple(split_operands(rest)), kind, text)

    def has(self, *modifiers: str) -> bool:
        """Whether it has one of the modifiers."""
        return any(each in self.modifiers for each in modifiers)

    def one_of(self, *modifiers: str) -> str:
        """The first of its modifiers that is one of these, or the empty text."""
        return next((each for each in self.modifiers if each in modifiers), "")

    @property
    def is_float(self) -> bool:
        """Whether it computes in floating point."""
        return self.type in ("f32", "f64")


class Symbols(Protocol):
    """What a function asks its module."""

    shared_symbols: dict[str, int]
    globals: dict[str, tuple[int, str, bool, int, str]]
    used: set[str]
    functions: dict[str, tuple[list[Parameter], list[Parameter]]]
    extern: set[str]
    flow: ControlFlow

    def add_shared(self, name: str, size: int, alignment: int) -> None:
        """Reserve shared memory of a block."""

    def shared_offset(self, name: str) -> str:
        """C expression of a symbol's place in shared memory."""


Handler = Callable[["Function", Instruction], None]


class Function:
    """The C text of one `.entry` or `.func`.

    Attributes:
        out: C statements so far.
        barrier: whether threads of a block wait for each other in it.
        line: line of the PTX text that is being translated.
    """

    def __init__(self, unit: Symbols, name: str, params: list[Parameter], results: list[Parameter]) -> None:
        self.unit, self.name = unit, name
        self.register_scopes: list[dict[str, str]] = [{}]
        self.symbol_scopes: list[dict[str, str]] = [{}]
        self.out: list[str] = []
        self.barrier = False
        self.line = 0
        for index, (symbol, _, _) in enumerate(params):
            self.symbol_scopes[0][symbol] = f"P[{index}]"
        for index, (symbol, _, _) in enumerate(results):
            self.symbol_scopes[0][symbol] = f"R[{index}]"

    def register_type(self, name: str) -> str:
        """PTX type of a register, or the empty text where there is none of this name."""
        return next((scope[name] for scope in reversed(self.register_scopes) if name in scope), "")

    def symbol(self, name: str) -> tuple[str, str] | None:
        """C expression of a symbol's address, and its space."""
        for scope in reversed(self.symbol_scopes):
            if name in scope:
                value = scope[name]
                if value.startswith(("P[", "R[")):
                    return f"(uint64_t){value}", "param"
                if value.startswith("S:"):
                    return value[2:], "shared"
                return f"(uint64_t){c_name(name)}", value
        if name in self.unit.shared_symbols:
            return self.unit.shared_offset(name), "shared"
        if name in self.unit.globals:
            self.unit.used.add(name)
            return f"(uint64_t)&{c_name('g_' + name)}", "module"
        if name in self.unit.functions or name in self.unit.extern:
            return f"(uint64_t)&{c_name('f_' + name)}", "code"
        return None

    def read(self, operand: str, kind: str) -> str:
        """C expression of an operand as a value of a PTX type."""
        operand = operand.strip()
        c_type = C_TYPES[kind]
        if operand in SPECIAL:
            return f"(({c_type}){SPECIAL[operand]})"
        if operand.startswith("!"):
            return f"(!{self.read(operand[1:], kind)})"
        if operand.startswith("-%"):
            return f"(-{self.read(operand[1:], kind)})"
        register = self.register_type(operand)
        if register:
            return _as_type(c_name("r_" + operand), register, kind)
        constant = _constant(operand, kind)
        if constant:
            return constant
        match = re.fullmatch(r"([^\s+]+)\s*\+\s*(-?\d+)", operand)
        found = self.symbol(match[1]) if match and not match[1].startswith("%") else self.symbol(operand)
        if not found:
            raise UnsupportedPtx(f"operand {operand!r} in {self.name}")
        return f"(({c_type})({found[0]} + {match[2]}))" if match else f"(({c_type}){found[0]})"

    def write(self, operand: str, kind: str, value: str) -> None:
        """Assign a value of a PTX type to a register."""
        operand = operand.strip()
        if operand == "_":
            self.out.append(f"(void)({value});")
            return
        register = self.register_type(operand)
        if not register:
            raise UnsupportedPtx(f"destination {operand!r}")
        name = c_name("r_" + operand)
        if register == "pred":
            self.out.append(f"{name} = !!({value});")
        elif register in ("f32", "f64"):
            if kind in ("f32", "f64") and kind != register:
                raise UnsupportedPtx(f"{operand}: {kind} into {register}")
            bits, convert = ("b32", "BF") if register == "f32" else ("b64", "BD")
            self.out.append(
                f"{name} = {value};" if kind == register else f"{name} = {convert}(({C_TYPES[bits]})({value}));"
            )
        elif kind in ("f32", "f64"):
            self.out.append(f"{name} = {'FB' if kind == 'f32' else 'DB'}({value});")
        else:
            self.out.append(f"{name} = ({C_TYPES[register]})({C_TYPES[kind]})({value});")

    def result(self, instruction: Instruction, value: str, kind: str = "") -> None:
        """Assign what an instruction computes to its first operand, flushed and saturated as its modifiers say."""
        kind = kind or instruction.type
        if kind == "f32" and instruction.has("ftz"):
            value = f"ftz({value})"
        if kind in ("f32", "f64") and instruction.has("sat"):
            value = f"sat{'F' if kind == 'f32' else 'D'}({value})"
        self.write(instruction.operands[0], kind, value)

    def address(self, operand: str) -> tuple[str, str]:
        """C expression of an address in brackets, and the space of its symbol or the empty text."""
        inner = operand.strip()[1:-1].strip()
        match = re.fullmatch(r"(.+?)\s*\+\s*(-?(?:0[xX][0-9a-fA-F]+|\d+))", inner)
        base, offset = (match[1].strip(), int(match[2], 0)) if match else (inner, 0)
        space = ""
        if base.startswith("%"):
            text = self.read(base, "u64" if self.register_type(base) in ("b64", "u64", "s64") else "u32")
        elif re.fullmatch(r"\d+|0x[0-9a-fA-F]+", base):
            text = f"{int(base, 0)}ull"
        else:
            found = self.symbol(base)
            if not found:
                raise UnsupportedPtx(f"address {operand}")
            text, space = found
        if offset:
            text = f"({text} + {offset})" if offset > 0 else f"({text} - {-offset})"
        return text, space

    def pointer(self, operand: str, space: str, size: int, access: int) -> str:
        """C expression of the host's pointer to `size` bytes; access 0 reads, 1 writes, 2 is atomic."""
        text, own = self.address(operand)
        if "shared" in (own, space):
            return f"(c->smem + (uint32_t)({text}))"
        if own in MODULE_SPACES or space in ("local", "param", "const"):
            return f"((void *)({text}))"
        return f"{'GP' if space == 'global' else 'GN'}(c, {text}, {size}, {self.line}, {access})"

    def statement(self, text: str, handlers: dict[str, Handler]) -> None:
        """Translate an instruction with its guard."""
        match = re.match(r"@(!?)(%[\w.]+)\s+(.*)", text, re.DOTALL)
        instruction = Instruction.parse(match[3] if match else text)
        if instruction.name not in handlers:
            raise UnsupportedPtx(text[:120])
        start = len(self.out)
        handlers[instruction.name](self, instruction)
        if match:
            body = " ".join(self.out[start:])
            del self.out[start:]
            self.out.append(f"if ({match[1]}{c_name('r_' + match[2])}) {{ {body} }}")
        ends = self.unit.flow.add(
            instruction.name, instruction.modifiers, instruction.operands, match[2] if match else ""
        )
        if ends:
            self.begin_block()

    def begin_block(self, label: str = "") -> None:
        """Begin a block of instructions, at a label if it has one: its number is noted where warps are counted."""
        self.out.append(f"B(c, {self.unit.flow.begin_block(label)});")

    def directive(self, text: str) -> None:
        """Translate a declaration in a body."""
        match = re.match(r"\.reg\s+\.(\w+)\s+(.*)", text, re.DOTALL)
        if match:
            for item in match[2].split(","):
                self._registers(match[1], item.strip())
            return
        match = re.match(r"\.(local|param|shared)\s+(?:\.align\s+(\d+)\s+)?\.(\w+)\s+([\w$%.]+)\s*(?:\[(\d+)\])?", text)
        if match:
            space, alignment, kind, name, count = match.groups()
            size = SIZES[kind] * int(count or 1)
            if space == "shared":
                self.unit.add_shared(name, size, int(alignment or SIZES[kind]))
                self.symbol_scopes[-1][name] = f"S:{self.unit.shared_offset(name)}"
            else:
                self.symbol_scopes[-1][name] = "local"
                aligned = max(int(alignment or 1), 8)
                self.out.append(f"char {c_name(name)}[{size}] __attribute__((aligned({aligned})));")
        elif not text.startswith((".loc", ".pragma", ".file", ".maxntid", ".minnctapersm", ".branchtargets")):
            raise UnsupportedPtx(text[:100])

    def _registers(self, kind: str, item: str) -> None:
        ranged = re.fullmatch(r"(%[\w$]+)<(\d+)>", item)
        names = [f"{ranged[1]}{index}" for index in range(int(ranged[2]))] if ranged else [item]
        self.register_scopes[-1].update(dict.fromkeys(names, kind))
        declared = [f"{c_name('r_' + name)} = 0" for name in names]
        for first in range(0, len(declared), 40):
            self.out.append(f"{C_TYPES[kind]} {', '.join(declared[first : first + 40])};")


def _as_type(name: str, register: str, kind: str) -> str:
    """C expression of a register of one type as a value of another; bits stay."""
    c_type = C_TYPES[kind]
    if register in ("f32", "f64"):
        if kind == register:
            return name
        if kind in ("f32", "f64"):
            raise UnsupportedPtx(f"{name}: {register} read as {kind}")
        return f"(({c_type})FB({name}))" if register == "f32" else f"(({c_type})DB({name}))"
    if kind == "f32":
        return f"BF({name})"
    return f"BD({name})" if kind == "f64" else f"(({c_type}){name})"


def _constant(text: str, kind: str) -> str:
    """C expression of a constant, or the empty text."""
    c_type = C_TYPES[kind]
    match = re.fullmatch(r"0[fF]([0-9a-fA-F]{8})", text)
    if match:
        single = f"BF(0x{match[1]}u)"
        return single if kind == "f32" else f"((double){single})" if kind == "f64" else f"(({c_type})0x{match[1]}u)"
    match = re.fullmatch(r"0[dD]([0-9a-fA-F]{16})", text)
    if match:
        return f"BD(0x{match[1]}ull)" if kind == "f64" else f"(({c_type})0x{match[1]}ull)"
    match = re.fullmatch(r"(-?)(0[xX][0-9a-fA-F]+|\d+)U?", text)
    if not match:
        return ""
    octal = match[2].isdigit() and match[2].startswith("0")
    value = int(match[1] + match[2], 8 if octal else 0)
    if kind == "f32":
        return f"BF(0x{value & (2**32 - 1):x}u)"
    bits = f"0x{value & (2**64 - 1):x}ull"
    return f"BD({bits})" if kind == "f64" else f"(({c_type}){bits})"
