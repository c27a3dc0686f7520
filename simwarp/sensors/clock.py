"""Clocks of sensors, and the frames that wait to be published."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import with_zeros, writable_from
from simwarp.core.memory import check_fits
from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError, formatted
from simwarp.model.model import Model
from simwarp.model.rules import RULES, instance_of
from simwarp.sensors.clock_kernels import (
    ClockSettings,
    ClockState,
    SampleEvents,
    advance_clock,
    begin_clock,
    publish_bytes,
    publish_words,
)
from simwarp.sensors.interface import Mount, Schedule, ScheduleSteps, body_index, checked_model
from simwarp.sensors.motion.mount_motion_kernels import MountArrays

if TYPE_CHECKING:
    from simwarp.simulation.attachments import StepContext

THREADS = 128
"""Threads that copy one world's frame on a GPU."""
MOST_BYTES = 2**31 - 1
"""Largest frame of one world [bytes]: kernels index it with 32 bits."""
MOST_WAITING = 2**20
"""Frames of a world that wait to be published."""
LONGEST_INTERVAL = 4096
"""Sub-steps between two reads up to which launches are recorded for each of them."""


class Field(NamedTuple):
    """One output of a sensor: shape of a world's part of it, and Warp dtype."""

    shape: tuple[int, ...]
    dtype: Any


def frame_bytes(field: Field) -> int:
    """Bytes of one world's frame."""
    return math.prod(int(length) for length in field.shape) * int(wp.types.type_size_in_bytes(field.dtype))


def check_frames(sensor: str, fields: Mapping[str, Field], worlds: int, device: Any) -> None:
    """Refuses frames that are too large, before they are allocated.

    Raises:
        ModelError: one world's frame cannot be addressed, or those of all worlds do not fit into memory.
    """
    for name, field in fields.items():
        if frame_bytes(field) > MOST_BYTES:
            raise ModelError(
                f"sensor '{sensor}': one world's frame must be below 2 GiB, got '{name}' of "
                f"{frame_bytes(field) / 2**30:.3g} GiB {field.shape}; take fewer pixels or beams"
            )
    needed = worlds * sum(frame_bytes(field) for field in fields.values())
    what = f"sensor '{sensor}': the frames of {worlds} worlds"
    check_fits(what, needed, device, "take fewer worlds, pixels or beams")


def stream_of(seed: int, name: str) -> int:
    """64-bit key of the random numbers of one sensor; different names give unrelated numbers.

    Raises:
        ModelError: the seed is no integer.
    """
    if not isinstance(seed, (int, np.integer)) or isinstance(seed, bool):
        raise ModelError(f"sensor '{name}': seed must be an integer, got {formatted(seed)}; pass for example 0")
    digest = hashlib.blake2b(f"{int(seed)}/{name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")


@RULES.arguments("sensor '{sensor}'")
def mount_arrays(
    sensor: str, mount: Annotated[Mount, instance_of(Mount, "write Mount(body, pose)")], model: Model, copies: int = 1
) -> MountArrays:
    """The mount as kernels read it, in `copies` rows (1, or W where worlds differ).

    Raises:
        ModelError: the model has no such body.
    """
    arrays = MountArrays()
    arrays.body = body_index(sensor, mount.body, model)
    arrays.position = writable_from(np.tile(mount.pose.position, (copies, 1)), wp.vec3d, model.device)
    arrays.rotation = writable_from(np.tile(mount.pose.rotation, (copies, 1)), wp.quatd, model.device)
    return arrays


