"""Milliseconds of a step and microseconds of its kernels: `python -m scripts.gpu_times DEVICE OUT.json NAME:WORLDS...`.

NAME is a scene or a vehicle, settled on the CPU, or `task:NAME`, a task under random actions after some control steps.
"""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import warp as wp

from scripts.gpu_profile import moving
from simwarp.bench.machine import describe
from simwarp.bench.task_rows import TaskRun
from simwarp.tasks import task_class

CALLS, ROUNDS, TASK_STEPS = 20, 5, 100


def milliseconds(call: Callable[[], None], wait: Callable[[], None]) -> list[float]:
    """Median, least and greatest time of a call in rounds of `CALLS`."""
    found = []
    for _ in range(ROUNDS):
        wait()
        begin = time.perf_counter()
        for _ in range(CALLS):
            call()
        wait()
        found.append(1e3 * (time.perf_counter() - begin) / CALLS)
    return [sorted(found)[ROUNDS // 2], min(found), max(found)]


def kernels(call: Callable[[], None]) -> dict[str, float]:
    """Microseconds of each kernel in one call, the longest first; launches of one kernel are added."""
    wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
    call()
    spent: dict[str, float] = defaultdict(float)
    for result in wp.timing_end():
        spent[result.name.removeprefix("forward kernel ")] += 1e3 * result.elapsed
    return dict(sorted(spent.items(), key=lambda item: -item[1]))


def fill_scene(row: dict[str, Any], name: str, worlds: int, device: str) -> None:
    """A scene, in graphs of several steps."""
    run = moving(name, worlds, device)
    run.capture()
    run.step()
    times = [each / run.steps_per_call for each in milliseconds(run.step, run.wait)]
    iterations = run.sim.diagnostics.iterations.numpy()
    row |= {"step_ms": times, "msteps_per_s": 1e-3 * worlds / times[0]}
    row |= {"iterations": float(iterations.mean()), "iterations_max": int(iterations.max())}
    row["kernels_us"] = kernels(run.single_step)


def fill_task(row: dict[str, Any], name: str, worlds: int, device: str) -> None:
    """A task's control step."""
    run = TaskRun(name, worlds, device, task_class(name).config_type())
    for _ in range(TASK_STEPS):
        run.step()
    times = milliseconds(run.step, run.wait)
    row |= {"step_ms": times, "control_steps_per_s": 1e3 * worlds / times[0]}


def main(device: str, out: str, *wanted: str) -> int:
    """Measure one after the other; an error is a row, too."""
    rows = []
    for each in wanted:
        name, worlds = each.rsplit(":", 1)
        row: dict[str, Any] = {"scene": name, "worlds": int(worlds)}
        try:
            if name.startswith("task:"):
                fill_task(row, name.removeprefix("task:"), int(worlds), device)
            else:
                fill_scene(row, name, int(worlds), device)
        except Exception as error:  # noqa: BLE001 - the next one follows
            row["error"] = f"{type(error).__name__}: {error}"
        rows.append(row)
        print(row, flush=True)
        facts = {"machine": describe(wp.get_device(device)), "rows": rows}
        Path(out).write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    return int(any("error" in row for row in rows))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
