"""PTX instructions as C statements: control flow, memory, integers, bits, atomics and what threads do together.

Arithmetic of floating point and conversions are in `ptx_arithmetic`.
"""

from __future__ import annotations

from tests.emulated_cuda.ptx import ptx_arithmetic
from tests.emulated_cuda.ptx.ptx_function import (
    C_TYPES,
    SIZES,
    UNSIGNED,
    Function,
    Handler,
    Instruction,
    UnsupportedPtx,
    c_name,
    split_operands,
)

WITHOUT_EFFECT = (
    "brkpt", "pragma", "membar", "fence", "prefetch", "prefetchu", "nanosleep", "discard", "applypriority",
    "griddepcontrol", "setmaxnreg",
)  # fmt: skip
"""Instructions that change nothing where threads run one after the other."""
SPACES = ("global", "local", "shared", "param", "const")
VECTORS = ("v2", "v4", "v8")
SHUFFLES = {"up": 0, "down": 1, "bfly": 2, "idx": 3}
VOTES = {"all": 0, "any": 1, "ballot": 2, "uni": 4}
VOTE_OF_NONE = 3
"""A vote without a result: `bar.warp.sync`."""
ATOMICS = {
    "add": "({t})(({u})o_ + ({u}){a})", "min": "o_ < {a} ? o_ : {a}", "max": "o_ > {a} ? o_ : {a}", "exch": "{a}",
    "cas": "o_ == {a} ? {b} : o_", "and": "o_ & {a}", "or": "o_ | {a}", "xor": "o_ ^ {a}",
    "inc": "o_ >= {a} ? 0 : o_ + 1", "dec": "(o_ == 0 || o_ > {a}) ? {a} : o_ - 1",
}  # fmt: skip
"""The new value of each atomic operation, of the old one `o_` and the operands."""
BITWISE = {"and": "&", "or": "|", "xor": "^"}


def nothing(function: Function, instruction: Instruction) -> None:
    """An instruction without an effect."""


def branch(function: Function, instruction: Instruction) -> None:
    """`bra`."""
    function.out.append(f"goto {c_name(instruction.operands[0])};")


def leave(function: Function, instruction: Instruction) -> None:
    """`ret`, and `exit` of a kernel."""
    function.out.append("return;")


def trap(function: Function, instruction: Instruction) -> None:
    """`trap`."""
    function.out.append(f'emu_trap(c, {function.line}, "trap");')


def load(function: Function, instruction: Instruction) -> None:
    """`ld`, of vectors too."""
    kind = instruction.type
    width = int(instruction.one_of(*VECTORS)[1:] or 1)
    pointer = function.pointer(instruction.operands[1], instruction.one_of(*SPACES), SIZES[kind] * width, 0)
    c_type, target = C_TYPES[kind], instruction.operands[0]
    if width == 1:
        function.write(target, kind, f"ld_{c_type}({pointer})")
        return
    registers = split_operands(target[1:-1])
    function.out.append(f"{{ const char *p_ = {pointer};")
    for index in range(len(registers)):
        function.out.append(f"{c_type} v{index}_ = ld_{c_type}(p_ + {index * SIZES[kind]});")
    for index, register in enumerate(registers):
        function.write(register, kind, f"v{index}_")
    function.out.append("}")


def store(function: Function, instruction: Instruction) -> None:
    """`st`, of vectors too."""
    kind = instruction.type
    width = int(instruction.one_of(*VECTORS)[1:] or 1)
    pointer = function.pointer(instruction.operands[0], instruction.one_of(*SPACES), SIZES[kind] * width, 1)
    c_type, source = C_TYPES[kind], instruction.operands[1]
    if width == 1:
        function.out.append(f"st_{c_type}({pointer}, {function.read(source, kind)});")
        return
    function.out.append(f"{{ char *p_ = {pointer};")
    for index, register in enumerate(split_operands(source[1:-1])):
        function.out.append(f"st_{c_type}(p_ + {index * SIZES[kind]}, {function.read(register, kind)});")
    function.out.append("}")


