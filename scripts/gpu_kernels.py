"""Compile the kernels of scenes side by side: `python -m scripts.gpu_kernels DEVICE OUT.json [SCENE ...]`.

A process for each scene, by default of all that `simwarp doctor --gpu` compares; DEVICE may be the CPU. What comes
after finds the kernels in the cache.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import warp as wp

from simwarp.bench.agreement import agreement_scenes, first_step
from simwarp.bench.machine import describe

# Scenes that between them use most kernels: side by side first, so that the others do not compile the same once more.
FIRST = ("hmmwv-soil", "rod-on-floor", "ant", "camera", "lidar")


def rounds(scenes: Sequence[str]) -> list[list[str]]:
    """First those that use most kernels, then the others."""
    first = [name for name in FIRST if name in scenes]
    return [first, [name for name in scenes if name not in first]]


def main(device: str, out: str, *scenes: str) -> int:
    """Compile, and write how long each scene took [s]; an exit code of 1 where one failed."""
    begin, rows = time.perf_counter(), []
    names = scenes or agreement_scenes()
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn")) as pool:
        for group in rounds(names):
            waiting = {pool.submit(first_step, name, device): name for name in group}
            for done in as_completed(waiting):
                name, error = waiting[done], done.exception()
                found = {"seconds": done.result()} if error is None else {"error": f"{type(error).__name__}: {error}"}
                rows.append({"scene": name, "after": time.perf_counter() - begin, **found})
                print(f"[{len(rows)}/{len(names)}] {name:24}{rows[-1]['after']:8.1f} s", flush=True)
                facts = {"machine": describe(wp.get_device(device)), "scenes": rows}
                Path(out).write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    return int(any("error" in row for row in rows))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
