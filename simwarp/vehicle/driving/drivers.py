"""Drivers: force elements that write a vehicle's inputs before each step."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.object_repr import ReadableFields
from simwarp.core.piecewise_linear import function_arrays
from simwarp.core.types import formatted
from simwarp.core.wording import nearest
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.vehicle.drivers_kernels import Script, run_script
from simwarp.vehicle.results.channels import COLUMNS, PULLS, SINKAGES, Run
from simwarp.vehicle.results.track_readings import MOST_ARMS, track_columns
from simwarp.vehicle.spec.parts import LARGEST
from simwarp.vehicle.spec.vehicle_spec import Points, SpecError
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle
from simwarp.vehicle.vehicle import Vehicles

HELD: Points = ((0.0, 0.0),)
COAST: Points = ((0.0, -1.0),)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScriptSpec(ReadableFields):
    """Inputs as piecewise linear functions of time [s], constant beyond their ends; two points at one time are a jump.

    Where `speed` [m/s] is not negative, a PI controller holds it with throttle and brake; elsewhere the pedals follow
    their own functions.

    Raises:
        SpecError: a function has no points, or its times are not in order.
    """

    steering: Points = HELD
    throttle: Points = HELD
    braking: Points = HELD
    speed: Points = COAST
    proportional: float = 0.5
    """Pedal per speed error [s/m]."""
    integral: float = 0.1
    """Pedal per integrated speed error [1/m]."""
    brake_share: float = 0.2
    """Braking per negative pedal."""

    def __post_init__(self) -> None:
        for name in ("steering", "throttle", "braking", "speed"):
            points = getattr(self, name)
            times = [time for time, _ in points]
            if not points or times != sorted(times):
                raise SpecError(f"{name}: must be (time, value) points in order, got {formatted(points)}")


TIMES = ("t_s", "time", "t")
SCRIPT_COLUMNS = {"steering": "steering", "steer": "steering", "throttle": "throttle", "braking": "braking",
                  "brake": "braking", "speed_target": "speed"}  # fmt: skip
"""Columns of a script's file that are read; a record of `simwarp drive` has some of them."""


LIMITS = {"steering": (-1.0, 1.0), "throttle": (0.0, 1.0), "braking": (0.0, 1.0)}
"""Of the channels; more would count as the limit, and be recorded as if it did not."""


def read_script(path: Path) -> tuple[ScriptSpec, float]:
    """A script from a CSV file with a header, and its last time [s].

    Columns: t_s (or time, t) [s], and any of steering (or steer, -1..1), throttle, braking (or brake, 0..1),
    speed_target [m/s]. Those of a record of `simwarp drive` may stand beside them. Times count from the file's first
    row on.

    Raises:
        SpecError: the file cannot be read, lacks these columns or has others, or a value cannot be used.
    """
    run = Run.read(path)
    names: dict[str, str] = {}
    for name in run.columns:
        channel = "time" if name in TIMES else SCRIPT_COLUMNS.get(name)
        if channel in names:
            raise SpecError(f"{path}: column {formatted(name)}: the same as {names[channel]!r}; leave out one of them")
        if channel is not None:
            names[channel] = name
    if "time" not in names:
        raise SpecError(f"{path}: needs a column of times (t_s), has {', '.join(run.columns)}")
    if len(names) < 2:
        raise SpecError(f"{path}: needs a column of steering, throttle or braking, has {', '.join(run.columns)}")
    known = (*TIMES, *SCRIPT_COLUMNS, *COLUMNS, *SINKAGES, *PULLS, *track_columns((MOST_ARMS, MOST_ARMS)))
    for name in run.columns:
        if name not in known:
            listed = f"{', '.join((*TIMES, *SCRIPT_COLUMNS))} and those of a record"
            raise SpecError(f"{path}: column {formatted(name)}: unknown{nearest(name, known)}; known: {listed}")
    time = run[names["time"]]
    _check_times(path, names["time"], time)
    channels: dict[str, Any] = {}
    for channel, name in names.items():
        if channel != "time":
            _check_values(path, name, run[name], *LIMITS.get(channel, (-LARGEST, LARGEST)))
            channels[channel] = tuple(zip((time - time[0]).tolist(), run[name].tolist(), strict=True))
    return ScriptSpec(**channels), float(time[-1] - time[0])


def _check_times(path: Path, name: str, time: npt.NDArray[np.float64]) -> None:
    good = np.abs(time) <= LARGEST
    if not good.all():
        raise SpecError(f"{path}: {_row(int(np.argmin(good)))}: {name}: must be a finite number")
    back = np.flatnonzero(np.diff(time) < 0.0)
    if back.size:
        row = int(back[0]) + 1
        raise SpecError(f"{path}: {_row(row)}: {name}: must be in order, got {time[row]:g} after {time[row - 1]:g}")
    if not time[-1] > time[0]:
        raise SpecError(f"{path}: {name}: must have two or more rows with different times, got {time[0]:g} alone")


def _check_values(path: Path, name: str, values: npt.NDArray[np.float64], low: float, high: float) -> None:
    good = np.isfinite(values) & (values >= low) & (values <= high)
    if not good.all():
        row = int(np.argmin(good))
        rule = f"from {low:g} to {high:g}" if high < LARGEST else "a finite number"
        raise SpecError(f"{path}: {_row(row)}: {name}: must be {rule}, got {values[row]:g}")


def _row(index: int) -> str:
    """A row for people, who count from 1 below the header."""
    return f"row {index + 1}"


class ScriptedDriver(ForceElement):
    """Drives all worlds by one script: a `ForceElement` that comes before its vehicle.

    Args:
        vehicle: whose `input` it writes; `Vehicles` follow the script all together, each with a controller of its own.
        script: inputs over time.
    """

    def __init__(self, vehicle: AnyVehicle | Vehicles, script: ScriptSpec) -> None:
        device = vehicle.model.device
        self.vehicle = vehicle
        self.script = script
        channels = [script.steering, script.throttle, script.braking, script.speed]
        self._script = Script()
        self._script.start, self._script.time, self._script.value = function_arrays(channels, float, device)
        self._script.proportional = script.proportional
        self._script.integral = script.integral
        self._script.brake_share = script.brake_share
        self._parts = vehicle.parts[0] if isinstance(vehicle, Vehicles) else vehicle.parts
        self.error_sum = wp.zeros(vehicle.input_rows.shape[:2], dtype=float, device=device)

    def _readable_title(self) -> str:
        return f" of vehicle '{self._parts.spec.name}', by a script"

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """The controller's integral."""
        return {"error_sum": self.error_sum}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that writes the inputs."""
        vehicle, reference = self.vehicle, wp.vec3(*self._parts.reference)
        return [
            simulation.shares.record(
                run_script, self.error_sum.shape[1],
                inputs=[dt, self._script, vehicle.chassis, reference, simulation.state.arrays],
                outputs=[self.error_sum, vehicle.input_rows],
            )
        ]  # fmt: skip
