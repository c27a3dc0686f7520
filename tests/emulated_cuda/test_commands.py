"""Commands on the emulated device: without a fault or race, and with the same results in another order."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.emulated_cuda.emulated_runs import HERE, ROOT, run_emulated, skip_where_unavailable
from tests.emulated_cuda.settings import Check, StreamOrder
from tests.reference.imported_robots import ROBOTS

pytestmark = pytest.mark.slow

PAIR = f"{ROOT / 'tests/tasks/framework/pair_task.py'}:PairTask"
SMALL = ("--num-envs", "4", "--iterations", "2", "--steps-per-iteration", "4", "--logger", "csv")


def numbers(path: Path) -> Any:
    """What a file of results holds, without its times."""
    if path.suffix == ".json":
        return _without_times(json.loads(path.read_text(encoding="utf-8")))
    if path.suffix == ".pt":
        return {name: each.numpy().tobytes() for name, each in _tensors(torch.load(path, weights_only=False))}
    return path.read_bytes()


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(each) for key, each in value.items() if "second" not in key and "wall" not in key}
    return [_without_times(each) for each in value] if isinstance(value, list) else value


def _tensors(value: Any, path: str = "") -> list[tuple[str, torch.Tensor]]:
    if isinstance(value, torch.Tensor):
        return [(path, value.cpu())]
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, (list, tuple)) else ()
    return [found for key, each in parts for found in _tensors(each, f"{path}/{key}")]


COMMANDS: dict[str, tuple[tuple[str, ...], str]] = {
    "verify": (("verify", "limits", "convex-law", "--json", "found.json"), "found.json"),
    "view": (("view", "ant", "--worlds", "3", "--record", "found.html", "--seconds", "0.5", "--no-open"), ""),
    "view, driven": (("view", "gator", "--drive", "--seconds", "1", "--speed", "0", "--no-open"), ""),
    "play": (("play", "pendulum", "--seconds", "0.2", "--size", "64", "48", "--video", "found.png"), "found.png"),
    "several agents": (("train", PAIR, *SMALL), "runs/**/*.pt"),
    "distill": (("distill", "pendulum", "--teacher", "shipped", *SMALL), "runs/**/*.pt"),
}  # fmt: skip
"""By name: words of the command, and the files that must hold the same in any order."""


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_runs_cleanly_and_alike_in_another_order(name, tmp_path):
    skip_where_unavailable()
    words, results = COMMANDS[name]
    found = []
    for seed, check, streams in ((1, Check.RACE, StreamOrder.EAGER), (7, Check.MEMORY, StreamOrder.LAZY)):
        folder = tmp_path / str(seed)
        folder.mkdir()
        run_emulated(
            "-m", "simwarp", *words, "--device", "cuda:0", check=check, streams=streams, seed=seed, folder=folder,
            cleanly=True,
        )  # fmt: skip
        found.append({path.name: numbers(path) for path in sorted(folder.glob(results))} if results else {})
    assert found[0] == found[1]
    assert bool(found[0]) == bool(results)


ROBOT_FILES = ("mjcf/go2/go2.xml", "mjcf/ur5e/ur5e.xml", "mjcf/2f85/2f85.xml", "urdf/r2d2/r2d2.urdf")
BOUND = 2e-5
"""Largest difference of a place to the CPU [m], after ten steps of 2 ms."""


@pytest.mark.skipif(not ROBOTS.is_dir(), reason="published robots are not there")
def test_imported_robots_move_as_on_the_cpu(tmp_path):
    skip_where_unavailable()
    files = [str(ROBOTS / name) for name in ROBOT_FILES]
    printed = run_emulated(str(HERE / "robots_on_device.py"), *files, check=Check.RACE, cleanly=True)
    for row in json.loads(printed.splitlines()[-1]).values():
        assert row["moved"] > 1e-4
        assert row["difference"] <= BOUND
        assert row["equal"]
        assert (row["faults"], row["races"]) == ([], 0)
