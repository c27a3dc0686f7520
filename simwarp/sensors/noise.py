"""Sensor noise, as stages that act one after the other; any sensor of a few numbers takes a sequence of them.

    (NormalNoise(std=0.02), BoundedDrift(std=0.05, time=300.0), Quantisation(step=0.001), Saturation(upper=40.0))

Numbers are one for all channels of a sensor, or one per channel. Randomness is a function of the sensor's seed and
name, the world, its episode and the frame: worlds do not depend on one another, a restored snapshot repeats it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal, TypeAlias, cast

import numpy as np
import warp as wp

from simwarp.core.arrays import WritableArray, writable_from
from simwarp.core.constraints import Infinite, MinLen, NotNegative, Positive, Tagged
from simwarp.core.types import ModelError, formatted
from simwarp.model.model import Model
from simwarp.sensors.interface import Configuration
from simwarp.sensors.noise_kernels import (
    BIAS_WALK,
    BOUNDED_DRIFT,
    NORMAL,
    QUANTISATION,
    SATURATION,
    NoiseArrays,
)

Numbers: TypeAlias = float | Annotated[tuple[float, ...], MinLen(1)]
"""One for all channels, or one per channel."""
PositiveNumbers: TypeAlias = Positive | Annotated[tuple[Positive, ...], MinLen(1)]
NotNegativeNumbers: TypeAlias = NotNegative | Annotated[tuple[NotNegative, ...], MinLen(1)]
Bound: TypeAlias = Annotated[float, Infinite()]

LARGEST: Final = 3.0e38
"""Stands for an infinite bound in float32."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NormalNoise(Configuration):
    """Independent from frame to frame: value + N(mean, std).

    Attributes:
        std: standard deviation [unit of the sensor].
        mean: a constant bias [unit].
    """

    kind: Literal["normal"] = "normal"
    std: NotNegativeNumbers
    mean: Numbers = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class BiasWalk(Configuration):
    """A bias that walks: after a time t it has moved by N(0, rate sqrt(t)), without bound.

    Attributes:
        rate: [unit/sqrt(s)]; its Allan deviation is rate sqrt(t / 3).
        initial_std: standard deviation of the bias at the beginning of an episode (turn-on bias) [unit].
    """

    kind: Literal["bias-walk"] = "bias-walk"
    rate: NotNegativeNumbers
    initial_std: NotNegativeNumbers = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class BoundedDrift(Configuration):
    """A bias that is forgotten: a Gauss-Markov process of first order, stationary from the beginning of an episode.

    Over a time t: bias <- e^(-t/time) bias + N(0, std sqrt(1 - e^(-2 t/time))) (exact for any t).

    Attributes:
        std: standard deviation of the bias [unit].
        time: its correlation time [s].
    """

    kind: Literal["bounded-drift"] = "bounded-drift"
    std: NotNegativeNumbers
    time: PositiveNumbers


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quantisation(Configuration):
    """The nearest multiple of a step.

    Attributes:
        step: [unit].
    """

    kind: Literal["quantisation"] = "quantisation"
    step: PositiveNumbers


@dataclasses.dataclass(frozen=True, kw_only=True)
class Saturation(Configuration):
    """Values are cut off at the ends of the range.

    Attributes:
        lower, upper: ends [unit]; infinite where there is none.
    """

    kind: Literal["saturation"] = "saturation"
    lower: Bound | tuple[Bound, ...] = -math.inf
    upper: Bound | tuple[Bound, ...] = math.inf

    def check(self) -> None:
        """Checks that the ends are in order.

        Raises:
            ModelError: `lower` is not below `upper`.
        """
        lower, upper = np.atleast_1d(self.lower), np.atleast_1d(self.upper)
        fits = len({1, len(lower), len(upper)}) <= 2
        if fits and not (lower < upper).all():
            raise ModelError(
                f"Saturation: lower must be below upper, got {formatted(self.lower)} and "
                f"{formatted(self.upper)}; swap them"
            )


Noise: TypeAlias = Annotated[NormalNoise | BiasWalk | BoundedDrift | Quantisation | Saturation, Tagged("kind")]

