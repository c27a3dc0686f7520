"""Control steps per second of the quadruped by the clock, and of MuJoCo C on mjbatch's threads with the same robot.

    python benchmarks/quadruped_speed.py [--worlds 512] [--threads 2]

Each way steps the same number of worlds, by four steps of 5 ms per control step, towards random targets around the
stance. `task` is all of `quadruped-velocity`: observations, rewards, resets and commands; `physics` is its simulation
alone. MuJoCo's robot is written from the same model; contacts are soft there, and its physics alone is stepped. Ways
take turns; medians are told. Without mjbatch (`pip install mjbatch`) it is left out.

Writes benchmarks/results/quadruped_speed.json.
"""

from __future__ import annotations

import argparse
import importlib.util
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
import warp as wp

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.bench.machine import describe  # noqa: E402
from simwarp.core.threads import default_threads  # noqa: E402
from simwarp.core.warp_start import start_warp  # noqa: E402
from simwarp.exporters import mjcf_of  # noqa: E402
from simwarp.scenes import QUADRUPED_STANCE, QUADRUPED_STANCE_HEIGHT, quadruped  # noqa: E402
from simwarp.tasks import make  # noqa: E402
from simwarp.train.runs.run_files import write_json  # noqa: E402

RESULT: Final = ROOT / "benchmarks" / "results" / "quadruped_speed.json"
WARM, STEPS, REPEATS = 25, 25, 9
"""Control steps before the clock runs, of one turn, and turns."""
SUBSTEPS, DT, SWING = 4, 0.005, 0.3
"""Physics steps per control step, their length [s], and the largest deviation of a target from the stance [rad]."""
SOFTNESS: Final = 0.02
"""Time constant of MuJoCo's contacts [s]: its default."""


def of_task(worlds: int, **config: Any) -> Callable[[], object]:
    """A control step of the task with random actions."""
    task = make("quadruped-velocity", worlds, seed=1, **config)
    task.restart(seed=1)
    scale = SWING / task.config.action_scale
    random = torch.Generator().manual_seed(1)
    return lambda: task.step(scale * (2.0 * torch.rand(worlds, 12, generator=random) - 1.0))


def of_physics(worlds: int) -> Callable[[], object]:
    """A control step of the task's simulation alone."""
    task: Any = make("quadruped-velocity", worlds, seed=1)
    task.restart(seed=1)
    random = torch.Generator().manual_seed(1)

    def step() -> None:
        swing = SWING * (2.0 * torch.rand(worlds, 12, generator=random) - 1.0)
        task._targets[:, task._columns] = task._stance + swing
        task.simulation.advance(SUBSTEPS)

    return step


def of_mujoco(worlds: int, threads: int) -> Callable[[], object]:
    """A control step of MuJoCo's worlds."""
    import mjbatch
    import mujoco

    own = quadruped().finalize(world_count=1, device="cpu")
    model: Any = mujoco.MjModel.from_xml_string(mjcf_of(own, timestep=DT, softness=SOFTNESS).text)
    stance = np.array(list(QUADRUPED_STANCE.values()))
    batch: Any = mjbatch.Batch(model, worlds, num_threads=threads)
    position, controls = batch.bind("qpos"), batch.bind("ctrl")
    position[:, 2], position[:, 7:] = QUADRUPED_STANCE_HEIGHT, stance
    random = np.random.default_rng(1)

    def step() -> None:
        controls[:, :12] = stance + SWING * (2.0 * random.random((worlds, 12)) - 1.0)
        for _ in range(SUBSTEPS):
            batch.step()
        if not np.isfinite(position).all():
            raise SystemExit("MuJoCo's worlds broke down: their speed means nothing")

    return step


def measured(worlds: int, threads: int) -> dict[str, list[float]]:
    """Control steps per second of each way, turn by turn."""
    ways = {
        "task": of_task(worlds),
        "task, rough ground": of_task(worlds, ground="rough"),
        "task, rough ground, scan": of_task(worlds, ground="rough", obs="scan"),
        "physics": of_physics(worlds),
    }
    if importlib.util.find_spec("mjbatch") is None:
        print("mjbatch is not installed: left out (pip install mjbatch)", file=sys.stderr)
    else:
        ways["MuJoCo C on mjbatch, physics"] = of_mujoco(worlds, threads)
    rates: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(REPEATS + 1):
        for name, step in ways.items():
            count = WARM if turn == 0 else STEPS
            began = time.perf_counter()
            for _ in range(count):
                step()
            if turn:
                rates[name].append(count * worlds / (time.perf_counter() - began))
    return rates


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=512)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    start_warp()
    torch.set_num_threads(1)
    with default_threads(options.threads):
        rates = measured(options.worlds, options.threads)
    rows = {name: {"median": statistics.median(of), "least": min(of), "most": max(of)} for name, of in rates.items()}
    print("| | control steps/s | least and most |\n|---|---|---|")
    for name, row in rows.items():
        print(f"| {name} | {row['median']:,.0f} | {row['least']:,.0f} to {row['most']:,.0f} |")
    about = {"worlds": options.worlds, "threads": options.threads, "substeps": SUBSTEPS, "dt": DT}
    write_json(RESULT, {**about, "control_steps_per_s": rows, "machine": describe(wp.get_device("cpu"))})


if __name__ == "__main__":
    main()
