"""The base of sensors of a few numbers: measured and true values, noise, means over the window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

from simwarp.model.model import Model
from simwarp.sensors.clock import Field, mount_arrays
from simwarp.sensors.frame_sensor import FrameSensor
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.noise import Noise, NoiseChain


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
