"""Every scene and sensor of `simwarp bench` on a GPU against a CPU: `python -m scripts.gpu_agreement cuda:0 OUT.json`.

Both start in the same state and take the same steps. Compilers round differently, and contacts amplify: what must agree
is the motion within the tolerance of the solver, after a few steps. The same device twice gives the same bits.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from simwarp.bench.machine import describe
from simwarp.bench.measure import SceneRun, TimedRun
from simwarp.bench.sensor_rows import SensorRun
from simwarp.bench.workloads import SENSOR_SCENES, bench_scenes

WORLDS = 32
STEPS = 10
POSITION = 2e-4
"""Largest difference of a position after these steps [m]: ten times the solver's loosest tolerance (1e-3 m/s) over the
ten steps of 5 ms, and the growth of a difference in one impact."""
BYTES = 0.02
"""Share of a picture's bytes that may differ: edges fall to one side or the other."""


def run(name: str, device: str) -> tuple[TimedRun, dict[str, np.ndarray]]:
    """A scene after some steps."""
    made: TimedRun = (
        SensorRun(name, WORLDS, device, None)
        if name in SENSOR_SCENES
        else SceneRun(bench_scenes()[name], WORLDS, device, None)
    )
    made.set_motion()
    for _ in range(STEPS):
        made.single_step()
    state = made.sim.state
    found: dict[str, Any] = {"body_x": state.body_x, "joint_q": state.joint_q}
    for sensor in made.sim.sensors:
        found[sensor.name] = sensor.data
    return made, {key: array.numpy().copy() for key, array in found.items()}


def compare(name: str, device: str) -> dict[str, Any]:
    """The row of a scene."""
    _, host = run(name, "cpu")
    _, other = run(name, device)
    _, again = run(name, device)
    row: dict[str, Any] = {"scene": name, "repeats": all(np.array_equal(other[key], again[key]) for key in other)}
    for key, values in host.items():
        if values.dtype == np.uint8:
            row[key] = float((values != other[key]).mean())
        else:
            near = np.isfinite(values) & np.isfinite(other[key])
            row[key] = float(np.abs(values - other[key])[near].max(initial=0.0))
    pixels = [row[key] for key, values in host.items() if values.dtype == np.uint8]
    row["agrees"] = bool(row["repeats"] and row["body_x"] <= POSITION and all(share <= BYTES for share in pixels))
    return row


def main(device: str, out: str) -> int:
    """Compare all, write the rows, 1 where one does not agree."""
    rows = []
    for name in [
        *(each for each in bench_scenes() if each != "pile"),
        *(each for each in SENSOR_SCENES if each != "rays"),
    ]:
        rows.append(compare(name, device))
        print(rows[-1], flush=True)
    found = {"machine": describe(wp.get_device(device)), "rows": rows}
    Path(out).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return int(not all(row["agrees"] for row in rows))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
