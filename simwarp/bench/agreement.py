"""A GPU against the CPU: scenes, vehicles and sensors of `bench` start in one state on both, and take equal steps."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from simwarp.bench.measure import SceneRun, TimedRun
from simwarp.bench.sensor_rows import SensorRun
from simwarp.bench.vehicle_rows import VehicleRun
from simwarp.bench.workloads import SENSOR_SCENES, bench_scenes

STEPS: Final = 10
POSITION: Final = 2e-4
"""Largest difference of a position after these steps [m]. Compilers round differently, and contacts amplify: what must
agree is the motion within ten times the loosest tolerance of a solver (1e-3 m/s) over ten steps of 5 ms, and the growth
of a difference in one impact."""
BYTES: Final = 0.02
"""Share of a picture's bytes that may differ: edges fall to one side or the other."""
VEHICLES: Final = ("hmmwv", "hmmwv-soil")
LEFT_OUT: Final = ("pile", "rays")
"""A pile falls apart, where nothing agrees for long; rays are no simulation."""


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How a scene on a device agrees with the CPU.

    Attributes:
        scene: its name.
        worlds, steps: that were simulated.
        seconds: from the model to the end of the first step on the device, with the kernels that are not in the cache.
        repeats: whether the device gives the same bits twice.
        position: largest difference of a position [m].
        bytes: largest share of bytes of a picture that differ; None without pictures.
        agrees: whether all that is within its bound.
    """

    scene: str
    worlds: int
    steps: int
    seconds: float
    repeats: bool
    position: float
    bytes: float | None
    agrees: bool


def agreement_scenes() -> list[str]:
    """Names of what can be compared."""
    return [name for name in (*bench_scenes(), *VEHICLES, *SENSOR_SCENES) if name not in LEFT_OUT]


def compare(name: str, device: str, worlds: int, steps: int = STEPS) -> Agreement:
    """Compare one scene.

    Args:
        name: one of `agreement_scenes`.
        device: of CUDA.
        worlds, steps: to simulate.
    """
    host, _ = _arrays_after(name, "cpu", worlds, steps)
    found, seconds = _arrays_after(name, device, worlds, steps)
    again, _ = _arrays_after(name, device, worlds, steps)
    repeats = all(np.array_equal(found[key], again[key], equal_nan=True) for key in found)
    images = [key for key, values in host.items() if values.dtype == np.uint8]
    shares = [float((host[key] != found[key]).mean()) for key in images]
    position = float(np.abs(host["body_x"] - found["body_x"]).max(initial=0.0))
    agrees = repeats and position <= POSITION and all(share <= BYTES for share in shares)
    return Agreement(name, worlds, steps, seconds, repeats, position, max(shares, default=None), agrees)


def _make(name: str, device: str, worlds: int) -> TimedRun:
    if name in SENSOR_SCENES:
        return SensorRun(name, worlds, device, None)
    if name in VEHICLES:
        return VehicleRun(name, worlds, device, None)
    return SceneRun(bench_scenes()[name], worlds, device, None)


def _arrays_after(name: str, device: str, worlds: int, steps: int) -> tuple[dict[str, np.ndarray[Any, Any]], float]:
    """State and frames after some steps, and the time until the first one was done [s]."""
    begin = time.perf_counter()
    run = _make(name, device, worlds)
    run.settle_device = "cpu"  # one start for all
    run.set_motion()
    run.single_step()
    run.wait()
    seconds = time.perf_counter() - begin
    for _ in range(steps - 1):
        run.single_step()
    state = run.sim.state
    arrays: dict[str, Any] = {"body_x": state.body_x, "joint_q": state.joint_q}
    arrays |= {sensor.name: sensor.data for sensor in run.sim.sensors}
    return {key: array.numpy().copy() for key, array in arrays.items()}, seconds


def disagreements(rows: Sequence[Agreement]) -> list[str]:
    """A line for each scene that does not agree."""
    lines = []
    for row in rows:
        if not row.repeats:
            lines.append(f"{row.scene}: two runs differ")
        elif not row.agrees:
            images = "" if row.bytes is None else f", {row.bytes:.1%} of a picture"
            lines.append(f"{row.scene}: {row.position:.2g} m from the CPU after {row.steps} steps{images}")
    return lines
