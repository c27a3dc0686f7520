"""Compile time as a new process sees it, with an empty and with a filled kernel cache.

`python -m simwarp.bench.compiling NAME DEVICE` is that process: one line of JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

from simwarp.bench.workloads import bench_scenes, vehicle_row_names
from simwarp.cli import ShortfallError

_PATIENCE_S = 600


class Start(NamedTuple):
    """From a model to the end of its first step [s]: by the clock, and of the process' CPU time."""

    wall_s: float
    cpu_s: float


def cold_and_warm(name: str, device: str) -> tuple[Start, Start]:
    """The start of a new process with an empty kernel cache, and of one with the cache that this left.

    Raises:
        ShortfallError: the process failed, or took too long; the message is its last line.
    """
    with tempfile.TemporaryDirectory(prefix="simwarp-bench-") as cache:
        first, second = _probe(name, device, cache), _probe(name, device, cache)
    return first, second


def _probe(name: str, device: str, cache: str) -> Start:
    try:
        done = subprocess.run(
            [sys.executable, "-m", "simwarp.bench.compiling", name, device], capture_output=True, encoding="utf-8",
            errors="replace", env=os.environ | {"WARP_CACHE_PATH": cache}, timeout=_PATIENCE_S,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ShortfallError(f"cold start of '{name}' took more than {_PATIENCE_S} s") from None
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise ShortfallError(f"cold start of '{name}' failed: {last}")
    return Start(*json.loads(done.stdout.splitlines()[-1]))


def first_step(name: str, device: str) -> Start:
    """From the model of a scene, a vehicle or a task to the end of its first step in one world, in this process."""
    scene = bench_scenes().get(name)
    if name in vehicle_row_names():
        from simwarp.bench.vehicle_rows import VehicleRun

        start, cpu = time.perf_counter(), time.process_time()
        vehicle_run = VehicleRun(name, 1, device, None)
        vehicle_run.step()
        vehicle_run.wait()
    elif scene is None:
        from simwarp.bench.task_rows import TaskRun
        from simwarp.tasks import task_class

        config = task_class(name).config_type()
        start, cpu = time.perf_counter(), time.process_time()
        task_run = TaskRun(name, 1, device, config)
        task_run.step()
        task_run.wait()
    else:
        from simwarp.bench.measure import SceneRun

        start, cpu = time.perf_counter(), time.process_time()
        run = SceneRun(scene, 1, device, None)
        run.step()
        run.wait()
    return Start(time.perf_counter() - start, time.process_time() - cpu)


if __name__ == "__main__":
    from simwarp.core.warp_start import start_warp

    start_warp()
    print(json.dumps(first_step(sys.argv[1], sys.argv[2])))
