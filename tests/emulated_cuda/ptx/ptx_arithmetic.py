"""PTX arithmetic of floating point, comparisons and conversions as C statements."""

from __future__ import annotations

from tests.emulated_cuda.ptx.ptx_function import C_TYPES, SIZES, Function, Handler, Instruction, UnsupportedPtx

COMPARE = {
    "eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "lo": "<", "ls": "<=", "hi": ">", "hs": ">=",
}  # fmt: skip
UNORDERED = {"neu": "==", "ltu": ">=", "leu": ">", "gtu": "<=", "geu": "<"}
"""Comparisons that hold for NaN: the opposite of an ordered one."""
TO_INTEGER = {"rni": "rint", "rzi": "trunc", "rmi": "floor", "rpi": "ceil"}
DIRECTED = {"rz": "0x6000u", "rm": "0x2000u", "rp": "0x4000u"}
"""Bits of x86's control register for a rounding other than to the nearest."""
BOOLEAN = {"and": "&&", "or": "||", "xor": "^"}
TESTS = {
    "finite": "isfinite({0})", "infinite": "isinf({0})", "number": "!isnan({0})", "notanumber": "isnan({0})",
    "normal": "isnormal({0})", "subnormal": "(fpclassify({0}) == FP_SUBNORMAL)",
}  # fmt: skip
LIBRARY = {"sin": "sinf", "cos": "cosf", "tanh": "tanhf", "ex2": "exp2f", "lg2": "log2f"}
"""Approximate functions are those of the C library."""


def _suffix(kind: str) -> str:
    return "f" if kind == "f32" else ""


def _compute(function: Function, instruction: Instruction, text: str) -> None:
    """Assign an expression of the operands {0}, {1}, {2}, rounded as the instruction says."""
    kind = instruction.type
    read = [function.read(each, kind) for each in instruction.operands[1:]]
    mode = instruction.one_of(*DIRECTED)
    if not mode:
        function.result(instruction, text.format(*read))
        return
    c_type, names = C_TYPES[kind], ("x_", "y_", "z_")[: len(read)]
    declared = ", ".join(f"{name} = {value}" for name, value in zip(names, read, strict=True))
    function.out.append(f"{{ volatile {c_type} {declared}; {_rounding(mode, c_type, text.format(*names))}")
    function.result(instruction, "w_")
    function.out.append("}")


def _rounding(mode: str, c_type: str, value: str) -> str:
    """C statements that compute `w_` with another rounding."""
    return (
        f"unsigned s_ = __builtin_ia32_stmxcsr(); __builtin_ia32_ldmxcsr((s_ & ~0x6000u) | {DIRECTED[mode]}); "
        f"volatile {c_type} w_ = ({c_type})({value}); __builtin_ia32_ldmxcsr(s_);"
    )


def add_or_subtract(function: Function, instruction: Instruction) -> None:
    """`add`, `sub`."""
    _compute(function, instruction, "{0} + {1}" if instruction.name == "add" else "{0} - {1}")


def multiply(function: Function, instruction: Instruction) -> None:
    """`mul`."""
    _compute(function, instruction, "{0} * {1}")


def multiply_add(function: Function, instruction: Instruction) -> None:
    """`fma`, and `mad`, which is the same since the first cards."""
    _compute(function, instruction, f"__builtin_fma{_suffix(instruction.type)}({{0}}, {{1}}, {{2}})")


def divide(function: Function, instruction: Instruction) -> None:
    """`div`."""
    _compute(function, instruction, "{0} / {1}")


def reciprocal(function: Function, instruction: Instruction) -> None:
    """`rcp`."""
    _compute(function, instruction, f"1.0{_suffix(instruction.type)} / {{0}}")


def square_root(function: Function, instruction: Instruction) -> None:
    """`sqrt` and its reciprocal `rsqrt`."""
    suffix = _suffix(instruction.type)
    root = f"__builtin_sqrt{suffix}({{0}})"
    _compute(function, instruction, root if instruction.name == "sqrt" else f"1.0{suffix} / {root}")


def library_function(function: Function, instruction: Instruction) -> None:
    """`sin`, `cos`, `tanh`, `ex2`, `lg2`."""
    function.result(
        instruction, f"{LIBRARY[instruction.name]}({function.read(instruction.operands[1], instruction.type)})"
    )


def smaller_or_larger(function: Function, instruction: Instruction) -> None:
    """`min` and `max`: NaN loses against a number unless `.NaN` says otherwise."""
    kind, name = instruction.type, instruction.name
    a, b = (function.read(each, kind) for each in instruction.operands[1:3])
    if not instruction.is_float:
        function.result(instruction, f"{a} {'<' if name == 'min' else '>'} {b} ? {a} : {b}")
        return
    value = f"{name}{'F' if kind == 'f32' else 'D'}({a}, {b})"
    if instruction.has("NaN"):
        value = f"(({a}) != ({a}) || ({b}) != ({b})) ? ({a}) + ({b}) : {value}"
    function.result(instruction, value)


def absolute(function: Function, instruction: Instruction) -> None:
    """`abs`."""
    kind = instruction.type
    a = function.read(instruction.operands[1], kind)
    if instruction.is_float:
        function.result(instruction, f"__builtin_fabs{_suffix(kind)}({a})")
    else:
        unsigned = C_TYPES["u" + kind[1:]]
        function.result(instruction, f"{a} < 0 ? 0 - ({unsigned}){a} : ({unsigned}){a}")


