"""Fixtures of the command line's tests."""

import json

import pytest

from simwarp import cli
from simwarp.bench.workloads import BenchScene, bench_scenes


@pytest.fixture
def row_keys():
    """Keys that every row of `simwarp bench --json` has at least."""
    return {
        "scene", "worlds", "dt", "steps_per_s", "steps_per_cpu_s", "residual", "launches_per_step", "bytes_per_world",
        "compile_s", "valid",
    }  # fmt: skip


@pytest.fixture
def command(capfd):
    """Run a command: exit code, standard output, standard error without what Warp says of its own."""

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(list(arguments))
        out, err = capfd.readouterr()
        return code, out, "".join(line for line in err.splitlines(keepends=True) if not line.startswith("Warp"))

    return run


@pytest.fixture
def bench(capfd):
    """Run the command: exit code, JSON (None without), standard error."""

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["bench", *arguments, "--seconds", "0.02", "--device", "cpu", "--json", "-"])
        out, err = capfd.readouterr()
        return code, json.loads(out) if out else None, err

    return run


@pytest.fixture
def with_scene(monkeypatch):
    """Offer one more scene under the name `test`."""

    def add(**fields):
        scene = BenchScene(name="test", summary="", **fields)
        found = bench_scenes() | {"test": scene}
        monkeypatch.setattr("simwarp.bench.subjects.bench_scenes", lambda: found)
        return scene

    return add
