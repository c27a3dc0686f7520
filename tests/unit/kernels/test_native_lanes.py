"""Vector types of the native functions: they are read from rows of arrays, whose place is a multiple of a float's size.

Whether a wrong alignment crashes is up to the compiler's choice of instructions, so that tests of results see it on
some processors alone. A deduced type (`decltype`, `auto`) has lost the attribute of the type it was deduced from.
"""

import re
from pathlib import Path

import pytest

import simwarp

ROOT = Path(simwarp.__path__[0])
SOURCES = sorted(path for path in ROOT.rglob("*.py") if "ext_vector_type" in path.read_text())
VECTOR = re.compile(r"typedef\s+(\w+)\s+(\w+)\s+__attribute__\(\((.*)\)\);")
SIZES = {"float": 4, "double": 8}


def test_there_are_sources() -> None:
    assert len(SOURCES) >= 5


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_vectors_are_read_at_any_element(path: Path) -> None:
    text = path.read_text()
    found = VECTOR.findall(text)
    assert len(found) == text.count("ext_vector_type")
    for element, name, attributes in found:
        if element in SIZES:  # masks are never read from arrays
            assert f"aligned({SIZES[element]})" in attributes, name
    assert not re.search(r"\(\s*(const\s+)?(decltype|auto)\b[^;]*\*\)", text), "memory is read through a deduced type"
