"""pytest plugin: what tests make on the CPU is made on the emulated device.

`python -m tests.emulated_cuda -m pytest -p tests.emulated_cuda.force_cuda tests/unit/simulation`

The word "cpu" in a test's source reads "cuda:0", and models and tasks that name no device are made there. Results of
torch that a test reads or compares on the host are copied to it. Tests that are about a CPU are left out by
`CPU_TESTS`, each with its reason.
"""

from __future__ import annotations

import ast
import importlib.machinery
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from _pytest.assertion import rewrite
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves, tree_map

from tests.emulated_cuda.cpu_tests import CPU_TESTS
from tests.emulated_cuda.device import device
from tests.emulated_cuda.torch_calls.torch_tensor import CudaTensor

CUDA = "cuda:0"
TESTS = str(Path(__file__).resolve().parents[1])
HERE = str(Path(__file__).resolve().parent)
LIBRARIES = ("numpy", "scipy", "torch", "_pytest", "contextlib", "tests.emulated_cuda.")
"""Beginnings of names of modules through which a test's line may call torch."""


class _Elsewhere(ast.NodeTransformer):
    """Names another device."""

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        """One word of a source."""
        return ast.copy_location(ast.Constant(CUDA), node) if node.value == "cpu" else node


def is_a_tests(file: str) -> bool:
    """Whether a source is a test's, or of what tests share."""
    return file.startswith(TESTS) and not file.startswith(HERE) and not file.endswith("conftest.py")


def read_tests_otherwise() -> None:
    """Let Python and pytest compile sources of tests for the other device, and keep what they compiled apart."""
    sys.pycache_prefix = tempfile.mkdtemp(prefix="simwarp-forced-")
    loader, rewrite_asserts = importlib.machinery.SourceFileLoader, rewrite.rewrite_asserts
    compile_source = loader.source_to_code

    def source_to_code(self: Any, data: Any, path: Any, **options: Any) -> Any:
        if is_a_tests(str(path)):
            data = _Elsewhere().visit(ast.parse(data, str(path)))
        return compile_source(self, data, path, **options)

    def rewrite_there(tree: ast.Module, source: bytes, module_path: str | None = None, config: Any = None) -> None:
        if is_a_tests(str(module_path)):
            _Elsewhere().visit(tree)
        rewrite_asserts(tree, source, module_path, config)

    loader.source_to_code = source_to_code  # type: ignore[method-assign]
    rewrite.rewrite_asserts = rewrite_there  # type: ignore[assignment]


class Together(TorchFunctionMode):
    """Tensors of the host that a test's line brings together with the device's are moved to it."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Call a function of torch."""
        kwargs = kwargs or {}
        tensors = [each for each in tree_leaves((args, kwargs)) if isinstance(each, torch.Tensor)]
        mixed = len({each.is_cuda for each in tensors if each.dim()}) > 1
        if mixed and getattr(func, "__name__", "") != "copy_" and _called_by_a_test():
            move = lambda each: each.to(CUDA) if isinstance(each, torch.Tensor) else each  # noqa: E731
            args, kwargs = tree_map(move, (args, kwargs))
        return func(*args, **kwargs)


def _called_by_a_test() -> bool:
    """Whether the first line outside of libraries and the device that called is a test's."""
    frame = sys._getframe(2)
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).startswith(LIBRARIES):
        frame = frame.f_back
    return is_a_tests(frame.f_code.co_filename)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Let makers choose the device."""
    from simwarp.model.builder import ModelBuilder
    from simwarp.tasks.framework import registry
    from simwarp.tasks.framework.task import Task

    finalize, make_task, resolve = ModelBuilder.finalize, Task.__init__, registry.resolve_device

    def finalize_there(self: ModelBuilder, *args: Any, **kwargs: Any) -> Any:
        if len(args) > 1:
            args = (args[0], CUDA if args[1] in ("cpu", None) else args[1], *args[2:])
        elif kwargs.get("device") in ("cpu", None):
            kwargs["device"] = CUDA
        return finalize(self, *args, **kwargs)

    def make_task_there(self: Any, *args: Any, **kwargs: Any) -> None:
        if kwargs.get("device", "cpu") == "cpu":
            kwargs["device"] = CUDA
        make_task(self, *args, **kwargs)

    numpy = CudaTensor.numpy

    def numpy_here(self: CudaTensor, *, force: bool = False) -> Any:
        return numpy(self, force=force or _called_by_a_test())

    def array_here(self: CudaTensor, *args: Any, **kwargs: Any) -> Any:
        return numpy_here(self).__array__(*args, **kwargs)

    CudaTensor.numpy = numpy_here  # type: ignore[method-assign]
    CudaTensor.__array__ = array_here  # type: ignore[method-assign]
    ModelBuilder.finalize = finalize_there  # type: ignore[method-assign]
    Task.__init__ = make_task_there  # type: ignore[method-assign]
    registry.resolve_device = lambda name: resolve(CUDA if name == "cpu" else name)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is about a CPU."""
    left_out = [item for item in items if item.nodeid.startswith(tuple(CPU_TESTS))]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]


@pytest.fixture(autouse=True)
def _on_device() -> Iterator[None]:
    """Print a test's faults, and let the next one begin without them."""
    faults = device().faults
    faults.clear()
    before = len(faults.violations)
    with Together():
        yield
    for text, _ in faults.violations[before:]:
        print("emulated CUDA:", text)


read_tests_otherwise()
