"""Every kernel also compiles for CUDA. NVRTC comes with Warp, so that neither a GPU nor a driver is needed.

A module whose kernels stand at module level needs nothing. One that makes kernels in functions (factories,
`module="unique"`) tells which instances stand for the others:

    def kernels_for_cuda_check() -> list[wp.Kernel]:
        return [make_solver(16), make_solver(64)]
"""

import ast
import importlib
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest
import warp as wp

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"simwarp": "simwarp", "tasks": "simwarp.tasks", "train": "simwarp.train"}
HOOK = "kernels_for_cuda_check"
WRITERS = {"simwarp.kernels.core.stages"}
"""Modules that write kernels from the tables of others, which tell of them."""
# Hopper: what the package is tuned for. Code that compiles for it and for no older card is not our problem.
ARCH = 90


def defines_kernels(tree: ast.AST) -> bool:
    """Whether `wp.kernel` or `wp.Kernel(...)` is used as a decorator or called anywhere in the tree."""
    for node in ast.walk(tree):
        used = [*getattr(node, "decorator_list", []), *([node.func] if isinstance(node, ast.Call) else [])]
        for expression in used:
            expression = expression.func if isinstance(expression, ast.Call) else expression
            if ast.unparse(expression) in ("wp.kernel", "warp.kernel", "wp.Kernel", "warp.Kernel"):
                return True
    return False


def has_factory(tree: ast.AST) -> bool:
    """Whether a kernel is made inside a function."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return any(defines_kernels(statement) for function in functions for statement in function.body)


def kernel_modules() -> list[str]:
    """Installed names of all files that define kernels."""
    found = []
    for folder, package in FOLDERS.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            found_here = re.search(r"\.[kK]ernel\b", source) and defines_kernels(ast.parse(source))
            if found_here or f"def {HOOK}(" in source:
                parts = path.relative_to(ROOT / folder).with_suffix("").parts
                found.append(".".join([package, *(p for p in parts if p != "__init__")]))
    return [name for name in found if name not in WRITERS]


def warp_modules(module: ModuleType) -> list[wp.Module]:
    """Warp's compilation units with the kernels of a Python module."""
    kernels = [value for value in vars(module).values() if isinstance(value, wp.Kernel)]
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    if has_factory(tree):
        assert hasattr(module, HOOK), f"{module.__name__} makes kernels in functions: let it define {HOOK}()"
    if hasattr(module, HOOK):
        kernels += getattr(module, HOOK)()
    assert kernels, f"{module.__name__} shows no kernel: let it define {HOOK}()"
    return list({id(kernel.module): kernel.module for kernel in kernels}.values())


def compile_for_cuda(module: ModuleType, folder: Path | None = None) -> int:
    """Compile all of a Python module's kernels; the number of compilation units. Raises what NVRTC finds."""
    units = warp_modules(module)
    for unit in units:
        # Without a folder it goes to Warp's cache, where an unchanged module is found by its hash.
        wp.compile_aot_module(unit, device=None, arch=ARCH, module_dir=folder)
    return len(units)


# Ten seconds to ten minutes of NVRTC each
LONG = {
    f"simwarp.{name}"
    for name in (
        "kernels.dynamics.world", "kernels.dynamics.step_stages", "kernels.cones.batch",
        "kernels.collision.collision_stages", "vehicle.tires.tires_kernels", "sensors.cameras.image_kernels",
        "kinematics.jacobian_kernels", "kinematics.inverse_kinematics_kernels",
    )
}  # fmt: skip
MODULES = [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in kernel_modules()]


def test_the_long_ones_are_there():
    assert set(kernel_modules()) >= LONG


def test_device_code_is_the_engine_or_stands_beside_its_host():
    assert all(name.startswith("simwarp.kernels.") or name.endswith("_kernels") for name in kernel_modules())


@pytest.mark.parametrize("name", MODULES)
def test_kernels_compile_for_cuda(name):
    assert compile_for_cuda(importlib.import_module(name)) > 0


TOY = '''
import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return EXPRESSION;
#else
    return 2.0f * x;
#endif
""")
def twice(x: float) -> float: ...


def make(count: int) -> wp.Kernel:
    @wp.kernel(module="unique", enable_backward=False)
    def repeat(a: wp.array[float]):
        i = wp.tid()
        for _ in range(wp.static(count)):
            a[i] = twice(a[i])

    return repeat
'''


def import_text(text: str, path: Path) -> ModuleType:
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def toy(tmp_path: Path, name: str, expression: str, hook: bool = True) -> ModuleType:
    tail = f"\n\ndef {HOOK}():\n    return [make(2), make(3)]\n" if hook else ""
    return import_text(TOY.replace("EXPRESSION", expression) + tail, tmp_path / f"{name}.py")


def test_instances_of_a_factory_are_compiled(tmp_path):
    assert compile_for_cuda(toy(tmp_path, "toy_good", "2.0f * x"), tmp_path / "out") == 2
    assert len(list((tmp_path / "out").glob("*.sm90.*"))) == 2


def test_a_cuda_only_mistake_is_found(tmp_path):
    with pytest.raises(Exception, match="CUDA kernel build failed"):
        compile_for_cuda(toy(tmp_path, "toy_bad", "x * undeclared"), tmp_path / "out")


def test_a_factory_without_the_hook_is_found(tmp_path):
    with pytest.raises(AssertionError, match=HOOK):
        compile_for_cuda(toy(tmp_path, "toy_silent", "2.0f * x", hook=False))