def move(function: Function, instruction: Instruction) -> None:
    """`mov`, also from and to the parts of a wider value."""
    kind, (target, source) = instruction.type, instruction.operands
    if target.startswith("{"):
        registers = split_operands(target[1:-1])
        part = SIZES[kind] // len(registers)
        function.out.append(f"{{ {C_TYPES[kind]} w_ = {function.read(source, kind)};")
        for index, register in enumerate(registers):
            function.write(register, f"b{8 * part}", f"({UNSIGNED[part]})(w_ >> {8 * part * index})")
        function.out.append("}")
    elif source.startswith("{"):
        registers = split_operands(source[1:-1])
        part = SIZES[kind] // len(registers)
        values = [function.read(register, f"b{8 * part}") for register in registers]
        function.write(
            target, kind, " | ".join(f"(({C_TYPES[kind]}){v} << {8 * part * k})" for k, v in enumerate(values))
        )
    else:
        function.write(target, kind, function.read(source, kind))


def convert_address(function: Function, instruction: Instruction) -> None:
    """`cvta`: only addresses of shared memory differ from generic ones."""
    value = function.read(instruction.operands[1], "u64")
    if instruction.has("shared"):
        to_shared = instruction.has("to")
        value = f"({value} - (uint64_t)c->smem)" if to_shared else f"((uint64_t)c->smem + (uint32_t)({value}))"
    function.write(instruction.operands[0], "u64", value)


def add_or_subtract(function: Function, instruction: Instruction) -> None:
    """`add`, `sub` and their forms with carry."""
    if instruction.is_float:
        ptx_arithmetic.add_or_subtract(function, instruction)
        return
    kind = instruction.type
    sign = "+" if instruction.name in ("add", "addc") else "-"
    if instruction.has("cc") or instruction.name in ("addc", "subc"):
        bits = 8 * SIZES[kind]
        a, b = (function.read(each, f"u{bits}") for each in instruction.operands[1:3])
        carry = "(CC & 1)" if instruction.name.endswith("c") else "0"
        wide = _wide(bits)
        function.out.append(f"{{ {wide} w_ = ({wide}){a} {sign} {b} {sign} {carry};")
        _write_with_carry(function, instruction, bits)
    elif instruction.has("sat"):
        a, b = (function.read(each, kind) for each in instruction.operands[1:3])
        function.out.append(f"{{ int64_t w_ = (int64_t){a} {sign} {b};")
        limits = "w_ > 2147483647 ? 2147483647 : w_ < -2147483647 - 1 ? -2147483647 - 1 : w_"
        function.write(instruction.operands[0], kind, limits)
        function.out.append("}")
    else:
        unsigned = "u" + kind[1:]
        a, b = (function.read(each, unsigned) for each in instruction.operands[1:3])
        function.write(instruction.operands[0], unsigned, f"{a} {sign} {b}")


def multiply(function: Function, instruction: Instruction) -> None:
    """`mul` of any type."""
    if instruction.is_float:
        ptx_arithmetic.multiply(function, instruction)
    else:
        _multiply_integers(function, instruction, add=False)


def multiply_add(function: Function, instruction: Instruction) -> None:
    """`mad`, `fma` and `madc`."""
    if instruction.is_float:
        ptx_arithmetic.multiply_add(function, instruction)
    elif instruction.has("cc") or instruction.name == "madc":
        bits = 8 * SIZES[instruction.type]
        wide, narrow = _wide(bits), C_TYPES[f"u{bits}"]
        if instruction.type == f"s{bits}" and instruction.has("hi"):
            raise UnsupportedPtx(instruction.text)
        a, b, d = (function.read(each, f"u{bits}") for each in instruction.operands[1:4])
        part = f"({narrow})(p_ >> {bits})" if instruction.has("hi") else f"({narrow})p_"
        carry = "(CC & 1)" if instruction.name == "madc" else "0"
        function.out.append(f"{{ {wide} p_ = ({wide}){a} * {b}; {wide} w_ = ({wide}){part} + {d} + {carry};")
        _write_with_carry(function, instruction, bits)
    else:
        _multiply_integers(function, instruction, add=True)


