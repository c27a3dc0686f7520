"""Residuals of a fit: unknowns in, differences from the logs out, a whole batch of vectors at a time.

Every world simulates one segment of one run with one set of numbers. Vectors that differ only in what does not touch a
world share it: a start of one segment, a bias, a delay of a reading cost no further worlds of the other segments.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import formatted
from simwarp.identify.fit_config import FitConfig
from simwarp.identify.fit_error import FitError
from simwarp.identify.fitted_parameters import FittedParameters, Unknown
from simwarp.identify.log_units import factor_of
from simwarp.identify.logs import RunLog, Signal
from simwarp.identify.segments import Segment, segments_of, start_values, value_and_slope
from simwarp.identify.vehicle_target import POSE
from simwarp.identify.world_numbers import Rollout, Target, World

Array = npt.NDArray[np.float64]

MOST_WORLDS: Final = 4096
"""Of one simulation; larger batches are simulated in parts."""
USUAL_NOISE: Final = 0.02
"""Share of a reading's range that stands for its noise where that is not given, until the fit tells it."""
ANGLES: Final = ("yaw_rad", "roll_rad")
"""Readings that jump by a turn."""
POSE_SCALES: Final = {"x_m": 0.1, "y_m": 0.1, "yaw_rad": 0.02}


@dataclasses.dataclass(frozen=True)
class Piece:
    """A segment with the samples that it is compared with.

    Attributes:
        segment: the times.
        measured: of each reading, the samples within them.
        start: values of readings that its worlds start with.
        pose: (3,) x, y [m] and heading [rad] at the beginning of the comparison; None: no reading depends on it.
    """

    segment: Segment
    measured: tuple[Signal, ...]
    start: dict[str, float]
    pose: Array | None


