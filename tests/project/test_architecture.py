"""The page on architecture is true: its map has every folder, and its walks name functions that are there."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "architecture.md"
MOST_FILES = 8
"""Files that a walk passes at most."""
TOGETHER = ("simwarp/vehicle/data", "tests/cli", "tests/data", "tests/emulated_cuda", "tests/reference", "tests/tasks",
            "tests/train", "tests/unit", "benchmarks", "docs", "examples")  # fmt: skip
"""Folders that have one row with all that is below them."""
WALKS = (
    "From an action to a torque", "From a contact to an impulse", "From a pixel to an observation",
    "From a word to the ground below a wheel",
)  # fmt: skip


def section(title):
    """The text of a section of the page."""
    text = PAGE.read_text(encoding="utf-8").partition(f"\n## {title}\n")[2]
    return re.split(r"\n## ", text)[0]


def rows():
    """Folders of the map, in its order."""
    return re.findall(r"^\| `([\w/]+)` \| \S", section("Folders"), re.MULTILINE)


def folders():
    """Folders of the checkout that hold files of the project, those of `TOGETHER` without what is below them."""
    roots = ("simwarp", "tasks", "train", "tests", "benchmarks", "scripts", "examples", "docs")
    found = set()
    for root in roots:
        for path in (ROOT / root).rglob("*"):
            name = path.parent.relative_to(ROOT).as_posix()
            through_link = name.startswith(("simwarp/tasks", "simwarp/train"))  # of an editable installation
            if path.is_file() and path.suffix in {".py", ".json", ".pt"} and not through_link:
                found.add(next((one for one in TOGETHER if name.startswith(f"{one}/")), name))
    return found - {"tests"}


def steps(title):
    """(file, names) of each step of a walk."""
    text = re.sub(r"\n   (?=\S)", " ", section(title))
    found = re.findall(r"^\d\. `([\w/.]+)`((?:, `[\w.]+`)+): ", text, re.MULTILINE)
    assert len(found) == len(re.findall(r"^\d\. ", text, re.MULTILINE)), "a step begins with its file and functions"
    return [(file, re.findall(r"`([\w.]+)`", names)) for file, names in found]


def defined(path):
    """Functions of a module, and methods as `Class.method`; functions within functions as well."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    methods = {
        f"{kind.name}.{part.name}"
        for kind in ast.walk(tree) if isinstance(kind, ast.ClassDef)
        for part in kind.body if isinstance(part, ast.FunctionDef)
    }  # fmt: skip
    return methods | {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_the_map_has_every_folder_and_no_other():
    named = rows()
    assert len(named) == len(set(named))
    assert set(named) == folders(), "docs/architecture.md, Folders"


@pytest.mark.parametrize("title", WALKS)
def test_a_walk_names_functions_that_are_there_and_passes_few_files(title):
    walk = steps(title)
    assert len(walk) >= 5
    assert len({file for file, _ in walk}) <= MOST_FILES
    for file, names in walk:
        assert (ROOT / file).is_file(), file
        missing = set(names) - defined(ROOT / file)
        assert not missing, f"{file}: {', '.join(sorted(missing))}"


def test_all_walks_are_checked():
    assert set(re.findall(r"^## (From .*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)) == set(WALKS)
