"""PTX as NVRTC writes it, to C: branches are gotos, and one call of a kernel's C function is one thread."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tests.emulated_cuda.ptx.control_flow import ControlFlow
from tests.emulated_cuda.ptx.ptx_function import C_TYPES, SIZES, Function, Parameter, UnsupportedPtx, c_name
from tests.emulated_cuda.ptx.ptx_instructions import HANDLERS

_PARAMETER = re.compile(
    r"\.param\s+(?:\.align\s+(\d+)\s+)?\.(\w+)\s+(?:\.ptr\s+)?(?:\.\w+\s+)*(?:\.align\s+\d+\s+)?"
    r"([\w$%.]+)\s*(?:\[(\d+)\])?"
)
_VARIABLE = re.compile(
    r"\.(global|const|shared)\s+(?:\.align\s+(\d+)\s+)?\.(\w+)\s+([\w$%.]+)\s*(\[(\d*)\])?\s*(?:=\s*(.*?))?;?$"
)


@dataclass(frozen=True)
class Body:
    """Lines of a function's body."""

    name: str
    is_kernel: bool
    params: list[Parameter]
    results: list[Parameter]
    begin: int
    end: int


@dataclass(frozen=True)
class KernelFacts:
    """What a launch needs to know: bytes of each argument, and whether threads of a block wait for each other."""

    argument_sizes: list[int]
    barrier: bool