def _wide(bits: int) -> str:
    return "uint64_t" if bits == 32 else "unsigned __int128"


def _write_with_carry(function: Function, instruction: Instruction, bits: int) -> None:
    function.write(instruction.operands[0], f"u{bits}", f"({C_TYPES[f'u{bits}']})w_")
    carry = f"CC = (uint32_t)(w_ >> {bits}) & 1; " if instruction.has("cc") else ""
    function.out.append(f"{carry}}}")


def _multiply_integers(function: Function, instruction: Instruction, *, add: bool) -> None:
    kind, operands = instruction.type, instruction.operands
    bits, signed = 8 * SIZES[kind], kind[0] == "s"
    out = f"u{2 * bits}" if instruction.has("wide") else f"u{bits}"
    if instruction.has("wide"):
        wide = C_TYPES[f"{'s' if signed else 'u'}{2 * bits}"]
        a, b = (function.read(each, kind) for each in operands[1:3])
        value = f"({C_TYPES[out]})(({wide}){a} * ({wide}){b})"
    elif instruction.has("hi"):
        wide = {16: "int32_t", 32: "int64_t", 64: "__int128"}[bits]
        wide = wide if signed else ("unsigned __int128" if bits == 64 else f"u{wide}")
        a, b = (function.read(each, kind) for each in operands[1:3])
        value = f"({C_TYPES[out]})((({wide}){a} * ({wide}){b}) >> {bits})"
    else:
        a, b = (function.read(each, out) for each in operands[1:3])
        value = f"(uint32_t){a} * {b}" if bits == 16 else f"{a} * {b}"
    function.write(operands[0], out, f"{value} + {function.read(operands[3], out)}" if add else value)


def divide(function: Function, instruction: Instruction) -> None:
    """`div` of any type."""
    if instruction.is_float:
        ptx_arithmetic.divide(function, instruction)
        return
    kind = instruction.type
    a, b = (function.read(each, kind) for each in instruction.operands[1:3])
    function.result(instruction, f"DIV{'S' if kind[0] == 's' else 'U'}({a}, {b})")


def remainder(function: Function, instruction: Instruction) -> None:
    """`rem`."""
    kind = instruction.type
    a, b = (function.read(each, kind) for each in instruction.operands[1:3])
    function.result(instruction, f"REM{'S' if kind[0] == 's' else 'U'}({a}, {b})")


def bitwise(function: Function, instruction: Instruction) -> None:
    """`and`, `or`, `xor`."""
    a, b = (function.read(each, instruction.type) for each in instruction.operands[1:3])
    function.result(instruction, f"{a} {BITWISE[instruction.name]} {b}")


def complement(function: Function, instruction: Instruction) -> None:
    """`not` and the logical `cnot`."""
    logical = instruction.name == "cnot" or instruction.type == "pred"
    function.result(instruction, f"{'!' if logical else '~'}{function.read(instruction.operands[1], instruction.type)}")


def shift(function: Function, instruction: Instruction) -> None:
    """`shl` and `shr`: shifts beyond the width give zeros, or the sign."""
    kind, operands = instruction.type, instruction.operands
    bits = 8 * SIZES[kind]
    if instruction.name == "shl":
        macro, c_type = "SHL", UNSIGNED[SIZES[kind]]
    else:
        macro, c_type = f"SHR{'S' if kind[0] == 's' else 'U'}", C_TYPES[kind]
    value, count = function.read(operands[1], kind), function.read(operands[2], "u32")
    function.result(instruction, f"{macro}({c_type}, {value}, {count}, {bits}u)")


def funnel_shift(function: Function, instruction: Instruction) -> None:
    """`shf`."""
    a, b, count = (function.read(each, "u32") for each in instruction.operands[1:4])
    function.result(instruction, f"shf_{instruction.modifiers[0]}({a}, {b}, {count}, {int(instruction.has('clamp'))})")


