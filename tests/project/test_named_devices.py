"""Every array and launch names its device: where there is a GPU, Warp's default is that, and memory of the CPU is none
that a kernel there may read, nor the other way round.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("simwarp", "tasks", "train", "tests", "scripts", "benchmarks", "examples")
MAKERS = {"array", "zeros", "ones", "full", "empty", "from_numpy", "launch"}
"""Functions of Warp that take its default device where none is named; those named `..._like` take that of an array."""
IN_KERNELS = {"wp.kernel", "wp.func"}
"""Decorators of what is compiled: an array that is made there is one of its thread."""


def unnamed(source: str) -> list[str]:
    """Calls of a file that leave the device to Warp, with their lines."""
    if not re.search(rf"\bwp\.({'|'.join(MAKERS)})\(", source):
        return []
    tree = ast.parse(source)
    compiled: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            decorators = (each.func if isinstance(each, ast.Call) else each for each in node.decorator_list)
            if any(ast.unparse(each) in IN_KERNELS for each in decorators):
                compiled.update(ast.walk(node))
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node not in compiled:
            name, keywords = node.func.attr, {each.arg for each in node.keywords}
            if name not in MAKERS or ast.unparse(node.func.value) != "wp" or keywords & {"device", None}:
                continue
            if name != "array" or node.args or keywords & {"data", "shape", "ptr"}:  # else the type of one
                found.append(f"line {node.lineno}: {' '.join(ast.unparse(node).split())[:60]}")
    return found


@pytest.mark.parametrize("folder", FOLDERS)
def test_arrays_and_launches_name_their_device(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    wrong = {
        str(path.relative_to(ROOT)): calls for path in files if (calls := unnamed(path.read_text(encoding="utf-8")))
    }
    assert wrong == {}, "name the device, as in wp.zeros(3, dtype=float, device='cpu')"


@pytest.mark.parametrize("call", ["wp.zeros(3, dtype=float)", "wp.array([1.0])", "wp.launch(k, dim=1, inputs=[])"])
def test_the_rule_sees_what_breaks_it(call):
    assert len(unnamed(f"def make():\n    return {call}\n")) == 1
    assert unnamed(f"@wp.kernel\ndef make():\n    x = {call}\n") == []


@pytest.mark.parametrize(
    "call", ["wp.zeros(3, device=d)", "wp.zeros_like(a)", "wp.array(dtype=float, ndim=2)", "wp.zeros(**options)"]
)
def test_the_rule_lets_pass_what_names_one(call):
    assert unnamed(f"x = {call}\n") == []
