"""Examples, documentation and tasks use what the packages offer, and nothing behind it."""

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import simwarp as sw
from simwarp.model.keyword_argument_types import DofOptions
from simwarp.sensors.instances import AppearanceOptions

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "simwarp", "simwarp.actuators", "simwarp.analysis", "simwarp.motions", "simwarp.vehicle", "simwarp.sensors",
    "simwarp.planning", "simwarp.identify", "simwarp.study", "simwarp.scenery", "simwarp.vehicle.rigs",
    "simwarp.vehicle.roads",
    "simwarp.importers", "simwarp.exporters", "simwarp.soil", "simwarp.flex",
    "simwarp.viewer", "simwarp.scenes", "simwarp.kinematics",
    "simwarp.tasks", "simwarp.tasks.driving", "simwarp.tasks.locomotion", "simwarp.tasks.locomotion.velocity",
    "simwarp.tasks.locomotion.velocity.mdp",
    "simwarp.train",
    # these import libraries that are optional
    "simwarp.mcap",
    "simwarp.tasks.adapters.in_mujoco", "simwarp.tasks.adapters.sb3_adapter", "simwarp.tasks.adapters.skrl_adapter",
}  # fmt: skip
"""The front door: their names do not move."""

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TASKS = [
    path
    for folder in ("", "arms", "driving", "locomotion")
    for path in sorted((ROOT / "tasks" / folder).glob("*.py"))
    if path.name != "__init__.py" and not path.name.endswith("_kernels.py")
]
"""What authors read before they write their own; framework and adapters use the core as every room does."""


def imports(text: str) -> Iterator[tuple[str, list[str]]]:
    """Modules of simwarp that a program imports, and the names that it takes from them."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and (node.module or "").split(".")[0] == "simwarp":
            yield node.module or "", [alias.name for alias in node.names]
        elif isinstance(node, ast.Import):
            yield from ((alias.name, []) for alias in node.names if alias.name.split(".")[0] == "simwarp")


def programs(page: Path) -> list[str]:
    """The Python in a page; shell sessions and fragments that are no whole program do not count."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    return [block for block in blocks if "simwarp" in block]


def behind(text: str) -> list[str]:
    """Imports that go past the front door."""
    found = []
    for module, names in imports(text):
        if module not in PACKAGES:
            found.append(module)
            continue
        package = importlib.import_module(module)
        for name in names:
            if name not in getattr(package, "__all__", ()) and f"{module}.{name}" not in PACKAGES:
                found.append(f"{module}.{name}")
    return found


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_import_public_names(path: Path) -> None:
    assert behind(path.read_text()) == []


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_pages_import_public_names(path: Path) -> None:
    assert [name for text in programs(path) for name in behind(text)] == []


@pytest.mark.parametrize("path", TASKS, ids=lambda path: str(path.relative_to(ROOT / "tasks")))
def test_tasks_import_public_names(path: Path) -> None:
    assert behind(path.read_text()) == []


def test_an_inner_module_is_found_out() -> None:
    assert behind("from simwarp.model.model import Model") == ["simwarp.model.model"]
    assert behind("from simwarp.sensors import scene, Camera") == ["simwarp.sensors.scene"]


@pytest.mark.parametrize(("options", "config"), [(DofOptions, sw.Dof), (AppearanceOptions, sw.sensors.Appearance)])
def test_options_are_the_fields_they_stand_for(options: Any, config: Any) -> None:
    """Type checkers read them from a class of their own, which must not fall behind."""
    assert get_type_hints(options) == get_type_hints(config)


def test_names_of_the_training_package_are_there() -> None:
    from simwarp import train

    assert sorted(name for names in train._HOMES.values() for name in names) == sorted(train.__all__)
    for name in train.__all__:
        assert getattr(train, name).__name__ == name