def bit_field(function: Function, instruction: Instruction) -> None:
    """`bfe` and `bfi`."""
    kind = instruction.type
    values = 1 if instruction.name == "bfe" else 2
    operands = instruction.operands[1:]
    read = [function.read(each, kind if k < values else "u32") for k, each in enumerate(operands)]
    name = "bfi" if instruction.name == "bfi" else f"bfe_{'s' if kind[0] == 's' else 'u'}"
    function.result(instruction, f"{name}({', '.join(read)}, {8 * SIZES[kind]})")


def count_bits(function: Function, instruction: Instruction) -> None:
    """`clz`, `popc`, `bfind`, of which the result has 32 bits."""
    kind = instruction.type
    value = function.read(instruction.operands[1], kind)
    bits, suffix = 8 * SIZES[kind], "ll" if SIZES[kind] == 8 else ""
    if instruction.name == "clz":
        value = f"{value} ? __builtin_clz{suffix}({value}) : {bits}"
    elif instruction.name == "popc":
        value = f"__builtin_popcount{suffix}({value})"
    else:
        value = f"({value} < 0 ? ~{value} : {value})" if kind[0] == "s" else value
        value = f"bfind{bits}({value}, {int(instruction.has('shiftamt'))})"
    function.write(instruction.operands[0], "u32", value)


def reverse_bits(function: Function, instruction: Instruction) -> None:
    """`brev`."""
    value = function.read(instruction.operands[1], instruction.type)
    function.result(instruction, f"brev{8 * SIZES[instruction.type]}({value})")


def permute(function: Function, instruction: Instruction) -> None:
    """`prmt` in its general form."""
    if len(instruction.modifiers) > 1:
        raise UnsupportedPtx(instruction.text)
    read = [function.read(each, "u32") for each in instruction.operands[1:4]]
    function.result(instruction, f"prmt({', '.join(read)})")


def logic_of_three(function: Function, instruction: Instruction) -> None:
    """`lop3`."""
    read = [function.read(each, "u32") for each in instruction.operands[1:4]]
    function.result(instruction, f"lop3({', '.join(read)}, {instruction.operands[4]})")


def select(function: Function, instruction: Instruction) -> None:
    """`selp` by a predicate, `slct` by a sign."""
    operands = instruction.operands
    if instruction.name == "selp":
        condition, kind = function.read(operands[3], "pred"), instruction.type
    else:
        kind = instruction.modifiers[-2]
        condition = f"{function.read(operands[3], instruction.modifiers[-1])} >= 0"
    a, b = (function.read(each, kind) for each in operands[1:3])
    function.write(operands[0], kind, f"{condition} ? {a} : {b}")


def atomic(function: Function, instruction: Instruction) -> None:
    """`atom`, and `red`, which has no result."""
    kind, operands = instruction.type, instruction.operands
    operation = instruction.one_of(*ATOMICS)
    if not operation or instruction.has(*VECTORS) or kind == "f16":
        raise UnsupportedPtx(instruction.text)
    address, values = (operands[1], operands[2:]) if instruction.name == "atom" else (operands[0], operands[1:])
    pointer = function.pointer(address, instruction.one_of("global", "shared"), SIZES[kind], 2)
    c_type = C_TYPES[kind]
    read = [function.read(each, kind) for each in values]
    new = ATOMICS[operation].format(
        t=c_type, u=c_type if instruction.is_float else UNSIGNED[SIZES[kind]], a=read[0], b=read[-1]
    )
    function.out.append(f"{{ char *p_ = {pointer}; {c_type} o_ = ld_{c_type}(p_); st_{c_type}(p_, {new});")
    if instruction.name == "atom":
        function.write(operands[0], kind, "o_")
    function.out.append("}")


def barrier(function: Function, instruction: Instruction) -> None:
    """`bar.sync` of a block, `bar.warp.sync` of a warp."""
    function.barrier = True
    if instruction.has("warp"):
        mask = function.read(instruction.operands[0], "u32")
        function.out.append(f"emu_vote(c, {VOTE_OF_NONE}, 0, {mask}, {function.line});")
    elif instruction.has("sync"):
        number = function.read(instruction.operands[0], "u32")
        function.out.append(f"emu_barrier(c, {number}, {function.line});")
    else:
        raise UnsupportedPtx(instruction.text)


