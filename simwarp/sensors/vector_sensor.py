"""The common part of sensors of a few numbers: frames of measured and true values, noise, means over the window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import warp as wp

from simwarp.model.model import Model
from simwarp.sensors.clock import ClockRound, Field, FrameBuffer, ReadableSensor
from simwarp.sensors.interface import Schedule, checked_model
from simwarp.sensors.noise import Noise, NoiseChain

if TYPE_CHECKING:
    from simwarp.simulation.protocols import StepContext


class VectorSensor(ReadableSensor):
    """Base of sensors whose frame is a row of channels. A subclass launches its kernel in `_sample`.

    Args:
        model: whose worlds it measures.
        name: of the sensor.
        schedule: times of the measurements.
        channels: of a frame.
        noise: stages by option, each with the number of channels that it acts on; they follow one another.
        dtype: of data and truth.
        seed: of the randomness, together with the name.
        randomised: True if every world has a row of its own in the parameters of the noise (and in the mount).
        others: further outputs by name.
    """

    only_in_windows: ClassVar[bool] = False
    """The kernel does nothing where `tick.collecting` is 0: it need not be launched there."""

    def __init__(
        self, model: Model, name: str, schedule: Schedule, channels: int,
        noise: Mapping[str, tuple[Sequence[Noise], int]], *, dtype: Any = wp.float32, seed: int = 0,
        randomised: bool = False, others: Mapping[str, Field] | None = None,
    ) -> None:  # fmt: skip
        self.name = name
        checked_model(name, model)
        fields = {"data": Field((channels,), dtype), "truth": Field((channels,), dtype), **(others or {})}
        self.frames = FrameBuffer(name, schedule, model, fields, seed=seed)
        self.copies = model.world_count if randomised else 1
        self._sums = wp.zeros((model.world_count, channels), dtype=wp.float64, device=model.device)
        self._chains: dict[str, NoiseChain] = {}
        draws = 0
        for option, (stages, count) in noise.items():
            thing = f"sensor '{name}': {option}"
            chain = NoiseChain(thing, stages, count, model, copies=self.copies, first_draw=draws)
            self._chains[option] = chain
            draws += chain.draws

    @property
    def data(self) -> wp.array:
        """(W, channels) the published measurement."""
        return self.frames.data["data"]

    @property
    def truth(self) -> wp.array:
        """(W, channels) the same frame without noise."""
        return self.frames.data["truth"]

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
        """State that a snapshot keeps."""
        kept = {**self.frames.memory, "window sums": self._sums}
        for option, chain in self._chains.items():
            kept |= {f"{option} {name}": array for name, array in chain.memory.items()}
        return kept

    def check(self, simulation: StepContext, dt: float) -> None:
        """Refuses a Simulation that it cannot be part of."""
        self.frames.check(simulation, dt)

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Launches of one sub-step."""
        return self.frames.record(simulation, dt, lambda: self._sample(simulation))

    def between_looks(self, simulation: StepContext) -> ClockRound | None:
        """Launches where they are due, between two looks at the data; None: in every sub-step."""
        return self.frames.between_looks(simulation) if self.only_in_windows else None

    def begin(self, simulation: StepContext, mask: wp.array) -> None:
        """Resets the worlds of the mask and publishes a frame of their present state."""
        self.frames.begin(simulation, mask)

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        """Recorded launches that fill `frames.ring`."""
        raise NotImplementedError