class FrameBuffer(Readable):
    """A clock, the frames in waiting, and the one that is published. Every `FrameSensor` owns one.

    Kernels of a sensor take `frames.tick` (clock_kernels.py), work where `tick.collecting` is 1, and write row
    `tick.row[world]` of the arrays in `frames.ring` where `tick.complete` is 1. The rest is done here.

    `begin` launches the same samples: in worlds of its mask `tick.mode` is BEGIN and a whole frame is due in one launch
    (first, complete and publish are all 1, the fractions span 0 to 1).

    Args:
        sensor: its name.
        schedule: times of the measurements.
        model: whose worlds it measures.
        fields: outputs by name: shape of one world's part, dtype.
        seed: of its randomness, together with its name.
        gradual: the sensor writes rows of the ring already while it collects, not only when a frame is complete.

    Attributes:
        data: (W, ...) published frames by name of the field.
        ring: (W·slots, ...) frames in waiting; without a lag the same memory as `data`.
        timestamp: (W,) float64, the world's time when the published frame was complete [s].
        valid: (W,) bool, false in frozen worlds.
        tick: actions in this sub-step.
        clock: numbers of the clock, in sub-steps, once recorded.
        steps: the schedule in sub-steps of `dt` seconds, once recorded.
        dt: of a sub-step [s], once recorded.

    Raises:
        ModelError: `schedule` is no Schedule, or the frames are too many for the memory.
    """

    def _readable_title(self) -> str:
        return f" of sensor '{self.sensor}': {', '.join(self.data)}"

    @RULES.arguments("sensor '{sensor}'")
    def __init__(
        self, sensor: str, schedule: Annotated[Schedule, instance_of(Schedule, "write Schedule(rate=...)")],
        model: Model, fields: Mapping[str, Field], *, seed: int = 0,
        gradual: bool = False,
    ) -> None:  # fmt: skip
        checked_model(sensor, model)
        check_frames(sensor, fields, model.world_count, model.device)
        self.sensor, self.schedule, self.model = sensor, schedule, model
        self._gradual = gradual
        self._fields = dict(fields)
        self.stream = stream_of(seed, sensor)
        self.data = {
            name: wp.zeros((model.world_count, *field.shape), dtype=field.dtype, device=model.device)
            for name, field in fields.items()
        }
        self.ring: dict[str, wp.array] = {}
        self.tick = with_zeros(SampleEvents(), model.world_count, model.device)
        self._state = with_zeros(ClockState(), model.world_count, model.device)
        self.clock = ClockSettings()
        self.steps = ScheduleSteps(0, 0, 0)
        self.dt = 0.0
        self._beginning: list[Any] = []
        self._samples: list[Any] = []
        self._copies: list[Any] = []
        self._advances: dict[int, Any] = {}
        self._phases_written = False

    @property
    def timestamp(self) -> wp.array:
        """(W,) float64, the world's time when the published frame was complete [s]."""
        return self._state.timestamp

    @property
    def valid(self) -> wp.array:
        """(W,) bool, false in frozen worlds."""
        return self._state.valid

    @property
    def phase(self) -> wp.array:
        """(W,) int32 [sub-steps]; writable where the schedule's phase is "zero"."""
        self._phases_written = True  # from now on they may be any
        return self._state.phase

    @property
    def memory(self) -> dict[str, wp.array]:
        """State that a snapshot keeps, (W, ...) or (W·slots, ...), complete once recorded. Names have two words."""
        kept = {f"clock {name}": getattr(self._state, name) for name in cast(Any, ClockState).vars}
        kept |= {f"data {name}": array for name, array in self.data.items()}
        kept |= {f"ring {name}": array for name, array in self.ring.items() if array is not self.data[name]}
        return {name: array for name, array in kept.items() if array.size}

    def record(self, simulation: StepContext, dt: float, sample: Callable[[], Sequence[Any]]) -> list[Any]:
        """The launches of a sub-step: the clock, what `sample` records, and publication.

        Args:
            simulation: the sensor's Simulation.
            dt: of a sub-step [s].
            sample: returns the recorded launches that write the ring; called once `ring` has its size.
        """
        self._set_clock(simulation, dt)
        advance = self._advancing(simulation, 1)
        self._samples, self._copies = [*sample()], self._publications(simulation)
        samples = [*self._samples, *self._copies]
        begin = simulation.shares.record(
            begin_clock, inputs=[self.valid, self.clock, simulation.state.arrays], outputs=[self._state, self.tick]
        )
        self._beginning = [begin, *samples]
        return [advance, *samples]

    def check(self, simulation: StepContext, dt: float, more: int = 0) -> None:
        """Refuses a Simulation that the sensor cannot be part of; changes nothing.

        Args:
            simulation: that is being made.
            dt: of a sub-step [s].
            more: bytes that the sensor itself will take beside the frames.

        Raises:
            ModelError: the sensor was made for another model, or its frames in waiting are too many for the memory.
        """
        thing = f"sensor '{self.sensor}'"
        if simulation.model is not self.model:
            raise ModelError(f"{thing}: was made for another model than the Simulation's; use that one")
        steps = self.schedule.steps(dt)
        for what, count in (("period (1 / rate)", steps.period), ("lag", steps.lag)):
            if count > MOST_BYTES:
                raise ModelError(
                    f"{thing}: its {what} must be below 2^31 sub-steps of {dt:g} s, got {float(count):g}; shorten it"
                )
        worlds, slots = self.model.world_count, self._slots(steps)
        if slots > MOST_WAITING or worlds * slots > MOST_BYTES:
            raise ModelError(
                f"{thing}: at most {MOST_WAITING} frames may wait to be published, got {slots} with a lag of "
                f"{self.schedule.lag:g} s at {self.schedule.rate:g} Hz; shorten the lag or lower the rate"
            )
        waiting = 0 if slots == 0 else worlds * slots * sum(frame_bytes(field) for field in self._fields.values())
        what = f"{thing}: {slots} frames in waiting and the sums of {worlds} worlds"
        remedy = "shorten the lag, take fewer worlds, or make its frames smaller"
        check_fits(what, waiting + more, self.model.device, remedy)

    def _slots(self, steps: ScheduleSteps) -> int:
        """Frames of a world that may be in waiting; 0: they are written where they are published.

        A frame occupies a row from its first write to its publication, which comes after the writes of a sub-step.
        """
        if steps.lag == 0 and (steps.window == 0 or not self._gradual):
            return 0
        return (steps.lag + (steps.window if self._gradual else 0)) // steps.period + 1

    def record_interval(self, simulation: StepContext) -> ClockInterval | None:
        """Launches of the sub-steps between two reads of the data; None: those of `record` in each of them.

        For sensors whose launches do nothing outside of windows: where `tick.collecting` is 0.
        """
        length = simulation.read_every * simulation.substeps
        due = due_substeps(self.steps, length) if self.schedule.phase == "zero" else None
        if due is None or len(due.collecting) == length:
            return None
        launches: list[list[Any]] = []
        last = 0
        for substep in range(1, length + 1):
            collecting, publishing = substep in due.collecting, substep in due.publishing
            launches.append([])
            if collecting or publishing or substep == length:  # a world that is frozen turns invalid before the read
                launches[-1].append(self._advancing(simulation, substep - last))
                last = substep
            launches[-1] += self._samples if collecting else []
            launches[-1] += self._copies if publishing else []
        return ClockInterval(launches, self)

    def begin(self, simulation: StepContext, mask: wp.array) -> None:
        """Resets the worlds of the (W,) bool mask and publishes a frame of their present state."""
        simulation.read_interval.begin_some()
        self._beginning[0].use(0, mask)
        simulation.shares.run(self._beginning)

    def _advancing(self, simulation: StepContext, steps: int) -> Any:
        """Launch of the clock after so many sub-steps."""
        if steps not in self._advances:
            self._advances[steps] = simulation.shares.record(
                advance_clock, inputs=[self.clock, steps, simulation.state.arrays], outputs=[self._state, self.tick]
            )
        return self._advances[steps]

    def _set_clock(self, simulation: StepContext, dt: float) -> None:
        """Rounds the schedule to sub-steps and makes room for the frames in waiting."""
        worlds, device = self.model.world_count, self.model.device
        self.steps = steps = self.schedule.steps(dt)
        self.dt, self._advances = dt, {}
        self.clock.period, self.clock.window, self.clock.lag = steps
        self.clock.every = simulation.read_every * simulation.substeps
        self.clock.random_phase = int(self.schedule.phase == "random")
        self.clock.stream = wp.uint64(self.stream)
        direct = self._slots(steps) == 0
        slots = max(self._slots(steps), 1)
        self.clock.slots = slots
        self._state.ring_time = wp.zeros(worlds * slots, dtype=wp.float64, device=device)
        for name, field in self._fields.items():
            fresh = wp.zeros((worlds * slots, *field.shape), dtype=field.dtype, device=device) if not direct else None
            self.ring[name] = self.data[name] if fresh is None else fresh

    def _publications(self, simulation: StepContext) -> list[Any]:
        """Launches that copy frames that are due out of the ring."""
        commands = []
        for name, ring in self.ring.items():
            data = self.data[name]
            if ring is data or not data.size:
                continue
            size = data.size * wp.types.type_size_in_bytes(data.dtype) // self.model.world_count
            whole = size % 4 == 0
            count = size // 4 if whole else size
            threads = min(THREADS, count) if self.model.device.is_cuda else 1
            commands.append(
                simulation.shares.record(
                    publish_words if whole else publish_bytes, threads,
                    inputs=[threads, self.tick, _rows(ring, count, whole)], outputs=[_rows(data, count, whole)],
                )
            )  # fmt: skip
        return commands


