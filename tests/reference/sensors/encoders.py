"""Reference of an encoder: positions of a shaft after every sub-step in, what a reader sees out; float64."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from tests.reference.sensors import sensor_noise
from tests.reference.sensors.sensor_clock import frames, read


@dataclasses.dataclass(frozen=True)
class Encoder:
    """One coordinate of one world; times in sub-steps of `dt` seconds."""

    reading: str
    period: int
    window: int
    lag: int
    dt: float
    ratio: float = 1.0
    step: float = 0.0

    def counted(self, shaft: float) -> int:
        """Whole steps, halves up."""
        return math.floor(shaft / self.step + 0.5)

    def stepped(self, shaft: float) -> float:
        """A position as its count tells it."""
        return self.counted(shaft) * self.step if self.step else shaft

    def series(
        self,
        position: Sequence[float],
        rate: Sequence[float],
        stages: Sequence[sensor_noise.Stage],
        keys: Sequence[int],
        channel: int,
        channels: int,
    ) -> list[float]:
        """What is read after 0, 1, 2 ... sub-steps.

        Args:
            position, rate: of the coordinate at these times.
            stages: of the noise on this channel.
            keys: random keys of the frames.
            channel: of the sensor.
            channels: how many it has.
        """
        taken = frames(self.period, self.window, self.lag, 0, len(position) - 1)
        values, before = {}, 0
        for index, frame in enumerate(taken):
            shaft = self.ratio * position[frame.complete]
            elapsed = None if index == 0 else (frame.complete - before) * self.dt
            before = frame.complete

            def noisy(value: float, key: int = keys[frame.number], elapsed: float | None = elapsed) -> float:
                for number, stage in enumerate(stages):
                    draw = sensor_noise.normals(key, number * channels + channel)[0]
                    value = stage.apply(value, elapsed, draw)
                return value

            if self.reading == "position":
                value = self.stepped(noisy(shaft))
            elif self.reading == "counts":
                value = self.counted(noisy(shaft)) - self.counted(self.ratio * position[0])
            elif index and self.window:
                begin = self.ratio * position[frame.complete - self.window]
                value = noisy((self.stepped(shaft) - self.stepped(begin)) / (self.window * self.dt))
            else:
                value = noisy(self.ratio * rate[frame.complete])
            values[frame.number] = value
        return [values[read(taken, count).number] for count in range(len(position))]