_STAGES: Final[dict[type, tuple[int, tuple[str, ...]]]] = {
    NormalNoise: (NORMAL, ("mean", "std")),
    BiasWalk: (BIAS_WALK, ("rate", "initial_std")),
    BoundedDrift: (BOUNDED_DRIFT, ("std", "time")),
    Quantisation: (QUANTISATION, ("step",)),
    Saturation: (SATURATION, ("lower", "upper")),
}
"""Kernel code of each stage, and the names of its (one or two) numbers in order."""


class NoiseChain:
    """The stages of one group of channels on a device.

    Args:
        thing: whose noise it is, for messages: "sensor 'imu': accelerometer_noise".
        stages: in the order in which they act.
        channels: of the group.
        model: whose worlds.
        copies: rows of the parameters: 1, shared by all worlds, or W.
        first_draw: index of the first random number within a frame; groups of one sensor must not share any.

    Raises:
        ModelError: a stage is none, or has numbers for another count of channels.
    """

    def __init__(
        self, thing: str, stages: Sequence[Noise], channels: int, model: Model, *, copies: int = 1, first_draw: int = 0
    ) -> None:
        self.thing, self.channels = thing, channels
        self.stages = tuple(stages) if isinstance(stages, Sequence) else (stages,)
        values = np.zeros((len(self.stages), channels, 2), np.float32)
        for index, stage in enumerate(self.stages):
            if type(stage) not in _STAGES:
                known = ", ".join(cls.__name__ for cls in _STAGES)
                raise ModelError(
                    f"{thing}: must be a sequence of {known}, got {formatted(stage)}; construct one of them"
                )
            for column, name in enumerate(_STAGES[type(stage)][1]):
                values[index, :, column] = self._spread(stage, name)
        worlds, device = model.world_count, model.device
        self.arrays = cast(Any, NoiseArrays())
        self.arrays.kind = wp.array([_STAGES[type(stage)][0] for stage in self.stages], dtype=int, device=device)
        data = np.ascontiguousarray(np.broadcast_to(values, (copies, *values.shape)))
        self.arrays.parameter = writable_from(data, wp.float32, device)
        self.arrays.bias = wp.zeros((worlds, len(self.stages), channels), dtype=wp.float32, device=device)
        self.arrays.time = wp.zeros(worlds, dtype=wp.float64, device=device)
        self.arrays.first_draw = first_draw

    @property
    def draws(self) -> int:
        """Random numbers drawn per frame."""
        return len(self.stages) * self.channels

    @property
    def memory(self) -> dict[str, wp.array]:
        """State that a snapshot keeps."""
        kept: dict[str, wp.array] = {"noise bias": self.arrays.bias, "noise time": self.arrays.time}
        return {name: array for name, array in kept.items() if array.size}

    def parameter(self, stage: int, name: str) -> WritableArray:
        """(1 or W, channels) a number of a stage, to be written between steps: `chain.parameter(0, "std")[:] = 0.1`.

        Raises:
            ModelError: there is no such stage or number.
        """
        names = _STAGES[type(self.stages[stage])][1] if 0 <= stage < len(self.stages) else ()
        if name not in names:
            known = "; ".join(f"{k}: {', '.join(_STAGES[type(s)][1])}" for k, s in enumerate(self.stages)) or "none"
            raise ModelError(f"{self.thing}: no stage {formatted(stage)} with a number '{name}'; there are {known}")
        view: WritableArray = self.arrays.parameter[:, stage, :, names.index(name)]
        return view

    def _spread(self, stage: Noise, name: str) -> Any:
        """A number of a stage for every channel."""
        value = getattr(stage, name)
        numbers = np.clip(np.atleast_1d(np.asarray(value, np.float64)), -LARGEST, LARGEST)
        if len(numbers) not in (1, self.channels):
            raise ModelError(
                f"{self.thing}: "
                f"{name} of {type(stage).__name__} must be one number or {self.channels}, got {formatted(value)}; "
                "give one for all channels, or one per channel"
            )
        return numbers
