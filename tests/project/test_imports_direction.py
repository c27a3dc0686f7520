"""Imports go one way, and never in a circle:

warp <- core <- kernels <- geometry <- model <- simulation <- actuators, kinematics, motions, analysis, vehicle,
sensors, soil, flex, scenery, scenes <- importers, exporters, ros2, mcap, identify, viewer, planning <- tasks <-
train, study <- bench, verify <- cli. A device half, `X_kernels.py` beside its host `X.py`, imports `core`, the engine
and other device halves. `statistics` and `search` import `core` alone. Vehicles and sensors do not import each other,
nor do training and studies. Measurement and commands may import each other's modules, but not in a circle. Torch and
trimesh have one file each. A name used only in annotations (`if TYPE_CHECKING:`) counts for directions and circles
too.
"""

import ast
import functools
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"simwarp": "simwarp", "tasks": "simwarp.tasks", "train": "simwarp.train"}
RANKS = {
    "core": 0, "statistics": 0, "search": 0, "task_names": 0,
    "kernels": 1, "geometry": 2, "model": 3, "simulation": 4, "api": 5, "actuators": 6, "kinematics": 6,
    "motions": 6, "analysis": 6, "meshes": 3,
    "vehicle": 6, "sensors": 6, "soil": 6, "flex": 6,
    "scenery": 6, "scenes": 6, "importers": 7, "exporters": 7, "ros2": 7, "mcap": 7, "identify": 7, "viewer": 7,
    "planning": 7,
    "tasks": 8, "train": 9, "study": 9, "bench": 10, "verify": 10, "cli": 10, "__main__": 11,
}  # fmt: skip
APART = ({"vehicle", "sensors"}, {"study", "train"})
"""Rooms side by side that must not import each other."""
ONLY_IMPORTER = {"torch": "simwarp.core.interop", "trimesh": "simwarp.geometry.mesh_files"}


def module_names() -> dict[str, Path]:
    """Every module of the three folders under the name it is installed by."""
    found = {}
    for folder, package in FOLDERS.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            found[".".join([package, *(p for p in parts if p != "__init__")])] = path
    return found


MODULES = module_names()


def rank(module: str) -> int:
    """The place of a module of simwarp in the order."""
    head = module.split(".")[1:2]
    return RANKS[head[0]] if head else RANKS["api"]


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """All statements in a node, functions and classes included; expressions, most of a tree, are left out."""
    for field in ("body", "orelse", "handlers", "finalbody", "cases"):
        for statement in getattr(node, field, ()):
            yield statement
            yield from statements(statement)


