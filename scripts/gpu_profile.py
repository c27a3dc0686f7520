"""One step of a scene in motion for a profiler: `python -m scripts.gpu_profile SCENE WORLDS DEVICE`.

Only that step lies between the profiler's start and stop: `ncu --profile-from-start off`.
"""

from __future__ import annotations

import sys

import torch

from simwarp.bench.measure import SceneRun, TimedRun
from simwarp.bench.vehicle_rows import VehicleRun
from simwarp.bench.workloads import bench_scenes, vehicle_row_names

STEPS_BEFORE = 3


def moving(name: str, worlds: int, device: str) -> TimedRun:
    """The scene, settled on the CPU: thousands of steps before are no work for a profiler.

    Raises:
        ValueError: there is no such scene.
    """
    run: TimedRun
    if name in bench_scenes():
        run = SceneRun(bench_scenes()[name], worlds, device, None)
    elif name in vehicle_row_names():
        run = VehicleRun(name, worlds, device, None)
    else:
        raise ValueError(f"there is no scene '{name}'; there are {', '.join([*bench_scenes(), *vehicle_row_names()])}")
    run.settle_device = "cpu"
    run.set_motion()
    run.advance(STEPS_BEFORE)
    run.wait()
    return run


def main(name: str, worlds: str, device: str) -> int:
    """Make the step."""
    run = moving(name, int(worlds), device)
    torch.cuda.profiler.start()
    run.single_step()
    run.wait()
    torch.cuda.profiler.stop()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
