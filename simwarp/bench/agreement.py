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
RANGE: Final = 1e-3
"""Difference of a range, depth or point that counts [m]: five times that of a position, for what turns with a body."""
VALUES: Final = 0.02
"""Share of a frame's values that may differ: rays at edges fall to one side or the other."""
STATE: Final = ("body_x", "joint_q")
"""Arrays of the state that are compared."""
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
        frames: largest share of a frame's values that differ, bytes of a picture or ranges; None without sensors.
        agrees: whether all that is within its bound.
    """

    scene: str
    worlds: int
    steps: int
    seconds: float
    repeats: bool
    position: float
    frames: float | None
    agrees: bool


def agreement_scenes() -> list[str]:
    """Names of what can be compared."""
    return [name for name in (*bench_scenes(), *VEHICLES, *SENSOR_SCENES) if name not in LEFT_OUT]


def first_step(name: str, device: str, worlds: int = 4) -> float:
    """From the model of a scene to the end of its first step, with the kernels that are not in the cache [s]."""
    begin = time.perf_counter()
    run = _make(name, device, worlds)
    if name not in VEHICLES:  # they settle for thousands of steps
        run.set_motion()
    run.single_step()
    run.wait()
    return time.perf_counter() - begin


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
    shares = [_differing(values, found[key]) for key, values in host.items() if key not in STATE]
    position = float(np.abs(host["body_x"] - found["body_x"]).max(initial=0.0))
    agrees = repeats and position <= POSITION and all(share <= VALUES for share in shares)
    return Agreement(name, worlds, steps, seconds, repeats, position, max(shares, default=None), agrees)


def _differing(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> float:
    """Share of the values of a frame that differ."""
    if one.dtype == np.uint8:
        return float((one != other).mean())
    return float((~np.isclose(one, other, rtol=0.0, atol=RANGE, equal_nan=True)).mean())


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
    arrays: dict[str, Any] = {key: getattr(run.sim.state, key) for key in STATE}
    arrays |= {sensor.name: sensor.data for sensor in run.sim.sensors}
    return {key: array.numpy().copy() for key, array in arrays.items()}, seconds


def disagreements(rows: Sequence[Agreement]) -> list[str]:
    """A line for each scene that does not agree."""
    lines = []
    for row in rows:
        if not row.repeats:
            lines.append(f"{row.scene}: two runs differ")
        elif not row.agrees:
            frames = "" if row.frames is None else f", {row.frames:.1%} of a frame"
            lines.append(f"{row.scene}: {row.position:.2g} m from the CPU after {row.steps} steps{frames}")
    return lines