class DueSubsteps(NamedTuple):
    """The sub-steps of a read interval, from 1 to its length, in which frames are collected and published."""

    collecting: frozenset[int]
    publishing: frozenset[int]


def due_substeps(steps: ScheduleSteps, length: int) -> DueSubsteps | None:
    """Where a clock without a phase that began at a read has work, `will_be_read` considered.

    Args:
        steps: schedule.
        length: sub-steps of a read interval; None is returned if there are too many.
    """
    if length > LONGEST_INTERVAL:
        return None
    period, window, lag = steps
    collecting: set[int] = set()
    publishing: set[int] = set()
    for frame in range(length // math.gcd(period, length)):  # then the frames lie in their intervals as before
        begin = frame * period
        published = begin + window + lag
        if -(-published // length) * length >= published + period:
            continue  # the next one replaces it before anybody reads
        first = begin + 1 if window > 0 else begin
        collecting |= {(first + k) % length or length for k in range(min(max(window, 1), length))}
        publishing.add(published % length or length)
    return DueSubsteps(frozenset(collecting), frozenset(publishing))


class ClockInterval:
    """The launches of a sensor in a read interval: `IntervalLaunches`.

    Args:
        launches: of each sub-step.
        frames: whose clock it is.
    """

    def __init__(self, launches: list[list[Any]], frames: FrameBuffer) -> None:
        self.launches = launches
        self._frames = frames
        self._shifted = False

    def in_phase(self) -> bool:
        """Whether no world has a phase: the array was not handed out to be written, and no snapshot set one."""
        return not self._frames._phases_written and not self._shifted

    def counts(self) -> npt.NDArray[np.int32]:
        """(W,) sub-steps since the clocks began. Waits for the device, and updates `in_phase`."""
        state = self._frames._state
        self._shifted = bool(state.phase.numpy().any())
        counts: npt.NDArray[np.int32] = state.count.numpy()
        return counts


def _rows(array: wp.array, count: int, whole: bool) -> wp.array:
    """The memory of an array as rows of words or bytes."""
    return wp.array(
        ptr=array.ptr, dtype=wp.int32 if whole else wp.uint8, shape=(array.shape[0], count), device=array.device,
        copy=False,
    )  # fmt: skip
