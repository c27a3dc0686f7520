"""Worlds that settle in calls of several steps get where single steps get them, bit by bit."""

from __future__ import annotations

import pytest

from simwarp.bench.measure import SceneRun, TimedRun
from simwarp.bench.vehicle_rows import VehicleRun
from simwarp.bench.workloads import bench_scenes

ON_GPU = pytest.param("cuda:0", marks=pytest.mark.cuda)


def arrays(run: TimedRun) -> dict[str, bytes]:
    return {name: array.numpy().tobytes() for name, array in run._arrays().items()}


def scene(name: str, device: str) -> SceneRun:
    run = SceneRun(bench_scenes()[name], 3, device, None)
    run._draw()
    return run


def by_single_steps(run: TimedRun, steps: int) -> dict[str, bytes]:
    for _ in range(steps):
        run.single_step()
    return arrays(run)


@pytest.mark.parametrize("steps", [0, 1, 9, 10, 11, 20, 21, 37])
def test_steps_of_a_scene_under_forces(steps):
    run = scene("ant", "cpu")
    start = arrays(run)
    run.advance(steps)
    assert arrays(run) == by_single_steps(scene("ant", "cpu"), steps)
    assert (arrays(run) == start) == (steps == 0)


@pytest.mark.parametrize("device", ["cpu", ON_GPU])
def test_calls_follow_one_another_and_single_steps(device):
    run = scene("pendulum", device)
    for steps in (12, 1, 25):
        run.advance(steps)
    assert arrays(run) == by_single_steps(scene("pendulum", device), 38)


def test_steps_of_a_vehicle():
    run, single = (VehicleRun("hmmwv", 1, "cpu", None) for _ in range(2))
    run.advance(64)
    run.advance(31)
    assert arrays(run) == by_single_steps(single, 95)


def test_a_run_that_settled_is_captured_with_the_same_call():
    run = scene("ant", "cpu")
    run.advance(11)
    run.capture()
    run.step()
    assert arrays(run) == by_single_steps(scene("ant", "cpu"), 21)