def shuffle(function: Function, instruction: Instruction) -> None:
    """`shfl`."""
    function.barrier = True
    operands = instruction.operands
    mode = SHUFFLES[instruction.one_of(*SHUFFLES)]
    target, _, predicate = operands[0].partition("|")
    value, lane, limits = (function.read(each, "u32") for each in operands[1:4])
    mask = function.read(operands[4], "u32") if len(operands) > 4 else "0xffffffffu"
    call = f"emu_shuffle(c, {mode}, {value}, {lane}, {limits}, {mask}, {function.line}, &q_)"
    function.out.append(f"{{ uint8_t q_; uint32_t v_ = {call};")
    function.write(target, "b32", "v_")
    if predicate:
        function.write(predicate, "pred", "q_")
    function.out.append("}")


def vote(function: Function, instruction: Instruction) -> None:
    """`vote`."""
    function.barrier = True
    operands = instruction.operands
    mode = VOTES[instruction.one_of(*VOTES)]
    mask = function.read(operands[2], "u32") if len(operands) > 2 else "0xffffffffu"
    call = f"emu_vote(c, {mode}, {function.read(operands[1], 'pred')}, {mask}, {function.line})"
    function.write(operands[0], "b32" if mode == VOTES["ballot"] else "pred", call)


def active_mask(function: Function, instruction: Instruction) -> None:
    """`activemask`: threads run one at a time."""
    function.write(instruction.operands[0], "b32", "(1u << (c->tid[0] & 31u))")


def call(function: Function, instruction: Instruction) -> None:
    """`call (result), name, (arguments)`, both lists optional."""
    operands = list(instruction.operands)
    results = split_operands(operands.pop(0)[1:-1]) if operands[0].startswith("(") else []
    name = operands[0]
    arguments = split_operands(operands[1].strip()[1:-1]) if len(operands) > 1 and operands[1].startswith("(") else []
    if name == "vprintf":
        text, values = (f"ld_uint64_t({c_name(each)})" for each in arguments)
        function.out.append(f"emu_vprintf(c, {text}, {values});")
        if results:
            function.out.append(f"memset({c_name(results[0])}, 0, 4);")
    elif name == "__assertfail":
        function.out.append(f'emu_trap(c, {function.line}, "assertion failed in the kernel");')
    elif name not in function.unit.functions:
        raise UnsupportedPtx(f"call of {name}")
    else:
        a, b = (", ".join(f"(void *){c_name(each)}" for each in names) or "0" for names in (arguments, results))
        function.out.append(f"{{ void *a_[] = {{{a}}}; void *b_[] = {{{b}}}; {c_name('f_' + name)}(c, a_, b_); }}")


HANDLERS: dict[str, Handler] = {
    **dict.fromkeys(WITHOUT_EFFECT, nothing),
    "bra": branch, "ret": leave, "exit": leave, "trap": trap, "ld": load, "ldu": load, "st": store, "mov": move,
    "cvta": convert_address, "add": add_or_subtract, "sub": add_or_subtract, "addc": add_or_subtract,
    "subc": add_or_subtract, "mul": multiply, "mad": multiply_add, "madc": multiply_add, "fma": multiply_add,
    "div": divide, "rem": remainder, "and": bitwise, "or": bitwise, "xor": bitwise, "not": complement,
    "cnot": complement, "shl": shift, "shr": shift, "shf": funnel_shift, "bfe": bit_field, "bfi": bit_field,
    "clz": count_bits, "popc": count_bits, "bfind": count_bits, "brev": reverse_bits, "prmt": permute,
    "lop3": logic_of_three, "selp": select, "slct": select, "atom": atomic, "red": atomic, "bar": barrier,
    "barrier": barrier, "shfl": shuffle, "vote": vote, "activemask": active_mask, "call": call,
    **ptx_arithmetic.HANDLERS,
}  # fmt: skip
"""By the first word of an instruction."""
