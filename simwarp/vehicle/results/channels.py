"""Recorded channels of a vehicle's run: the columns that analysts expect, from the arrays of a Simulation."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.files import replacing
from simwarp.core.object_repr import Readable, ReadableFields, plural
from simwarp.core.types import formatted
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.results.chassis_motion import ChassisMotion, matrices
from simwarp.vehicle.results.named_channels import NamedReadings
from simwarp.vehicle.results.track_readings import TrackReadings
from simwarp.vehicle.spec.vehicle_files import read_text
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.tires.soil_tires import SoilTires
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle
from simwarp.vehicle.vehicle import Vehicle

Array = npt.NDArray[np.float64]

COLUMNS: Final = (
    "t_s", "x_m", "y_m", "z_m", "yaw_rad", "pitch_rad", "roll_rad", "speed_mps", "yawrate_radps", "latacc_com_mps2",
    "v_times_yawrate_mps2", "omega_FL_radps", "omega_FR_radps", "omega_RL_radps", "omega_RR_radps", "engine_radps",
    "gear", "Fz_FL_N", "Fz_FR_N", "Fz_RL_N", "Fz_RR_N", "throttle", "brake", "steer", "steerangle_FL_rad",
    "steerangle_FR_rad",
)  # fmt: skip
"""Of the first and the last axle, in the axes and signs of ISO 8855 (docs/vehicles.md#the-usual-columns)."""
WHEELS: Final = ("FL", "FR", "RL", "RR")
SINKAGES: Final = ("sink_FL_m", "sink_FR_m", "sink_RL_m", "sink_RR_m")
"""Further columns of a vehicle on soil: depth of the soil below the wheels' centres."""
PULLS: Final = ("slip", "pull_N", "pull_per_weight", "wheel_torque_Nm")
"""Further columns of a drawbar test: slip of the driven wheels, pull, pull over weight, the ground's torque on them."""


class WheelReadings:
    """Columns of a wheeled vehicle from the arrays of its Simulation, beside the motion of its chassis."""

    def __init__(self, simulation: Simulation, vehicle: Vehicle) -> None:
        self._simulation, self._vehicle = simulation, vehicle
        self._on_soil = isinstance(vehicle.tires, SoilTires)
        self.names = (*COLUMNS, *(SINKAGES if self._on_soil else ()))
        """Of the columns."""
        axles = len(vehicle.parts.spec.axles)
        self._wheels = [0, 1, 2 * axles - 2, 2 * axles - 1]
        self._last_v: Array | None = None
        self._last_t: Array | None = None

    def read(self, motion: ChassisMotion, worlds: slice) -> dict[str, Array]:
        """(n,) by name, of the present state."""
        state, vehicle, parts, w = self._simulation.state, self._vehicle, self._vehicle.parts, worlds
        acceleration = np.zeros_like(motion.velocity)
        if self._last_v is not None and self._last_t is not None:
            acceleration = (motion.velocity - self._last_v) / np.maximum(motion.time - self._last_t, 1e-9)[:, None]
        self._last_v, self._last_t = motion.velocity, motion.time
        if vehicle.reduced is not None:
            spins = vehicle.reduced.turn_rate.numpy()[w]
            axes = vehicle.reduced.axis.numpy()[w].astype(float)
        else:
            starts = self._simulation.model.joint_dof_start
            spins = state.joint_qd.numpy()[w][:, [starts[parts.sides[k].turn] for k in self._wheels]]
            axes = self._axes(motion, worlds)
        loads, inputs = vehicle.tires.load.numpy()[w][:, self._wheels], vehicle.input.numpy()[w]
        found = {
            "latacc_com_mps2": np.einsum("wi,wi->w", acceleration, motion.level_axes[:, :, 1]),
            "v_times_yawrate_mps2": motion.speed * motion.yaw_rate,
            "engine_radps": vehicle.engine_speed.numpy()[w], "gear": vehicle.gear.numpy()[w].astype(float),
            "throttle": inputs[:, 1], "brake": inputs[:, 2], "steer": inputs[:, 0],
        }  # fmt: skip
        for k, wheel in enumerate(WHEELS):
            found |= {f"omega_{wheel}_radps": spins[:, k], f"Fz_{wheel}_N": loads[:, k]}
        for k, wheel in enumerate(WHEELS[:2]):
            found[f"steerangle_{wheel}_rad"] = np.arctan2(-axes[:, k, 0], axes[:, k, 1])
        if self._on_soil:
            sinkage = vehicle.tires.deflection.numpy()[w][:, self._wheels]
            found |= {name: sinkage[:, k] for k, name in enumerate(SINKAGES)}
        return found

    def _axes(self, motion: ChassisMotion, worlds: slice) -> Array:
        """(n, 2, 3) of the front wheels, in axes of the chassis."""
        rotations = self._simulation.state.body_rot.numpy()
        axes = [
            matrices(rotations[worlds, side.spindle].astype(float))[:, :, 1] for side in self._vehicle.parts.sides[:2]
        ]
        return np.einsum("wij,wki->wkj", motion.rotation, np.stack(axes, axis=1))


class Recorder(Readable):
    """Collects rows of some worlds; `sample` reads from the device, so call it at the rate of the output.

    Args:
        simulation: with the vehicle among its elements.
        vehicle: whose run it is.
        worlds: indices of the worlds; the first alone by default.
        start: time of the simulation that counts as zero [s].
        further: (W,) arrays by the names of columns that come after the usual ones.
        channels: names of further channels or patterns of them, such as `Fx_*` (docs/vehicles.md); they come last.

    Raises:
        SpecError: there is no such channel, or it needs a Simulation with `joint_reactions=True`.
    """

    def __init__(
        self, simulation: Simulation, vehicle: AnyVehicle, worlds: slice = slice(0, 1), start: float = 0.0,
        further: Mapping[str, wp.array] = MappingProxyType({}), channels: Iterable[str] = (),
    ) -> None:  # fmt: skip
        self.simulation, self.vehicle, self.worlds, self.start = simulation, vehicle, worlds, start
        self._further = dict(further)
        self._readings: WheelReadings | TrackReadings = (
            TrackReadings(simulation, vehicle)
            if isinstance(vehicle, TrackedVehicle)
            else WheelReadings(simulation, vehicle)
        )
        usual = (*self._readings.names, *further)
        self._named = NamedReadings(simulation, vehicle, channels, usual)
        self.names = (*usual, *(channel.name for channel in self._named.channels))
        """Of the columns."""
        self.channels = self._named.channels
        """Those that were chosen by name."""
        self.rows: list[Array] = []

    def _readable_title(self) -> str:
        return f" of vehicle '{self.vehicle.parts.spec.name}': {plural(len(self.rows), 'row')}"

    def sample(self) -> None:
        """Adds one row per world, of the present state; waits for the device."""
        motion = ChassisMotion.of(self.simulation, self.vehicle, self.worlds)
        found = {"t_s": self._manoeuvre_time(motion.time)} | motion.columns()
        found |= self._readings.read(motion, self.worlds)
        found |= self._named.read(motion, self.worlds)
        found |= {name: array.numpy()[self.worlds] for name, array in self._further.items()}
        self.rows.append(np.stack([found[name] for name in self.names], axis=-1))

    def _manoeuvre_time(self, t: Array) -> Array:
        """Whole steps: the simulation adds up a step of single precision, 30 µs off after ten minutes."""
        dt = self.simulation.dt
        return np.asarray(np.round(np.round(t / dt) * dt - self.start, 9))

    def record_inputs(self) -> None:
        """Enters what the driver did in the step after `sample`: the inputs at the sample's own time."""
        throttle = self.names.index("throttle")
        inputs = self.vehicle.input.numpy()[self.worlds]
        self.rows[-1][:, throttle : throttle + 3] = inputs[:, [1, 2, 0]]

    def table(self) -> Array:
        """All rows so far: (samples, worlds, columns), in the order of `names` and in their units."""
        return np.array(self.rows)

    def column(self, name: str) -> Array:
        """(samples, worlds) of one of `names`."""
        return self.table()[:, :, self.names.index(name)]


def _numbers(path: Path, line: int, row: list[str], header: list[str]) -> list[float]:
    """The numbers of a row."""
    if len(row) != len(header):
        raise SpecError(f"{path}: line {line}: must have {len(header)} numbers as the header has names, got {len(row)}")
    found = []
    for name, cell in zip(header, row, strict=True):
        try:
            found.append(float(cell))
        except ValueError:
            rule = f"a table of numbers with a header, got {formatted(cell)} in column {formatted(name)}"
            raise SpecError(f"{path}: line {line}: must be {rule}") from None
    return found


@dataclasses.dataclass(frozen=True)
class Run(ReadableFields):
    """A recorded run of one world: `COLUMNS` by name, or `track_columns` of a vehicle on tracks."""

    columns: dict[str, Array]

    @staticmethod
    def of(recorder: Recorder, world: int = 0) -> Run:
        """The run of one of the recorder's worlds."""
        table = recorder.table()[:, world]
        return Run({name: table[:, index] for index, name in enumerate(recorder.names)})

    @staticmethod
    def read(path: Path) -> Run:
        """A run from a CSV file.

        Raises:
            SpecError: it cannot be read, or is no table of numbers with a header.
        """
        text = read_text(path)
        try:
            lines = [(number, row) for number, row in enumerate(csv.reader(io.StringIO(text, newline="")), 1) if row]
        except csv.Error as error:
            raise SpecError(f"{path}: must be a table of numbers with a header: {error}") from None
        if len(lines) < 2:
            count = len(lines[0][1]) if lines else 1
            raise SpecError(f"{path}: must have rows of {count} numbers under its header, got none")
        header = [name.strip() for name in lines[0][1]]
        twice = next((name for name, count in Counter(header).items() if count > 1), None)
        if twice is not None:
            raise SpecError(f"{path}: column {formatted(twice)}: given twice; give it once")
        data = np.array([_numbers(path, number, row, header) for number, row in lines[1:]])
        return Run({name: data[:, index] for index, name in enumerate(header)})

    def write(self, path: Path) -> None:
        """Writes a CSV file with a header.

        Raises:
            FileError: the path cannot be written to.
            OutputError: the disk did not take it.
        """
        with replacing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            for row in np.stack(list(self.columns.values()), axis=1):
                writer.writerow([f"{value:.9g}" for value in row])

    def resampled(self, every: float) -> Run:
        """The run at multiples of a time [s], by linear interpolation; gears are those before."""
        t = self.columns["t_s"]
        first = math.ceil(t[0] / every - 1e-6)
        times = np.round(every * np.arange(first, math.floor(t[-1] / every + 1e-6) + 1), 6)
        before = np.clip(np.searchsorted(t, times + 1e-9, side="right") - 1, 0, None)
        found = {}
        for name, values in self.columns.items():
            if name == "gear":
                found[name] = values[before]
            elif name in ("yaw_rad", "roll_rad"):
                angle = np.interp(times, t, np.unwrap(values))
                found[name] = np.arctan2(np.sin(angle), np.cos(angle))
            else:
                found[name] = np.interp(times, t, values)
        return Run(found | {"t_s": times})

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def final(self) -> dict[str, Any]:
        """The last value of every column."""
        return {name: float(values[-1]) for name, values in self.columns.items()}