def type_checking_nodes(tree: ast.AST) -> set[ast.AST]:
    """Statements inside `if TYPE_CHECKING:` bodies."""
    inside: set[ast.AST] = set()
    for node in statements(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            for statement in node.body:
                inside.update([statement, *statements(statement)])
    return inside


@functools.cache
def imports_of(source: str, module: str, is_package: bool) -> list[tuple[str, int, bool]]:
    """Absolute name, line, and whether only type checkers see it, of each import of a module."""
    tree = ast.parse(source)
    found: list[tuple[str, int, bool]] = []
    for_types = type_checking_nodes(tree)
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in statements(tree):
        if isinstance(node, ast.Import):
            found.extend((alias.name, node.lineno, node in for_types) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*parents, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{base}.{alias.name}"
                # `from simwarp import model` names a module, `from simwarp.model.model import Model` a thing in one.
                found.append((full if full in MODULES else base, node.lineno, node in for_types))
    return found


def complaints(source: str, module: str, is_package: bool = False) -> list[str]:
    """What is wrong with the imports of one module."""
    wrong = []
    room = module.split(".")[1]
    for name, line, only_types in imports_of(source, module, is_package):
        top, *rest = name.split(".")
        at = f"{module}:{line}"
        if top in ("tasks", "train", "tests"):
            wrong.append(f"{at}: imports {name}; the installed name is simwarp.{name}")
        elif top == "simwarp":
            if rank(name) > rank(module):
                wrong.append(f"{at}: {room} imports {name}")
            engine = name.startswith(("simwarp.core.", "simwarp.kernels.")) or name.endswith("_kernels")
            if module.endswith("_kernels") and not engine:
                wrong.append(f"{at}: a device half imports {name}")
            if {rest[0] if rest else "", room} in APART:
                wrong.append(f"{at}: {room} imports {name}; neither may import the other")
        elif top in ONLY_IMPORTER and not only_types:
            # Planning, tasks and training are written in torch; below them it has one door.
            free = top == "torch" and (room == "planning" or rank(module) >= RANKS["tasks"])
            if not free and module != ONLY_IMPORTER[top]:
                wrong.append(f"{at}: imports {top}; only {ONLY_IMPORTER[top]} may")
    return wrong


def circles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other (Tarjan's strongly connected components of more than one)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(module: str) -> None:
        index[module] = low[module] = len(index)
        stack.append(module)
        for other in imports.get(module, ()):
            if other not in index:
                visit(other)
            if other in stack:
                low[module] = min(low[module], low[other])
        if low[module] == index[module]:
            group = stack[stack.index(module) :]
            del stack[stack.index(module) :]
            if len(group) > 1:
                found.append(sorted(group))

    for module in imports:
        if module not in index:
            visit(module)
    return found


def test_no_modules_import_each_other():
    imports: dict[str, set[str]] = {}
    for module, path in MODULES.items():
        names = imports_of(path.read_text(encoding="utf-8"), module, path.name == "__init__.py")
        imports[module] = {name for name, _, _ in names if name in MODULES} - {module, "simwarp"}
    assert circles(imports) == []


def test_a_base_name_is_one_place():
    """A file of the engine may share it with the host's file in the room of the same name."""
    places: dict[str, list[tuple[str, ...]]] = {}
    for path in (ROOT / "simwarp").rglob("*.py"):
        if path.name != "__init__.py":
            places.setdefault(path.name, []).append(path.relative_to(ROOT / "simwarp").parts)
    for name, found in places.items():
        host = [parts for parts in found if parts[0] != "kernels"]
        device = [parts[1:] for parts in found if parts[0] == "kernels"]
        assert len(host) <= 1, name
        assert len(device) <= 1, name
        assert len({parts[0] for parts in host + device}) == 1, name
    halves = [path.name for path in MODULES.values() if path.name.endswith("_kernels.py")]
    assert len(set(halves)) == len(halves)


def test_device_halves_are_checked_as_device_code():
    """mypy has no pattern for the end of a name: the list in pyproject.toml is that of the files."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    listed = [each for rule in tomllib.loads(text)["tool"]["mypy"]["overrides"] for each in rule["module"]]
    halves = {name for name in MODULES if name.endswith("_kernels")}
    # Without an installed package mypy sees the tasks under the name of their folder
    halves |= {name.removeprefix("simwarp.") for name in halves if name.startswith("simwarp.tasks.")}
    assert {name for name in listed if name.endswith("_kernels")} == halves


def test_no_folder_is_crowded():
    for folder in {path.parent for path in (ROOT / "simwarp").rglob("*.py")}:
        assert len(list(folder.glob("*.py"))) <= 24, folder


ONE_IDEA = {Path("tasks/framework/task.py"), Path("simwarp/model/builder.py")}
"""Files of one class that inheritance would only cut into pieces."""


@pytest.mark.parametrize("folder", ["simwarp", "tasks", "train", "tests", "scripts", "benchmarks", "examples"])
@pytest.mark.sweep
def test_no_file_and_no_function_is_long(folder):
    for path in (ROOT / folder).rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert text.count("\n") <= (800 if path.relative_to(ROOT) in ONE_IDEA else 600), path
        for node in statements(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                assert (node.end_lineno or 0) - node.lineno < 80, f"{path}: {node.name}"


def test_a_circle_is_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]


@pytest.mark.parametrize("module", sorted(MODULES))
@pytest.mark.sweep
def test_imports_follow_the_direction(module):
    path = MODULES[module]
    if module == "simwarp":
        # The package itself has no name after `simwarp.`; it is the front door.
        found = complaints(path.read_text(encoding="utf-8"), "simwarp.api")
    else:
        found = complaints(path.read_text(encoding="utf-8"), module, path.name == "__init__.py")
    assert found == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("simwarp.kernels.dynamics.bilateral_rows", "from simwarp.model.model import Model"),
        ("simwarp.kernels.dynamics.bilateral_rows", "from ...model.model import Model"),
        ("simwarp.kernels.dynamics.bilateral_rows", "import simwarp"),
        ("simwarp.core.types", "from simwarp.kernels import rows"),
        ("simwarp.model.model", "from simwarp.vehicle.tire import Tire"),
        ("simwarp.model.model", "def f():\n    import torch"),
        ("simwarp.planning.imagination", "from simwarp.tasks import Task"),
        ("simwarp.model.builder", "from trimesh import load"),
        ("simwarp.vehicle.tire", "from ..sensors import camera"),
        ("simwarp.sensors.cameras.camera", "import simwarp.vehicle"),
        ("simwarp.sensors.cameras.camera", "import torch.nn"),
        ("simwarp.sensors.cameras.image_kernels", "from simwarp.sensors.cameras.lenses import Pinhole"),
        ("simwarp.soil.pressing_kernels", "from simwarp.model.model import Model"),
        ("simwarp.tasks.locomotion.ant", "from simwarp.train import runner"),
        ("simwarp.study.monte_carlo", "from simwarp.train.evaluation import evaluation"),
        ("simwarp.train.runner", "from simwarp.study import MonteCarlo"),
        ("simwarp.search.search_journal", "from simwarp.tasks import InputError"),
        ("simwarp.statistics.proportions", "from simwarp.model.model import Model"),
        ("simwarp.train.runner", "from simwarp.cli import main"),
        ("simwarp.train.runner", "import tasks"),
    ],
)
def test_a_wrong_import_is_found(module, source):
    assert len(complaints(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        (
            "simwarp.kernels.dynamics.bilateral_rows",
            "import warp as wp\nfrom simwarp.core.types import JointType\nfrom . import algebra",
        ),
        ("simwarp.model.model", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import torch"),
        ("simwarp.core.interop", "import torch"),
        ("simwarp.tasks.locomotion.ant", "import torch\nfrom simwarp import Simulation"),
        ("simwarp.cli", "from simwarp.train import runner"),
    ],
)
def test_a_right_import_passes(module, source):
    assert complaints(source, module) == []


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)


def test_importing_simwarp_pulls_in_neither_torch_nor_trimesh():
    done = run_python("import simwarp, sys; print(sorted({'torch', 'trimesh'} & set(sys.modules)))")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("folder", ["tasks", "train"])
def test_the_checkout_root_gives_no_second_copy(folder):
    # A second copy of a module would be a second registry: what is registered in one is missing in the other.
    code = f"""
import sys, pathlib
import simwarp.{folder}
try:
    import {folder}
except ImportError:
    pass
root = pathlib.Path({str(ROOT / folder)!r})
files = [pathlib.Path(m.__file__).resolve() for m in list(sys.modules.values()) if getattr(m, "__file__", None)]
files = [f for f in files if root in f.parents]
print(len(files) > 0 and len(files) == len(set(files)))
"""
    done = run_python(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "True", f"`import {folder}` loads a second copy of simwarp.{folder}"
