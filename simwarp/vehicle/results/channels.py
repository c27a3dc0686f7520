"""Recorded channels of a vehicle's run: the columns that analysts expect, from the arrays of a Simulation."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.files import replacing
from simwarp.core.host_views import HostViews
from simwarp.core.object_repr import Readable, ReadableFields, plural
from simwarp.core.types import formatted
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.results.channel_samples import articulation_names
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
MOST_TAKEN: Final = 2**14
"""Rows of a record, of all its worlds, that are made at once: what they are made of is some megabytes."""
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
        self._articulations = articulation_names(vehicle.parts.spec)
        self.names = (*COLUMNS, *self._articulations, *(SINKAGES if self._on_soil else ()))
        """Of the columns."""
        axles = len(vehicle.parts.spec.axles)
        self._wheels = [0, 1, 2 * axles - 2, 2 * axles - 1]
        sides, starts = vehicle.parts.sides, simulation.model.joint_dof_start
        self._turns = [] if vehicle.parts.spec.is_reduced else [starts[sides[k].turn] for k in self._wheels]
        self._spindles = [side.spindle for side in sides[:2]]
        self._last_v: Array | None = None
        self._last_t: Array | None = None

    def read(self, motion: ChassisMotion, worlds: slice) -> dict[str, Array]:
        """(n,) by name, of the present state."""
        return self.columns(motion, self.take(worlds, HostViews()))

    def take(self, worlds: slice, views: HostViews) -> dict[str, Array]:
        """Copies of what the columns are made of; waits for the device."""
        vehicle, state = self._vehicle, self._simulation.state

        def of(array: wp.array, *rest: Any) -> Array:
            return np.array(views.of(array)[(worlds, *rest)])

        found = {
            "loads": of(vehicle.tires.load), "inputs": of(vehicle.input), "engine": of(vehicle.engine_speed),
            "gear": of(vehicle.gear),
        }  # fmt: skip
        if vehicle.reduced is not None:
            found |= {"spins": of(vehicle.reduced.turn_rate), "axes": of(vehicle.reduced.axis)}
        else:
            found |= {"spins": of(state.joint_qd, self._turns), "axes": of(state.body_rot, self._spindles)}
        if self._articulations:
            found["articulation"] = of(vehicle.articulation)
        return found | ({"sinkage": of(vehicle.tires.deflection)} if self._on_soil else {})

    def columns(self, motion: ChassisMotion, taken: Mapping[str, Array], times: int = 1) -> dict[str, Array]:
        """(n,) by name, of what was taken at some times one after the other."""
        inputs, loads = taken["inputs"], taken["loads"][:, self._wheels]
        axes, spins = self._axes(motion, taken["axes"]), taken["spins"]
        found = {
            "latacc_com_mps2": np.einsum("wi,wi->w", self._acceleration(motion, times), motion.level_axes[:, :, 1]),
            "v_times_yawrate_mps2": motion.speed * motion.yaw_rate,
            "engine_radps": taken["engine"], "gear": taken["gear"].astype(float),
            "throttle": inputs[:, 1], "brake": inputs[:, 2], "steer": inputs[:, 0],
        }  # fmt: skip
        for k, wheel in enumerate(WHEELS):
            found |= {f"omega_{wheel}_radps": spins[:, k], f"Fz_{wheel}_N": loads[:, k]}
        for k, wheel in enumerate(WHEELS[:2]):
            found[f"steerangle_{wheel}_rad"] = np.arctan2(-axes[:, k, 0], axes[:, k, 1])
        for trailer, name in enumerate(self._articulations):
            found[name] = taken["articulation"][:, trailer]
        if self._on_soil:
            found |= {name: taken["sinkage"][:, wheel] for name, wheel in zip(SINKAGES, self._wheels, strict=True)}
        return found

    def _acceleration(self, motion: ChassisMotion, times: int) -> Array:
        """(n, 3) means since the time before, 0 at the first."""
        worlds = len(motion.time) // times
        before_v = motion.velocity[:worlds] if self._last_v is None else self._last_v
        before_t = motion.time[:worlds] if self._last_t is None else self._last_t
        change = motion.velocity - np.concatenate([before_v, motion.velocity[:-worlds]])
        elapsed = motion.time - np.concatenate([before_t, motion.time[:-worlds]])
        self._last_v, self._last_t = motion.velocity[-worlds:], motion.time[-worlds:]
        return np.asarray(change / np.maximum(elapsed, 1e-9)[:, None])

    def _axes(self, motion: ChassisMotion, taken: Array) -> Array:
        """(n, 2, 3) or more of the front wheels, in axes of the chassis."""
        if self._vehicle.reduced is not None:
            return taken.astype(float)
        axes = np.ascontiguousarray(matrices(taken.astype(float))[..., 1])
        return np.einsum("wij,wki->wkj", motion.rotation, axes)


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
        self._views = HostViews()
        self._rows: list[Array] = []
        self._taken: list[dict[str, Array]] = []
        """Of the samples behind these rows, which become rows many at a time."""

    def _readable_title(self) -> str:
        return f" of vehicle '{self.vehicle.parts.spec.name}': {plural(len(self.rows), 'row')}"

    @property
    def rows(self) -> list[Array]:
        """(n, columns) of each sample."""
        self._convert()
        return self._rows

    def sample(self) -> None:
        """Adds one row per world, of the present state; waits for the device."""
        if isinstance(self._readings, WheelReadings) and not self.channels:
            taken = ChassisMotion.take(self.simulation, self.vehicle, self.worlds, self._views)
            taken |= self._readings.take(self.worlds, self._views)
            further = {name: np.array(self._views.of(array)[self.worlds]) for name, array in self._further.items()}
            self._taken.append(taken | further)
            if len(self._taken) * len(taken["time"]) >= MOST_TAKEN:
                self._convert()
            return
        motion = ChassisMotion.of(self.simulation, self.vehicle, self.worlds)
        found = {"t_s": self._manoeuvre_time(motion.time)} | motion.columns()
        found |= self._readings.read(motion, self.worlds)
        found |= self._named.read(motion, self.worlds)
        found |= {name: array.numpy()[self.worlds] for name, array in self._further.items()}
        self._rows.append(np.stack([found[name] for name in self.names], axis=-1))

    def _convert(self) -> None:
        """Make rows of the samples that are only taken."""
        times = len(self._taken)
        if not times:
            return
        assert isinstance(self._readings, WheelReadings)  # of which alone they are
        taken = {name: np.concatenate([each[name] for each in self._taken]) for name in self._taken[0]}
        self._taken.clear()
        motion = ChassisMotion.made(self.vehicle, taken)
        found = {"t_s": self._manoeuvre_time(motion.time)} | motion.columns()
        found |= self._readings.columns(motion, taken, times) | {name: taken[name] for name in self._further}
        table = np.stack([found[name] for name in self.names], axis=-1)
        self._rows += list(table.reshape(times, -1, len(self.names)))

    def _manoeuvre_time(self, t: Array) -> Array:
        """Whole steps: the simulation adds up a step of single precision, 30 µs off after ten minutes."""
        dt = self.simulation.dt
        return np.asarray(np.round(np.round(t / dt) * dt - self.start, 9))

    def record_inputs(self) -> None:
        """Enters what the driver did in the step after `sample`: the inputs at the sample's own time."""
        inputs = self._views.of(self.vehicle.input)[self.worlds]
        if self._taken:
            self._taken[-1]["inputs"] = inputs.copy()
            return
        throttle = self.names.index("throttle")
        self._rows[-1][:, throttle : throttle + 3] = inputs[:, [1, 2, 0]]

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
        return Run._of_table(recorder.names, recorder.table()[:, world])

    @staticmethod
    def of_all(recorder: Recorder) -> list[Run]:
        """The runs of all of the recorder's worlds, in their order."""
        table = recorder.table()
        return [Run._of_table(recorder.names, table[:, world]) for world in range(table.shape[1])]

    @staticmethod
    def _of_table(names: Sequence[str], table: Array) -> Run:
        return Run({name: table[:, index] for index, name in enumerate(names)})

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
