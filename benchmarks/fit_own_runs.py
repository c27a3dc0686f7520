"""Ten parameters of the HMMWV from own runs with the noise of real sensors: `python -m benchmarks.fit_own_runs`.

The vehicle that is recorded differs from the shipped one in ten numbers. The fit begins at the shipped one, and is told
the readings of two runs of five seconds, the inputs, and how noisy each sensor is. Errors are those of the fitted
numbers; an interval holds the truth or does not.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.warp_start import start_warp
from simwarp.identify import Fit, FitConfig, FitResult, fit_config, load_target
from simwarp.identify.fitted_parameters import FittedParameters
from simwarp.identify.world_numbers import World

Array = npt.NDArray[np.float64]

VEHICLE: Final = "hmmwv"
DT: Final = 0.002
SAMPLE: Final = 0.01
SECONDS: Final = 5.0
SPRING, DAMPER = "suspension.springs[0].spring_curve", "suspension.springs[1].damper_map"
TRUTH: Final = {
    "chassis.components[0].mass": 2250.0,
    "chassis.components[0].com[0]": 0.12,
    "chassis.components[0].inertia[2]": 3200.0,
    f"axles[0].{SPRING}": 1.12,
    f"axles[1].{SPRING}": 0.9,
    f"axles[*].{DAMPER}": 1.2,
    "axles[*].tire.parameters.slope_y": 0.88,
    "engine.torque": 1.1,
    "steerings[0].steering.max_angle": 0.56,
    "axles[*].brake.max_torque": 0.85,
}
"""What is fitted, and the numbers of the recorded vehicle; tables and pairs as factors."""
BESIDE: Final[dict[str, dict[str, Any]]] = {
    "chassis.components[0].inertia[2]": {"low": 2200.0, "high": 4000.0},
    f"axles[0].{SPRING}": {"also": "axles[0].suspension.springs[0].bump_curve"},
    f"axles[1].{SPRING}": {"also": "axles[1].suspension.springs[0].bump_curve"},
    f"axles[*].{DAMPER}": {"also": "axles[*].suspension.springs[1].damper_curve"},
}
"""Bounds, and tables that go along."""
NOISE: Final = {
    "speed_mps": 0.05, "yawrate_radps": 0.005, "ax_chassis_mps2": 0.1, "latacc_com_mps2": 0.1,
    "pitchrate_radps": 0.005, "rollrate_radps": 0.005, "engine_radps": 1.0,
    **{f"spin_{wheel}_radps": 0.1 for wheel in ("FL", "FR", "RL", "RR")},
    **{f"travel_{wheel}_m": 0.001 for wheel in ("FL", "FR", "RL", "RR")},
}  # fmt: skip
"""Standard deviations of the sensors, in SI."""
INPUTS: Final = ("steering", "throttle", "braking")


def inputs_of_runs(times: npt.NDArray[np.floating]) -> list[tuple[float, Array]]:
    """Speed at the start [m/s] and (n, 3) inputs of each run: a sweep of the steering, then pedals and a turn."""
    sweep = 0.35 * np.sin(2.0 * np.pi * (0.3 + 0.12 * times) * times) * np.clip(times - 0.5, 0.0, 1.0)
    turn = np.where(times < 3.5, 0.15, 0.0) * np.clip((times - 1.2) / 0.2, 0.0, 1.0)
    brakes = np.where((times > 2.2) & (times < 3.2), 0.25, 0.0) + np.where(times > 4.0, 0.12, 0.0)
    return [
        (12.0, np.stack([sweep, np.full(len(times), 0.4), np.zeros(len(times))], axis=1)),
        (7.0, np.stack([turn, np.where(times < 2.0, 0.8, 0.0), brakes], axis=1)),
    ]


def configuration(folder: Path, iterations: int) -> FitConfig:
    """The fit, of logs in a folder."""
    speeds = [speed for speed, _ in inputs_of_runs(np.zeros(1))]
    return fit_config(
        {
            "target": VEHICLE, "dt": DT, "sample": SAMPLE, "warmup": 0.0,
            "runs": [
                {"file": [f"run{index}.npz", f"inputs{index}.npz"], "start": {"speed_mps": speed}}
                for index, speed in enumerate(speeds)
            ],
            "readings": {name: {"noise": noise} for name, noise in NOISE.items()},
            "inputs": {name: {} for name in INPUTS},
            "parameters": {name: BESIDE.get(name, {}) for name in TRUTH},
            "search": {"iterations": iterations, "tolerance": 1e-4},
        },
        folder=str(folder),
    )  # fmt: skip


def write_runs(folder: Path, seed: int, threads: int | None) -> None:
    """Record the vehicle with other numbers, and add the sensors' noise."""
    config = configuration(folder, 1)
    target = load_target(config, threads=threads)
    document = FittedParameters(config, target.document).changed(np.array(list(TRUTH.values())))
    differing = target.numbers(target.document, {}).different(target.numbers(document, {}))
    times = DT * np.arange(round(SECONDS / DT) + 1)
    runs = inputs_of_runs(times)
    rollout = target.rollout(len(runs), differing, tuple(NOISE), INPUTS)
    samples = round(SECONDS / SAMPLE)
    worlds = []
    for speed, inputs in runs:
        start = {"speed_mps": speed}
        worlds.append(World(target.numbers(document, start), inputs, start))
    record = rollout.run(worlds, samples)
    rng = np.random.default_rng(seed)
    record += np.array(list(NOISE.values())) * rng.standard_normal(record.shape)
    for index, (_, inputs) in enumerate(runs):
        columns = dict(zip(NOISE, record[:, index].T, strict=True))
        np.savez(folder / f"run{index}.npz", t_s=SAMPLE * np.arange(samples + 1), **columns)
        np.savez(folder / f"inputs{index}.npz", t_s=times, **dict(zip(INPUTS, inputs.T, strict=True)))