class PtxModule:
    """A PTX text and its translation.

    Attributes:
        kernels: by name.
        problems: why a function is not translated, by name.
        shared_size: bytes of static shared memory of a block.
        flow: blocks of instructions, once it is translated.
    """

    def __init__(self, text: str) -> None:
        self.lines = text.split("\n")
        self.globals: dict[str, tuple[int, str, bool, int, str]] = {}
        self.used: set[str] = set()
        self.functions: dict[str, tuple[list[Parameter], list[Parameter]]] = {}
        self.extern: set[str] = set()
        self.shared_symbols: dict[str, int] = {}
        self.shared_size = 0
        self.kernels: dict[str, KernelFacts] = {}
        self.problems: dict[str, str] = {}
        self.flow = ControlFlow()

    def add_shared(self, name: str, size: int, alignment: int) -> None:
        """Reserve shared memory of a block."""
        if name not in self.shared_symbols:
            self.shared_size = -(-self.shared_size // alignment) * alignment
            self.shared_symbols[name] = self.shared_size
            self.shared_size += size

    def shared_offset(self, name: str) -> str:
        """C expression of a symbol's place in shared memory; dynamic memory follows the static one."""
        value = self.shared_symbols[name]
        return "(uint64_t)c->smem_static" if value < 0 else f"{value}ull"

    def translate(self) -> str:
        """The C text; functions that cannot be translated are left out and stand in `problems`."""
        texts: list[tuple[Body, str]] = []
        for body in self._declarations():
            function = Function(self, body.name, body.params, body.results)
            try:
                texts.append((body, self._translate_body(function, body)))
            except UnsupportedPtx as error:
                self.problems[body.name] = f"{error} (line {function.line})"
            else:
                if body.is_kernel:
                    sizes = [size for _, size, _ in body.params]
                    self.kernels[body.name] = KernelFacts(sizes, function.barrier)
        self._spread_barriers({body.name: text for body, text in texts})
        out = ['#include "device_runtime.h"', "", *(self._variable_text(name) for name in sorted(self.used))]
        kernels = {body.name for body, _ in texts if body.is_kernel}
        for name in self.functions:
            if name not in kernels and name not in self.problems:
                out.append(f"static void {c_name('f_' + name)}(C *c, void **P, void **R);")
        for body, text in texts:
            head = f"void {c_name('k_' + body.name)}(C *c, void **P)"
            if not body.is_kernel:
                head = f"static void {c_name('f_' + body.name)}(C *c, void **P, void **R)"
            out.append(f"{head} {{ uint32_t CC = 0; (void)CC;\n{text}\n}}")
        variables = [c_name("g_" + name) for name in sorted(self.used)]
        out.append(f"void emu_module_init(void) {{ {' '.join(f'emu_allow(&{n}, sizeof {n});' for n in variables)} }}")
        return "\n".join(out)

    def _spread_barriers(self, texts: dict[str, str]) -> None:
        """A kernel waits where a function that it calls does."""
        called = {name: set(re.findall(r"\bf_(\w+)\(c, a_, b_\)", text)) for name, text in texts.items()}
        waiting = {name for name, text in texts.items() if re.search(r"\bemu_(barrier|shuffle|vote)\(", text)}
        by_c_name = {c_name(name): name for name in texts}
        while True:
            more = {name for name, calls in called.items() if {by_c_name.get(each) for each in calls} & waiting}
            if more <= waiting:
                break
            waiting |= more
        for name, facts in self.kernels.items():
            self.kernels[name] = KernelFacts(facts.argument_sizes, name in waiting)

    def _declarations(self) -> list[Body]:
        """Collect variables and functions; the bodies that are to be translated."""
        bodies, index = [], 0
        while index < len(self.lines):
            line = self.lines[index].partition("//")[0].strip()
            bare = re.sub(r"^(\.(visible|weak|extern|common)\s+)+", "", line)
            if bare.startswith((".entry", ".func")):
                body, index = self._function(index)
                bodies += [body] if body else []
                continue
            match = _VARIABLE.match(bare)
            if match:
                index = self._variable(match, index)
            index += 1
        return bodies

    def _function(self, index: int) -> tuple[Body | None, int]:
        """A function whose head begins in a line, or None where it is only declared; the line after it."""
        head = self.lines[index].partition("//")[0]
        while "{" not in self.lines[index] and not self.lines[index].strip().endswith(";"):
            index += 1
            head += " " + self.lines[index].partition("//")[0]
        header = head.partition("{")[0]
        match = re.search(r"\.(entry|func)\s*(\([^)]*\))?\s*([\w$%.]+)\s*(\(.*\))?", header, re.DOTALL)
        if not match:
            raise UnsupportedPtx(header[:100])
        name, params, results = match[3], _parameters(match[4] or ""), _parameters(match[2] or "")
        if "{" not in self.lines[index]:
            if ".extern" in head:
                self.extern.add(name)
            else:
                self.functions.setdefault(name, (params, results))
            return None, index + 1
        self.functions[name] = (params, results)
        depth, begin = 0, index
        while True:
            code = self.lines[index].partition("//")[0]
            depth += code.count("{") - code.count("}")
            index += 1
            if depth == 0:
                return Body(name, match[1] == "entry", params, results, begin, index), index

    def _variable(self, match: re.Match[str], index: int) -> int:
        """Note a variable of the module; the last line of its initialiser."""
        space, alignment, kind, name, array, count, initial = match.groups()
        if space == "shared":
            if array and not count:
                self.shared_symbols[name] = -1
            else:
                self.add_shared(name, SIZES[kind] * int(count or 1), int(alignment or 1))
            return index
        while initial is not None and initial.startswith("{") and "}" not in initial:
            index += 1
            initial += self.lines[index]
        length = int(count or 1)
        self.globals[name] = (
            int(alignment or SIZES[kind]),
            kind,
            array is not None,
            length,
            (initial or "").rstrip(";"),
        )
        return index

    def _variable_text(self, name: str) -> str:
        alignment, kind, _, count, initial = self.globals[name]
        if kind in ("f32", "f64"):
            c_type = "uint32_t" if kind == "f32" else "uint64_t"
            values = ", ".join(f"0x{bits}" for bits in re.findall(r"0[fFdD]([0-9a-fA-F]+)", initial)) or "0"
        else:
            c_type = C_TYPES[kind]
            values = (
                ", ".join(value.strip() for value in initial.strip().strip("{}").split(",") if value.strip()) or "0"
            )
            if re.search(r"[A-Za-z_$]", re.sub(r"0[xX][0-9a-fA-F]+", "", values)):
                raise UnsupportedPtx(f"initialiser of {name}: {initial[:60]}")
        return f"static {c_type} {c_name('g_' + name)}[{count}] __attribute__((aligned({alignment}))) = {{{values}}};"

    def _translate_body(self, function: Function, body: Body) -> str:
        function.out.append(f"B(c, {self.flow.begin_function()});")
        pending, first = "", True
        for number in range(body.begin, body.end):
            line = self.lines[number].partition("//")[0].strip()
            if first:
                line, first = line.partition("{")[2], False
            if not line:
                continue
            pending = f"{pending} {line}" if pending else line
            function.line = number + 1
            while pending:
                rest = _translate_next(function, pending)
                if rest == pending:
                    break
                pending = rest
        return "\n".join(function.out)


def _translate_next(function: Function, pending: str) -> str:
    """Translate what stands first; what is left, or all of it where its end is still missing."""
    if pending[0] in "{}":
        if pending[0] == "{":
            function.out.append("{")
            function.register_scopes.append({})
            function.symbol_scopes.append({})
        elif len(function.register_scopes) > 1:
            function.out.append("}")
            function.register_scopes.pop()
            function.symbol_scopes.pop()
        return pending[1:].strip()
    match = re.match(r"([$\w]+):(?!:)\s*", pending)
    if match:
        function.out.append(f"{c_name(match[1])}: ;")
        function.begin_block(match[1])
        return pending[match.end() :]
    if re.match(r"\.loc\s", pending):
        return ""
    if ";" not in pending:
        return pending
    statement, _, rest = pending.partition(";")
    statement = statement.strip()
    if statement.startswith("."):
        function.directive(statement)
    elif statement:
        function.statement(statement, HANDLERS)
    return rest.strip()


def _parameters(text: str) -> list[Parameter]:
    return [
        (name, SIZES[kind] * int(count or 1), int(alignment or SIZES[kind]))
        for alignment, kind, name, count in _PARAMETER.findall(text)
    ]