class FitProblem:
    """Runs of a target as one least-squares problem.

    Args:
        config: of the fit.
        target: whose numbers are fitted.
        runs: recorded ones.
        parameters: unknowns of the target and of the columns.
        fitted: whether starts are unknowns too; False: they are as measured, for runs that are only predicted.

    Attributes:
        unknowns: all, in the order of the vectors.
        pieces: of the runs.
        readings: names in the order of the residuals' columns.
        noise: standard deviation that one unit of a residual stands for, by reading.
        groups: rows of each reading among the residuals; priors follow.
        diverged: worlds that broke down so far.
    """

    def __init__(
        self, config: FitConfig, target: Target, runs: Sequence[RunLog], parameters: FittedParameters, *,
        fitted: bool = True,
    ) -> None:  # fmt: skip
        self.config, self.target, self.parameters, self.runs = config, target, parameters, runs
        self.readings, self.inputs = tuple(config.readings), tuple(config.inputs)
        warmup = target.usual_warmup if config.warmup is None else config.warmup
        self.noise = {name: self._noise_of(name) for name in self.readings}
        self.pieces = tuple(self._piece(segment) for segment in segments_of(config, runs, warmup))
        self.unknowns: list[Unknown] = list(parameters.unknowns)
        self._starts: dict[tuple[int, str], int] = {}
        self._poses: dict[tuple[int, int], int] = {}
        if fitted:
            self._add_starts()
        self._samples = max(piece.segment.samples(config.sample) for piece in self.pieces)
        self.groups = self._groups()
        self.diverged = 0
        self._differing: set[str] = set()
        self._rollouts: dict[int, Rollout] = {}

    # ---- what there is -----------------------------------------------------------------------------------------------

    def _noise_of(self, name: str) -> float:
        column = self.config.readings[name]
        if column.noise is not None:
            factor = abs(factor_of(column.unit, f"readings.{name}")) if column.unit else 1.0
            return float(column.noise * factor)
        values = np.concatenate([run.readings[name].within(run.begin, run.end).value for run in self.runs])
        size = float(np.ptp(values)) or float(np.abs(values).max())
        return USUAL_NOISE * (size or 1.0)

    def _piece(self, segment: Segment) -> Piece:
        run = self.runs[segment.run]
        measured = tuple(run.readings[name].within(segment.begin, segment.end) for name in self.readings)
        names = self.target.measured_start(self.readings)
        is_first = segment.first <= run.begin + 1e-9
        noisy = any(self.config.readings[name].noise is not None for name in names)
        start = start_values(run, segment, names, is_first, noisy)
        for name in start:
            if not self.target.can_start_with(name):
                raise FitError(
                    f"runs[{segment.run}].start: {formatted(name)}: no reading that '{self.target.name}' starts with"
                )
        return Piece(segment, measured, start, self._pose_at(run, segment.begin))

    def _pose_at(self, run: RunLog, time: float) -> Array | None:
        """Where a vehicle is at a time, from the readings that tell it; its heading from its path if need be."""
        if not any(name in self.readings for name in POSE):
            return None
        pose = np.zeros(3)
        slopes = np.zeros(3)
        for index, name in enumerate(POSE):
            if name in run.readings:
                signal = run.readings[name]
                if name in ANGLES:
                    signal = Signal(signal.time, np.unwrap(signal.value))
                pose[index], slopes[index] = value_and_slope(signal, time)
        if "yaw_rad" not in run.readings and np.hypot(slopes[0], slopes[1]) > 0.1:
            pose[2] = math.atan2(slopes[1], slopes[0])
        return pose

    def _add_starts(self) -> None:
        """Unknowns of single segments: their poses, and their starts where these are to be fitted."""
        for index, piece in enumerate(self.pieces):
            title = f"{self.runs[piece.segment.run].config.title} at {piece.segment.begin:g} s"
            if piece.pose is not None:
                placed = "x_m" in self.readings or "y_m" in self.readings
                for axis, (name, value) in enumerate(zip(POSE, piece.pose, strict=True)):
                    if not placed and name != "yaw_rad":
                        continue
                    self._poses[index, axis] = len(self.unknowns)
                    self.unknowns.append(
                        Unknown(
                            name=f"{name} of {title}", start=float(value), scale=POSE_SCALES[name], segment=index,
                            simulated=False,
                        )
                    )  # fmt: skip
            if self.config.fit_start:
                for name, value in piece.start.items():
                    deviation = self.noise.get(name, 0.0) or 0.1
                    self._starts[index, name] = len(self.unknowns)
                    self.unknowns.append(
                        Unknown(
                            name=f"{name} of {title}", start=value, scale=deviation, prior=(value, deviation),
                            segment=index,
                        )
                    )  # fmt: skip

    def _groups(self) -> list[slice]:
        counts = [sum(len(piece.measured[index].time) for piece in self.pieces) for index in range(len(self.readings))]
        ends = np.cumsum([0, *counts])
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]

    @property
    def starts(self) -> Array:
        """(P,) of the unknowns."""
        return np.array([each.start for each in self.unknowns])

    @property
    def row_count(self) -> int:
        """Residuals of a vector."""
        return self.groups[-1].stop + sum(each.prior is not None for each in self.unknowns)

    # ---- residuals ---------------------------------------------------------------------------------------------------

    def probe(self) -> None:
        """Find in which arrays worlds differ, by a change of every unknown.

        Raises:
            FitError: an unknown changes nothing that worlds can differ in.
        """
        vector = self.starts
        start = self.pieces[0].start
        base = self.target.numbers(self.parameters.changed(vector), start)
        for index, unknown in enumerate(self.parameters.unknowns[: self.parameters.document_count]):
            moved = vector.copy()
            step = self.config.search.difference * unknown.scale
            moved[index] += step if moved[index] + step <= unknown.high else -step
            try:
                found = base.different(self.target.numbers(self.parameters.changed(moved), start))
            except ValueError as error:
                raise FitError(f"parameters: {unknown.name}: {error}") from None
            if not found:
                rule = "must change something that worlds can differ in, got nothing"
                raise FitError(f"parameters: {unknown.name}: {rule}; leave it out")
            self._differing |= found

    def share_differences_of(self, other: FitProblem) -> None:
        """Let worlds differ in what those of another problem of the same target differ in."""
        self._differing = set(other._differing)

    def residuals(self, vectors: Array) -> Array:
        """(N, rows) residuals in standard deviations for (N, P) vectors; nan where the model diverges."""
        records = self.simulate(vectors)
        found = np.empty((len(vectors), self.row_count))
        for number, vector in enumerate(vectors):
            for index, name in enumerate(self.readings):
                parts = [
                    (self.predicted(vector, piece, index, records[number][piece]) - self.compared(piece, index))
                    for piece in range(len(self.pieces))
                ]
                found[number, self.groups[index]] = np.concatenate(parts) / self.noise[name]
            found[number, self.groups[-1].stop :] = [
                (vector[index] - each.prior[0]) / each.prior[1]
                for index, each in enumerate(self.unknowns)
                if each.prior is not None
            ]
        return found

    def compared(self, piece: int, reading: int) -> Array:
        """Measured values of a piece; angles without jumps."""
        values = self.pieces[piece].measured[reading].value
        return np.unwrap(values) if self.readings[reading] in ANGLES else values

    def predicted(self, vector: Array, piece: int, reading: int, record: Array) -> Array:
        """What the model says at the times of the measured values, as the sensor tells it."""
        name, config = self.readings[reading], self.config
        own = self.pieces[piece]
        times = own.segment.times(config.sample, len(record) - 1)
        values = self._placed(vector, piece, record, times)[:, reading]
        column = f"reading.{name}"
        delay = self.parameters.of_column(column, "delay", vector, config.readings[name].delay)
        if name in ANGLES:
            values = np.unwrap(values)
        told = np.interp(own.measured[reading].time - delay, times, values)
        if name in ANGLES:
            # the turns that a log has made before are not those of the model
            told += 2.0 * math.pi * np.round((self.compared(piece, reading)[0] - told[0]) / (2.0 * math.pi))
        gain = self.parameters.of_column(column, "gain", vector, 1.0)
        return np.asarray(gain * told + self.parameters.of_column(column, "bias", vector, 0.0))

    def _placed(self, vector: Array, piece: int, record: Array, times: Array) -> Array:
        """A record laid over the measured pose: moved and turned on level ground."""
        own = self.pieces[piece]
        if own.pose is None:
            return record
        pose = own.pose.copy()
        for axis in range(len(POSE)):
            if (piece, axis) in self._poses:
                pose[axis] = vector[self._poses[piece, axis]]
        columns = [self.record_names.index(name) for name in POSE]
        moved = record.copy()
        x, y, yaw = (record[:, column] for column in columns)
        yaw = np.unwrap(yaw)
        at = [float(np.interp(own.segment.begin, times, each)) for each in (x, y, yaw)]
        turn = pose[2] - at[2]
        cosine, sine = math.cos(turn), math.sin(turn)
        moved[:, columns[0]] = pose[0] + cosine * (x - at[0]) - sine * (y - at[1])
        moved[:, columns[1]] = pose[1] + sine * (x - at[0]) + cosine * (y - at[1])
        moved[:, columns[2]] = yaw + turn
        return moved

    @property
    def record_names(self) -> tuple[str, ...]:
        """Readings that a simulation records: those of the fit, and the pose where one of them depends on it."""
        if not any(name in self.readings for name in POSE):
            return self.readings
        return (*self.readings, *(name for name in POSE if name not in self.readings))

    def simulate(self, vectors: Array) -> list[list[Array]]:
        """Records (samples + 1, readings) of every piece for every vector."""
        keys: dict[tuple[int, bytes], int] = {}
        wanted: list[list[int]] = []
        worlds: list[tuple[int, Array]] = []
        for vector in vectors:
            row = []
            for piece in range(len(self.pieces)):
                mine = np.array([
                    value for value, each in zip(vector, self.unknowns, strict=True)
                    if each.simulated and each.segment in (-1, piece)
                ])  # fmt: skip
                key = (piece, mine.tobytes())
                if key not in keys:
                    keys[key] = len(worlds)
                    worlds.append((piece, vector))
                row.append(keys[key])
            wanted.append(row)
        records = self._run(worlds)
        return [[records[index] for index in row] for row in wanted]

    def _run(self, wanted: Sequence[tuple[int, Array]]) -> list[Array]:
        """A record of every world, in as many simulations as it takes."""
        made: dict[bytes, World | None] = {}
        worlds = [self._world(piece, vector, made) for piece, vector in wanted]
        shape = (self._samples + 1, len(self.record_names))
        records = [np.full(shape, np.nan) for _ in worlds]
        good = [index for index, world in enumerate(worlds) if world is not None]
        for first in range(0, len(good), MOST_WORLDS):
            some = good[first : first + MOST_WORLDS]
            rollout = self._rollout(len(some))
            found = rollout.run([world for index in some if (world := worlds[index]) is not None], self._samples)
            for column, index in enumerate(some):
                records[index] = found[:, column]
        self.diverged += sum(not np.isfinite(record).all() for record in records)
        return records

    def _rollout(self, worlds: int) -> Rollout:
        """A simulation of at least so many worlds: the least one that was made, or a new one."""
        fitting = [count for count in self._rollouts if count >= worlds and count <= 1.3 * worlds + 1]
        count = min(fitting, default=worlds)
        if count not in self._rollouts:
            if len(self._rollouts) > 2:
                self._rollouts.clear()
            self._rollouts[count] = self.target.rollout(count, self._differing, self.record_names, self.inputs)
        return self._rollouts[count]

    def _world(self, piece: int, vector: Array, made: dict[bytes, World | None]) -> World | None:
        """The world of a piece with the numbers of a vector; None where there can be none."""
        own = self.pieces[piece]
        start = dict(own.start)
        for name in start:
            if (piece, name) in self._starts:
                start[name] = float(vector[self._starts[piece, name]])
        head = vector[: self.parameters.document_count].tobytes()
        key = head + repr(sorted(start.items())).encode()
        if key not in made:
            try:
                numbers = self.target.numbers(self.parameters.changed(vector), start)
                made[key] = World(numbers, np.zeros((0, 0)), start)
            except ValueError:
                # beyond what can be built: it counts as diverged
                made[key] = None
        base = made[key]
        return None if base is None else dataclasses.replace(base, inputs=self._inputs_of(piece, vector))

    def _inputs_of(self, piece: int, vector: Array) -> Array:
        """(steps, inputs) of a piece with the delays, gains and biases of a vector."""
        config, segment = self.config, self.pieces[piece].segment
        times = np.asarray(segment.first + config.dt * np.arange(self._samples * config.sample_steps), float)
        found = np.zeros((len(times), len(self.inputs)))
        for index, name in enumerate(self.inputs):
            column, place = config.inputs[name], f"input.{name}"
            delay = self.parameters.of_column(place, "delay", vector, column.delay)
            values = self.runs[segment.run].inputs[name].at(times - delay, hold=column.hold)
            gain = self.parameters.of_column(place, "gain", vector, 1.0)
            found[:, index] = gain * values + self.parameters.of_column(place, "bias", vector, 0.0)
        return found
