"""Bases of the sensors of this package: a name, a clock and frames that it publishes; rows of channels with noise."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import warp as wp

from simwarp.core.object_repr import array_text, plural
from simwarp.core.types import WORLD
from simwarp.model.model import Model
from simwarp.sensors.clock import ClockInterval, Field, FrameBuffer, mount_arrays
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.noise import Noise, NoiseChain
from simwarp.simulation.attachments import Sensor, StepContext


class FrameSensor(Sensor):
    """Base of sensors that publish frames on a clock. A subclass has `data` and `_sample`.

    ::

        class Thermometer(FrameSensor):
            def __init__(self, model, mount, config, *, name="thermometer", seed=0):
                super().__init__(name, config.schedule, model, {"data": Field((), wp.float32)}, seed=seed)
                self.mount = mount_arrays(name, mount, model)

            data = property(lambda self: self.frames.data["data"])

            def _sample(self, simulation):
                return [simulation.shares.record(read_temperature, inputs=[
                    self.mount, simulation.state.arrays, self.frames.tick], outputs=[self.frames.ring["data"]])]

        @wp.kernel
        def read_temperature(worlds: WorldRange, mount: MountArrays, state: StateArrays, tick: Tick,
                             ring: wp.array[float]):
            world = worlds.first + wp.tid()
            if tick.complete[world] == 1:
                ring[tick.row[world]] = 300.0 - 0.0065 * float(mount_position(world, mount, state)[2])

    Args:
        name: unique in a Simulation; part of its randomness.
        schedule: times of the measurements.
        model: whose worlds it measures.
        fields: outputs by name: shape of one world's part, dtype.
        seed: of its randomness, together with the name.
        gradual: it writes rows of the ring already while it collects, not only when a frame is complete.

    Attributes:
        frames: the clock, the frames in waiting, and the published ones.
        model: whose worlds it measures.

    Raises:
        ModelError: `schedule` is no Schedule, or the frames are too many for the memory.
    """

    only_in_windows: ClassVar[bool] = False
    """The kernels do nothing where `tick.collecting` is 0: they are launched only where a frame is due."""
    mount: Any = None

    def __init__(
        self, name: str, schedule: Schedule, model: Model, fields: Mapping[str, Field], *, seed: int = 0,
        gradual: bool = False,
    ) -> None:  # fmt: skip
        self.name, self.model = name, model
        self.frames = FrameBuffer(name, schedule, model, fields, seed=seed, gradual=gradual)

    def _readable_title(self) -> str:
        frames, model = self.frames, self.model
        mount = self.mount
        place = "" if mount is None else f" on {'WORLD' if mount.body == WORLD else repr(model.body_names[mount.body])}"
        worlds = f"{plural(model.world_count, 'world')} on {model.device}"
        return f" '{self.name}'{place}: {frames.schedule.rate:g} Hz, {worlds}"

    def _readable_rows(self) -> dict[str, str]:
        return {name: array_text(array) for name, array in self.frames.data.items()}

    @property
    def timestamp(self) -> wp.array:
        """(W,) float64, the world's time when the published frame was complete [s]."""
        return self.frames.timestamp

    @property
    def valid(self) -> wp.array:
        """(W,) bool, false in worlds that are frozen."""
        return self.frames.valid

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Clock and frames, arrays (W, ...) or (W·slots, ...) by name."""
        return self.frames.memory

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Place and axes of the mount."""
        mount = self.mount
        return {} if mount is None else {"mount_position": mount.position, "mount_rotation": mount.rotation}

    def check(self, simulation: StepContext, dt: float) -> None:
        """Refuses a Simulation with sub-steps of `dt` [s] that it cannot be part of.

        Raises:
            ModelError: see `FrameBuffer.check`.
        """
        self.frames.check(simulation, dt, self._scratch_bytes(dt))

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launches of a sub-step of `dt` [s]: clock, samples, publication."""
        return self.frames.record(simulation, dt, lambda: self._sample(simulation))

    def record_interval(self, simulation: StepContext) -> ClockInterval | None:
        """Launches where they are due, between two reads of the data; None: in every sub-step."""
        return self.frames.record_interval(simulation) if self.only_in_windows else None

    def begin(self, simulation: StepContext, mask: wp.array) -> None:
        """Resets the worlds of the (W,) bool mask and publishes a frame of their present state."""
        self.frames.begin(simulation, mask)

    @abc.abstractmethod
    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        """Recorded launches that fill `frames.ring`."""

    def _scratch_bytes(self, dt: float) -> int:
        """Bytes that it needs beside its frames, with sub-steps of `dt` [s]."""
        return 0


class VectorSensor(FrameSensor):
    """Base of sensors whose frame is a row of channels. A subclass launches its kernel in `_sample`.

    Args:
        model: whose worlds it measures.
        name: of the sensor.
        schedule: times of the measurements.
        channels: of a frame.
        noise: stages by option, each with the number of channels that it acts on; they follow one another. An attribute
            of the option's name has their `NoiseChain`.
        mount: place and axes on a body; None: it has none.
        dtype: of data and truth.
        seed: of the randomness, together with the name.
        randomised: True if every world has a row of its own in the parameters of the noise (and in the mount).
        others: further outputs by name.
    """

    def __init__(
        self, model: Model, name: str, schedule: Schedule, channels: int,
        noise: Mapping[str, tuple[Sequence[Noise], int]], *, mount: Mount | None = None, dtype: Any = wp.float32,
        seed: int = 0, randomised: bool = False, others: Mapping[str, Field] | None = None,
    ) -> None:  # fmt: skip
        fields = {"data": Field((channels,), dtype), "truth": Field((channels,), dtype), **(others or {})}
        super().__init__(name, schedule, model, fields, seed=seed)
        self.copies = model.world_count if randomised else 1
        self._sums = wp.zeros((model.world_count, channels), dtype=wp.float64, device=model.device)
        self._chains: dict[str, NoiseChain] = {}
        draws = 0
        for option, (stages, count) in noise.items():
            thing = f"sensor '{name}': {option}"
            chain = NoiseChain(thing, stages, count, model, copies=self.copies, first_draw=draws)
            self._chains[option] = chain
            setattr(self, option, chain)
            draws += chain.draws
        if mount is not None:
            self.mount = mount_arrays(name, mount, model, self.copies)

    @property
    def data(self) -> wp.array:
        """(W, channels) the published measurement."""
        return self.frames.data["data"]

    @property
    def truth(self) -> wp.array:
        """(W, channels) the same frame without noise."""
        return self.frames.data["truth"]

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a snapshot keeps."""
        kept = {**super().memory, "window sums": self._sums}
        for option, chain in self._chains.items():
            kept |= {f"{option} {name}": array for name, array in chain.memory.items()}
        return kept

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """The mount, and numbers of the noise."""
        noise = {f"{option}_parameter": chain.arrays.parameter for option, chain in self._chains.items()}
        return {**super().world_parameters, **noise}
