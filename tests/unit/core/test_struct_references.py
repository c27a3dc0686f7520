"""Structs that device functions get by reference: the same values, and nobody writes into them."""

import ast
import importlib
import pkgutil
from typing import Any

import numpy as np
import warp as wp
from warp._src import context
from warp._src.codegen import Struct

import simwarp
from simwarp.core.struct_references import BY_REFERENCE, pass_structs_by_reference
from simwarp.core.warp_start import start_warp
from simwarp.kernels.core.cpu_flags import INLINE


@wp.struct
class Pair:
    """Two numbers and an array."""

    first: float
    second: float
    more: wp.array[float]


@wp.func
def weighted(pair: Pair, scale: float) -> float:
    """Reads its struct, and writes into the array of it."""
    pair.more[1] = scale
    return scale * pair.first - pair.second


@wp.func
def changed(pair: Pair) -> Pair:
    """A copy that differs leaves the original alone."""
    other = pair
    other.first = 100.0
    return other


@wp.kernel(
    enable_backward=False, module="unique", module_options={"cpu_compiler_flags": f"-march=native {BY_REFERENCE}"}
)
def by_reference(pair: Pair, out: wp.array[float]):
    """With the flag."""
    other = changed(pair)
    out[0] = weighted(pair, 2.0)
    out[1] = weighted(other, 3.0)
    out[2] = pair.first


@wp.kernel(enable_backward=False, module="unique", module_options={"cpu_compiler_flags": "-march=native"})
def by_value(pair: Pair, out: wp.array[float]):
    """Without."""
    other = changed(pair)
    out[0] = weighted(pair, 2.0)
    out[1] = weighted(other, 3.0)
    out[2] = pair.first


def text_of(kernel: wp.Kernel, device: str) -> str:
    """The kernel's module as Warp writes it for a device."""
    module: Any = kernel.module
    builder: Any = context.ModuleBuilder(module, module.resolve_options(wp.config))
    return str(builder.codegen(device))


def test_functions_of_a_module_with_the_flag_get_references():
    start_warp()
    pass_structs_by_reference()
    name = Pair.native_name
    assert f"    {name}& var_pair," in text_of(by_reference, "cpu")
    assert f"    {name} var_pair," in text_of(by_value, "cpu")
    assert f"    {name} var_pair," in text_of(by_reference, "cuda")


def test_values_are_those_of_copies():
    start_warp()
    found = []
    for kernel in (by_reference, by_value):
        pair = Pair()
        pair.first, pair.second, pair.more = 5.0, 7.0, wp.zeros(2, dtype=float, device="cpu")
        out = wp.zeros(3, dtype=float, device="cpu")
        wp.launch(kernel, 1, inputs=[pair], outputs=[out], device="cpu")
        found.append([*out.numpy(), *pair.more.numpy()])
    np.testing.assert_array_equal(found[0], [3.0, 293.0, 5.0, 0.0, 3.0])
    np.testing.assert_array_equal(found[0], found[1])


def written_structs(function: Any) -> list[str]:
    """Parameters that are structs, of which a device function assigns an attribute or that it names anew."""
    structs = {each.label for each in function.adj.args if isinstance(each.type, Struct)}
    found = []
    for node in ast.walk(function.adj.tree):
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
        )
        for target in targets:
            for each in target.elts if isinstance(target, ast.Tuple) else [target]:
                while isinstance(each, ast.Attribute):
                    each = each.value
                if isinstance(each, ast.Name) and each.id in structs:
                    found.append(f"{function.key}: {ast.unparse(node)}")
    return found


@wp.func
def spoils(pair: Pair):
    """What no device function may do."""
    pair.first = 1.0


def test_the_search_finds_who_writes():
    assert written_structs(spoils) == ["spoils: pair.first = 1.0"]
    assert written_structs(changed) == []
    assert written_structs(weighted) == []


def test_nobody_writes_into_a_struct_that_it_was_given():
    """Callers would see it on a CPU, where it is theirs, and not on a GPU, where it is a copy."""
    start_warp()
    for module in pkgutil.walk_packages(simwarp.__path__, "simwarp."):
        if module.name.endswith("kernels") or ".kernels." in module.name:
            importlib.import_module(module.name)
    functions = [
        overload
        for name, module in context.user_modules.items() if name.startswith("simwarp.")
        for function in module.functions.values()
        for overload in [*function.user_overloads.values(), *function.user_templates.values()]
    ]  # fmt: skip
    assert len(functions) > 500
    assert [line for function in functions for line in written_structs(function)] == []


def test_flags_of_large_kernels_have_those_of_warp():
    """Modules compile side by side only where all have the same after `-mllvm`."""
    flags = [flag for flag in INLINE.split() if flag.startswith("-mllvm")]
    assert flags == [flag for flag in str(wp.config.cpu_compiler_flags).split() if flag.startswith("-mllvm")]
