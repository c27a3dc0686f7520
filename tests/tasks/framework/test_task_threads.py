"""Every task gives the same bits for any number of threads, and any number of worlds among them."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import torch

from simwarp.core.threads import default_threads
from simwarp.tasks import make
from simwarp.tasks.framework.task import Task
from tests.tasks.framework.test_capture import CASES

COUNTS = (2, 3, 7)
STEPS = 7
LIMIT = 4
"""Control steps of an episode: resets happen on the way."""


def bits(value: Any) -> Any:
    """Tensors inside of what is there as bytes: NaN is equal to itself."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return bits(vars(value))
    if isinstance(value, dict):
        return {name: bits(part) for name, part in value.items()}
    return value.contiguous().numpy().tobytes() if isinstance(value, torch.Tensor) else value


def different(first: Any, second: Any, path: str = "") -> list[str]:
    """Paths of what differs."""
    if not isinstance(first, dict):
        return [] if first == second else [path]
    if first.keys() != second.keys():
        return [f"{path} (keys)"]
    return [found for name in first for found in different(first[name], second[name], f"{path}/{name}")]


def made(case: str, worlds: int, threads: int) -> Task[Any]:
    """The task, whose worlds end one after another."""
    name, options = CASES[case]
    if options.get("obs") == "camera":
        options = options | {"camera_width": 40, "camera_height": 36}
    with default_threads(threads):
        task: Task[Any] = make(name, worlds, seed=3, max_episode_steps=LIMIT, guard_steps=4, **options)
    task.episode_clock.copy_(torch.arange(worlds) % LIMIT)
    return task


def run(case: str, worlds: int, threads: int) -> dict[str, Any]:
    """All that control steps hand out, and what is there after them."""
    task = made(case, worlds, threads)
    if task.simulation is not None:
        # one world is one chunk; several are one for one thread, else at most four for each
        assert task.simulation.shares.threads == min(threads, worlds)
    generator = torch.Generator().manual_seed(1)
    actions = 2.0 * torch.rand(STEPS, worlds, task.action_size, generator=generator) - 1.0
    found: dict[str, Any] = {f"step {k}": bits(task.step(action)) for k, action in enumerate(actions)}
    assert int(task.episode_index.min()) >= 1
    found["restart"] = bits(task.restart())
    found |= {f"after it {k}": bits(task.step(action)) for k, action in enumerate(actions[:2])}
    found["state"] = bits(task.state_dict())
    found["statistics"] = bits(task.drain_statistics())
    return found


@pytest.mark.quick("ant uncertain", "fast", "hexapod", "obstacle-avoidance camera", "pendulum", "pendulum at random")
@pytest.mark.parametrize("case", CASES)
def test_tasks_have_the_same_bits(case):
    alone = run(case, 5, 1)
    for threads in COUNTS:
        assert different(alone, run(case, 5, threads)) == []


@pytest.mark.quick("pendulum-2", "pendulum-13")
@pytest.mark.parametrize("worlds", [1, 2, 13])
@pytest.mark.parametrize("case", ["pendulum", "ant", "obstacle-avoidance camera"])
def test_any_number_of_worlds(case, worlds):
    alone = run(case, worlds, 1)
    for threads in COUNTS:
        assert different(alone, run(case, worlds, threads)) == []


def test_the_comparison_sees_one_bit():
    first, second = ({"step": bits({"x": torch.tensor([[value]])})} for value in (1.0, 1.0 + 2.0**-23))
    assert different(first, second) == ["/step/x"]
    assert different(first, first) == []