def negate(function: Function, instruction: Instruction) -> None:
    """`neg`."""
    kind = instruction.type
    a = function.read(instruction.operands[1], kind)
    function.result(instruction, f"-{a}" if instruction.is_float else f"0 - ({C_TYPES['u' + kind[1:]]}){a}")


def copy_sign(function: Function, instruction: Instruction) -> None:
    """`copysign`: the first operand's sign, the second one's magnitude."""
    kind = instruction.type
    sign, magnitude = (function.read(each, kind) for each in instruction.operands[1:3])
    function.result(instruction, f"__builtin_copysign{_suffix(kind)}({magnitude}, {sign})")


def number_class(function: Function, instruction: Instruction) -> None:
    """`testp`."""
    value = function.read(instruction.operands[1], instruction.type)
    function.write(instruction.operands[0], "pred", TESTS[instruction.modifiers[0]].format(value))


def comparison(relation: str, a: str, b: str, kind: str) -> str:
    """C expression of a comparison."""
    if kind in ("f32", "f64"):
        if relation == "num":
            return f"({a} == {a} && {b} == {b})"
        if relation == "nan":
            return f"({a} != {a} || {b} != {b})"
        if relation == "ne":
            return f"({a} < {b} || {a} > {b})"
        if relation == "equ":
            return f"!({a} < {b} || {a} > {b})"
        if relation in UNORDERED:
            return f"!({a} {UNORDERED[relation]} {b})"
    return f"({a} {COMPARE[relation]} {b})"


def set_predicate(function: Function, instruction: Instruction) -> None:
    """`setp`, combined with a third operand, and with its opposite as a second result."""
    kind, operands = instruction.type, instruction.operands
    a, b = (function.read(each, kind) for each in operands[1:3])
    value = comparison(instruction.modifiers[0], a, b, kind)
    sign = BOOLEAN.get(instruction.one_of(*BOOLEAN))
    more = f" {sign} {function.read(operands[3], 'pred')}" if sign else ""
    target, _, opposite = operands[0].partition("|")
    function.out.append(f"{{ int t_ = {value}; int v_ = t_{more}, u_ = !t_{more}; (void)u_;")
    function.write(target, "pred", "v_")
    if opposite:
        function.write(opposite, "pred", "u_")
    function.out.append("}")


def set_value(function: Function, instruction: Instruction) -> None:
    """`set`: all ones, or 1.0, where a comparison holds."""
    target, source = instruction.modifiers[-2:]
    if instruction.has(*BOOLEAN):
        raise UnsupportedPtx(instruction.text)
    a, b = (function.read(each, source) for each in instruction.operands[1:3])
    value = comparison(instruction.modifiers[0], a, b, source)
    function.write(instruction.operands[0], target, f"{value} ? {'1.0f' if target == 'f32' else '-1'} : 0")


def convert(function: Function, instruction: Instruction) -> None:
    """`cvt`: to integers it saturates."""
    target, source = [each for each in instruction.modifiers if each in C_TYPES][-2:]
    if "f16" in (target, source) or instruction.has("bf16"):
        raise UnsupportedPtx(instruction.text)
    value, to_integer = function.read(instruction.operands[1], source), instruction.one_of(*TO_INTEGER)
    from_float, to_float = source in ("f32", "f64"), target in ("f32", "f64")
    out = instruction.operands[0]
    if to_float:
        mode = instruction.one_of(*DIRECTED)
        if from_float and to_integer:
            value = f"{TO_INTEGER[to_integer]}{_suffix(source)}({value})"
        elif mode:
            c_type = C_TYPES[target]
            function.out.append(f"{{ volatile {C_TYPES[source]} x_ = {value}; {_rounding(mode, c_type, 'x_')}")
            function.result(instruction, "w_", target)
            function.out.append("}")
            return
        function.result(instruction, f"({C_TYPES[target]}){value}", target)
    elif from_float:
        value = f"(double){TO_INTEGER[to_integer or 'rzi']}{_suffix(source)}({value})"
        # NaN gives zero, or the first bit alone where 64 bits are on either side
        nan = 0 if source == "f32" and SIZES[target] < 8 else 1 << (8 * SIZES[target] - 1)
        function.write(out, target, f"f_{target.replace('b', 'u')}({value}, ({C_TYPES[target]}){nan}ull)")
    elif instruction.has("sat"):
        bits, signed = 8 * SIZES[target], target[0] == "s"
        low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
        low_text = f"(-(__int128){-low - 1}ull - 1)" if signed else "(__int128)0"
        function.out.append(f"{{ __int128 w_ = {value}, l_ = {low_text}, h_ = (__int128){high}ull;")
        function.write(out, target, "w_ < l_ ? l_ : w_ > h_ ? h_ : w_")
        function.out.append("}")
    else:
        function.write(out, target, f"({C_TYPES[target]}){value}")


HANDLERS: dict[str, Handler] = {
    "rcp": reciprocal, "sqrt": square_root, "rsqrt": square_root, **dict.fromkeys(LIBRARY, library_function),
    "min": smaller_or_larger, "max": smaller_or_larger, "abs": absolute, "neg": negate, "copysign": copy_sign,
    "testp": number_class, "setp": set_predicate, "set": set_value, "cvt": convert,
}  # fmt: skip
