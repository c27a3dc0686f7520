"""A hundred different models in one process with an empty kernel cache: which of them compiled anything?

    python benchmarks/hundred_models.py [--models 100] [--max-bodies 24] [--device cpu] [--json FILE]

Prints every model that compiled a kernel, and what the last one took from `finalize` to the end of its first step.
Exit code 1 when the last model compiled something, or a state was not sound.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
_CHILD = "SIMWARP_HUNDRED_MODELS_CHILD"


def build_all(models: int, max_bodies: int, device: str) -> dict[str, Any]:
    """Builds and steps the models; to be called in a process with an empty kernel cache."""
    begin = time.perf_counter()
    sys.path.insert(0, str(ROOT))
    import numpy as np

    from simwarp.core.warp_start import start_warp

    start_warp()
    import warp as wp

    from simwarp import Simulation
    from simwarp.bench.machine import describe
    from simwarp.bench.timing import compiled_modules
    from tests.reference.mechanisms import random_mechanism

    import_s = time.perf_counter() - begin
    cache = str(wp.config.kernel_cache_dir)
    rows = []
    for index in range(models):
        rng = np.random.default_rng(index)
        # Seldom large: a random tree of many bodies takes the generator seconds
        bodies = 1 + int(max_bodies * rng.random() ** 3)
        builder = random_mechanism(index, bodies=bodies, loops=int(rng.integers(0, 3)), bounds=bool(index % 2))
        before = compiled_modules(cache)
        start, cpu = time.perf_counter(), time.process_time()
        model = builder.finalize(world_count=2, device=device)
        sim = Simulation(model, dt=1e-3)
        sim.step()
        sound = bool(np.isfinite(sim.state.body_q.numpy()).all()) and not sim.state.world_status.numpy().any()
        rows.append(
            {
                "model": index + 1, "bodies": model.body_count, "joints": model.joint_count,
                "dofs": model.dof_count, "compiled": compiled_modules(cache) - before,
                "first_step_s": time.perf_counter() - start, "first_step_cpu_s": time.process_time() - cpu,
                "sound": sound,
            }
        )  # fmt: skip
    return {
        "machine": describe(wp.get_device(device)),
        "import_s": import_s,
        "cold_first_step_s": rows[0]["first_step_s"],
        "cold_first_step_cpu_s": rows[0]["first_step_cpu_s"],
        "compiled_total": sum(row["compiled"] for row in rows),
        "last_compiled": rows[-1]["compiled"],
        "last_first_step_s": rows[-1]["first_step_s"],
        "rows": rows,
    }


def report(result: dict[str, Any]) -> bool:
    """Prints the result; whether it is as it should be."""
    rows = result["rows"]
    print(f"import {result['import_s']:.2f} s, first model to the end of its first step", end=" ")
    print(f"{result['cold_first_step_s']:.2f} s with an empty kernel cache", end=" ")
    print(f"({result['cold_first_step_cpu_s']:.2f} s of CPU time)")
    for row in rows:
        if row["compiled"]:
            size = f"{row['bodies']} bodies, {row['joints']} joints, {row['dofs']} degrees of freedom"
            print(f"model {row['model']:>3}: {row['compiled']} modules, {row['first_step_s']:.2f} s, {size}")
    last = rows[-1]
    print(f"model {last['model']:>3}: {last['compiled']} modules, {1e3 * last['first_step_s']:.1f} ms")
    unsound = [row["model"] for row in rows if not row["sound"]]
    if unsound:
        print(f"not sound after a step: models {unsound}")
    return last["compiled"] == 0 and not unsound


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=int, default=100)
    parser.add_argument("--max-bodies", type=int, default=24)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path, default=None)
    options = parser.parse_args()
    if os.environ.get(_CHILD):
        print(json.dumps(build_all(options.models, options.max_bodies, options.device)))
        return 0
    with tempfile.TemporaryDirectory(prefix="simwarp-models-") as cache:
        done = subprocess.run(
            [sys.executable, __file__, *sys.argv[1:]], env=os.environ | {"WARP_CACHE_PATH": cache, _CHILD: "1"},
            stdout=subprocess.PIPE, encoding="utf-8", errors="replace",
        )  # fmt: skip
    if done.returncode != 0:
        return done.returncode
    result = json.loads(done.stdout.splitlines()[-1])
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0 if report(result) else 1


if __name__ == "__main__":
    sys.exit(main())