def fitted(folder: Path, iterations: int, threads: int | None) -> tuple[FitResult, float, float]:
    """The result, and the seconds that it took: by the clock, and of the CPU in all threads."""
    begin, worked = time.perf_counter(), time.process_time()
    fit = Fit(configuration(folder, iterations), threads=threads)
    result = fit.run(on_progress=lambda at: print(f"  iteration {at.iteration}: cost {at.cost:.6g}", flush=True))
    return result, time.perf_counter() - begin, time.process_time() - worked


def rows_of(result: FitResult) -> list[dict[str, Any]]:
    """A row per parameter with the truth, the error and whether the interval holds it."""
    rows = []
    for row in result.rows():
        truth = TRUTH[row["name"]]
        holds = row["low"] is not None and row["low"] <= truth <= row["high"]
        rows.append({**row, "truth": truth, "error": row["value"] / truth - 1.0, "holds": holds})
    return rows


def main() -> None:
    """Record, fit, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=1, help="draws of the noise")
    parser.add_argument("--iterations", type=int, default=25)
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--json", type=Path, default=None, help="file of all rows")
    given = parser.parse_args()
    start_warp()
    found = []
    for seed in range(given.seeds):
        with tempfile.TemporaryDirectory() as name:
            write_runs(Path(name), seed, given.threads)
            result, seconds, worked = fitted(Path(name), given.iterations, given.threads)
        rows = rows_of(result)
        for row in rows:
            print(
                f"{row['name']:<50} truth {row['truth']:9.4g}  fitted {row['value']:9.4g}  "
                f"error {100.0 * row['error']:+7.3f} %  {'holds' if row['holds'] else 'misses'}"
            )
        took = f"{seconds:.0f} s, {worked:.0f} s of CPU, {result.iterations} iterations"
        print(f"seed {seed}: {took}, cost {result.cost:.6g}: {result.reason}", flush=True)
        found.append(
            {"seed": seed, "seconds": seconds, "cpu_seconds": worked, "iterations": result.iterations, "rows": rows}
        )
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
