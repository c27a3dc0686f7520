"""Times are measured by clocks that nobody sets: the one on the wall only stamps what people or other programs read."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("simwarp", "train", "tasks", "benchmarks", "scripts", "examples")
ON_THE_WALL = {
    "time": {"time", "time_ns", "localtime", "gmtime", "ctime"},
    "datetime": {"now", "utcnow", "today"},
    "date": {"today"},
}
STAMPS = {
    "simwarp/viewer/live/recording.py": 1,  # name of a file
    "train/runs/loggers.py": 2,  # TensorBoard's events and their file
    "train/runs/run_folder.py": 2,  # name and provenance of a run
}
"""Where the clock on the wall is read, and how often."""


def reads(source: str) -> list[int]:
    """Lines that read the clock on the wall."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and node.attr in ON_THE_WALL.get(_last(node.value), ()):
            found.append(node.lineno)
        elif isinstance(node, ast.ImportFrom) and node.module == "time":
            found += [node.lineno for name in node.names if name.name in ON_THE_WALL["time"]]
    return found


def _last(value: ast.expr) -> str:
    """Last name of a dotted one."""
    return value.attr if isinstance(value, ast.Attribute) else value.id if isinstance(value, ast.Name) else ""


def test_only_stamps_are_of_the_clock_on_the_wall():
    found = {}
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.py"):
            count = len(reads(path.read_text(encoding="utf-8")))
            if count:
                found[path.relative_to(ROOT).as_posix()] = count
    assert found == STAMPS


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("import time\nbegin = time.time()\n", 1),
        ("import datetime\nbegin = datetime.datetime.now()\n", 1),
        ("from datetime import datetime\nbegin = datetime.utcnow()\n", 1),
        ("from time import time, monotonic\n", 1),
        ("import time\nbegin = time.monotonic(), time.perf_counter()\n", 0),
        ("task.time.time\n", 1),  # rather too many than too few
    ],
)
def test_what_is_found(source, count):
    assert len(reads(source)) == count
